"""The simulated camera: on or off the bus, in MTP or live mode, one control endpoint and four others.

Pictures come from outside (`offer`); whoever plays the host takes a `Port` and talks to that. Time comes
from the caller's clock, so tests can bring their own.
"""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from drivers.theta_v.codec import h264
from drivers.theta_v.codec.ptp import CaptureMode, Property
from drivers.theta_v.errors import ThetaGone, ThetaNotFound, ThetaStall
from drivers.theta_v.simulator import descriptors as d
from drivers.theta_v.simulator.faults import Cure, FaultPlan, Overheat, PowerCycle, Unplug
from drivers.theta_v.simulator.ptp import PtpResponder
from drivers.theta_v.simulator.video import Burst, Demand, ProtocolStall, VideoStreaming

REPLY_S = 0.05  # what the host gets to fetch the answer before the device leaves the bus
REENUMERATION_S = 0.5  # unknown for the V; of a phone of its age, one to three seconds

BOARD_HOT, BOARD_TOO_HOT = 0x00100000, 0x80000000  # ErrorInfo (fact sheet 4.3)

DEVICE_TYPE, CONFIGURATION_TYPE, STRING_TYPE, QUALIFIER_TYPE = 1, 2, 3, 6
CT_AE_MODE, CT_AE_PRIORITY = 0x0200, 0x0300
ERROR_CODE = 0x0200


class Composition(Enum):
    """Which of its two USB faces the camera shows."""

    MTP = "mtp"
    LIVE = "live"


@dataclass(frozen=True, slots=True)
class Setup:
    """The eight bytes every control transfer begins with."""

    request_type: int
    request: int
    value: int
    index: int
    length: int

    @classmethod
    def decode(cls, raw: bytes) -> Setup:
        return cls(*struct.unpack("<BBHHH", raw))


