"""What the driver tells: the base's state, the link's state, the counts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.fault_log import FaultLog
from drivers.rmp110.codec.faults import (
    GROUPS,
    Group,
    dynamic_response_texts,
    fault_texts,
    mcu_fault_texts,
)
from drivers.rmp110.codec.feedback import Layout
from drivers.rmp110.codec.motion import MotionScale
from drivers.rmp110.codec.parameters import OperationalState, Stored
from drivers.rmp110.device.language import Language
from drivers.rmp110.device.odometry import Covariance, Odometry
from drivers.rmp110.device.slip import SlipWatch

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

PACKS: Mapping[str, tuple[str, str]] = {
    "front 1": ("front_base_batt_1_soc", "front_base_batt_1_temp_degC"),
    "front 2": ("front_base_batt_2_soc", "front_base_batt_2_temp_degC"),
    "rear 1": ("rear_base_batt_1_soc", "rear_base_batt_1_temp_degC"),
    "rear 2": ("rear_base_batt_2_soc", "rear_base_batt_2_temp_degC"),
    **{f"motor controller {n}": (f"mcu_{n}_batt_soc", f"mcu_{n}_batt_temp_degC") for n in range(4)},
    "auxiliary": ("aux_batt_soc", "aux_batt_temp_degC"),
    "auxiliary 1": ("aux_batt_1_soc", "aux_batt_1_temp_degC"),
    "auxiliary 2": ("aux_batt_2_soc", "aux_batt_2_temp_degC"),
}
"""Words of charge and temperature by battery pack; each dialect has some of them, each base uses some of those."""


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
    language: Language
    differences: Mapping[str, tuple[float, float]]
    """Stored parameter by name: (stored, expected), where the float32 bits differ."""
    refusal: str | None = None
    """Why these parameters forbid motion."""
    postponed: bool = False
    """Whether parameters differ that are written, on another connection, once the base is in STANDBY."""
    warnings: tuple[str, ...] = ()
    """What the person at the robot should know about these parameters; motion is possible."""
    firmware: str = ""
    """Build numbers, where the base told them."""
    fault_log: FaultLog | None = None
    """Where it was asked for and came whole."""
    fault_groups: tuple[Group, ...] = GROUPS


@dataclass(frozen=True, slots=True)
class Battery:
    """One pack as the feedback tells it; a pack that is not fitted reads zero."""

    name: str
    percent: float | None
    temperature_degc: float | None


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
    covariance: Covariance = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Of the pose: xx, xy, x yaw, yy, y yaw, yaw yaw."""
    warnings: tuple[str, ...] = ()
    """What is odd, in words; motion is possible."""
    slipping: tuple[str, ...] = ()
    """Those of them that say the wheels do not do as they are told."""
    batteries: tuple[Battery, ...] = ()
    """The packs that the feedback set speaks of."""
    latched: str | None = None
    """Trouble while driving that may be over, in words: kept until STANDBY is requested."""

    @property
    def temperature_degc(self) -> float | None:
        """Of the hottest battery; None where the feedback set has none (the compact one has not)."""
        return max((b.temperature_degc for b in self.batteries if b.temperature_degc is not None), default=None)

    @property
    def trouble(self) -> str | None:
        """Why the base must not be commanded, in words; None when healthy."""
        return self.trouble_now or self.latched

    @property
    def trouble_now(self) -> str | None:
        """The same of this very packet."""
        if self.faults:
            return f"the base reports {'; '.join(self.faults)}"
        if self.dynamic_response:
            what = ", ".join(dynamic_response_texts(self.dynamic_response))
            return f"the base acts of its own accord (dynamic response 0x{self.dynamic_response:X}: {what})"
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
    """Packets that were asked for, or due, and did not come whole."""
    damaged: int
    """Frames that no healthy base sends."""
    reconnects: int
    dropped: int
    """Commands that the bus did not take, that came too fast, or that were no numbers."""
    rate_hz: float
    last_ns: int | None
    watchdog_trips: int = 0
    """How often the watchdog stopped the base because the event loop was stuck."""


def all_finite(values: Mapping[str, float]) -> bool:
    """Whether every word the driver needs is a number; otherwise the packet is damaged."""
    return all(math.isfinite(values[name]) for name in NEEDED)


def read_state(
    stamp_ns: int,
    values: Mapping[str, float],
    odometry: Odometry,
    identity: Identity,
    track_m: float,
    slip: SlipWatch,
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
        faults=fault_texts([int(values[f"fault_status_word_{n}"]) for n in (1, 2, 3, 4)], identity.fault_groups),
        dynamic_response=int(values["dynamic_response"]),
        operational_time_s=values["operational_time"],
        covariance=odometry.covariance(),
        warnings=(*identity.warnings, *_controllers(values), *slip.warnings),
        slipping=slip.slipping,
        batteries=_batteries(values),
    )


def _controllers(values: Mapping[str, float]) -> tuple[str, ...]:
    """Motor controllers' own words say more than the fault words, also what is no fault yet: a low battery."""
    words = [(n, int(values.get(f"mcu_{n}_fault_status", 0))) for n in range(4)]
    return tuple(text for n, word in words if word for text in mcu_fault_texts(n, word))


def _batteries(values: Mapping[str, float]) -> tuple[Battery, ...]:
    return tuple(
        Battery(name, _number(values.get(charge)), _number(values.get(temperature)))
        for name, (charge, temperature) in PACKS.items()
        if charge in values or temperature in values
    )


def _number(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
