"""What the paper reports, and why ours differs. Its source has no figures: only the text and Table I."""

from __future__ import annotations

ACCURACY = {"MFO": 0.58, "ADV": 0.58, "FGS": 0.71, "RLGS": 0.81, "GHAL360": 0.84}
"""Table I, overall."""
REFERENCE = {"MFO": 0.56, "ADV": 0.56, "FGS": 0.74, "RLGS": 0.79, "GHAL360": 0.84}
"""Configuration F1 in an independent implementation, on floors of its own."""
RANGES = {"ADV": (0.52, 0.66), "FGS": (0.68, 0.75), "RLGS": (0.78, 0.82), "GHAL360": (0.81, 0.87)}
"""Smallest and largest entry of Table I."""

WHY = (
    """The paper gives no map, cell, step, field of view, detection range, time limit, nor what accuracy is; it is
    taken for the share of targets noticed within 330 s.""",
    """MFO and ADV are one and the same process here: turning the base takes as long as turning the head, and both
    look and drive the same way.""",
    """That FGS does worse than RLGS cannot come from avoiding clutter: with the same human the two differ by under
    0.01. In F1 it comes from one assumption: only the learned systems ask to confirm, and what is not asked for is
    noticed with probability 0.3 per look (0.1 in clutter). The row "everyone recognises at once" is without it.""",
    """GHAL360 is better than RLGS far away because random forward and back is a walk without drift, and driving where
    one looks is not.""",
)
"""Printed beside the table."""

OPTIMUM, FGS_VALUE = 228.976, 227.895
"""Exact values in the abstract simulation."""
