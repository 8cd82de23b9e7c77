"""`ghal360`: assembles the commands and turns errors into one sentence and an exit status."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.markup import escape

from drivers.rmp110.errors import RmpError
from drivers.theta_v.errors import ThetaError
from drivers.tim571.errors import TimError
from ghal360_robot import __version__
from ghal360_robot.cli import (
    bench,
    config,
    demo,
    detectors,
    export,
    inspect,
    pictures,
    probe,
    replay,
    run,
    simulate,
    tls,
    token,
    view,
)
from ghal360_robot.cli.careful import run_in_child, wants_child
from ghal360_robot.cli.evaluate import evaluate
from ghal360_robot.cli.figures import figures
from ghal360_robot.cli.optional_value import LiveCommand
from ghal360_robot.cli.train import train
from ghal360_robot.errors import GhalError
from ghal360_robot.logbook.errors import LogbookError

if TYPE_CHECKING:
    from collections.abc import Callable

SENTENCES = (GhalError, LogbookError, RmpError, ThetaError, TimError)
"""Errors whose text is for the person at the robot; anything else is a bug and keeps its traceback."""

app = typer.Typer(
    name="ghal360",
    help="Onboard software of a 360° telepresence robot: live, simulated at the wire, or replayed.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("run", cls=LiveCommand)(run.run)
app.command("demo")(demo.demo)
app.add_typer(probe.app, name="probe")
app.add_typer(simulate.app, name="simulate")
app.command("inspect")(inspect.inspect)
app.command("replay")(replay.replay)
app.command("export")(export.export)
app.command("view")(view.view)
app.add_typer(bench.app, name="bench")
app.add_typer(config.app, name="config")
app.add_typer(detectors.app, name="detectors")
app.command("pictures")(pictures.pictures)
app.add_typer(tls.app, name="tls")
app.command("token")(token.addresses)
app.command("train")(train)
app.command("evaluate")(evaluate)
app.command("figures")(figures)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"ghal360-robot {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Say which version this is."
    ),
) -> None:
    """Options before any command."""


def main() -> None:
    """Entry point: exit 0, 1 (failed, one sentence) or 2 (usage)."""
    if wants_child(sys.argv[1:]):
        status, sentence = run_in_child(sys.argv[1:])
        sys.exit(guarded(lambda: _fail(sentence)) if sentence else status)
    sys.exit(guarded(app))


def _fail(sentence: str) -> None:
    raise GhalError(sentence)


def guarded(command: Callable[[], None]) -> int:
    """Run a command; a GhalError becomes its sentence on stderr and its exit status."""
    try:
        command()
    except SENTENCES as error:
        Console(stderr=True, highlight=False, soft_wrap=True).print(f"[bold red]error:[/] {escape(str(error))}")
        return error.exit_status if isinstance(error, GhalError) else 1
    except KeyboardInterrupt:
        return 1
    return 0
