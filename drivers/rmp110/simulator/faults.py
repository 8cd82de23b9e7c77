"""What goes wrong, when and how often: a plan with a seed, so that every failure can be had again."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.rmp110.codec.frames import Frame

Span = tuple[float, float]
"""Begins after so many seconds, lasts so many."""


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Probabilities are per feedback frame (`drop`, `corrupt`) or per reply (`delay`); seconds since start."""

    seed: int = 0
    drop: float = 0.0
    corrupt: float = 0.0
    """Too few bytes, or an id beyond the packet; CAN's own checksum rules out wrong bits."""
    delay: float = 0.0
    delay_s: float = 0.05
    silences: tuple[Span, ...] = ()
    """The base hears and says nothing."""
    unplugs: tuple[Span, ...] = ()
    """The bus is gone: socketcand connections close, other buses fall silent."""
    power_cycles: tuple[Span, ...] = ()
    kill_at_s: float | None = None


class FaultInjector:
    """Applies a plan."""

    def __init__(self, plan: FaultPlan) -> None:
        self.plan = plan
        self._random = random.Random(plan.seed)  # noqa: S311 - reproducible, not secret

    def mangle(self, frames: Sequence[Frame]) -> list[Frame]:
        """A reply as it reaches the bus."""
        plan, draw = self.plan, self._random
        if not (plan.drop or plan.corrupt):
            return list(frames)
        kept = [frame for frame in frames if draw.random() >= plan.drop]
        return [self._corrupt(frame) if draw.random() < plan.corrupt else frame for frame in kept]

    def delay_s(self) -> float:
        """How long this reply is held back."""
        return self.plan.delay_s if self.plan.delay and self._random.random() < self.plan.delay else 0.0

    def _corrupt(self, frame: Frame) -> Frame:
        if self._random.random() < 0.5:
            return Frame(frame.can_id, frame.data[: self._random.randrange(8)])
        return Frame(0x532 + self._random.randrange(0x40), frame.data)


def within(spans: Sequence[Span], elapsed_s: float) -> bool:
    """Whether now is inside one of the spans."""
    return any(begin <= elapsed_s < begin + length for begin, length in spans)
