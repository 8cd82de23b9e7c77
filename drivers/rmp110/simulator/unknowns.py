"""What nobody published about the real base (fact sheet section 16); the defaults are the worse of what it may do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Unknowns:
    """One guess about the machine per field."""

    poll_refreshes_motion: bool = False
    """Whether a configuration frame also restarts the motion timeout."""
    dtz_switches_off: bool = True
    """Whether "decelerate to zero" ends with the power off, or in STANDBY."""
    standby_while_rolling: bool = False
    """Whether a STANDBY request is obeyed at speed; otherwise it is ignored."""
    bad_motion_faults: bool = True
    """Whether a command that is no number or beyond 1 latches a fault; otherwise it is only ignored."""
    unknown_command_faults: bool = True
    reset_spares_feedback: bool = False
    """Whether resetting the parameters leaves the feedback bitmaps alone."""
    narrow_track: bool = False
    """Whether track widths below the documented 0.506476 m, as the 110 itself has, are accepted."""
    refused_bitmaps: frozenset[int] = frozenset()
    """Input bitmaps that this base does not take; one was seen that refused 0x101."""
    odd_word: int = 0
    """Second half of the last frame where a reply has an odd number of words."""
    float32_positions: bool = True
    """Whether wheel positions are summed up in float32: they then stick far from zero."""
    most_hz: float | None = None
    """Commands that come faster are ignored; 100 Hz is documented as the most, nobody says what happens beyond."""
    streaming_answers: bool = True
    """Whether requests are still answered one by one while the 100 Hz stream runs."""
    empty_switches_off: bool = True
    """Whether an empty battery switches the base off."""
    charger_blocks: bool = True
    """Whether TRACTOR is refused while the charger is plugged in, unless the input bitmap allows it."""
