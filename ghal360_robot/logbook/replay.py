"""A recorded run through today's core: the inputs of every tick as recorded, and what is decided on them now."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from ghal360_robot.brain import BrainState
from ghal360_robot.logbook.errors import RecordingNotReadableError
from ghal360_robot.messages import Applied, ArmState, Decision, Inputs
from ghal360_robot.safety.chain import SafetyState
from ghal360_robot.surroundings import look_around

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.mounting import LidarMount
    from ghal360_robot.brain import Brain
    from ghal360_robot.logbook.reader import RunReader
    from ghal360_robot.logbook.records import Tick
    from ghal360_robot.messages import Detections, Surroundings
    from ghal360_robot.safety.chain import Safety


DETECTION_NS = 150_000_000
"""From a picture to its detections, where the recording does not say: decode, wait, search."""


class Stamped(Protocol):
    @property
    def stamp_ns(self) -> int: ...


Message = TypeVar("Message", bound=Stamped)


@dataclass(frozen=True, slots=True)
class Replayed:
    """One tick: what was recorded, and what today's core makes of the same inputs."""

    recorded: Tick
    inputs: Inputs
    decision: Decision
    applied: Applied

    @property
    def differing(self) -> tuple[str, ...]:
        """Names of the fields of decision and applied command that are not bit for bit the recorded ones."""
        return _differing(self.recorded.decision, self.decision) + _differing(self.recorded.applied, self.applied)

    def values(self, name: str) -> tuple[object, object]:
        """A field's recorded value and today's, from the decision or else from what was applied."""
        if hasattr(self.decision, name):
            return getattr(self.recorded.decision, name), getattr(self.decision, name)
        return getattr(self.recorded.applied, name), getattr(self.applied, name)


def replay(
    reader: RunReader,
    brain: Brain,
    safety: Safety,
    lidar: LidarMount,
    detections: Iterator[Detections] | None = None,
) -> Iterator[Replayed]:
    """Every whole tick of the run, in order, from a robot that was just switched on.

    `detections` takes the place of the recorded ones: each is seen by the ticks that saw the recorded one of the
    same stamp, or, in a run without any, from `DETECTION_NS` after its picture on.

    Raises:
        RecordingNotReadableError: the beginning is missing, or a message that a tick saw is not in the recording.
    """
    brain_state, safety_state = BrainState(), SafetyState()
    for tick, inputs in recorded_inputs(reader, lidar, detections):
        brain_state, decision = brain.step(brain_state, inputs)
        safety_state, applied = safety.step(safety_state, inputs, decision.wanted)
        yield Replayed(tick, inputs, decision, applied)


def recorded_inputs(
    reader: RunReader, lidar: LidarMount, other: Iterator[Detections] | None = None
) -> Iterator[tuple[Tick, Inputs]]:
    """What each tick saw, put together from the messages whose stamps it recorded."""
    base, scan = _Newest(reader.base_states(), "base states"), _Newest(reader.scans(), "scans")
    detections = _Newest(reader.detections(), "detections")
    recorded = next(reader.detections(), None) is not None
    substitute = None if other is None else _Substitute(other, recorded=recorded)
    operator = _Newest(reader.operator_inputs(), "messages of the operator")
    expected, armed = 0, False
    around: Surroundings | None = None
    for tick in reader.ticks():
        if tick.tick != expected:
            raise RecordingNotReadableError(
                f"{reader.path}: tick {expected} is missing, and what the robot remembered after it with it; "
                "a run can be replayed from its first tick on only."
            )
        seen = scan.at(tick.scan_ns)
        if seen is not None and (around is None or around.stamp_ns != seen.stamp_ns):
            around = look_around(seen, lidar)
        yield (
            tick,
            Inputs(
                tick.stamp_ns,
                tick.tick,
                base.at(tick.base_ns),
                seen,
                detections.at(tick.detections_ns) if substitute is None else substitute.at(tick),
                operator.at(tick.operator_ns),
                tick.freshness,
                armed,
                tick.commands,
                tick.locks,
                tick.lease,
                tick.stops,
                around,
            ),
        )
        expected, armed = tick.tick + 1, tick.applied.arm is ArmState.ARMED


class _Newest(Generic[Message]):
    """One input's messages, asked for by stamps that never run backwards by more than a few messages."""

    KEPT = 64
    """Detections of one picture may be recorded after those of the next; nothing is further out of order."""

    def __init__(self, messages: Iterator[Message], what: str) -> None:
        self._messages = messages
        self._what = what
        self._kept: dict[int, Message] = {}

    def at(self, stamp_ns: int | None) -> Message | None:
        if stamp_ns is None:
            return None
        while stamp_ns not in self._kept:
            message = next(self._messages, None)
            if message is None:
                raise RecordingNotReadableError(f"The recording lacks some of the {self._what} that its ticks saw.")
            self._kept.setdefault(message.stamp_ns, message)
            if len(self._kept) > self.KEPT:
                del self._kept[next(iter(self._kept))]
        return self._kept[stamp_ns]


class _Substitute:
    """Other detections in the place of the recorded ones."""

    def __init__(self, detections: Iterator[Detections], *, recorded: bool) -> None:
        self._detections = detections
        self._next = next(detections, None)
        self._newest: Detections | None = None
        self._recorded = recorded

    def at(self, tick: Tick) -> Detections | None:
        """What `tick` would have seen: as new as what it saw, or as soon as a detector could have been done."""
        until_ns = tick.detections_ns if self._recorded else tick.stamp_ns - DETECTION_NS
        if until_ns is None:
            return None
        while self._next is not None and self._next.stamp_ns <= until_ns:
            self._newest, self._next = self._next, next(self._detections, None)
        return self._newest


def _differing(recorded: Decision | Applied, now: Decision | Applied) -> tuple[str, ...]:
    return tuple(f.name for f in fields(recorded) if getattr(recorded, f.name) != getattr(now, f.name))
