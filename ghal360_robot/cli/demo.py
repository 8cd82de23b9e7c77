"""`ghal360 demo`: one simulated search from start to found."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from ghal360_robot.cli.scenario import checked_scenario, detector_of_demo, dressed, with_target
from ghal360_robot.cli.session import Session, print_json, run_session
from ghal360_robot.cli.summary import print_summary
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.errors import GhalError

TIME_LIMIT_S = 240.0
"""Four minutes: the slowest of forty searches in simulated time took 214 s, half of them less than 45 s."""


def demo(
    world: Annotated[str, typer.Option(help="office or home")] = "office",
    seed: Annotated[int, typer.Option(help="Seed of the world, the noise and the operator", min=0)] = 0,
    target: Annotated[str, typer.Option(help="backpack, laptop, bottle or television")] = "backpack",
    detector: Annotated[
        str | None, typer.Option(help="One of `ghal360 detectors list`; centernet, or painted without its weights")
    ] = None,
    time_limit: Annotated[float, typer.Option(help="Seconds after which the search has failed", min=1)] = TIME_LIMIT_S,
    record: Annotated[Path, typer.Option(help="Where the recording's folder is made")] = Path("runs"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """One search on simulated devices with a virtual operator; ends by itself, mostly within a minute.

    Example: ghal360 demo --world home --target bottle --seed 3
    """
    scenario = checked_scenario(world=world, seed=seed, target=target)
    if detector is None:
        detector, why_not = detector_of_demo()
        if why_not:
            Console(stderr=True).print(why_not, highlight=False, soft_wrap=True)
    config = with_target(with_overrides(RobotConfig(), {"perception": {"detector": detector}}), target)
    ended = run_session(
        Session(
            config=config,
            scenario=dressed(scenario, config),
            virtual_operator=True,
            duration_s=time_limit,
            until_found=True,
            record_to=record,
            quiet=as_json,
        )
    )
    report = ended.report
    if as_json:
        print_json(report)
    else:
        print_summary(report)
    if not report.found and ended.interrupted:
        raise GhalError(f"interrupted after {report.seconds:.0f} s, before the {target} was found")
    if not report.found:
        raise GhalError(f"the {target} was not found within {time_limit:g} s; the recording shows the search")
    truth = report.simulation or {}
    if not truth.get("target_in_view"):
        raise GhalError(f"the operator took something else for the {target}: it was not in view")
    if truth.get("collisions"):
        raise GhalError(f"the robot touched something {truth['collisions']} times; the recording shows where")
