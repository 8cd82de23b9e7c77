"""The 85 feedback words of dialect B1: B2's words at other places (fact sheet 4.6)."""

from __future__ import annotations

from drivers.rmp110.codec.feedback_words import B2_BITMAPS, Entry, numbered

_B2: dict[str, Entry] = {entry[0]: entry for entries in B2_BITMAPS for entry in entries}

_STORED_IN_BITMAP_2 = (
    "fram_vel_limit_mps",
    "fram_accel_limit_mps2",
    "fram_decel_limit_mps2",
    "fram_dtz_decel_limit_mps2",
    "fram_coastdown_decel_mps2",
    "fram_yaw_rate_limit_rps",
)
"""Bits 26 to 31; bits 0 to 25 are B2's."""

_BITMAP_3 = (
    "fram_yaw_accel_limit_rps2",
    "fram_tire_diameter_m",
    "fram_wheel_track_width_m",
    "fram_transmission_ratio",
    "fram_config_bitmap",
    "fram_eth_ip_address",
    "fram_eth_port_number",
    "fram_eth_subnet_mask",
    "fram_eth_gateway",
    "user_feedback_bitmap_1",
    "user_feedback_bitmap_2",
    "user_feedback_bitmap_3",
    "aux_batt_voltage_V",
    "aux_batt_current_A",
    "aux_batt_temp_degC",
    "abb_system_status",
    "aux_batt_status",
    "aux_batt_faults",
    "7p2V_battery_voltage",
    "ccu_sp_sw_build_id",
    "ccu_uip_sw_build_id",
)

# Bit 8 of bitmap 1 is called frame_count in B1's own papers; it is the same float (fact sheet 4.1, 4.6).
WORDS = numbered(
    (
        B2_BITMAPS[0],
        (*B2_BITMAPS[1][:26], *(_B2[name] for name in _STORED_IN_BITMAP_2)),
        tuple(_B2[name] for name in _BITMAP_3),
    )
)
