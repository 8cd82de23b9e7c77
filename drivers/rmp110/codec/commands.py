"""Frames from host to base: motion, poll, configuration, mode requests (fact sheet 3.2, 6)."""

from __future__ import annotations

from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, float_to_word, pack_words
from drivers.rmp110.codec.parameters import BY_NUMBER, ModeRequest, Number


def motion(velocity: float, yaw_rate: float) -> Frame:
    """A motion frame of normalised values, -1..1; positive yaw rate is clockwise (fact sheet 3.3)."""
    return pack_words(MOTION_ID, float_to_word(velocity), float_to_word(yaw_rate))


ZERO_MOTION = motion(0.0, 0.0)


def configure(number: int, value: float = 0) -> Frame:
    """A configuration frame; `value` is in the parameter's unit, or the action's whole number."""
    parameter = BY_NUMBER.get(number)
    word = parameter.word(value) if parameter else int(value)
    return pack_words(CONFIG_ID, number, word)


POLL = configure(Number.NONE)
"""Does nothing and triggers feedback."""


def request_mode(mode: ModeRequest) -> Frame:
    """Ask for a mode; the base reports it 40 to 50 ms later."""
    return configure(Number.MODE_REQUEST, mode)
