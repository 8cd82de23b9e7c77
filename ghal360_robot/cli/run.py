"""`ghal360 run`: the robot service, on the real devices or on simulated ones."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ghal360_robot.cli.address import split_address
from ghal360_robot.cli.optional_value import LIVE
from ghal360_robot.cli.scenario import SIMULATED_DETECTOR, checked_scenario, dressed, with_target
from ghal360_robot.cli.session import Session, print_json, run_session
from ghal360_robot.cli.summary import print_summary
from ghal360_robot.config import load_config, with_overrides
from ghal360_robot.errors import UsageError


class OperatorKind(StrEnum):
    """Who drives."""

    VIRTUAL = "virtual"
    PAGE = "page"
    NONE = "none"


def run(
    *,
    config_path: Annotated[Path | None, typer.Option("--config", "-c", help="robot.toml; defaults without")] = None,
    sim: Annotated[bool, typer.Option("--sim", help="Wire-level simulators instead of the devices")] = False,
    duration: Annotated[float | None, typer.Option(help="Seconds to run; without, until SIGTERM or Ctrl-C")] = None,
    target: Annotated[str | None, typer.Option(help="Class name of the object to search for")] = None,
    operator: Annotated[OperatorKind, typer.Option(help="Who drives")] = OperatorKind.NONE,
    record: Annotated[Path | None, typer.Option(help="Where the recording's folder is made")] = None,
    world: Annotated[str, typer.Option(help="Simulated world: office or home")] = "office",
    seed: Annotated[int, typer.Option(help="Seed of the world, the noise and the operator", min=0)] = 0,
    camera_images: Annotated[
        Path | None, typer.Option(help="Folder of equirectangular pictures for the simulated camera")
    ] = None,
    lidar_replay: Annotated[Path | None, typer.Option(help="Recorded telegrams (.rec) for the simulated lidar")] = None,
    cut: Annotated[
        list[str] | None, typer.Option(help="Unplug a simulated device: DEVICE@START+SECONDS, e.g. tim571@10+5")
    ] = None,
    live: Annotated[
        str, typer.Option(metavar="[HOST:PORT]", help=f"Let Rerun viewers watch; without an address at {LIVE}")
    ] = "",
    live_web: Annotated[int, typer.Option(metavar="PORT", help="Serve the viewer to browsers, too", min=0)] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Run the robot until SIGTERM, Ctrl-C or the end of --duration.

    With `--operator page` it serves the telepresence page and says at which address. SIGUSR1 sets a bookmark in the
    recording.

    Example: ghal360 run --sim --operator virtual --target backpack --duration 60
    """
    config = load_config(config_path)
    if live or live_web:
        split_address(live or LIVE)
        config = with_overrides(config, {"logbook": {"live": live or LIVE, "live_web_port": live_web}})
    simulated_only = {
        "--operator virtual": operator is OperatorKind.VIRTUAL,
        "--camera-images": camera_images is not None,
        "--lidar-replay": lidar_replay is not None,
        "--cut": bool(cut),
    }
    if not sim and any(simulated_only.values()):
        option = next(name for name, used in simulated_only.items() if used)
        raise UsageError(f"{option} needs --sim: it is a part of the simulation")
    if duration is not None and not 0 < duration < 1e7:
        raise UsageError("--duration is a number of seconds above zero")
    scenario = None
    if sim:
        scenario = checked_scenario(
            world=world,
            seed=seed,
            target=target or config.perception.target or "backpack",
            camera_images=camera_images,
            lidar_replay=lidar_replay,
            cuts=cut or [],
            operator=operator is OperatorKind.VIRTUAL,
        )
        detector = "none" if camera_images is not None else SIMULATED_DETECTOR
        if config.perception.detector == "none":
            config = with_overrides(config, {"perception": {"detector": detector}})
    config = with_target(config, target or (scenario.target if scenario and not camera_images else None))
    ended = run_session(
        Session(
            config=config,
            scenario=scenario and dressed(scenario, config),
            virtual_operator=operator is OperatorKind.VIRTUAL,
            duration_s=duration,
            until_found=False,
            record_to=record or config.logbook.directory,
            quiet=as_json,
            page=operator is OperatorKind.PAGE,
        )
    )
    if as_json:
        print_json(ended.report)
    else:
        print_summary(ended.report)
