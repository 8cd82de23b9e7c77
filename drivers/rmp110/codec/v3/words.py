"""The 132 words of a V3 status packet (fact sheet section 11); the line number is the index.

Words that say the same as on CAN carry the same name. Yaw is counter-clockwise here, velocities are m/s.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.rmp110.codec.feedback import Layout
from drivers.rmp110.codec.feedback_words import Entry, numbered
from drivers.rmp110.codec.parameters import BY_NAME, RMP110_TRACK_MINIMUM_M, Kind, Parameter


def _floats(unit: str, *names: str) -> tuple[Entry, ...]:
    return tuple((name, Kind.FLOAT, unit) for name in names)


def _hex(*names: str) -> tuple[Entry, ...]:
    return tuple((name, Kind.HEX, "") for name in names)


def _mcus(unit: str, name: str) -> tuple[Entry, ...]:
    return _floats(unit, *(name.format(n) for n in range(4)))


def _wheels(unit: str, name: str) -> tuple[Entry, ...]:
    return _floats(unit, *(name.format(wheel) for wheel in ("right_front", "left_front", "right_rear", "left_rear")))


def _aux(unit: str, name: str) -> tuple[Entry, ...]:
    return _floats(unit, *(name.format(n) for n in (1, 2)))


STORED_AT = 116
"""Index of the first stored parameter."""
MACHINE_ID_AT, STATE_AT = 12, 9
"""Indices that tell the byte order."""

_STATUS = (
    *_hex("fault_status_word_1", "fault_status_word_2", "fault_status_word_3", "fault_status_word_4"),  # 0
    *_hex("mcu_0_fault_status", "mcu_1_fault_status", "mcu_2_fault_status", "mcu_3_fault_status"),  # 4
    *_floats("s", "operational_time"),  # 8
    ("operational_state", Kind.UINT, ""),  # 9
    *_hex("dynamic_response", "packed_build_ids", "machine_id"),  # 10
)
_POWER = (
    *_floats("%", "min_propulsion_batt_soc"),  # 13
    *_mcus("%", "mcu_{}_batt_soc"),  # 14
    *_mcus("degC", "mcu_{}_batt_temp_degC"),  # 18
    *_mcus("W", "mcu_{}_inst_power_W"),  # 22
    *_mcus("Wh", "mcu_{}_total_energy_Wh"),  # 26
    *_wheels("A", "{}_current_A0pk"),  # 30
    *_floats("A", "max_motor_current_A0pk"),  # 34
    *_wheels("A", "{}_current_limit_A0pk"),  # 35
    *_floats("A", "min_motor_current_limit_A0pk"),  # 39
    *_aux("%", "aux_batt_{}_soc"),  # 40
    *_aux("V", "aux_batt_{}_voltage_V"),  # 42
    *_aux("A", "aux_batt_{}_current_A"),  # 44
    *_aux("degC", "aux_batt_{}_temp_degC"),  # 46
    *_hex("aux_batt_1_system_status", "aux_batt_2_system_status"),  # 48
    *_hex("aux_batt_1_status", "aux_batt_2_status"),  # 50
    *_hex("aux_batt_1_faults", "aux_batt_2_faults"),  # 52
    *_floats("V", "7p2V_battery_voltage"),  # 54
)
_ATTITUDE = (
    *_floats("g", "inertial_x_acc_g", "inertial_y_acc_g"),  # 55
    *_floats("rad/s", "inertial_x_rate_rps", "inertial_y_rate_rps", "inertial_z_rate_rps"),  # 57
    *_floats("deg", "pse_pitch_deg"),  # 60
    *_floats("deg/s", "pse_pitch_rate_dps"),  # 61
    *_floats("deg", "pse_roll_deg"),  # 62
    *_floats("deg/s", "pse_roll_rate_dps", "pse_yaw_rate_dps"),  # 63
    *_hex("pse_data_is_valid"),  # 65
    *_floats("", "ahrs_x_acc", "ahrs_y_acc", "ahrs_z_acc"),  # 66
    *_floats("", "ahrs_x_gyro", "ahrs_y_gyro", "ahrs_z_gyro"),  # 69
    *_floats("", "ahrs_x_mag", "ahrs_y_mag", "ahrs_z_mag"),  # 72
    *_floats("", "ahrs_roll", "ahrs_pitch", "ahrs_yaw"),  # 75
    *_floats("s", "ahrs_timestamp"),  # 78
    *_hex("gps_latitude_high", "gps_latitude_low", "gps_longitude_high", "gps_longitude_low"),  # 79
    *_hex("gps_ellipsoid_high", "gps_ellipsoid_low", "gps_sea_level_high", "gps_sea_level_low"),  # 83
    *_floats("m", "gps_horizontal_std_m", "gps_vertical_std_m"),  # 87
    *_hex("gps_flags_1", "gps_flags_2", "gps_flags_3", "imu_status", "imu_error"),  # 89
)
_MOTION = (
    *_floats("m/s", "vel_target_mps", "y_vel_target_mps"),  # 94
    *_floats("rad/s", "yaw_rate_target_rps", "yaw_rate_limit_rps"),  # 96
    *_floats("m/s", "vel_limit_mps"),  # 98
    *_wheels("m/s", "{}_vel_mps"),  # 99
    *_wheels("m", "{}_pos_m"),  # 103
    *_floats("m/s^2", "odom_x_acc_mps2", "odom_y_acc_mps2"),  # 107
    *_floats("rad/s^2", "odom_yaw_acc_rps2"),  # 109
    *_floats("m/s", "linear_vel_mps", "odom_y_vel_mps"),  # 110
    *_floats("rad/s", "odom_yaw_rate_rps"),  # 112
    *_floats("m", "odom_x_m", "odom_y_m"),  # 113
    *_floats("rad", "odom_yaw_rad"),  # 115
)

_CONFIG_ORDER = (
    "max_velocity",
    "max_accel",
    "max_decel",
    "max_dtz_decel",
    "max_yaw_rate",
    "max_yaw_accel",
    "lateral_accel",
    "tire_diameter",
    "wheel_base",
    "track_width",
    "gear_ratio",
    "input_bitmap",
    "ip_address",
    "ip_port",
    "subnet_mask",
    "gateway",
)
_RMP110_DEFAULTS: Mapping[str, float] = {
    "max_velocity": 0.5,
    "max_accel": 0.5,
    "max_decel": 0.5,
    "max_dtz_decel": 1.0,
    "max_yaw_rate": 1.0,
    "max_yaw_accel": 1.5,
    "track_width": 0.481224,
    "input_bitmap": 0x2,
}
"""What Stanley Innovation's own tools store in a 110 (fact sheet 7, 15.4); addresses are not published."""


def _parameter(number: int, name: str) -> Parameter:
    known = BY_NAME.get(name, Parameter(number, name, Kind.FLOAT, "m/s^2", 4.905, 0.981, 9.81))
    low = RMP110_TRACK_MINIMUM_M if name == "track_width" else known.minimum
    high = 0x7FFF if name == "input_bitmap" else known.maximum
    return Parameter(number, name, known.kind, known.unit, _RMP110_DEFAULTS.get(name, known.factory), low, high)


PARAMETERS: tuple[Parameter, ...] = tuple(_parameter(n, name) for n, name in enumerate(_CONFIG_ORDER, start=1))
"""In the order of the machine configuration command and of the status packet's last words."""
CONFIG_WORDS = 12
"""The first twelve make the machine configuration command; the rest are network settings."""

WORDS = numbered(
    ((*_STATUS, *_POWER, *_ATTITUDE, *_MOTION, *((f"stored_{p.name}", p.kind, p.unit) for p in PARAMETERS)),)
)
LAYOUT = Layout(WORDS)
