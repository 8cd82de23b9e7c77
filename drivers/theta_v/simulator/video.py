"""The camera's VideoStreaming interface: negotiation, alternate settings, pictures into microframes."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from drivers.theta_v.codec.probe import (
    BLOCK_BYTES,
    SET_CUR,
    VS_COMMIT,
    VS_PROBE,
    Probe,
)
from drivers.theta_v.errors import ThetaMalformed, ThetaStall
from drivers.theta_v.simulator.faults import Cure, FaultPlan, Stall, spoil
from drivers.theta_v.simulator.packetiser import PACKET_BYTES, packetise
from drivers.theta_v.transport.base import MICROFRAME_NS

MAX_WAITING = 4  # pictures the encoder keeps before it drops: the gadget driver's own number of buffers
BULK_PAYLOAD_BYTES = 16 << 10  # of gadgets seen elsewhere; a THETA with bulk video was never seen
MAX_PICTURE_BYTES = 8 << 20

INTERVAL_100NS = 333_667
SIZES = {1: (3840, 1920), 2: (1920, 960)}

WRONG_STATE, OUT_OF_RANGE, UNKNOWN_CONTROL, UNKNOWN_REQUEST = 2, 4, 6, 7


@dataclass(frozen=True, slots=True)
class Demand:
    """What the host wants pictures of."""

    width: int
    height: int
    interval_s: float


@dataclass(frozen=True, slots=True)
class Burst:
    """Packets of `count` consecutive microframes: (microframe, status, bytes), empty ones left out."""

    count: int
    packets: list[tuple[int, int, bytes]]


class ProtocolStall(ThetaStall):
    """The camera answers STALL; `code` is what it then says when asked why (UVC 1.5 section 4.2.1.2)."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


