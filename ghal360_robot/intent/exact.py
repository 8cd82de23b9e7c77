"""The exact intent filter: Bayes over the eight wedges that the operator may want to go to."""

from __future__ import annotations

from dataclasses import dataclass

from ghal360_robot.intent.head_motion import Evidence
from ghal360_robot.intent.model import UNIFORM, IntentModel
from ghal360_robot.intent.trigger import TriggerSettings, TriggerState, step_trigger


@dataclass(frozen=True, slots=True)
class IntentState:
    """`belief` is the probability of each world wedge (clockwise from the odometry's x)."""

    belief: tuple[float, ...] = UNIFORM
    trigger: TriggerState = TriggerState()


@dataclass(frozen=True, slots=True)
class ExactFilter:
    """The filter's parameters and its pure step; the state lives with the caller."""

    model: IntentModel = IntentModel()
    trigger: TriggerSettings = TriggerSettings()

    def step(self, state: IntentState, evidence: Evidence | None, dt_s: float) -> IntentState:
        """The state `dt_s` seconds later, with what the head did meanwhile; None where nobody knows.

        Raises ValueError for a negative or infinite time.
        """
        if not 0 <= dt_s < float("inf"):
            raise ValueError(f"Time goes forward by a finite step, not by {dt_s} s.")
        belief = self.model.predict(state.belief, dt_s)
        if evidence is not None:
            weighted = [b * p for b, p in zip(belief, self.model.likelihood(evidence, dt_s), strict=True)]
            total = sum(weighted)
            belief = tuple(w / total for w in weighted)
        return IntentState(belief, step_trigger(self.trigger, state.trigger, belief, dt_s))

    def intention(self, state: IntentState) -> int | None:
        """The world wedge that the operator wants to go to, or None: hold."""
        return state.trigger.intention
