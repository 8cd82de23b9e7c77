"""When a belief is strong enough to act on (paper: 70 %)."""

from __future__ import annotations

from dataclasses import dataclass

from ghal360_robot.guidance.egocentric import N_WEDGES


@dataclass(frozen=True, slots=True)
class TriggerSettings:
    """Plain threshold by default; `steady_s` 0.2 and `release` 0.5 make fewer false and longer triggers."""

    threshold: float = 0.7
    release: float | None = None
    """An intention holds until its belief falls below this; None: below the threshold."""
    steady_s: float = 0.0
    """The belief must have been over the threshold for this long (0.2 s: three samples of a 10 Hz head)."""

    def __post_init__(self) -> None:
        if not 1 / N_WEDGES < self.threshold < 1:
            raise ValueError(f"The intent threshold must lie between 1/8 and 1, not at {self.threshold}.")
        if self.release is not None and not 0.5 <= self.release <= self.threshold:
            raise ValueError(f"The release must lie between 0.5 and the threshold, not at {self.release}.")
        if self.steady_s < 0:
            raise ValueError(f"The time above the threshold must not be negative: {self.steady_s} s.")


@dataclass(frozen=True, slots=True)
class TriggerState:
    """The intention acted on, and the wedge that is becoming one."""

    intention: int | None = None
    candidate: int | None = None
    steady_s: float = 0.0


def step_trigger(
    settings: TriggerSettings, state: TriggerState, belief: tuple[float, ...], dt_s: float
) -> TriggerState:
    """The intention after a step of `dt_s` seconds that led to this belief (8,)."""
    release = settings.threshold if settings.release is None else settings.release
    if state.intention is not None and belief[state.intention] >= release:
        return state
    best = max(range(N_WEDGES), key=belief.__getitem__)
    if belief[best] < settings.threshold:
        return TriggerState()
    steady_s = state.steady_s + dt_s if best == state.candidate else 0.0
    # Half a nanosecond forgives the rounding of a sum of ticks.
    ripe = steady_s >= settings.steady_s - 5e-10
    return TriggerState(intention=best if ripe else None, candidate=best, steady_s=steady_s)
