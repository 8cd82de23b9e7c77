"""The control loop: 50 times a second take the newest of everything, decide, check, command, then log.

The loop is a shell around two pure steps (`Brain.step`, `Safety.step`). It sends the base command before it
does anything else, measures how late it is, and never skips a tick silently.
"""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from ghal360_robot.messages import Applied, ArmState, Decision, Inputs
from ghal360_robot.timing import Lateness

if TYPE_CHECKING:
    from collections.abc import Callable

    from ghal360_robot.board import Board
    from ghal360_robot.brain import Brain, BrainState
    from ghal360_robot.safety.chain import Safety, SafetyState
    from ghal360_robot.systemd import Notifier

SAY_NS = 1_000_000_000

logger = logging.getLogger(__name__)


class Actuator(Protocol):
    """Takes what the safety chain let through to the base."""

    def apply(self, applied: Applied) -> None:
        """Send one motion command now. Must not block and must not raise for a base that is away."""


class TickLog(Protocol):
    """Where every tick is written; must not block."""

    def tick(
        self, inputs: Inputs, decision: Decision, applied: Applied, *, lateness_ms: float, work_ms: float
    ) -> None: ...


@dataclass(slots=True)
class ControlLoop:
    """One run of the loop; `newest` is what the status line and the page show."""

    board: Board
    brain: Brain
    safety: Safety
    actuator: Actuator
    log: TickLog
    notifier: Notifier
    rate_hz: float
    brain_state: BrainState
    safety_state: SafetyState
    on_tick: Callable[[Inputs, Decision, Applied], None] | None = None
    lateness: Lateness = field(default_factory=Lateness)
    ticks: int = 0
    newest: tuple[Inputs, Decision, Applied] | None = None
    _arm: tuple[ArmState, str] = (ArmState.DISARMED, "")
    _skipped: tuple[int, float] = (0, 0.0)
    _skipped_said_ns: int = 0

    async def run(self, stop: asyncio.Event) -> None:
        """Tick until `stop` is set. The schedule is absolute: a late tick does not delay the next ones."""
        period_ns = round(1e9 / self.rate_hz)
        due_ns = time.monotonic_ns() + period_ns
        try:
            while not stop.is_set():
                await _sleep_until(due_ns)
                late_ns = time.monotonic_ns() - due_ns
                self.tick(late_ns / 1e6)
                missed = (time.monotonic_ns() - due_ns) // period_ns
                self._count_skipped(int(missed), late_ns / 1e6)
                due_ns += (missed + 1) * period_ns
        finally:
            self._say_skipped()

    def tick(self, late_ms: float) -> None:
        """One turn: snapshot, brain, safety, base; everything else after the command is out."""
        start_ns = time.monotonic_ns()
        armed = self.safety_state.arming.state is ArmState.ARMED
        inputs = self.board.snapshot(start_ns, self.ticks, armed=armed)
        self.brain_state, decision = self.brain.step(self.brain_state, inputs)
        self.safety_state, applied = self.safety.step(self.safety_state, inputs, decision.wanted)
        self.actuator.apply(applied)
        work_ms = (time.monotonic_ns() - start_ns) / 1e6
        self.ticks += 1
        self.lateness.note(late_ms)
        self.newest = (inputs, decision, applied)
        self.log.tick(inputs, decision, applied, lateness_ms=late_ms, work_ms=work_ms)
        self._say_arming(applied)
        self.notifier.beat(start_ns)
        if self.on_tick is not None:
            self.on_tick(inputs, decision, applied)

    def _count_skipped(self, missed: int, late_ms: float) -> None:
        """No tick is skipped silently; a bad second is one line, not fifty."""
        self.lateness.skipped += missed
        self._skipped = (self._skipped[0] + missed, max(self._skipped[1], late_ms if missed else 0.0))
        if time.monotonic_ns() - self._skipped_said_ns > SAY_NS:
            self._say_skipped()

    def _say_skipped(self) -> None:
        if self._skipped[0]:
            logger.warning("control loop: %d ticks skipped, the latest up to %.0f ms late", *self._skipped)
            self._skipped, self._skipped_said_ns = (0, 0.0), time.monotonic_ns()

    def _say_arming(self, applied: Applied) -> None:
        """A change of the right to move is an event for the log, once, with its reason."""
        reason = self.safety_state.arming.reason
        if (applied.arm, reason) == self._arm:
            return
        before, self._arm = self._arm[0], (applied.arm, reason)
        if applied.arm is ArmState.ARMED:
            logger.info("armed by the operator")
        elif before is ArmState.ARMED or applied.arm is ArmState.ESTOP:
            logger.warning("stopped: %s", reason)
        else:
            logger.info("%s: %s", applied.arm.value, reason)


async def _sleep_until(due_ns: int) -> None:
    """Sleep to within the timer's grain; yields to other tasks even when late."""
    await asyncio.sleep(max(0.0, (due_ns - time.monotonic_ns()) / 1e9))
