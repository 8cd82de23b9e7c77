"""The board where every input leaves its newest value, and from which each tick takes one snapshot."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from calibration.mounting import LidarMount
from ghal360_robot.assembly import lidar_mount
from ghal360_robot.freshness import RateWatch
from ghal360_robot.messages import HeadPose, Inputs, Stops, Twist
from ghal360_robot.safety.mux import FUTURE_NS
from ghal360_robot.surroundings import look_around

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ghal360_robot.config import RobotConfig
    from ghal360_robot.messages import (
        BaseState,
        Command,
        Detections,
        Lease,
        LidarScan,
        Lock,
        OperatorInput,
        Surroundings,
    )

INPUTS = ("theta", "tim571", "rmp110", "operator")
LIDAR_HZ = 15.0
BASE_HZ = 20.0
"""Slower polling than this would not do; motion frames and polls bring 50."""

MAX_NUMBER = 1e6
MAX_PRESSES = 1_000_000_000
MAX_NAME = 64
MAX_NAMES = 16
"""Bystanders, locks and sources that are remembered; a robot has a handful of each."""

MAX_LATENCY_S = 3600.0


@dataclass(slots=True)
class Board:
    """Newest values by input. Written from driver tasks and threads, read by the control tick.

    `watches` judges arrivals: the camera's are pictures that were decoded whole, because that is what an
    operator drives by, whether or not something was detected in them.
    """

    watches: Mapping[str, RateWatch]
    mount: LidarMount = LidarMount()
    base: BaseState | None = None
    scan: LidarScan | None = None
    surroundings: Surroundings | None = None
    detections: Detections | None = None
    operator: OperatorInput | None = None
    lease: Lease | None = None
    stops: Stops = Stops()
    commands: dict[str, Command] = field(default_factory=dict)
    locks: dict[str, Lock] = field(default_factory=dict)
    refused: int = 0
    """Messages of operators that made no sense."""
    valid: dict[str, bool] = field(default_factory=lambda: dict.fromkeys(INPUTS, True))
    _bystanders: dict[str, OperatorInput] = field(default_factory=dict)
    _snapped: OperatorInput | None = None
    """The operator's message that a tick saw last."""
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def put_base(self, state: BaseState) -> None:
        self.base = state
        self._arrived("rmp110", state.stamp_ns)

    def put_scan(self, scan: LidarScan, arrival_ns: int) -> None:
        """A scan's stamp is its last beam's; it is its arrival that says whether the device is alive."""
        around = look_around(scan, self.mount)
        with self._lock:
            self.scan, self.surroundings = scan, around
        self.valid["tim571"] = scan.device_ok
        self._arrived("tim571", arrival_ns)

    def put_picture(self, stamp_ns: int) -> None:
        """A picture was decoded and nothing of it is missing; called from the decoder's thread."""
        self._arrived("theta", stamp_ns)

    def put_detections(self, detections: Detections) -> None:
        self.detections = detections

    def put_operator(self, message: OperatorInput) -> str:
        """Take a message in, unless it makes no sense: it comes from outside and steers the robot.

        Who does not hold the lease is a bystander. A message that was overtaken by a newer one of the same
        holder, or is stamped later than now, is refused. Stops count in all of them. Returns why the message was
        not taken in; empty where it was.
        """
        if not _is_count(message.disarm_presses) or not _is_count(message.estop_presses):
            self.estop()  # nobody can tell whether somebody wanted to stop: then somebody did
        if not (_counts_are_sane(message) and _holder_is_sane(message)):
            self.refused += 1
            self._stop_of_nonsense(message)
            return "its counts or its sender make no sense"
        newest = self.operator
        from_driver = message.holder == self.driver
        why_not = ""
        if not is_sane(message):
            why_not = "its numbers make no sense"
        elif not from_driver:
            why_not = "somebody else holds the lease"
        elif newest is not None and message.holder == newest.holder and message.stamp_ns <= newest.stamp_ns:
            why_not = "a newer one was here before it"
        elif _is_from_the_future(message):
            why_not = "it is stamped later than now"
        if not why_not:
            self._keep_stops(message)
            self.operator = message
            self._arrived("operator", message.stamp_ns)
            return ""
        self.refused += from_driver or not is_sane(message)
        self._watch_bystander(message)
        return why_not

    @property
    def driver(self) -> str:
        """Whose messages drive: the lease's holder, or the operator at the robot itself."""
        return "" if self.lease is None else self.lease.holder

    def put_lease(self, lease: Lease | None) -> None:
        """Grant, renew or withdraw the right to drive; who holds it is for the giver to decide."""
        self.lease = lease

    def put_command(self, command: Command) -> None:
        """The newest wish of a source other than operator and brain; repeated for as long as it is meant."""
        known = command.source in self.commands or len(self.commands) < MAX_NAMES
        if known and _is_stamp(command.stamp_ns) and _are_numbers(command.twist.v, command.twist.w):
            self.commands[command.source] = command
        else:
            self.refused += 1

    def withdraw(self, source: str) -> None:
        """A source has finished properly; one that only falls silent holds the robot still for a while."""
        self.commands.pop(source, None)

    def put_lock(self, lock: Lock) -> None:
        """Hold the robot or let it go; a lock whose publisher falls silent holds."""
        if (lock.name in self.locks or len(self.locks) < MAX_NAMES) and _is_stamp(lock.stamp_ns):
            self.locks[lock.name] = lock
        else:
            self.refused += 1
            self.stop()  # a lock that cannot be kept might be one that holds

    def stop(self) -> None:
        """Disarm, whoever asks."""
        self.stops = replace(self.stops, disarm=self.stops.disarm + 1)

    def estop(self) -> None:
        """Emergency stop, whoever asks."""
        self.stops = replace(self.stops, estop=self.stops.estop + 1)

    def snapshot(self, now_ns: int, tick: int, *, armed: bool) -> Inputs:
        """What the tick at `now_ns` sees."""
        with self._lock:
            freshness = {name: self.watches[name].at(now_ns, valid=self.valid[name]) for name in INPUTS}
            scan, around = self.scan, self.surroundings
        self._snapped = self.operator
        return Inputs(
            now_ns,
            tick,
            self.base,
            scan,
            self.detections,
            self._snapped,
            freshness,
            armed,
            tuple(self.commands.values()),
            tuple(self.locks.values()),
            self.lease,
            self.stops,
            around,
        )

    def _keep_stops(self, following: OperatorInput) -> None:
        """A stop in a message that is replaced before any tick saw it, by one that does not repeat it."""
        unseen, seen = self.operator, self._snapped
        if unseen is None or unseen is seen:
            return
        if seen is not None and unseen.holder != seen.holder:
            seen = None
        disarm, estop = (0, 0) if seen is None else (seen.disarm_presses, seen.estop_presses)
        if unseen.disarm_presses > max(disarm, following.disarm_presses):
            self.stop()
        if unseen.estop_presses > max(estop, following.estop_presses):
            self.estop()

    def _stop_of_nonsense(self, message: OperatorInput) -> None:
        """Stops in a message that is refused for something else in it."""
        before = self.operator
        disarm, estop = (0, 0) if before is None else (before.disarm_presses, before.estop_presses)
        if _is_count(message.disarm_presses) and message.disarm_presses > disarm:
            self.stop()
        if _is_count(message.estop_presses) and message.estop_presses > estop:
            self.estop()

    def _watch_bystander(self, message: OperatorInput) -> None:
        """Stops of somebody who does not drive; a first message with stops in it counts, as any stop does."""
        before = self._bystanders.pop(message.holder, None)
        if before is None and self.operator is not None and self.operator.holder == message.holder:
            before = self.operator
        disarm, estop = (0, 0) if before is None else (before.disarm_presses, before.estop_presses)
        if message.disarm_presses > disarm:
            self.stop()
        if message.estop_presses > estop:
            self.estop()
        self._bystanders[message.holder] = message
        if len(self._bystanders) > MAX_NAMES:
            del self._bystanders[next(iter(self._bystanders))]

    def _arrived(self, name: str, stamp_ns: int) -> None:
        with self._lock:
            self.watches[name].note(stamp_ns)


