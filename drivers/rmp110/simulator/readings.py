"""What the simulated base tells, word by word, under the vendor's names.

Names that are not here read zero, as the words of rear wheels, IMU and GPS do on a base that has none.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

from drivers.rmp110.codec.feedback_words import Word
from drivers.rmp110.codec.parameters import Kind
from drivers.rmp110.simulator.fault_memory import SP_BUILD, UIP_BUILD
from drivers.rmp110.simulator.machine import Machine, Reading
from drivers.rmp110.simulator.power import CURRENT_LIMIT_A, in_steps, wheel_current


def _charge(machine: Machine) -> float:
    return in_steps(machine.power.percent, 2.56)


def _warmth(machine: Machine) -> float:
    return in_steps(machine.power.temperature_degc, 16)


def _right(machine: Machine) -> float:
    return machine.drive.v - machine.drive.yaw * machine.settings.track_m / 2


def _left(machine: Machine) -> float:
    return machine.drive.v + machine.drive.yaw * machine.settings.track_m / 2


def _right_current(machine: Machine) -> float:
    return wheel_current(machine.drive, -1)


def _left_current(machine: Machine) -> float:
    return wheel_current(machine.drive, +1)


def _stored(name: str) -> Reading:
    return lambda machine: machine.stored[name]


def _fault_word(index: int) -> Reading:
    return lambda machine: machine.fault_words[index]


def _mcu_fault(index: int) -> Reading:
    return lambda machine: machine.mcu_faults[index]


STORED_AS: Mapping[str, str] = {
    "fram_vel_limit_mps": "max_velocity",
    "fram_accel_limit_mps2": "max_accel",
    "fram_decel_limit_mps2": "max_decel",
    "fram_dtz_decel_limit_mps2": "max_dtz_decel",
    "fram_coastdown_decel_mps2": "coastdown_decel",
    "fram_yaw_rate_limit_rps": "max_yaw_rate",
    "fram_yaw_accel_limit_rps2": "max_yaw_accel",
    "fram_lateral_accel_limit_mps2": "lateral_accel",
    "fram_tire_diameter_m": "tire_diameter",
    "fram_wheelbase_length_m": "wheel_base",
    "fram_wheel_track_width_m": "track_width",
    "fram_transmission_ratio": "gear_ratio",
    "fram_config_bitmap": "input_bitmap",
    "fram_eth_ip_address": "ip_address",
    "fram_eth_port_number": "ip_port",
    "fram_eth_subnet_mask": "subnet_mask",
    "fram_eth_gateway": "gateway",
    **{f"user_feedback_bitmap_{n}": f"feedback_bitmap_{n}" for n in (1, 2, 3, 4)},
}
"""Feedback words that repeat a stored parameter."""

READINGS: Mapping[str, Reading] = {
    **{f"fault_status_word_{n + 1}": _fault_word(n) for n in range(4)},
    **{f"mcu_{n}_fault_status": _mcu_fault(n) for n in range(4)},
    "operational_time": lambda machine: machine.run_time_s,
    "operational_state": lambda machine: int(machine.state),
    "dynamic_response": lambda machine: machine.dynamic_response,
    "min_propulsion_batt_soc": _charge,
    "mcu_1_batt_soc": _charge,
    "front_base_batt_1_soc": _charge,
    "mcu_1_batt_temp_degC": _warmth,
    "front_base_batt_1_temp_degC": _warmth,
    "aux_batt_soc": lambda machine: in_steps(machine.power.aux_percent, 2.55),
    "aux_batt_voltage_V": lambda machine: in_steps(machine.power.aux_volts, 128),
    "aux_batt_current_A": lambda machine: in_steps(7.8 / machine.power.aux_volts, 128),
    "aux_batt_temp_degC": lambda machine: in_steps(machine.power.aux_temperature_degc, 16),
    "yaw_rate_limit_rps": lambda machine: machine.drive.yaw_limit,
    "vel_limit_mps": lambda machine: machine.drive.v_limit,
    "linear_accel_mps2": lambda machine: machine.drive.accel,
    "linear_vel_mps": lambda machine: machine.drive.v,
    "differential_wheel_vel_rps": lambda machine: machine.drive.yaw,
    "right_front_vel_mps": _right,
    "left_front_vel_mps": _left,
    "right_front_pos_m": lambda machine: machine.drive.right_m,
    "left_front_pos_m": lambda machine: machine.drive.left_m,
    "linear_pos_m": lambda machine: machine.drive.linear_m,
    "right_front_current_A0pk": _right_current,
    "left_front_current_A0pk": _left_current,
    "max_motor_current_A0pk": lambda machine: max(abs(_right_current(machine)), abs(_left_current(machine))),
    "right_front_current_limit_A0pk": lambda _: CURRENT_LIMIT_A,
    "left_front_current_limit_A0pk": lambda _: CURRENT_LIMIT_A,
    "vel_target_mps": lambda machine: machine.drive.v_target,
    "yaw_rate_target_rps": lambda machine: machine.drive.yaw_target,
    "mcu_1_inst_power_W": lambda machine: machine.power.watts,
    "mcu_1_total_energy_Wh": lambda machine: machine.power.energy_wh,
    "ccu_sp_sw_build_id": lambda _: SP_BUILD,
    "ccu_uip_sw_build_id": lambda _: UIP_BUILD,
    "packed_build_ids": lambda _: SP_BUILD << 16 | UIP_BUILD,
    "odom_x_m": lambda machine: machine.odom[0],
    "odom_y_m": lambda machine: machine.odom[1],
    "odom_yaw_rad": lambda machine: machine.odom[2],
    **{word: _stored(name) for word, name in STORED_AS.items()},
}


def _nothing(_: Machine) -> float:
    return 0


class Reader:
    """The feedback of one set of words, prepared once because it is asked for up to a hundred times a second."""

    def __init__(
        self,
        words: Sequence[Word],
        byte_order: str = ">",
        pad_word: int | None = None,
        readings: Mapping[str, Reading] = READINGS,
    ) -> None:
        self._readings = tuple(readings.get(word.name, _nothing) for word in words)
        kinds = "".join("f" if word.kind is Kind.FLOAT else "I" for word in words)
        self._tail = (pad_word,) if pad_word is not None else ()
        self._struct = struct.Struct(f"{byte_order}{kinds}{'I' * len(self._tail)}")

    def read(self, machine: Machine) -> bytes:
        """The words as they are now, packed."""
        return self._struct.pack(*[reading(machine) for reading in self._readings], *self._tail)
