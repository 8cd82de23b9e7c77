"""The 96 feedback words of dialect B2, in wire order (fact sheet 4.1 to 4.3).

Names are the vendor's. A bitmap bit that is set puts its word into every reply; bit 0 comes first.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from drivers.rmp110.codec.parameters import Kind


@dataclass(frozen=True, slots=True)
class Word:
    """One feedback word: which bit of which bitmap (1..3) switches it on, and how it is read."""

    bitmap: int
    bit: int
    name: str
    kind: Kind
    unit: str


Entry = tuple[str, Kind, str]
"""Name, kind, unit of one bit."""

B2_BITMAPS: tuple[tuple[Entry, ...], ...] = (
    (
        ("fault_status_word_1", Kind.HEX, ""),
        ("fault_status_word_2", Kind.HEX, ""),
        ("fault_status_word_3", Kind.HEX, ""),
        ("fault_status_word_4", Kind.HEX, ""),
        ("mcu_0_fault_status", Kind.HEX, ""),
        ("mcu_1_fault_status", Kind.HEX, ""),
        ("mcu_2_fault_status", Kind.HEX, ""),
        ("mcu_3_fault_status", Kind.HEX, ""),
        ("operational_time", Kind.FLOAT, "s"),
        ("operational_state", Kind.UINT, ""),
        ("dynamic_response", Kind.HEX, ""),
        ("min_propulsion_batt_soc", Kind.FLOAT, "%"),
        ("aux_batt_soc", Kind.FLOAT, "%"),
        ("inertial_x_acc_g", Kind.FLOAT, "g"),
        ("inertial_y_acc_g", Kind.FLOAT, "g"),
        ("inertial_x_rate_rps", Kind.FLOAT, "rad/s"),
        ("inertial_y_rate_rps", Kind.FLOAT, "rad/s"),
        ("inertial_z_rate_rps", Kind.FLOAT, "rad/s"),
        ("pse_pitch_deg", Kind.FLOAT, "deg"),
        ("pse_pitch_rate_dps", Kind.FLOAT, "deg/s"),
        ("pse_roll_deg", Kind.FLOAT, "deg"),
        ("pse_roll_rate_dps", Kind.FLOAT, "deg/s"),
        ("pse_yaw_rate_dps", Kind.FLOAT, "deg/s"),
        ("pse_data_is_valid", Kind.HEX, ""),
        ("yaw_rate_limit_rps", Kind.FLOAT, "rad/s"),
        ("vel_limit_mps", Kind.FLOAT, "m/s"),
        ("linear_accel_mps2", Kind.FLOAT, "m/s^2"),
        ("linear_vel_mps", Kind.FLOAT, "m/s"),
        ("differential_wheel_vel_rps", Kind.FLOAT, "rad/s"),
        ("right_front_vel_mps", Kind.FLOAT, "m/s"),
        ("left_front_vel_mps", Kind.FLOAT, "m/s"),
        ("right_rear_vel_mps", Kind.FLOAT, "m/s"),
    ),
    (
        ("left_rear_vel_mps", Kind.FLOAT, "m/s"),
        ("right_front_pos_m", Kind.FLOAT, "m"),
        ("left_front_pos_m", Kind.FLOAT, "m"),
        ("right_rear_pos_m", Kind.FLOAT, "m"),
        ("left_rear_pos_m", Kind.FLOAT, "m"),
        ("linear_pos_m", Kind.FLOAT, "m"),
        ("right_front_current_A0pk", Kind.FLOAT, "A"),
        ("left_front_current_A0pk", Kind.FLOAT, "A"),
        ("right_rear_current_A0pk", Kind.FLOAT, "A"),
        ("left_rear_current_A0pk", Kind.FLOAT, "A"),
        ("max_motor_current_A0pk", Kind.FLOAT, "A"),
        ("right_front_current_limit_A0pk", Kind.FLOAT, "A"),
        ("left_front_current_limit_A0pk", Kind.FLOAT, "A"),
        ("right_rear_current_limit_A0pk", Kind.FLOAT, "A"),
        ("left_rear_current_limit_A0pk", Kind.FLOAT, "A"),
        ("min_motor_current_limit_A0pk", Kind.FLOAT, "A"),
        ("front_base_batt_1_soc", Kind.FLOAT, "%"),
        ("front_base_batt_2_soc", Kind.FLOAT, "%"),
        ("rear_base_batt_1_soc", Kind.FLOAT, "%"),
        ("rear_base_batt_2_soc", Kind.FLOAT, "%"),
        ("front_base_batt_1_temp_degC", Kind.FLOAT, "degC"),
        ("front_base_batt_2_temp_degC", Kind.FLOAT, "degC"),
        ("rear_base_batt_1_temp_degC", Kind.FLOAT, "degC"),
        ("rear_base_batt_2_temp_degC", Kind.FLOAT, "degC"),
        ("vel_target_mps", Kind.FLOAT, "m/s"),
        ("yaw_rate_target_rps", Kind.FLOAT, "rad/s"),
        ("angle_target_deg", Kind.FLOAT, "deg"),
        ("aux_batt_voltage_V", Kind.FLOAT, "V"),
        ("aux_batt_current_A", Kind.FLOAT, "A"),
        ("aux_batt_temp_degC", Kind.FLOAT, "degC"),
        ("abb_system_status", Kind.HEX, ""),
        ("aux_batt_status", Kind.HEX, ""),
    ),
    (
        ("aux_batt_faults", Kind.HEX, ""),
        ("7p2V_battery_voltage", Kind.FLOAT, "V"),
        ("ccu_sp_sw_build_id", Kind.UINT, ""),
        ("ccu_uip_sw_build_id", Kind.UINT, ""),
        ("mcu_0_inst_power_W", Kind.FLOAT, "W"),
        ("mcu_1_inst_power_W", Kind.FLOAT, "W"),
        ("mcu_2_inst_power_W", Kind.FLOAT, "W"),
        ("mcu_3_inst_power_W", Kind.FLOAT, "W"),
        ("mcu_0_total_energy_Wh", Kind.FLOAT, "Wh"),
        ("mcu_1_total_energy_Wh", Kind.FLOAT, "Wh"),
        ("mcu_2_total_energy_Wh", Kind.FLOAT, "Wh"),
        ("mcu_3_total_energy_Wh", Kind.FLOAT, "Wh"),
        ("fram_vel_limit_mps", Kind.FLOAT, "m/s"),
        ("fram_accel_limit_mps2", Kind.FLOAT, "m/s^2"),
        ("fram_decel_limit_mps2", Kind.FLOAT, "m/s^2"),
        ("fram_dtz_decel_limit_mps2", Kind.FLOAT, "m/s^2"),
        ("fram_coastdown_decel_mps2", Kind.FLOAT, "m/s^2"),
        ("fram_yaw_rate_limit_rps", Kind.FLOAT, "rad/s"),
        ("fram_yaw_accel_limit_rps2", Kind.FLOAT, "rad/s^2"),
        ("fram_tire_diameter_m", Kind.FLOAT, "m"),
        ("fram_wheelbase_length_m", Kind.FLOAT, "m"),
        ("fram_wheel_track_width_m", Kind.FLOAT, "m"),
        ("fram_transmission_ratio", Kind.FLOAT, ""),
        ("fram_config_bitmap", Kind.HEX, ""),
        ("fram_eth_ip_address", Kind.IP, ""),
        ("fram_eth_port_number", Kind.UINT, ""),
        ("fram_eth_subnet_mask", Kind.IP, ""),
        ("fram_eth_gateway", Kind.IP, ""),
        ("user_feedback_bitmap_1", Kind.HEX, ""),
        ("user_feedback_bitmap_2", Kind.HEX, ""),
        ("user_feedback_bitmap_3", Kind.HEX, ""),
        ("user_feedback_bitmap_4", Kind.HEX, ""),
    ),
)


def numbered(bitmaps: Iterable[Iterable[Entry]]) -> tuple[Word, ...]:
    """The words of these bitmaps, bit 0 of the first one first."""
    return tuple(
        Word(bitmap, bit, name, kind, unit)
        for bitmap, entries in enumerate(bitmaps, start=1)
        for bit, (name, kind, unit) in enumerate(entries)
    )


WORDS = numbered(B2_BITMAPS)
