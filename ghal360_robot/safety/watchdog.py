"""The chain watches its own clock: a tick that comes much too late found the robot without a mind for as long."""

from __future__ import annotations

GAP_S = 0.15
"""Seven ticks of 20 ms. Less than the base driver's own watchdog waits (0.2 s): whenever that had to stop the base,
the chain knows by its own clock and disarms."""


def gap(before_ns: int | None, now_ns: int, limit_s: float = GAP_S) -> str:
    """What is wrong with this tick's time, in words; empty where nothing is."""
    if before_ns is None:
        return ""
    late_s = (now_ns - before_ns) / 1e9
    if late_s < 0.0:
        return "the clock ran backwards"
    return f"the control loop stood still for {late_s:.2f} s" if late_s > limit_s else ""
