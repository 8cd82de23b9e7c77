"""The 89 feedback words of dialect B3: one propulsion pack, odometry, IMU and GPS (fact sheet 4.6).

Words that say the same as in B2 carry the same name. Bits 23 and 24 of bitmap 3 are not in the factory's mask.
"""

from __future__ import annotations

from drivers.rmp110.codec.feedback_words import B2_BITMAPS, Entry, numbered
from drivers.rmp110.codec.parameters import Kind

_B2: dict[str, Entry] = {entry[0]: entry for entries in B2_BITMAPS for entry in entries}


def _same(*names: str) -> tuple[Entry, ...]:
    return tuple(_B2[name] for name in names)


def _floats(unit: str, *names: str) -> tuple[Entry, ...]:
    return tuple((name, Kind.FLOAT, unit) for name in names)


def _hex(*names: str) -> tuple[Entry, ...]:
    return tuple((name, Kind.HEX, "") for name in names)


_BITMAP_1 = (
    *_same("fault_status_word_1", "fault_status_word_2", "fault_status_word_3", "fault_status_word_4"),
    *_same("mcu_1_fault_status", "operational_time", "operational_state", "dynamic_response"),
    *_floats("%", "mcu_1_batt_soc"),
    *_floats("degC", "mcu_1_batt_temp_degC"),
    *_same("min_propulsion_batt_soc", "aux_batt_soc", "aux_batt_voltage_V", "aux_batt_current_A"),
    *_same("aux_batt_temp_degC", "abb_system_status"),
    *_same("right_front_current_A0pk", "left_front_current_A0pk", "max_motor_current_A0pk"),
    *_same("right_front_current_limit_A0pk", "left_front_current_limit_A0pk", "min_motor_current_limit_A0pk"),
    *_same("mcu_1_inst_power_W", "mcu_1_total_energy_Wh"),
    *_same("vel_limit_mps", "yaw_rate_limit_rps", "linear_accel_mps2", "linear_vel_mps"),
    *_same("differential_wheel_vel_rps", "right_front_vel_mps", "left_front_vel_mps", "right_front_pos_m"),
)
_BITMAP_2 = (
    *_same("left_front_pos_m", "linear_pos_m", "vel_target_mps", "yaw_rate_target_rps"),
    *_floats("m", "odom_x_m", "odom_y_m"),
    *_floats("rad", "odom_yaw_rad"),
    *_same("fram_vel_limit_mps", "fram_accel_limit_mps2", "fram_decel_limit_mps2", "fram_dtz_decel_limit_mps2"),
    *_same("fram_coastdown_decel_mps2", "fram_yaw_rate_limit_rps", "fram_yaw_accel_limit_rps2"),
    *_same("fram_tire_diameter_m", "fram_wheelbase_length_m", "fram_wheel_track_width_m", "fram_transmission_ratio"),
    *_same("fram_config_bitmap", "fram_eth_ip_address", "fram_eth_port_number", "fram_eth_subnet_mask"),
    *_same("fram_eth_gateway", "user_feedback_bitmap_1", "user_feedback_bitmap_2", "user_feedback_bitmap_3"),
    *_same("user_feedback_bitmap_4"),
    *_floats("m/s^2", "fram_lateral_accel_limit_mps2"),
    *_floats("g", "imu_x_acc_g", "imu_y_acc_g", "imu_z_acc_g"),
    *_floats("rad/s", "imu_x_rate_rps"),
)
_BITMAP_3 = (
    *_floats("rad/s", "imu_y_rate_rps", "imu_z_rate_rps"),
    *_floats("", "imu_x_mag", "imu_y_mag", "imu_z_mag"),
    *_floats("rad", "imu_roll", "imu_pitch", "imu_yaw"),
    *_floats("s", "imu_timestamp"),
    *_hex("gps_latitude_high", "gps_latitude_low", "gps_longitude_high", "gps_longitude_low"),
    *_hex("gps_ellipsoid_high", "gps_ellipsoid_low", "gps_sea_level_high", "gps_sea_level_low"),
    *_floats("m", "gps_horizontal_std_m", "gps_vertical_std_m"),
    *_hex("gps_flags_1", "gps_flags_2", "gps_flags_3", "imu_status", "imu_error", "packed_build_ids"),
)

WORDS = numbered((_BITMAP_1, _BITMAP_2, _BITMAP_3))
