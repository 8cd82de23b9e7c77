"""`ghal360 bench`: the robot's budgets, measured on this machine."""

from __future__ import annotations

import asyncio
import json
import signal
import time
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ghal360_robot.bench import log as logging
from ghal360_robot.bench import stop as stopping
from ghal360_robot.bench import tick as ticking
from ghal360_robot.cli import page
from ghal360_robot.errors import GhalError, UsageError

app = typer.Typer(help="The robot's budgets, measured on this machine; exit status 1 where one is missed.")
app.command("page")(page.page)

AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")]


@app.command()
def stop(
    repeat: Annotated[int, typer.Option(help="Stops measured for each cause", min=1, max=100)] = 1,
    cause: Annotated[
        list[str] | None, typer.Option(help=f"Only this one: {', '.join(cause.name for cause in stopping.CAUSES)}")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """How fast the robot stops for every reason there is to, at the base's end of a simulated bus.

    A real robot process drives with 0.45 m/s over real wires on loopback; then the cause strikes. Takes a minute.

    Example: ghal360 bench stop --cause loop-blocked --repeat 5
    """
    causes = _causes(cause or [])
    console = Console(stderr=True, highlight=False, soft_wrap=True, quiet=as_json)
    began = time.monotonic()
    try:
        results = asyncio.run(_stops(causes, repeat, console))
    except asyncio.CancelledError:
        raise GhalError("interrupted before every stop was measured") from None
    failed = [result.cause.name for result in results if not result.passed]
    if as_json:
        summary: dict[str, Any] = {
            "passed": not failed,
            "repeat": repeat,
            "seconds": round(time.monotonic() - began, 1),
            "machine": stopping.machine(),
            "stops": [result.to_json() for result in results],
        }
        print(json.dumps(summary))
    else:
        Console(highlight=False).print(_stop_table(results), "", "the robot said", _remarks(results))
    if failed:
        raise GhalError(
            f"{len(failed)} of {len(results)} causes missed a limit or were not measured: {', '.join(failed)}. "
            "On a machine that is busy with something else, measure again before looking for the reason"
        )


@app.command()
def tick(
    ticks: Annotated[int, typer.Option(help="Ticks to measure", min=1000, max=10_000_000)] = ticking.TICKS,
    as_json: AsJson = False,
) -> None:
    """What decoding the base's feedback, the safety chain and encoding its command cost in every control tick.

    Example: ghal360 bench tick --json
    """
    cost = ticking.measure(ticks)
    if as_json:
        print(json.dumps({**cost.to_json(), "machine": stopping.machine()}))
    else:
        Console(highlight=False).print(_tick_table(cost))
    if not cost.passed:
        raise GhalError(
            f"99 % of the ticks cost up to {cost.total.p99_us / 1e3:.2f} ms, the budget is {ticking.LIMIT_MS:g} ms. "
            "On a machine that is busy with something else, measure again; "
            "`python benchmarks/base_tick.py --profile` says which function costs what"
        )


@app.command()
def log(
    seconds: Annotated[float, typer.Option(help="Seconds to measure", min=5, max=3600)] = 60.0,
    picture_hz: Annotated[float, typer.Option(help="Pictures a second", min=1, max=50)] = 30.0,
    mbit_s: Annotated[float, typer.Option("--mbit-s", help="Rate of the video", min=0.1, max=200)] = 12.0,
    live_port: Annotated[int, typer.Option(help="Serve a live view on this port as well", min=0, max=65535)] = 0,
    as_json: AsJson = False,
) -> None:
    """What logging everything costs in time and bytes, beside a loop that only writes the bytes of the devices.

    Example: ghal360 bench log --json
    """
    console = Console(stderr=True, highlight=False, quiet=as_json)
    cost = logging.measure(seconds, picture_hz=picture_hz, mbit_s=mbit_s, live_port=live_port, say=console.print)
    if as_json:
        print(json.dumps({**cost.to_json(), "machine": stopping.machine()}))
    else:
        Console(highlight=False).print(_log_table(cost))
    if not cost.passed:
        raise GhalError(
            f"logging takes {cost.cpu_percent:g} % of a core (allowed {logging.CPU_PERCENT:g}) and writes "
            f"{cost.file_mb_per_min:g} MB/min (allowed {cost.allowed_mb_per_min:g}). "
            "On a machine that is busy with something else, measure again"
        )


def _causes(names: list[str]) -> list[stopping.Cause]:
    known = {cause.name: cause for cause in stopping.CAUSES}
    for name in names:
        if name not in known:
            raise UsageError(f"'{name}' is no cause to stop; the causes are {', '.join(known)}")
    return [cause for cause in stopping.CAUSES if not names or cause.name in names]


async def _stops(causes: list[stopping.Cause], repeat: int, console: Console) -> list[stopping.Result]:
    # As Ctrl-C does: leave in order, with the measured process ended and its folder removed.
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, _this_task().cancel)
    results = []
    for cause in causes:

        def say(number: int, words: str = cause.words) -> None:
            more = f" ({number + 1} of {repeat})" if repeat > 1 else ""
            console.print(f"driving until: {words}{more} ...")

        results.append(await stopping.measure_all(cause, repeat, say))
    return results


def _this_task() -> asyncio.Task[Any]:
    task = asyncio.current_task()
    if task is None:
        raise RuntimeError("not in a task")
    return task


def _stop_table(results: list[stopping.Result]) -> Table:
    several = any(len(result.samples) > 1 for result in results)
    columns = ("median", "worst", "limit") if several else ("measured", "limit")
    table = Table(box=None, padding=(0, 1), collapse_padding=True, pad_edge=False)
    table.caption, table.caption_justify = "milliseconds from the cause, at the base's end of the bus", "left"
    table.add_column("cause", no_wrap=True)
    for what in ("to zero", "to still"):
        for name in columns:
            table.add_column(f"{what}\n{name}", justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for result in results:
        values: list[str] = []
        for measured, limit in zip((result.to_zero_ms, result.to_standstill_ms), result.limits_ms, strict=True):
            figures = {"median": stopping.median(measured), "worst": stopping.worst(measured), "limit": limit}
            values += [_ms(figures.get(name, figures["worst"])) for name in columns]
        table.add_row(result.cause.words, *values, _verdict(result))
    return table


def _verdict(result: stopping.Result) -> str:
    if result.passed:
        return "ok"
    return "[bold red]not measured[/]" if result.trouble else "[bold red]too late[/]"


def _remarks(results: list[stopping.Result]) -> Table:
    """What the robot said about each stop."""
    table = Table(box=None, padding=(0, 1), show_header=False)
    for result in results:
        said = dict.fromkeys(remark for sample in result.samples for remark in sample.remarks)
        if result.trouble:
            said[result.trouble] = None
        table.add_row(result.cause.words, "\n".join(escape(remark) for remark in said) or "(nothing)")
    return table


def _log_table(cost: logging.LogCost) -> Table:
    table = Table(box=None, padding=(0, 2))
    for name in (f"{cost.picture_hz:g} pictures/s, {cost.mbit_s:g} Mbit/s", "logbook", "plain write", "allowed"):
        table.add_column(name, justify="left" if not table.columns else "right")
    table.add_row(
        "share of a core", f"{cost.cpu_percent:.1f} %", f"{cost.floor_cpu_percent:.1f} %", f"{logging.CPU_PERCENT:g} %"
    )
    written = (cost.file_mb_per_min, cost.raw_mb_per_min, cost.allowed_mb_per_min)
    table.add_row("written per minute", *(f"{mb:.1f} MB" for mb in written))
    table.add_row("ticks late, p99", f"{cost.lateness_ms['p99']:.1f} ms", f"{cost.floor_lateness_ms['p99']:.1f} ms")
    return table


def _tick_table(cost: ticking.TickCost) -> Table:
    table = Table(box=None, padding=(0, 2))
    table.add_column(f"{cost.ticks} ticks")
    for name in ("p50", "p99", "max"):
        table.add_column(name, justify="right")
    rows = (
        ("decode: 11 frames to base state", cost.decode),
        ("chain: freshness, safety, 811 beams", cost.chain),
        ("encode: motion frame, whitelist", cost.encode),
        (f"together; p99 at most {ticking.LIMIT_MS:g} ms", cost.total),
        ("scan: into the base frame, between ticks", cost.scan),
        ("floor: an empty turn of the event loop", cost.floor),
    )
    for name, spread in rows:
        table.add_row(name, *(f"{value / 1e3:.3f} ms" for value in (spread.p50_us, spread.p99_us, spread.max_us)))
    table.add_row("together, as a multiple of the floor", f"{cost.ratio:.1f}", "", "")
    return table


def _ms(value: float | None) -> str:
    return "never" if value is None else f"{value:.0f}"