class SimulatedThetaV:
    """One camera. Thread-safe: `offer` may come from any thread, ports are used from others.

    `lock`, `video`, `generation`, `held` and `talked` are for `Port` alone.
    """

    def __init__(
        self,
        serial: str = "00105377",
        *,
        composition: Composition = Composition.LIVE,
        plan: FaultPlan | None = None,
        firmware: str = "3.50.1",
        asleep: bool = False,
        probe_bytes: int = 48,
        bulk_video: bool = False,
        reenumeration_s: float = REENUMERATION_S,
        reply_s: float = REPLY_S,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.serial = serial
        self.clock = clock
        self._firmware = firmware
        self._plan = plan or FaultPlan()
        self._reenumeration_ns, self._reply_ns = round(reenumeration_s * 1e9), round(reply_s * 1e9)
        self._talked_ns = clock()
        self.lock = threading.RLock()
        self.bulk_video = bulk_video
        self.video = VideoStreaming(self._plan, probe_bytes, bulk=bulk_video)
        self._composition = composition
        self._present = True
        self.generation = 0
        self._agenda: list[tuple[int, Callable[[int], None]]] = []
        self.held = False
        self._listeners: tuple[Callable[[], None], ...] = ()
        self._ptp = self._responder(asleep=asleep)
        started = clock()
        for event in self._plan.events:
            if isinstance(event, Unplug | PowerCycle):
                self._plan_absence(started + round(event.at_s * 1e9), event)
            elif isinstance(event, Overheat):
                self._plan_heat(started, event)

    @property
    def present(self) -> bool:
        """Whether it is on the bus now."""
        self._advance()
        return self._present

    @property
    def composition(self) -> Composition:
        return self._composition

    @property
    def demand(self) -> Demand | None:
        """The pictures the host wants now, or None while it wants none: then `offer` throws them away."""
        self._advance()
        with self.lock:
            return self.video.demand if self._present and not self._ptp.asleep else None

    @property
    def wants_keyframe(self) -> bool:
        """True when only a key picture helps the host: at the start of a stream and after an overrun."""
        with self.lock:
            return self.video.wants_keyframe

    @property
    def overruns(self) -> int:
        """Offered pictures the host was too slow to fetch."""
        return self.video.overruns

    @property
    def sent(self) -> int:
        return self.video.sent

    @property
    def ptp(self) -> PtpResponder:
        return self._ptp

    @property
    def device_descriptor(self) -> bytes:
        return d.LIVE_DEVICE if self._composition is Composition.LIVE else d.MTP_DEVICE

    @property
    def configuration(self) -> bytes:
        if self._composition is not Composition.LIVE:
            return d.MTP_CONFIGURATION
        return d.with_bulk_video(d.LIVE_CONFIGURATION) if self.bulk_video else d.LIVE_CONFIGURATION

    def offer(self, access_unit: bytes, keyframe: bool | None = None) -> bool:
        """One H.264 access unit (Annex B, SPS and PPS in key pictures) is ready. False if it was dropped.

        Whoever knows whether it is a key picture spares the camera the look into it.
        """
        self._advance()
        with self.lock:
            if keyframe is None:
                keyframe = any(n.kind == h264.IDR for n in h264.split(access_unit))
            awake = self._present and not self._ptp.asleep
            taken = awake and self.video.offer(access_unit, self.clock(), keyframe)
        if taken:
            for listener in self._listeners:
                listener()
        return taken

    def listen(self, listener: Callable[[], None]) -> None:
        """Have `listener` called, in the offering thread, whenever a picture was taken."""
        self._listeners = (*self._listeners, listener)

    def unlisten(self, listener: Callable[[], None]) -> None:
        self._listeners = tuple(x for x in self._listeners if x != listener)

    def unplug(self) -> None:
        """Pull the cable now."""
        with self.lock:
            self._detach()

    def replug(self) -> None:
        with self.lock:
            self._attach()

    def connect(self) -> Port:
        """Take the camera as its only host: a bus reset. Raises ThetaNotFound or ThetaStall (held)."""
        self._advance()
        with self.lock:
            if not self._present:
                raise ThetaNotFound("the simulated camera is not on the bus")
            if self.held:
                raise ThetaStall("another host holds the simulated camera")
            self.held = True
            self.talked()
            self.video.reset()
            self._ptp.reset()
            return Port(self, self.generation)

    def _responder(self, *, asleep: bool) -> PtpResponder:
        mode = CaptureMode.LIVE if self._composition is Composition.LIVE else CaptureMode.STILL
        return PtpResponder(
            self.serial, self._firmware, mode, self._change_mode, self._power_down, asleep=asleep,
            first_session=self._plan.first_session,
        )  # fmt: skip

    def talked(self) -> None:
        """The host said something on PTP: that puts sleep off."""
        self._talked_ns = self.clock()

    def _advance(self) -> None:
        """Let everything happen that is due."""
        now = self.clock()
        with self.lock:
            while self._agenda and self._agenda[0][0] <= now:
                at, action = self._agenda.pop(0)
                action(at)
            # Whether a V falls asleep while it streams is unknown (fact sheet 4.4): this one does.
            delay_s = self._ptp.sleep_delay_s
            if delay_s and not self._ptp.asleep and now - self._talked_ns > delay_s * 1e9:
                self._ptp.fall_asleep()
                self.video.wants_keyframe = True

    def _at(self, at_ns: int, action: Callable[[int], None]) -> None:
        self._agenda.append((at_ns, action))
        self._agenda.sort(key=lambda entry: entry[0])

    def _plan_absence(self, at_ns: int, event: Unplug | PowerCycle | Overheat) -> None:
        def back(_: int) -> None:
            if not isinstance(event, Unplug):
                self._composition = Composition.MTP
                self._ptp = self._responder(asleep=True)
            self._attach()

        self._at(at_ns, lambda _: self._detach())
        self._at(at_ns + round(event.for_s * 1e9), back)

    def _plan_heat(self, started_ns: int, event: Overheat) -> None:
        warned, hot = (started_ns + round(s * 1e9) for s in (event.at_s, event.at_s + event.warned_s))
        self._at(warned, lambda _: self._ptp.set(Property.ERROR_INFO, BOARD_HOT))
        self._at(hot, lambda _: self._ptp.set(Property.ERROR_INFO, BOARD_HOT | BOARD_TOO_HOT))
        self._plan_absence(hot + self._reply_ns, event)

    def _change_mode(self, mode: CaptureMode) -> None:
        wanted = Composition.LIVE if mode is CaptureMode.LIVE else Composition.MTP
        if wanted is self._composition:
            return

        def back(_: int) -> None:
            self._composition = wanted
            self.video.cure(Cure.TOGGLE)
            self._attach()

        leaves = self.clock() + self._reply_ns
        self._at(leaves, lambda _: self._detach())
        self._at(leaves + self._reenumeration_ns, back)

    def _power_down(self) -> None:
        self._at(self.clock() + self._reply_ns, lambda _: self._detach())

    def _detach(self) -> None:
        self._present = self.held = False
        self.generation += 1
        self.video.reset()

    def _attach(self) -> None:
        self._present = True
        self.talked()
        self.video.reset()
        self._ptp.reset()


class Port:
    """The host's end of the cable. Every method raises ThetaGone once the camera has left the bus."""

    def __init__(self, camera: SimulatedThetaV, generation: int) -> None:
        self._camera = camera
        self.generation = generation
        self._strings = d.strings(camera.serial)
        self._configured = 0
        self._alternates: dict[int, int] = {}
        self._last_error = 0
        self._ae = {CT_AE_MODE: b"\x02", CT_AE_PRIORITY: b"\x00"}

    @property
    def connected(self) -> bool:
        camera = self._camera
        return camera.present and camera.generation == self.generation

    def disconnect(self) -> None:
        """The host lets go; the camera stops streaming."""
        with self._camera.lock:
            if self.connected:
                self._camera.held = False
                self._camera.video.reset()
                self.generation = -1

    def control(self, raw_setup: bytes, data: bytes = b"") -> bytes:
        """One control transfer. Raises ThetaStall as the device would answer STALL."""
        setup = Setup.decode(raw_setup)
        with self._camera.lock:
            self._check()
            if not setup.request_type & 0x80 and len(data) != setup.length:
                raise ThetaStall("the data stage is not as long as announced")
            try:
                return self._route(setup, data)[: setup.length]
            except ProtocolStall as stall:
                self._last_error = stall.code
                raise

    def write(self, endpoint: int, data: bytes) -> None:
        """An OUT transfer on a bulk endpoint."""
        with self._camera.lock:
            self._check()
            if endpoint != d.PTP_OUT:
                raise ThetaStall(f"no OUT endpoint {endpoint:#04x}")
            self._camera.talked()
            self._camera.ptp.receive(data)

    def read(self, endpoint: int, length: int) -> bytes | None:
        """An IN transfer on a bulk or interrupt endpoint; None while the camera has nothing to say."""
        with self._camera.lock:
            self._check()
            if endpoint == d.PTP_IN:
                return self._camera.ptp.send(length)
            if endpoint == d.PTP_EVENTS:
                return self._camera.ptp.event(length)
            if self._camera.composition is Composition.LIVE:
                if endpoint == d.VIDEO_STATUS:
                    return None
                if endpoint == d.VIDEO and self._camera.bulk_video:
                    return self._camera.video.payload(length)
            raise ThetaStall(f"no IN endpoint {endpoint:#04x}")

    @property
    def idle(self) -> bool:
        """Whether the video's microframes are empty until the next picture is offered."""
        with self._camera.lock:
            return self._camera.video.idle

    def isochronous(self, endpoint: int, count: int, start_ns: int) -> Burst:
        """`count` microframes of an isochronous endpoint from `start_ns` on; the microphones are silent."""
        with self._camera.lock:
            self._check()
            live = self._camera.composition is Composition.LIVE
            if not live or endpoint not in ({d.AUDIO} if self._camera.bulk_video else {d.VIDEO, d.AUDIO}):
                raise ThetaStall(f"no isochronous endpoint {endpoint:#04x}")
            return self._camera.video.take(count, start_ns) if endpoint == d.VIDEO else Burst(count, [])

    def _check(self) -> None:
        if not self.connected:
            raise ThetaGone("the simulated camera left the bus")

    def _route(self, setup: Setup, data: bytes) -> bytes:
        kind, recipient = setup.request_type & 0x60, setup.request_type & 0x1F
        if kind == 0x00:
            return self._standard(setup, recipient)
        if kind != 0x20 or recipient != 1 or self._configured == 0:
            raise ProtocolStall(0, f"request type {setup.request_type:#04x}")
        interface, entity = setup.index & 0xFF, setup.index >> 8
        if interface == d.STILL_INTERFACE and entity == 0:
            return self._camera.ptp.class_request(setup.request, setup.length)
        if self._camera.composition is Composition.LIVE:
            if interface == d.VIDEO_INTERFACE and entity == 0:
                return self._camera.video.control(setup.request, setup.value, setup.length, data)
            if interface == d.CONTROL_INTERFACE:
                return self._video_control(setup, entity, data)
        raise ProtocolStall(0, f"class request to interface {interface}, entity {entity}")

    def _video_control(self, setup: Setup, entity: int, data: bytes) -> bytes:
        """The video control interface: why the last request failed, and the terminal's two controls."""
        if entity == 0 and setup.value == ERROR_CODE and setup.request == 0x81:
            return bytes([self._last_error])
        if entity != 1 or setup.value not in self._ae:
            raise ProtocolStall(6, f"unknown control {setup.value:#06x} of entity {entity}")
        match setup.request:
            case 0x01:
                self._ae[setup.value] = data
                return b""
            case 0x81 | 0x87:
                return self._ae[setup.value]
            case 0x84 if setup.value == CT_AE_MODE:
                return b"\x0f"
            case 0x85:
                return b"\x01\x00"
            case 0x86:
                return b"\x03"
            case _:
                raise ProtocolStall(7, f"unknown request {setup.request:#04x}")

    def _standard(self, setup: Setup, recipient: int) -> bytes:
        match (setup.request_type, setup.request):
            case (0x80, 0x06):
                return self._descriptor(setup.value >> 8, setup.value & 0xFF)
            case (0x80, 0x08):
                return bytes([self._configured])
            case (0x00, 0x09) if setup.value in (0, 1):
                self._configured = setup.value
                self._alternates.clear()
                self._camera.video.reset()
                return b""
            case (0x01, 0x0B):
                self._set_interface(setup.index, setup.value)
                return b""
            case (0x81, 0x0A) if self._configured:
                return bytes([self._alternates.get(setup.index, 0)])
            case (0x80 | 0x81 | 0x82, 0x00):
                return bytes(2)
            case (0x02, 0x01) if setup.value == 0:
                if setup.index in (d.PTP_IN, d.PTP_OUT):
                    self._camera.ptp.clear_halt()
                elif setup.index == d.VIDEO and self._camera.bulk_video:
                    self._camera.video.set_alternate(0)
                return b""
            case (0x00, 0x05) | (0x00, 0x01) | (0x00, 0x03):
                return b""  # SET_ADDRESS and device features: nothing a host could see
            case _:
                raise ProtocolStall(0, f"standard request {setup.request:#04x} to recipient {recipient}")

    def _descriptor(self, kind: int, index: int) -> bytes:
        camera = self._camera
        live = camera.composition is Composition.LIVE
        if kind == DEVICE_TYPE and index == 0:
            return camera.device_descriptor
        if kind == CONFIGURATION_TYPE and index == 0:
            return camera.configuration
        if kind == QUALIFIER_TYPE and index == 0:
            return d.LIVE_QUALIFIER if live else d.MTP_QUALIFIER
        if kind == STRING_TYPE and index in self._strings:
            return self._strings[index]
        raise ProtocolStall(0, f"no descriptor {kind:#04x}/{index}")

    def _set_interface(self, interface: int, alternate: int) -> None:
        live = self._camera.composition is Composition.LIVE
        highest = {0: 0, 1: 0, 2: 0 if self._camera.bulk_video else 1, 3: 0, 4: 1} if live else {0: 0}
        if not self._configured or alternate > highest.get(interface, -1):
            raise ProtocolStall(0, f"no alternate setting {alternate} of interface {interface}")
        self._alternates[interface] = alternate
        if interface == d.VIDEO_INTERFACE:
            self._camera.video.set_alternate(alternate)
