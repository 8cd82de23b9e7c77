"""Isochronous requests of one endpoint at a USB/IP server: when each is due, and what it is answered."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from drivers.theta_v.codec import usbip
from drivers.theta_v.transport.base import MICROFRAME_NS

MAX_BEHIND_NS = 1_000_000_000  # after a longer pause of the process the missed microframes are not made up
LULL_NS = 16_000_000  # empty requests are answered in groups: a wake-up costs more than a request


@dataclass(slots=True)
class Schedule:
    """Requests in order, and when the microframes of the next one begin."""

    waiting: deque[tuple[usbip.Submit, bytes]] = field(default_factory=deque)
    start_ns: int = 0
    accepted: tuple[int, bytes] = (0, b"")
    """Length and descriptors of the last good request: a host sends the same again and again."""

    def add(self, submit: usbip.Submit, descriptors: bytes, now_ns: int) -> bool:
        """Take a request in; False when it makes no sense."""
        if not submit.inward or not submit.packets or not self._accepts(submit.length, descriptors):
            return False
        if not self.waiting:
            self.start_ns = max(self.start_ns, now_ns)
        self.waiting.append((submit, descriptors))
        return True

    def due_ns(self, *, idle: bool = False) -> int | None:
        """When the next request must be answered; later if the camera has nothing to send."""
        if not self.waiting:
            return None
        packets = self.waiting[0][0].packets
        slack_ns = min(LULL_NS, len(self.waiting) * packets * MICROFRAME_NS // 2) if idle else 0
        return self.start_ns + packets * MICROFRAME_NS + slack_ns

    def next_due(self, now_ns: int) -> tuple[usbip.Submit, bytes, int] | None:
        """The request whose microframes have passed, and when they began; None while there is none."""
        if self.waiting and now_ns - self.start_ns > MAX_BEHIND_NS:
            self.start_ns = now_ns
        due_ns = self.due_ns()
        if due_ns is None or due_ns > now_ns:
            return None
        submit, descriptors = self.waiting.popleft()
        start_ns, self.start_ns = self.start_ns, due_ns
        return submit, descriptors, start_ns

    def _accepts(self, length: int, descriptors: bytes) -> bool:
        """Whether all packets lie within the transfer."""
        if (length, descriptors) == self.accepted:
            return True
        table = usbip.iso_table(descriptors)
        if int((table[:, 0].astype(np.int64) + table[:, 1]).max()) > length:
            return False
        self.accepted = (length, descriptors)
        return True


def answered(submit: usbip.Submit, descriptors: bytes, packets: list[tuple[int, int, bytes]]) -> bytes:
    """RET_SUBMIT with the packets packed one behind the other, as the kernel's stub sends them."""
    table = np.frombuffer(descriptors, ">u4").reshape(-1, 4).copy()
    table[:, 2:] = 0
    pieces = [data for _, _, data in packets]
    errors = 0
    if packets:
        slots = [slot for slot, _, _ in packets]
        statuses = [status for _, status, _ in packets]
        for i, room in enumerate(table[slots, 1].tolist()):
            # A packet longer than the host made room for is cut and said to overflow, as a host controller does.
            if len(pieces[i]) > room:
                pieces[i], statuses[i] = pieces[i][:room], -usbip.EOVERFLOW
        table[slots, 2] = [len(piece) for piece in pieces]
        table[slots, 3] = [status & 0xFFFFFFFF for status in statuses]
        errors = sum(status != 0 for status in statuses)
    body = b"".join(pieces)
    head = usbip.Return(submit.sequence, 0, len(body), submit.packets, errors, submit.start_frame)
    return b"".join((head.encode(), body, table.tobytes()))
