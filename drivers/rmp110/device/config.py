"""Settings of one base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from drivers.rmp110.codec.parameters import BY_NAME, RMP110_STORED

EXPECTED: Mapping[str, float] = MappingProxyType(dict(RMP110_STORED))


@dataclass(frozen=True, slots=True)
class Rmp110Config:
    """What the driver may do with the base, and what it expects to find stored in it.

    `expected` holds stored parameters by name (see `codec.parameters`). With `write_parameters` those that
    differ are written; without, a difference that changes how the base moves makes the driver refuse motion.
    """

    max_v_mps: float = 0.5
    max_w_rps: float = 1.0
    track_m: float = 0.481224
    """Distance between the driven wheels: odometry, and the yaw rate where the base stored another one."""
    expected: Mapping[str, float] = field(default_factory=lambda: EXPECTED)
    write_parameters: bool = False
    write_feedback_set: bool = True
    """Write the compact feedback set where another one is stored; without, the stored one is used."""
    poll_hz: float = 50.0
    """Feedback rate while nothing moves; 20 to 50."""
    backoff_s: tuple[float, float] = (1.0, 5.0)
    """First and longest pause before another attempt to connect: a second after bus-off (fact sheet 13.8),
    and no hurry after a kill switch, where silence is normal."""

    def __post_init__(self) -> None:
        if not 20.0 <= self.poll_hz <= 50.0:
            raise ValueError(f"poll_hz is {self.poll_hz}; the base is polled with 20 to 50 Hz")
        if not (0 < self.max_v_mps <= 8.047 and 0 < self.max_w_rps <= 4.5 and 0.2 < self.track_m < 1.5):
            raise ValueError("max_v_mps, max_w_rps or track_m is outside of what an RMP 110 can be")
        unknown = set(self.expected) - set(BY_NAME)
        if unknown:
            raise ValueError(f"unknown stored parameters: {', '.join(sorted(unknown))}")
