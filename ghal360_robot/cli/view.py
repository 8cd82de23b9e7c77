"""`ghal360 view`: a recorded run in the Rerun viewer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.logbook.viewer import find_files, start_viewer


def view(
    run: Annotated[Path, typer.Argument(help="A run's folder, or one .rrd file")],
    overlay: Annotated[
        Path | None, typer.Option(help="A replay's recording; by default the newest in the run's folder")
    ] = None,
    no_overlay: Annotated[bool, typer.Option("--no-overlay", help="The run alone")] = False,
    web: Annotated[
        int | None, typer.Option(metavar="PORT", help="Serve it to a browser on this machine instead", min=1, max=65535)
    ] = None,
) -> None:
    """Open a run with its layout, and what a replay would have decided over it.

    Example: ghal360 view runs/2026-10-11T09-30-00Z-a1b2c3 --web 9090
    """
    if overlay is not None and no_overlay:
        raise UsageError("--overlay names a recording and --no-overlay wants none: choose one")
    files = find_files(run, overlay, with_overlay=not no_overlay)
    if web is None and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise GhalError("there is no screen here: add --web 9090 and open http://127.0.0.1:9090 in a browser")
    with start_viewer(files, web) as viewer:
        for line in viewer.words:
            print(line)
        viewer.wait()