def is_sane(message: OperatorInput) -> bool:
    """Whether every number is finite and every count a whole number that a finger can reach."""
    head, stick = message.head, message.stick
    if not (_is_a(head, HeadPose) and (stick is None or _is_a(stick, Twist))):
        return False
    angles = (head.yaw, head.pitch, head.fov, *((stick.v, stick.w) if stick is not None else ()))
    return (
        _are_numbers(*angles)
        and all(math.isfinite(x) and abs(x) < MAX_NUMBER for x in angles)
        and isinstance(message.deadman, bool)
        and _is_stamp(message.stamp_ns)
        and _are_numbers(message.latency_s)
        and 0.0 <= message.latency_s <= MAX_LATENCY_S
        and _counts_are_sane(message)
        and _holder_is_sane(message)
    )


def _counts_are_sane(message: OperatorInput) -> bool:
    counts = (message.arm_presses, message.disarm_presses, message.estop_presses, message.found_presses)
    return all(_is_count(n) for n in counts)


def _is_a(value: object, kind: type) -> bool:
    """Messages come from outside: their fields are what they say only once this was asked."""
    return isinstance(value, kind)


def _is_count(value: object) -> bool:
    return isinstance(value, int) and 0 <= value < MAX_PRESSES


def _is_stamp(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _are_numbers(*values: object) -> bool:
    """Whether each is a number at all; NaN and infinities are for the safety chain to name."""
    return all(isinstance(value, float | int) and not isinstance(value, bool) for value in values)


def _holder_is_sane(message: OperatorInput) -> bool:
    return isinstance(message.holder, str) and len(message.holder) <= MAX_NAME


def _is_from_the_future(message: OperatorInput) -> bool:
    """Such a message would be a sign of life until its time has come."""
    return message.stamp_ns > time.monotonic_ns() + FUTURE_NS


def make_board(config: RobotConfig, operator_hz: float) -> Board:
    """A board that knows how often each input comes, and from what age on it holds the robot still."""
    safety = config.safety
    return Board(
        {
            "theta": RateWatch(config.theta.rate_hz, safety.video_hold_s),
            "tim571": RateWatch(LIDAR_HZ, safety.lidar_hold_s),
            "rmp110": RateWatch(BASE_HZ, safety.base_hold_s),
            "operator": RateWatch(operator_hz, safety.operator_hold_s),
        },
        lidar_mount(config),
    )
