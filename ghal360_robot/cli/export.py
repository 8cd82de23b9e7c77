"""`ghal360 export`: a run for other tools."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ghal360_robot.assembly import camera_mount, camera_view, lidar_mount
from ghal360_robot.config import RobotConfig, parse_config
from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.export.csv_tables import write_csv
from ghal360_robot.export.mcap import Mounts, write_mcap
from ghal360_robot.export.mp4 import FilmSettings, Look, write_mp4
from ghal360_robot.logbook.reader import RunReader

if TYPE_CHECKING:
    from collections.abc import Callable


def export(
    run: Annotated[Path, typer.Argument(help="A run's folder, or one .rrd file")],
    mp4: Annotated[Path | None, typer.Option(help="Film of the panorama with boxes, wedges and cue")] = None,
    mcap: Annotated[Path | None, typer.Option(help="MCAP file with ROS 2 messages; needs the extra [export]")] = None,
    csv: Annotated[Path | None, typer.Option(help="Folder for CSV tables")] = None,
    look: Annotated[
        Look, typer.Option(help="What the film shows: the panorama, or the operator's view")
    ] = Look.PANORAMA,
    width: Annotated[int, typer.Option(min=160, max=3840, help="Width of the film in pixels")] = 1280,
    from_s: Annotated[float, typer.Option("--from", min=0, help="Film from this second on")] = 0.0,
    to_s: Annotated[float, typer.Option("--to", min=0, help="... to this one")] = math.inf,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Write a recorded run as MP4, MCAP or CSV.

    Example: ghal360 export runs/2026-10-11T09-30-00Z-a1b2c3 --mp4 run.mp4 --mcap run.mcap
    """
    if mp4 is None and mcap is None and csv is None:
        raise UsageError("say what to write: --mp4 FILE, --mcap FILE or --csv FOLDER")
    report: dict[str, Any] = {}
    with RunReader(run) as reader:
        config = parse_config(reader.config_json, str(run)) if reader.config_json else RobotConfig()
        if mp4 is not None:
            film = FilmSettings(look, width, camera_view(config), config.perception.target, from_s, to_s)
            report["mp4"] = {"file": str(mp4), "pictures": _written(mp4, lambda: write_mp4(reader, mp4, film))}
        if mcap is not None:
            mounts = Mounts(lidar_mount(config), camera_mount(config))
            report["mcap"] = {"file": str(mcap), "messages": _written(mcap, lambda: write_mcap(reader, mcap, mounts))}
        if csv is not None:
            report["csv"] = {"folder": str(csv), "rows": _written(csv, lambda: write_csv(reader, csv))}
        report["damage"] = reader.damage
    if as_json:
        print(json.dumps(report))
        return
    for kind in ("mp4", "mcap", "csv"):
        if kind in report:
            what = report[kind]
            print(f"{kind}: {what.get('file') or what.get('folder')}, {_amount(what)}")
    for sentence in report["damage"]:
        print(sentence)


def _amount(what: dict[str, Any]) -> str:
    if "pictures" in what:
        return f"{what['pictures']} pictures"
    word, counts = ("messages", what["messages"]) if "messages" in what else ("rows", what["rows"])
    return f"{sum(counts.values())} {word} (" + ", ".join(f"{name} {count}" for name, count in counts.items()) + ")"


def _written(path: Path, write: Callable[[], Any]) -> Any:
    try:
        return write()
    except OSError as error:
        raise GhalError(f"cannot write {path}: {error.strerror or error}") from error
