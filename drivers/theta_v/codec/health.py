"""What the camera says about itself while it streams: battery, charging, faults (fact sheet section 4.3)."""

from __future__ import annotations

from dataclasses import dataclass

ERRORS: dict[int, str] = {
    0x00000001: "its memory is full",
    0x00000004: "its file numbers are used up",
    0x00000008: "its clock is not set",
    0x00000010: "its compass is disturbed",
    0x00100000: "its board gets hot",
    0x00200000: "its battery is too hot, it will switch off",
    0x00400000: "its shooting hardware has failed",
    0x08000000: "its memory cannot be accessed",
    0x20000000: "it reports a fault without a name",
    0x40000000: "it cannot charge, it will switch off",
    0x80000000: "its board is too hot, it will switch off",
}
"""ErrorInfo (0xD006), in words that follow "the camera says:"."""

HARMLESS = 0x00000001 | 0x00000004 | 0x00000008 | 0x00000010
"""Bits that do not concern a live stream: nothing is stored, and nobody asks for the time or north."""

CHARGING = ("not charging", "charging", "full")
LOW_BATTERY_PERCENT = 20  # a V that is not charged streams for another hour and a half


@dataclass(frozen=True, slots=True)
class Health:
    battery_percent: int
    battery_status: int
    error_bits: int

    @property
    def charging(self) -> str:
        known = self.battery_status < len(CHARGING)
        return CHARGING[self.battery_status] if known else f"battery status {self.battery_status}"

    @property
    def faults(self) -> tuple[str, ...]:
        """What the robot's people should know, most urgent first."""
        return (*self._errors, *self._worries)

    @property
    def _worries(self) -> tuple[str, ...]:
        if self.battery_status != 0 or self.battery_percent > LOW_BATTERY_PERCENT:
            return ()
        return (f"its battery is down to {self.battery_percent} % and does not charge",)

    @property
    def _errors(self) -> tuple[str, ...]:
        bits = self.error_bits & ~HARMLESS
        known = tuple(text for bit, text in sorted(ERRORS.items(), reverse=True) if bits & bit)
        unknown = bits & ~sum(ERRORS)
        return (*known, f"it reports unknown faults {unknown:#010x}") if unknown else known
