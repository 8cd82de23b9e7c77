"""`ghal360 bench page`: how late the telepresence page is, measured on this machine."""

from __future__ import annotations

import asyncio
import json
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from ghal360_robot.bench import page as paging
from ghal360_robot.bench.stop import machine
from ghal360_robot.errors import GhalError, UsageError


def page(
    seconds: Annotated[float, typer.Option(help="How long to look", min=2, max=600)] = 20.0,
    pages: Annotated[int, typer.Option(help="Pages open at once", min=1, max=4)] = 2,
    mode: Annotated[str, typer.Option(help="The camera's: 2k or 4k")] = "2k",
    size: Annotated[str, typer.Option(help="Of each page, in pixels")] = "1280x720",
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """How old pictures are on the page and how long a round trip takes, with a whole robot and Chromium on it.

    Example: ghal360 bench page --pages 1 --json
    """
    width, _, height = size.partition("x")
    if not (width.isdigit() and height.isdigit() and 100 <= int(width) <= 4096 and 100 <= int(height) <= 4096):
        raise UsageError(f"'{size}' is no size: write WIDTHxHEIGHT, for example 1280x720")
    if mode not in paging.SIZES:
        raise UsageError(f"the camera has no mode '{mode}': choose one of {', '.join(paging.SIZES)}")
    console = Console(stderr=True, highlight=False, soft_wrap=True, quiet=as_json)
    console.print(f"a robot with {pages} page(s) for {seconds:g} s, and half a minute to come up ...")
    cost = asyncio.run(paging.measure(seconds, pages, mode, (int(width), int(height))))
    if as_json:
        print(json.dumps({**cost.to_json(), "mode": mode, "seconds": seconds, "machine": machine()}))
    else:
        busy = ", ".join(f"{part} {cores:.2f}" for part, cores in cost.cores.items())
        Console(highlight=False).print(_table(cost), f"cores kept busy: {busy}", sep="\n")
    if cost.missed:
        raise GhalError(
            f"budgets missed: {', '.join(cost.missed)}. The browser draws without a GPU on the same cores; "
            "on a machine that is busy with something else, measure again"
        )


def _table(cost: paging.PageCost) -> Table:
    table = Table(box=None, padding=(0, 2))
    table.add_column(f"{cost.pages} page(s), {cost.fps:g} pictures a second, {cost.dropped} dropped")
    for name in ("p50", "p95", "p99", "max"):
        table.add_column(name, justify="right")
    rows = (
        ("access unit at the robot to decoded frame on the page", cost.decoded),
        ("... to the frame that draws it", cost.drawn),
        ("control round trip", cost.round_trip),
    )
    for name, spread in rows:
        table.add_row(name, *(f"{value:.1f} ms" for value in (spread.p50, spread.p95, spread.p99, spread.max)))
    tick = cost.tick
    table.add_row(
        "the robot's tick, lateness", f"{tick['p50']:.1f} ms", "", f"{tick['p99']:.1f} ms", f"{tick['max']:.1f} ms"
    )
    return table
