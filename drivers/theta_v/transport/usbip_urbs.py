"""Requests in flight to a USB/IP server: what was asked, what an answer means, what to ask next. No I/O."""

from __future__ import annotations

import itertools
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drivers.theta_v.codec import usbip
from drivers.theta_v.codec.payload import RAN_DRY, Packet
from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaMalformed, ThetaStall
from drivers.theta_v.transport.base import PacketSink
from drivers.theta_v.transport.microframes import Listening, Pauses

MAX_URB_ERRORS = 32  # in a row: the endpoint is dead, do not resubmit for ever

Settle = Callable[[bytes | ThetaError], None]
"""Told how a request ended; called in the connection's thread."""


@dataclass(frozen=True, slots=True)
class Pending:
    """One request on its way. Without `settle` it is video, or nobody waits for it any more."""

    inward: bool
    length: int
    packets: int
    video: bool
    settle: Settle | None
    what: str


@dataclass(slots=True)
class Video:
    """The running stream: what is asked for again and again, and who gets what comes."""

    endpoint: int
    packet_bytes: int
    packets: int
    """Per request; 0 for a bulk endpoint."""
    sink: PacketSink
    errors: int = 0
    listening: Listening | None = None
    pauses: Pauses = field(default_factory=Pauses)
    after_gap: set[int] = field(default_factory=set)
    """Requests that were made too late: what came before they began is lost."""

    @property
    def length(self) -> int:
        return max(self.packets, 1) * self.packet_bytes


