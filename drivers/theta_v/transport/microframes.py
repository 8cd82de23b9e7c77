"""What the packets of isochronous transfers do not say themselves: where nothing came, and when nobody listened."""

from __future__ import annotations

import logging

from drivers.theta_v.codec.payload import Packet
from drivers.theta_v.transport.base import MICROFRAME_NS

NOTHING: Packet = (0, b"")

WARN_EVERY_NS = 10_000_000_000  # one that is held up is held up often, and need not be told each time

RECOVERY = 64  # part of a transfer by which the estimate may catch up with each: far more than clocks drift


log = logging.getLogger(__name__)


class Pauses:
    """Fed the transfers of one stream in order, puts one empty packet wherever microframes were empty."""

    def __init__(self) -> None:
        self._empty = False

    def marked(self, slots: list[int], packets: list[Packet], count: int) -> list[Packet]:
        """The packets of a transfer of `count` microframes, `slots` their numbers; none of them is empty and good."""
        if not packets:
            self._empty = self._empty or count > 0
            return []
        found: list[Packet] = [NOTHING] if self._empty or slots[0] else []
        self._empty = slots[-1] < count - 1
        if slots[-1] - slots[0] == len(slots) - 1:
            return found + packets
        before = slots[0]
        for slot, packet in zip(slots, packets, strict=True):
            if slot > before + 1:
                found.append(NOTHING)
            found.append(packet)
            before = slot
        return found


class Listening:
    """Whether transfers were in flight all the time.

    A process that is held up longer than its transfers last leaves the camera without a listener. What it sends
    then is lost, and no status tells of it: only the time shows. Kept is an estimate of when the last transfer
    in flight ends.
    """

    def __init__(self, transfers: int, packets: int) -> None:
        self._transfer_ns = packets * MICROFRAME_NS
        self._queue_ns = transfers * self._transfer_ns
        self._until_ns: int | None = None
        self._now_ns = self._silent_until_ns = 0

    def gap(self, now_ns: int) -> int:
        """Nanoseconds for which nobody listened before the transfer that is submitted again at `now_ns`.

        To be asked once for each. The transfers that were in flight meanwhile are whole.
        """
        until_ns = now_ns + self._queue_ns if self._until_ns is None else self._until_ns
        gap_ns = max(0, now_ns - until_ns)
        until_ns = max(until_ns, now_ns) + self._transfer_ns
        self._until_ns = min(until_ns + self._transfer_ns // RECOVERY, now_ns + self._queue_ns)
        self._now_ns = now_ns
        return gap_ns

    def warn(self) -> None:
        """Tell people, now and then, that pictures were lost because nobody listened."""
        if self._now_ns >= self._silent_until_ns:
            self._silent_until_ns = self._now_ns + WARN_EVERY_NS
            log.warning("this computer was held up, and for a moment nobody listened to the camera")
