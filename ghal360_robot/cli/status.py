"""The live status line of a running robot: rates, ages, target, cue, intention, speed, and why not faster."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from ghal360_robot.messages import ArmState, Cue

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ghal360_robot.messages import Applied, Decision, Inputs, LinkStats
    from ghal360_robot.timing import Lateness

ARROWS = {Cue.NONE: "·", Cue.LEFT: "◀ left", Cue.RIGHT: "right ▶", Cue.CONFIRM: "◉ confirm"}
LINK_STYLE = {"streaming": "green", "backoff": "red", "closed": "red"}
ARM_STYLE = {ArmState.ARMED: "bold green", ArmState.DISARMED: "yellow", ArmState.ESTOP: "bold red"}


def status(
    newest: tuple[Inputs, Decision, Applied] | None,
    links: Mapping[str, LinkStats],
    lateness: Lateness,
    target: str,
    seconds: float,
    not_recorded: tuple[str, ...] = (),
) -> Table:
    """One screen line for each device and one for the robot."""
    grid = Table.grid(padding=(0, 2))
    for name, link in links.items():
        age = newest[0].freshness[name].age_s if newest else float("inf")
        grid.add_row(
            Text(name, style="bold"),
            Text(link.link, style=LINK_STYLE.get(link.link, "yellow")),
            f"{link.rate_hz:5.1f} Hz",
            f"age {age * 1e3:4.0f} ms" if age < 10 else "age  -",
            f"lost {link.lost}  damaged {link.damaged}  reconnects {link.reconnects}",
            Text(link.detail or link.condition, "red" if link.detail else "dim", overflow="ellipsis", no_wrap=True),
        )
    if newest is not None:
        _, decision, applied = newest
        grid.add_row(
            Text("robot", style="bold"),
            Text(applied.arm.value, style=ARM_STYLE[applied.arm]),
            Text(ARROWS[decision.cue], style="bold cyan"),
            f"{applied.twist.v:+.2f} m/s {applied.twist.w:+.2f} rad/s",
            f"intention {_intention(decision)}",
            Text(", ".join(applied.reasons), style="dim", overflow="ellipsis", no_wrap=True),
        )
    for sentence in not_recorded:
        grid.add_row(Text("logbook", style="bold"), Text("!", style="bold red"), *[""] * 3, Text(sentence, style="red"))
    late = lateness.summary()
    found = "in view" if newest is not None and newest[1].target_yaw is not None else "not in view"
    grid.add_row(
        Text(f"{seconds:5.1f} s", style="bold"),
        Text(target or "no target"),
        found if target else "",
        f"ticks late p99 {late['p99']:.1f} ms",
        f"max {late['max']:.0f} ms, skipped {lateness.skipped}",
        "",
    )
    return grid


def _intention(decision: Decision) -> str:
    strongest = max(decision.belief, default=0.0)
    if decision.intention is None:
        return f"none ({strongest:.0%})"
    return f"wedge {decision.intention} ({strongest:.0%})"
