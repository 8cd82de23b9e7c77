"""The collecting thread's side: packets in, access units out to everyone who wants them."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial

from drivers.theta_v.codec.access_units import AccessUnit, AccessUnitTracker
from drivers.theta_v.codec.h264 import opens_stream
from drivers.theta_v.codec.payload import Assembler, Packet
from drivers.theta_v.device.mailbox import Mailbox
from drivers.theta_v.device.stats import Meter
from drivers.theta_v.errors import ThetaError
from drivers.theta_v.transport.base import PacketSink

AccessUnitHook = Callable[[AccessUnit], None]

log = logging.getLogger(__name__)


class Collector:
    """Lives as long as the driver; one stream after the other goes through it.

    `packets` runs in the transport's thread and nothing else does while a stream runs. It assembles,
    counts and passes on; whatever takes longer is the reader's business.
    """

    def __init__(self, hook: AccessUnitHook | None, packet_hook: PacketSink | None = None) -> None:
        self.meter = Meter()
        self.hook_failures = 0
        """Times the recorder's hook raised; the stream goes on without it."""
        self.last_end_ns: int | None = None
        """When the newest unit ended, whatever was in it: the camera's sign of life."""
        self.thirsty_since_ns: int | None = None
        """Since when pictures come, but somebody waits for a key picture: the stream is tainted, or a reader joins."""
        self._hook, self._packet_hook = hook, packet_hook
        self._assembler = Assembler(opens=opens_stream)
        self._tracker = AccessUnitTracker()
        self._mailboxes: tuple[Mailbox, ...] = ()
        self._dropped_before = 0

    @property
    def lost(self) -> int:
        return self._tracker.lost

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the running stream; zeros before its first picture."""
        sps = self._tracker.sps
        return (sps.width, sps.height) if sps is not None else (0, 0)

    @property
    def dropped(self) -> int:
        return self._dropped_before + sum(m.dropped for m in self._mailboxes)

    def restart(self, framing: int) -> None:
        """A new stream begins, with the bmFramingInfo agreed; only while none is running."""
        self._assembler = Assembler(opens=opens_stream, framing=framing)
        self._tracker.restart()

    def subscribe(self, mailbox: Mailbox) -> None:
        self._mailboxes = (*self._mailboxes, mailbox)

    def unsubscribe(self, mailbox: Mailbox) -> None:
        self._mailboxes = tuple(m for m in self._mailboxes if m is not mailbox)
        self._dropped_before += mailbox.dropped

    def close(self, error: ThetaError | None = None) -> None:
        """End all subscriptions."""
        for mailbox in self._mailboxes:
            mailbox.close(error)

    def packets(self, stamp_ns: int, packets: list[Packet]) -> None:
        """Sink of the transport."""
        if self._packet_hook is not None:
            self._tell(partial(self._packet_hook, stamp_ns, packets))
        for unit in self._assembler.feed(stamp_ns, packets):
            self.last_end_ns = stamp_ns
            access_unit = self._tracker.feed(unit)
            if access_unit is not None:
                self._publish(access_unit)

    def _publish(self, unit: AccessUnit) -> None:
        self.meter.count(unit)
        if self._hook is not None:
            self._tell(partial(self._hook, unit))
        for mailbox in self._mailboxes:
            try:
                mailbox.put(unit)
            except RuntimeError:
                log.debug("a picture came after the event loop had ended")
        if not unit.tainted and not any(mailbox.thirsty for mailbox in self._mailboxes):
            self.thirsty_since_ns = None
        elif self.thirsty_since_ns is None:
            self.thirsty_since_ns = unit.stamp_ns

    def _tell(self, hook: Callable[[], None]) -> None:
        """A recorder that fails, whatever its reason, must not stop the pictures."""
        try:
            hook()
        except Exception:
            self.hook_failures += 1
            log.exception("a hook for what the camera sends failed")
