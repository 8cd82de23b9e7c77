"""The simulated camera: on or off the bus, in MTP or live mode, one control endpoint and four others.

Pictures come from outside (`offer`); whoever plays the host takes a `Port` and talks to that. Time comes
from the caller's clock, so tests can bring their own.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from drivers.theta_v.codec import h264
from drivers.theta_v.codec.ptp import CaptureMode, Property
from drivers.theta_v.errors import ThetaNotFound, ThetaStall
from drivers.theta_v.simulator import descriptors as d
from drivers.theta_v.simulator.descriptors import Composition
from drivers.theta_v.simulator.faults import Cure, FaultPlan, Overheat, PowerCycle, Unplug
from drivers.theta_v.simulator.port import Port
from drivers.theta_v.simulator.ptp import PtpResponder
from drivers.theta_v.simulator.video import Demand, VideoStreaming

REPLY_S = 0.05  # what the host gets to fetch the answer before the device leaves the bus
REENUMERATION_S = 0.5  # unknown for the V; of a phone of its age, one to three seconds

BOARD_HOT, BOARD_TOO_HOT = 0x00100000, 0x80000000  # ErrorInfo (fact sheet 4.3)


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

    def stall(self, cure: Cure) -> None:
        """Stop the encoder now, until `cure` is applied."""
        with self.lock:
            self.video.stall(cure)

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