class VideoStreaming:
    """Not thread-safe; the camera model holds the lock."""

    def __init__(self, plan: FaultPlan, probe_bytes: int, *, bulk: bool = False) -> None:
        if probe_bytes not in BLOCK_BYTES:
            raise ValueError("a probe block has 26, 34 or 48 bytes")
        self.overruns = 0
        """Pictures dropped because the host did not fetch the ones before."""
        self.sent = 0
        self.wants_keyframe = False
        self._plan = plan
        self._bulk = bulk
        self._payload_bytes = BULK_PAYLOAD_BYTES if bulk else PACKET_BYTES
        self._probe_bytes = probe_bytes
        self._rng = np.random.default_rng(plan.seed)
        self._stalls = sorted((e for e in plan.events if isinstance(e, Stall)), key=lambda s: s.at_s)
        self._first_picture_ns: int | None = None
        self._stalled: Cure | None = None
        self._default = Probe(
            format_index=1,
            frame_index=1,
            interval_100ns=INTERVAL_100NS,
            max_frame_bytes=0x00800000,
            max_payload_bytes=self._payload_bytes,
            clock_hz=1000,
            framing=0x03,
            min_version=1,
            max_version=1,
        )
        self.reset()

    def reset(self) -> None:
        """Bus reset: nothing negotiated, alternate setting 0."""
        self.cure(Cure.RESET)
        self._probe = self._default
        self._committed: Probe | None = None
        self.alternate = 0
        self._stop()

    @property
    def demand(self) -> Demand | None:
        """What is being streamed, or None: nothing before commit and, where it is isochronous, alternate setting 1."""
        if self._committed is None or (self.alternate != 1 and not self._bulk):
            return None
        width, height = SIZES[self._committed.frame_index]
        return Demand(width, height, self._committed.interval_100ns / 1e7)

    def set_alternate(self, alternate: int) -> None:
        if alternate not in (0, 1):
            raise ProtocolStall(OUT_OF_RANGE, f"the video interface has no alternate setting {alternate}")
        self._stop()
        self.alternate = alternate
        if self._bulk:
            self._committed = None  # with one alternate setting, to select it again is to stop
        if self.demand is not None:
            self.cure(Cure.RESTART)
            self.wants_keyframe = True

    @property
    def idle(self) -> bool:
        """Whether the microframes to come are empty until the next picture is offered."""
        return not self._packets and not self._waiting

    def control(self, request: int, selector: int, length: int, data: bytes) -> bytes:
        """A class request to the interface. Raises ProtocolStall."""
        if selector not in (VS_PROBE, VS_COMMIT):
            raise ProtocolStall(UNKNOWN_CONTROL, f"unknown video control {selector:#06x}")
        if request == SET_CUR:
            self._set(selector, data)
            return b""
        match request:
            case 0x85:
                return self._probe_bytes.to_bytes(2, "little")[:length]
            case 0x86:
                return b"\x03"[:length]
            case 0x81:
                block = self._probe if selector == VS_PROBE else self._committed or Probe()
            case 0x82 | 0x87 if selector == VS_PROBE:
                block = self._default
            case 0x83 if selector == VS_PROBE:
                block = replace(self._default, frame_index=max(SIZES))
            case _:
                raise ProtocolStall(UNKNOWN_REQUEST, f"unknown video request {request:#04x}")
        return block.encode(self._probe_bytes)[:length]

    def offer(self, unit: bytes, now_ns: int, keyframe: bool) -> bool:
        """Queue one picture that is ready now. False when nobody watches or too many wait."""
        if self.demand is None or not unit or len(unit) > MAX_PICTURE_BYTES:
            return False
        if self._first_picture_ns is None:
            self._first_picture_ns = now_ns
        if self._stalls and now_ns - self._first_picture_ns >= self._stalls[0].at_s * 1e9:
            self.stall(self._stalls.pop(0).cure)
        if self._stalled is not None:
            return False
        if len(self._waiting) >= MAX_WAITING:
            self.overruns += 1
            self.wants_keyframe = True
            return False
        if keyframe:
            self.wants_keyframe = False
        self._waiting.append((now_ns, unit))
        return True

    def take(self, count: int, start_ns: int) -> Burst:
        """What `count` microframes from `start_ns` on carry. A picture begins when it was offered."""
        out: list[tuple[int, int, bytes]] = []
        slot = 0
        while slot < count and self._stalled is None:
            if not self._packets:
                if not self._waiting:
                    break
                ready_ns, unit = self._waiting[0]
                slot = max(slot, -((start_ns - ready_ns) // MICROFRAME_NS))
                if slot >= count:
                    break
                self._waiting.popleft()
                self._begin(unit)
                continue
            for _ in range(min(count - slot, len(self._packets))):
                packet = self._packets.popleft()
                if packet is not None:
                    out.append((slot, *packet))
                slot += 1
        return Burst(count, out)

    def payload(self, length: int) -> bytes | None:
        """One bulk transfer's worth of video, or None while there is none; a payload too long for it is cut."""
        while self._stalled is None:
            if not self._packets:
                if not self._waiting:
                    break
                self._begin(self._waiting.popleft()[1])
            packet = self._packets.popleft() if self._packets else None
            if packet is not None and not packet[0]:
                return packet[1][:length]
        return None

    def _begin(self, unit: bytes) -> None:
        packets = packetise(unit, self._fid, packet_bytes=self._payload_bytes)
        self._fid ^= 1
        self.sent += 1
        if self._plan.has_rates:
            self._packets.extend(spoil(packets, self._plan, self._rng))
        else:
            self._packets.extend((0, p) for p in packets)

    def _stop(self) -> None:
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._packets: deque[tuple[int, bytes] | None] = deque()
        self._fid = 0
        self.wants_keyframe = False

    def stall(self, cure: Cure) -> None:
        """The encoder stops, and what it had ready goes nowhere."""
        self._stalled = cure

    def cure(self, means: Cure) -> None:
        """Something was done that may have brought a stalled encoder back."""
        if self._stalled is not None and means >= self._stalled:
            self._stalled = None

    def _set(self, selector: int, data: bytes) -> None:
        if self.alternate != 0:
            raise ProtocolStall(WRONG_STATE, "negotiation while streaming")
        try:
            block = Probe.decode(data)
        except ThetaMalformed as error:
            raise ProtocolStall(OUT_OF_RANGE, str(error)) from None
        if len(data) not in BLOCK_BYTES:
            raise ProtocolStall(OUT_OF_RANGE, f"probe block of {len(data)} bytes")
        if selector == VS_PROBE:
            # A probe is corrected to what the camera can do, as the gadget's daemon does.
            self._probe = replace(
                self._default, hint=block.hint, frame_index=min(max(block.frame_index, 1), max(SIZES))
            )
            return
        wanted = (block.format_index, block.frame_index, block.interval_100ns)
        if wanted != (self._probe.format_index, self._probe.frame_index, self._probe.interval_100ns):
            raise ProtocolStall(OUT_OF_RANGE, "commit of something that was not negotiated")
        self._committed = self._probe
        self.cure(Cure.NEGOTIATE)
        self.wants_keyframe = self.wants_keyframe or self._bulk
