"""What the driver tells: the base's state, the link's state, the counts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from drivers.rmp110.codec.faults import fault_texts
from drivers.rmp110.codec.feedback import Dialect, Layout
from drivers.rmp110.codec.motion import MotionScale
from drivers.rmp110.codec.parameters import OperationalState, Stored
from drivers.rmp110.device.odometry import Odometry

NEEDED = (
    "fault_status_word_1",
    "fault_status_word_2",
    "fault_status_word_3",
    "fault_status_word_4",
    "operational_time",
    "operational_state",
    "dynamic_response",
    "min_propulsion_batt_soc",
    "yaw_rate_limit_rps",
    "vel_limit_mps",
    "linear_vel_mps",
    "right_front_vel_mps",
    "left_front_vel_mps",
    "right_front_pos_m",
    "left_front_pos_m",
    "vel_target_mps",
    "yaw_rate_target_rps",
)
"""Feedback words without which the driver does not work; the compact set has them all."""


class LinkState(Enum):
    """Where the conversation with the base stands."""

    CLOSED = "closed"
    CONNECTING = "connecting"
    PROBING = "probing"
    IDENTIFYING = "identifying"
    CONFIGURING = "configuring"
    STREAMING = "streaming"
    BACKOFF = "backoff"


@dataclass(frozen=True, slots=True)
class Identity:
    """What is known of the base before it may move."""

    dialect: Dialect
    stored: Stored
    layout: Layout
    scale: MotionScale
    differences: Mapping[str, tuple[float, float]]
    """Stored parameter by name: (stored, expected), where the float32 bits differ."""
    refusal: str | None = None
    """Why these parameters forbid motion."""


@dataclass(frozen=True, slots=True)
class State:
    """One complete feedback packet in SI units and REP-103 signs."""

    stamp_ns: int
    """Reception of the packet's first frame; the content is what the base knew then."""
    mode: OperationalState
    x: float
    y: float
    yaw: float
    """Pose from the wheel positions since the first packet, radians counter-clockwise, unbounded."""
    v: float
    w: float
    target_v: float
    target_w: float
    limit_v: float
    limit_w: float
    """Effective limits: zero in standby, growing to the stored ones after tractor was entered."""
    battery_percent: float
    faults: tuple[str, ...]
    dynamic_response: int
    """Not zero while the base does something of its own accord; 0x200 at the kill switch."""
    operational_time_s: float

    @property
    def trouble(self) -> str | None:
        """Why the base must not be commanded now, in words; None when healthy."""
        if self.faults:
            return f"the base reports {'; '.join(self.faults)}"
        if self.dynamic_response:
            return f"the base acts of its own accord (dynamic response 0x{self.dynamic_response:X})"
        if self.mode >= OperationalState.DISABLED_OR_BALANCE:
            return f"the base is switching off (state {int(self.mode)})"
        return None


@dataclass(frozen=True, slots=True)
class Stats:
    """How the link is doing."""

    link: LinkState
    detail: str
    """Why, in words; empty when all is well."""
    received: int
    """Complete feedback packets."""
    lost: int
    """Packets that were asked for and did not come whole."""
    damaged: int
    """Frames that no healthy base sends."""
    reconnects: int
    dropped: int
    """Commands that the bus did not take, or that were no numbers."""
    rate_hz: float
    last_ns: int | None


def all_finite(values: Mapping[str, float]) -> bool:
    """Whether every word the driver needs is a number; otherwise the packet is damaged."""
    return all(math.isfinite(values[name]) for name in NEEDED)


def read_state(
    stamp_ns: int, values: Mapping[str, float], odometry: Odometry, identity: Identity, track_m: float
) -> State:
    """The state that a packet's values describe."""
    ratio = identity.scale.track_ratio
    # `0.0 -` rather than a sign: standing still then reads 0.0, not -0.0.
    return State(
        stamp_ns=stamp_ns,
        mode=OperationalState.of(int(values["operational_state"])),
        x=odometry.x,
        y=odometry.y,
        yaw=odometry.yaw,
        v=values["linear_vel_mps"],
        w=(values["right_front_vel_mps"] - values["left_front_vel_mps"]) / track_m,
        target_v=values["vel_target_mps"],
        target_w=0.0 - values["yaw_rate_target_rps"] / ratio,
        limit_v=values["vel_limit_mps"],
        limit_w=values["yaw_rate_limit_rps"] / ratio,
        battery_percent=values["min_propulsion_batt_soc"],
        faults=fault_texts([int(values[f"fault_status_word_{n}"]) for n in (1, 2, 3, 4)]),
        dynamic_response=int(values["dynamic_response"]),
        operational_time_s=values["operational_time"],
    )