class Urbs:
    """Thread-safe: asked from the event loop, fed answers by the connection's thread."""

    def __init__(self, devid: int, server: str) -> None:
        self._devid, self._server = devid, server
        self._sequence = itertools.count(1)
        self._lock = threading.Lock()
        self._pending: dict[int, Pending] = {}
        self._unlinking: dict[int, int] = {}
        self._video: Video | None = None
        self._iso_request = b""

    def ask(
        self, endpoint: int, inward: bool, data: bytes, length: int, setup: bytes, what: str, settle: Settle
    ) -> tuple[int, bytes]:
        """A control, bulk or interrupt request: its number and the message to send."""
        with self._lock:
            sequence = next(self._sequence)
            self._pending[sequence] = Pending(inward, length, 0, False, settle, what)
        head = usbip.Submit(sequence, self._devid, inward, endpoint & 0x0F, length, 0, setup=setup)
        return sequence, head.encode() + data

    def give_up(self, sequence: int) -> bytes:
        """The message that cancels a request, or nothing if it has ended."""
        with self._lock:
            return self._unlink(sequence) if sequence in self._pending else b""

    def start_video(self, video: Video, count: int) -> bytes:
        """The messages that keep `count` requests in flight. Raises RuntimeError while another stream runs."""
        with self._lock:
            if self._video is not None:
                raise RuntimeError("video is running already")
            self._video = video
            if video.packets:
                video.listening = Listening(count, video.packets)
                self._iso_request = usbip.iso_request(video.packets, video.packet_bytes)
            else:
                self._iso_request = b""
            return b"".join(self._ask_video(video) for _ in range(count))

    def stop_video(self) -> tuple[list[int], bytes]:
        """Numbers of the requests to be reaped, and the messages that cancel them."""
        with self._lock:
            self._video = None
            victims = [sequence for sequence, pending in self._pending.items() if pending.video]
            return victims, b"".join(self._unlink(victim) for victim in victims)

    def reaped(self, victims: list[int]) -> bool:
        with self._lock:
            return not any(victim in self._pending for victim in victims)

    def fail_all(self, reason: str) -> None:
        """The connection is no more."""
        with self._lock:
            waiting = [pending.settle for pending in self._pending.values()]
            self._pending.clear()
            self._unlinking.clear()
            self._video = None
        for settle in waiting:
            if settle is not None:
                settle(ThetaGone(reason))

    def answers(self, data: memoryview, now_ns: int) -> tuple[int, bytes]:
        """Deal with all whole answers in `data`: how many bytes they took, and what to send in return.

        Raises ThetaMalformed for a server that lies, ThetaGone when the camera left.
        """
        at = 0
        again: list[bytes] = []
        packets: list[Packet] = []
        video = self._video
        while len(data) - at >= usbip.HEADER_BYTES:
            kind = int.from_bytes(data[at : at + 4], "big")
            if kind == usbip.RET_UNLINK:
                self._unlinked(bytes(data[at : at + usbip.HEADER_BYTES]))
                at += usbip.HEADER_BYTES
                continue
            if kind != usbip.RET_SUBMIT:
                raise ThetaMalformed(f"the {self._server} sends something that is not USB/IP")
            answer = usbip.Return.decode(bytes(data[at : at + usbip.HEADER_BYTES]))
            pending = self._pending.get(answer.sequence)
            if pending is None:
                raise ThetaMalformed(f"the {self._server} answers a question nobody asked")
            if answer.length > pending.length or answer.packets != pending.packets:
                raise ThetaMalformed(f"the {self._server} answers {answer.length} bytes to {pending.what}")
            body = answer.length if pending.inward else 0
            end = at + usbip.HEADER_BYTES + body + 16 * answer.packets
            if end > len(data):
                break
            with self._lock:
                del self._pending[answer.sequence]
                if pending.video and self._video is not None:
                    again.append(self._ask_video(self._video, now_ns))
            payload = data[at + usbip.HEADER_BYTES : end]
            if pending.settle is not None:
                pending.settle(_outcome(pending, answer.status, bytes(payload)))
            elif pending.video and video is not None:
                packets += self._arrived(video, answer, payload, body)
            at = end
        if packets and video is not None and video is self._video:
            video.sink(now_ns, packets)
        return at, b"".join(again)

    def _arrived(self, video: Video, answer: usbip.Return, payload: memoryview, body: int) -> list[Packet]:
        if answer.status == -usbip.ENODEV:
            raise ThetaGone("the camera left the bus: unplugged, switched off or changing its mode")
        video.errors = video.errors + 1 if answer.status else 0
        if video.errors > MAX_URB_ERRORS:
            raise ThetaGone("the camera's video endpoint is dead; unplug and replug the camera")
        if not video.packets:
            return [(answer.status, payload)] if answer.status or body else []
        table = np.frombuffer(payload[body:], ">u4").reshape(-1, 4)
        lengths = table[:, 2]
        if int(lengths.sum()) != body or int(lengths.max()) > video.packet_bytes:
            raise ThetaMalformed(f"the {self._server} sends packets that do not add up")
        found = np.flatnonzero(lengths | table[:, 3])
        carried: list[Packet] = []
        at = 0
        for size, status in table[found, 2:4].astype(np.int32).tolist():
            carried.append((status, payload[at : at + size]))
            at += size
        packets = video.pauses.marked(found.tolist(), carried, video.packets)
        if answer.sequence in video.after_gap:
            video.after_gap.discard(answer.sequence)
            packets.insert(0, (RAN_DRY, b""))
        return packets

    def _ask_video(self, video: Video, now_ns: int | None = None) -> bytes:
        """`now_ns` when a request is made because another ended."""
        sequence = next(self._sequence)
        if now_ns is not None and video.listening is not None and video.listening.gap(now_ns):
            video.after_gap.add(sequence)
            video.listening.warn()
        self._pending[sequence] = Pending(True, video.length, video.packets, True, None, "video")
        endpoint = video.endpoint & 0x0F
        head = usbip.Submit(sequence, self._devid, True, endpoint, video.length, video.packets, interval=1)
        return head.encode() + self._iso_request

    def _unlink(self, victim: int) -> bytes:
        sequence = next(self._sequence)
        self._unlinking[sequence] = victim
        pending = self._pending[victim]
        self._pending[victim] = Pending(
            pending.inward, pending.length, pending.packets, pending.video, None, pending.what
        )
        return usbip.unlink(sequence, self._devid, victim)

    def _unlinked(self, raw: bytes) -> None:
        sequence, status = struct.unpack_from(">I12xi", raw, 4)
        victim = self._unlinking.pop(sequence, None)
        if victim is None:
            raise ThetaMalformed(f"the {self._server} cancels something nobody asked to cancel")
        if status:
            with self._lock:
                self._pending.pop(victim, None)


def _outcome(pending: Pending, status: int, data: bytes) -> bytes | ThetaError:
    if status == -usbip.EPIPE:
        return ThetaStall(f"the camera refuses {pending.what}")
    if status == -usbip.ENODEV:
        return ThetaGone("the camera left the bus")
    if status:
        return ThetaGone(f"USB error {-status} during {pending.what}")
    return data
