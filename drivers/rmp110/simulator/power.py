"""Currents, power and batteries of the simulated base: plausible, not measured, and quantised as in the logs."""

from __future__ import annotations

import math

from drivers.rmp110.simulator.dynamics import DT, Drive

CURRENT_LIMIT_A = 34.991
"""Zero to peak, as every log has it (fact sheet 4.5)."""
PACK_WH, AUX_WH = 770.0, 400.0
IDLE_W, AUX_W = 12.0, 7.8
"""2 to 15 W per motor controller standing still, 0.1 A at 77 V for the electronics, as logged."""
MASS_KG, ROLLING_N, SCRUB_W = 70.0, 14.0, 12.0
"""Base with load; rolling resistance; what turning costs per rad/s on rubber tyres."""
AMPERE_PER_NEWTON = 0.08
"""0.23 m tyre, gear 24.27, some 0.12 N m per ampere."""
EFFICIENCY = 0.7
STALL_W = 180.0
AMBIENT_DEGC, WARMING_DEGC_PER_WH, COOLING_S = 24.0, 0.05, 5400.0
LOW_PERCENT = 10.0
"""Below this the motor controller says so and asks for less."""


class Power:
    """One propulsion pack on motor controller 1, one auxiliary pack; both drain with energy and warm."""

    def __init__(self) -> None:
        self.percent = 96.875
        self.aux_percent = 249 / 2.55
        self.temperature_degc = 26.25
        self.aux_temperature_degc = 27.25
        self.watts = IDLE_W
        self.energy_wh = 0.0
        self._joules = 0.0

    def tick(self, drive: Drive) -> None:
        """One control period of driving."""
        watts = IDLE_W
        if drive.blocked and (drive.v_target or drive.yaw_target):
            watts += STALL_W
        elif not drive.resting:
            force_n = MASS_KG * drive.accel + math.copysign(ROLLING_N, drive.v) if drive.v else 0.0
            shaft_w = force_n * drive.v + SCRUB_W * abs(drive.yaw)
            # Braking gives some back to the pack.
            watts += shaft_w / EFFICIENCY if shaft_w > 0 else shaft_w * EFFICIENCY
        self.watts = watts
        self._joules += watts * DT

    def settle(self, seconds: float) -> None:
        """Book what was used in the last `seconds`."""
        used_wh, self._joules = self._joules / 3600, 0.0
        self.energy_wh += used_wh
        self.percent = min(100.0, max(0.0, self.percent - used_wh / PACK_WH * 100))
        self.aux_percent = max(0.0, self.aux_percent - AUX_W * seconds / 3600 / AUX_WH * 100)
        cooling = seconds / COOLING_S
        self.temperature_degc += abs(used_wh) * WARMING_DEGC_PER_WH - (self.temperature_degc - AMBIENT_DEGC) * cooling
        self.aux_temperature_degc += (AMBIENT_DEGC + 3 - self.aux_temperature_degc) * cooling

    @property
    def aux_volts(self) -> float:
        """A lithium iron phosphate pack: flat over most of its charge."""
        return 73.0 + 3.8 * self.aux_percent / 100


def wheel_current(drive: Drive, side: int, limit_a: float = CURRENT_LIMIT_A) -> float:
    """Amperes, zero to peak, of the right (-1) or left (+1) wheel; `side` is the sign of clockwise yaw there."""
    if drive.blocked:
        wanted = drive.v_target + side * drive.yaw_target
        return math.copysign(limit_a, wanted) if wanted else 0.0
    turning = drive.v + side * drive.yaw
    if not turning:
        return 0.0
    force_n = MASS_KG * drive.accel / 2 + math.copysign(ROLLING_N / 2, turning)
    return max(-limit_a, min(limit_a, force_n * AMPERE_PER_NEWTON))


def in_steps(value: float, per_unit: float) -> float:
    """`value` rounded down to what a converter with so many steps per unit reads."""
    return math.floor(value * per_unit) / per_unit
