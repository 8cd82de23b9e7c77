"""`ghal360 config`: check, show and explain the robot's settings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ghal360_robot.assembly import detector_options
from ghal360_robot.config import RobotConfig, load_config
from ghal360_robot.perception.detectors.base import make_detector

app = typer.Typer(help="Check, show and explain the robot's settings.", no_args_is_help=True)


@app.command(epilog="Example: ghal360 config check robot.toml")
def check(path: Path) -> None:
    """Say whether a configuration file is valid; exit status 2 and one sentence if not."""
    config = load_config(path)
    make_detector(config.perception.detector, detector_options(config))
    print(f"{path} is valid; sha256 {config.sha256()[:16]}")


@app.command(epilog="Example: ghal360 config show robot.toml --json")
def show(
    path: Annotated[Path | None, typer.Argument(help="robot.toml; defaults without")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Print the effective settings: the file's, and the defaults for the rest."""
    data = load_config(path).model_dump(mode="json")
    if as_json:
        print(json.dumps(data))
        return
    for section, values in data.items():
        print(f"[{section}]")
        for key, value in values.items():
            print(f"{key} = {json.dumps(value)}")
        print()


@app.command(epilog="Example: ghal360 config schema > robot.schema.json")
def schema() -> None:
    """Print the JSON schema of robot.toml: every key with unit, bound and meaning."""
    print(json.dumps(RobotConfig.model_json_schema(), indent=2))
