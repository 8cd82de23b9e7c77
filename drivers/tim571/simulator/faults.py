"""What may go wrong between the simulated lidar and its clients, decided by a seed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from random import Random
from typing import Any


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Chances apply to each frame sent; spans are `(begin, length)` in seconds from the simulator's start."""

    drop: float = 0.0
    """Chance that a frame is never sent."""
    corrupt: float = 0.0
    """Chance that one of its bytes is changed."""
    split: float = 0.0
    """Chance that it goes out in several segments with time between them."""
    delay: float = 0.0
    """Chance that it is held back, by up to `delay_s`."""
    delay_s: float = 0.05
    jitter_s: float = 0.0
    """Mean of the time by which every frame is late, exponentially distributed; 100 us on a real network."""
    byte_error: float = 0.0
    """Chance that a byte is changed, for each byte sent."""
    stall: tuple[float, float] | None = None
    """The connection stays open but no byte comes or goes, as with a pulled cable."""
    unplug: tuple[float, float] | None = None
    """All connections close and new ones are refused."""
    power_cycle: tuple[float, float] | None = None
    """As unplugged, and the device begins anew afterwards: its ticks and counters, and all that wasn't saved."""


def _span(text: str) -> tuple[float, float]:
    start, _, length = text.partition("+")
    at_s, for_s = float(start), float(length)
    if not (0 <= at_s < inf and 0 < for_s < inf):
        raise ValueError(text)
    return at_s, for_s


def _chance(text: str) -> float:
    if not 0 <= float(text) <= 1:
        raise ValueError(text)
    return float(text)


def _seconds(text: str) -> float:
    if not 0 <= float(text) < inf:
        raise ValueError(text)
    return float(text)


_READERS: dict[str, tuple[str, Callable[[str], object]]] = {
    "drop": ("drop", _chance),
    "corrupt": ("corrupt", _chance),
    "bytes": ("byte_error", _chance),
    "split": ("split", _chance),
    "delay": ("delay", _chance),
    "delay_s": ("delay_s", _seconds),
    "jitter_s": ("jitter_s", _seconds),
    "stall": ("stall", _span),
    "unplug": ("unplug", _span),
    "power": ("power_cycle", _span),
}
FORM = "drop=0.01,jitter_s=0.0001,unplug=20+5; spans are START+SECONDS; known: " + ", ".join(_READERS)


def parse_plan(text: str) -> FaultPlan:
    """A plan from `drop=0.01,stall=5+2`; raises ValueError with a sentence."""
    values: dict[str, Any] = {}
    for entry in filter(None, (part.strip() for part in text.split(","))):
        word, _, value = entry.partition("=")
        if word not in _READERS:
            raise ValueError(f"'{entry}' is no fault, for example {FORM}")
        name, read = _READERS[word]
        try:
            values[name] = read(value)
        except ValueError:
            raise ValueError(f"'{entry}' has no sensible value, for example {FORM}") from None
    return FaultPlan(**values)


@dataclass(frozen=True, slots=True)
class Piece:
    """Bytes to send after waiting `pause_s`."""

    pause_s: float
    data: bytes


SEGMENT_PAUSE_S = 0.003


def strike(plan: FaultPlan, chance: Random, frame: bytes) -> list[Piece]:
    """What becomes of a frame."""
    if chance.random() < plan.drop:
        return []
    pause_s = chance.random() * plan.delay_s if chance.random() < plan.delay else 0.0
    if plan.jitter_s:
        pause_s += chance.expovariate(1 / plan.jitter_s)
    if chance.random() < plan.corrupt:
        frame = _spoil(frame, [chance.randrange(len(frame))], chance)
    if plan.byte_error:
        frame = _spoil(frame, [at for at in range(len(frame)) if chance.random() < plan.byte_error], chance)
    if chance.random() >= plan.split:
        return [Piece(pause_s, frame)]
    cuts = sorted(chance.randrange(len(frame)) for _ in range(chance.randrange(1, 4)))
    parts = [frame[a:b] for a, b in zip([0, *cuts], [*cuts, len(frame)], strict=True)]
    return [Piece(pause_s if at == 0 else SEGMENT_PAUSE_S, part) for at, part in enumerate(parts) if part]


def _spoil(frame: bytes, places: list[int], chance: Random) -> bytes:
    spoilt = bytearray(frame)
    for at in places:
        spoilt[at] ^= chance.randrange(1, 256)
    return bytes(spoilt)


class Line:
    """The way to the clients, with the plan's faults from `begin` on."""

    def __init__(self, plan: FaultPlan, seed: int) -> None:
        self._plan = plan
        self._chance = Random(seed)  # noqa: S311 - faults, not secrets
        self._began_s = time.monotonic()

    def begin(self) -> None:
        """Count the plan's times from now."""
        self._began_s = time.monotonic()

    @property
    def dead(self) -> bool:
        """Whether nothing passes now."""
        if self._plan.stall is None:
            return False
        at_s, for_s = self._plan.stall
        return at_s <= time.monotonic() - self._began_s < at_s + for_s

    def strike(self, frame: bytes) -> list[Piece]:
        """What becomes of the next frame."""
        return strike(self._plan, self._chance, frame)
