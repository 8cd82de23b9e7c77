"""What goes wrong, when and how often: a plan with a seed, so that every failure can be had again."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar, cast

from drivers.rmp110.codec.frames import Frame

Span = tuple[float, float]
"""Begins after so many seconds, lasts so many."""
Message = TypeVar("Message", bound=Frame | bytes)
"""A CAN frame, or a whole packet of a byte transport."""


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Probabilities are per message of the base, `delay` per reply; seconds since start."""

    seed: int = 0
    drop: float = 0.0
    corrupt: float = 0.0
    """Frames: too few bytes, or an id beyond the packet; CAN's own checksum rules out wrong bits. Packets: both."""
    duplicate: float = 0.0
    reorder: float = 0.0
    """Two neighbours of a reply change places."""
    delay: float = 0.0
    delay_s: float = 0.05
    silences: tuple[Span, ...] = ()
    """The base neither hears nor says anything."""
    unplugs: tuple[Span, ...] = ()
    """The bus is gone: connections close, other buses fall silent."""
    power_cycles: tuple[Span, ...] = ()
    stuck_modes: tuple[Span, ...] = ()
    """Mode requests have no effect."""
    foreign: tuple[Span, ...] = ()
    """Somebody else commands the base on the same bus, ten times a second."""
    restarts: tuple[float, ...] = ()
    """The base's processor resets itself into STANDBY."""
    kill_at_s: float | None = None

    def __post_init__(self) -> None:
        for name in PROBABILITIES:
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} is a probability between 0 and 1, not {getattr(self, name)}")


PROBABILITIES = ("drop", "corrupt", "duplicate", "reorder", "delay")


def _span(text: str) -> Span:
    begin, plus, length = text.partition("+")
    if not plus:
        raise ValueError
    return float(begin), float(length)


_ENTRIES: Mapping[str, tuple[str, Callable[[str], object]]] = {
    "seed": ("seed", int),
    "delay_s": ("delay_s", float),
    **{name: (name, float) for name in PROBABILITIES},
    "silence": ("silences", _span),
    "unplug": ("unplugs", _span),
    "power": ("power_cycles", _span),
    "stuck": ("stuck_modes", _span),
    "foreign": ("foreign", _span),
    "restart": ("restarts", float),
    "kill": ("kill_at_s", float),
}
"""Word in the text, field, and how its value is read; fields that are tuples may be given several times."""

FORM = "drop=0.01,seed=3,silence=5+2,kill=30; spans are START+SECONDS; known: " + ", ".join(_ENTRIES)


def parse_plan(text: str) -> FaultPlan:
    """A plan from `drop=0.01,seed=3,silence=5+2`. Raises ValueError with a sentence."""
    values: dict[str, object] = {}
    for entry in filter(None, (part.strip() for part in text.split(","))):
        word, _, value = entry.partition("=")
        if word not in _ENTRIES:
            raise ValueError(f"'{entry}' is no fault, for example {FORM}")
        field, read = _ENTRIES[word]
        try:
            found = read(value)
        except ValueError:
            raise ValueError(f"'{entry}' has no sensible value, for example {FORM}") from None
        several = isinstance(getattr(FaultPlan(), field), tuple)
        values[field] = (*values.get(field, ()), found) if several else found  # type: ignore[misc]
    return dataclasses.replace(FaultPlan(), **values)  # type: ignore[arg-type]


class FaultInjector:
    """Applies a plan to the base's messages; what it does depends on the seed and on the messages alone."""

    def __init__(self, plan: FaultPlan) -> None:
        self.plan = plan
        self._random = random.Random(plan.seed)  # noqa: S311 - reproducible, not secret

    def mangle(self, messages: Sequence[Message]) -> list[Message]:
        """A reply as it reaches the bus."""
        plan, draw = self.plan, self._random
        if not (plan.drop or plan.corrupt or plan.duplicate or plan.reorder):
            return list(messages)
        kept: list[Message] = []
        for message in messages:
            if draw.random() < plan.drop:
                continue
            kept.append(cast(Message, self._corrupt(message)) if draw.random() < plan.corrupt else message)
            if draw.random() < plan.duplicate:
                kept.append(kept[-1])
        for place in range(len(kept) - 1):
            if draw.random() < plan.reorder:
                kept[place], kept[place + 1] = kept[place + 1], kept[place]
        return kept

    def delay_s(self, alone: bool = False) -> float:
        """How long this reply is held back; one `alone` can only change places with the next reply."""
        plan, draw = self.plan, self._random
        if plan.delay and draw.random() < plan.delay:
            return plan.delay_s
        return OVERTAKEN_S if alone and plan.reorder and draw.random() < plan.reorder else 0.0

    def _corrupt(self, message: Frame | bytes) -> Frame | bytes:
        draw = self._random
        if isinstance(message, Frame):
            if draw.random() < 0.5:
                return Frame(message.can_id, message.data[: draw.randrange(8)])
            return Frame(0x532 + draw.randrange(0x40), message.data)
        if draw.random() < 0.5:
            return message[: draw.randrange(len(message))]
        place = draw.randrange(len(message))
        return message[:place] + bytes([message[place] ^ 1 << draw.randrange(8)]) + message[place + 1 :]


OVERTAKEN_S = 0.015
"""Longer than the 10 ms between two packets of a stream, shorter than between two polls."""


def within(spans: Sequence[Span], elapsed_s: float) -> bool:
    """Whether now is inside one of the spans."""
    return any(begin <= elapsed_s < begin + length for begin, length in spans)
