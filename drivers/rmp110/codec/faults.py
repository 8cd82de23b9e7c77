"""Fault status words in words (fact sheet section 8). Faults latch until the base is power-cycled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

ARCHITECTURE = {
    0x001: "SPI receive",
    0x002: "SPI transmit",
    0x004: "SPI receive overrun",
    0x008: "SPI receive buffer overrun",
    0x010: "commanded safety shutdown",
    0x020: "commanded disable",
    0x040: "kill switch active",
    0x080: "stored configuration could not be read",
    0x100: "stored configuration could not be written",
    0x200: "bad model id",
    0x400: "bad CCU hardware revision",
    0x800: "deceleration switch active",
}
CRITICAL = {
    0x1: "initialisation",
    0x2: "initialisation of the user interface processor",
    0x4: "initialisation of propulsion",
    0x8: "initialisation timed out",
    0x10: "forward speed limiter hazard",
    0x20: "aft speed limiter hazard",
    0x40: "startup check",
    0x80: "velocity control failed",
    0x100: "position control failed",
    0x200: "auxiliary battery board shutdown",
    0x400: "mode transition timed out",
    0x800: "pitch angle exceeded",
    0x1000: "roll angle exceeded",
    0x2000: "balance sensor initialisation failed",
    0x4000: "balance sensor communication failed",
    0x8000: "balance sensor lost power",
    0x10000: "balance sensor hardware",
}
COMM = {
    0x1: "user interface processor data missing",
    0x2: "unknown message from the user interface processor",
    0x4: "bad checksum from the user interface processor",
    0x8: "transmission to the user interface processor",
    0x10: "bad motion command received",
    0x20: "unknown configuration command received",
    0x40: "bad packet checksum received",
}
INTERNAL = {0x1: "default condition hit", 0x2: "special case hit"}
SENSORS = {
    0x1: "2.5 V reference",
    0x2: "7.2 V battery out of range",
    0x4: "7.2 V battery warning",
    0x8: "7.2 V battery imbalance",
    0x10: "7.2 V battery temperature",
    0x20: "digital input",
    0x40: "range",
    0x80: "default",
    0x100: "5 V monitor",
    0x200: "12 V monitor",
}
BSA = {
    0x1: "side A missing",
    0x2: "side B missing",
    0x4: "unknown message",
    0x8: "transmission A failed",
    0x10: "transmission B failed",
    0x20: "default",
    0x40: "rate A saturated",
    0x80: "rate B saturated",
    0x100: "tilt A saturated",
    0x200: "tilt B saturated",
    0x400: "pitch estimates differ",
}
MCU_REQUESTS = {
    **{
        1 << (4 * unit + bit): f"motor controller {unit} {text}"
        for unit in range(4)
        for bit, text in enumerate(("degraded", "failed", "requests reduced performance", "requests zero speed"))
    },
    **{0x10000 << unit: f"data of motor controller {unit} missing" for unit in range(4)},
    0x100000: "unknown message from a motor controller",
}
MCU_STATUS = {
    0x1: "battery temperature warning",
    0x2: "cold battery limits regeneration",
    0x10: "low battery",
    0x20: "transient over-voltage",
    0x40: "critical over-voltage",
    0x80: "empty battery",
    0x100: "critical battery temperature",
    0x200: "link to the battery down",
    0x400: "communication initialisation failed",
    0x800: "calibration memory",
    0x1000: "power supply transient",
    0x2000: "12 V supply",
    0x4000: "5 V supply",
    0x8000: "3 V supply",
    0x10000: "junction temperature",
    0x20000: "winding temperature",
    0x40000: "motor drive",
    0x80000: "hall sensor",
    0x100000: "amplifier",
    0x200000: "amplifier enable",
    0x400000: "amplifier over-current",
    0x800000: "voltage feedback",
    0x1000000: "frame fault",
    0x2000000: "battery",
    0x8000000: "stuck relay",
    0x10000000: "actuator power consistency",
    0x20000000: "actuator halted the processor",
    0x40000000: "actuator degraded",
}

KILL_SWITCH = 0x40
"""Bit of fault status word 1."""
COMMANDED_DISABLE = 0x20
"""Bit of fault status word 1."""
BAD_MOTION_COMMAND = 0x10
"""Bit of fault status word 2."""
UNKNOWN_COMMAND = 0x20
"""Bit of fault status word 2."""

DYNAMIC_RESPONSES = {0x200: "it switches off after its kill switch was pressed"}
"""The only bit ever seen; the others were never published (fact sheet section 5)."""

ARCHITECTURE_V3 = {**ARCHITECTURE, 0x800: "invalid keys of the firmware's licence"}
"""V3 firmware gives bit 0x800 another meaning."""

Texts = Mapping[int, str]
Group = tuple[str, int, int, int, Texts]
"""Name, word, shift, mask after the shift, texts."""

GROUPS: tuple[Group, ...] = (
    ("architecture", 0, 0, 0xFFF, ARCHITECTURE),
    ("critical", 0, 12, 0xFFFFF, CRITICAL),
    ("communication", 1, 0, 0xFFFF, COMM),
    ("internal", 1, 16, 0xFFFF, INTERNAL),
    ("sensors", 2, 0, 0xFFFF, SENSORS),
    ("balance sensor", 2, 16, 0xFFFF, BSA),
    ("motor controllers", 3, 0, 0xFFFFFFFF, MCU_REQUESTS),
)
GROUPS_V3: tuple[Group, ...] = (("architecture", 0, 0, 0xFFF, ARCHITECTURE_V3), *GROUPS[1:])

LOG_GROUPS: tuple[tuple[str, Texts], ...] = (
    ("transient", {}),
    ("critical", CRITICAL),
    ("communication", COMM),
    ("sensors", SENSORS),
    ("balance sensor", BSA),
    ("motor controllers", MCU_REQUESTS),
    ("architecture", ARCHITECTURE),
    ("internal", INTERNAL),
)
"""In the order of a fault log entry; transient faults have no bits anywhere else and no published names."""


def fault_texts(words: Sequence[int], groups: Sequence[Group] = GROUPS) -> tuple[str, ...]:
    """Every set bit of fault status words 1..4 as `group: text`; bits nobody documented by their number."""
    if not any(words):
        return ()
    return tuple(
        f"{group}: {text}"
        for group, index, shift, mask, table in groups
        for text in bit_texts((words[index] >> shift) & mask, table)
    )


def mcu_fault_texts(unit: int, word: int) -> tuple[str, ...]:
    """Every set bit of one motor controller's own fault word."""
    return tuple(f"motor controller {unit}: {text}" for text in bit_texts(word, MCU_STATUS))


def dynamic_response_texts(word: int) -> tuple[str, ...]:
    """What the base does of its own accord."""
    return bit_texts(word, DYNAMIC_RESPONSES)


def bit_texts(word: int, table: Texts) -> tuple[str, ...]:
    """The text of every set bit, lowest first."""
    bits = [1 << bit for bit in range(32) if word >> bit & 1]
    return tuple(table.get(bit, f"unknown bit 0x{bit:X}") for bit in bits)
