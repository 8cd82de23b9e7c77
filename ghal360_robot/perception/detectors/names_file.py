"""A list of class names, one a line, as darknet's `.names` files are."""

from __future__ import annotations

from ghal360_robot.perception.detectors.errors import WeightsError


def class_names(text: bytes) -> tuple[str, ...]:
    """Raises WeightsError where this is no text or holds no name."""
    try:
        names = tuple(line.strip() for line in text.decode().splitlines() if line.strip())
    except UnicodeDecodeError as error:
        raise WeightsError("The list of class names is no text in UTF-8.") from error
    if not names:
        raise WeightsError("The list of class names is empty.")
    return names
