"""`ghal360 figures`: draw saved results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from ghal360_robot.atomic import write_atomically
from ghal360_robot.errors import GhalError, UsageError

DEFAULT = ("runs/train/train.json", "runs/evaluate/paper.json", "runs/evaluate/beyond.json", "runs/evaluate/stack.json")


def figures(
    results: Annotated[list[Path] | None, typer.Argument(help="Saved results; those of the default folders")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the figures")] = Path("runs/figures"),
    rerun: Annotated[bool, typer.Option("--rerun/--no-rerun", help="Also as one .rrd for the Rerun viewer")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Draw every figure of saved results as PNG and SVG, the same bytes from the same results.

    Example: ghal360 figures runs/train/train.json --out docs
    """
    try:
        from ghal360_robot.experiments import figures as drawing  # noqa: PLC0415 - needs the extra [experiments]
    except ModuleNotFoundError as error:
        raise GhalError(f"{error.name} is missing: pip install 'ghal360-robot[experiments]'") from error
    from ghal360_robot.logbook.experiment_plots import write_plots  # noqa: PLC0415

    files = results or [Path(name) for name in DEFAULT if Path(name).exists()]
    if not files:
        raise UsageError("there are no results yet: run ghal360 train or ghal360 evaluate first, or name a file")
    loaded = [_load(file) for file in files]
    written: list[str] = []
    try:
        for file, result in zip(files, loaded, strict=True):
            for name, figure in _draw(drawing.draw, file, result).items():
                for suffix, data in ((".png", drawing.to_png(figure)), (".svg", drawing.to_svg(figure))):
                    write_atomically(out / (name + suffix), data)
                    written.append(str(out / (name + suffix)))
    except OSError as error:
        raise GhalError(f"cannot write figures to {out}: {error.strerror}") from error
    if rerun:
        write_plots(out / "experiments.rrd", loaded)
        written.append(str(out / "experiments.rrd"))
    if as_json:
        print(json.dumps({"figures": written}))
    else:
        print("\n".join(written))


def _draw(draw: Any, file: Path, result: dict[str, Any]) -> dict[str, Any]:
    try:
        drawn: dict[str, Any] = draw(result)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise UsageError(f"{file} holds no results that can be drawn: {type(error).__name__} {error}") from error
    return drawn


def _load(file: Path) -> dict[str, Any]:
    try:
        found = json.loads(file.read_text())
    except OSError as error:
        raise UsageError(f"cannot read {file}: {error.strerror}") from error
    except ValueError:
        raise UsageError(f"{file} is no JSON file") from None
    if not isinstance(found, dict) or found.get("kind") not in {"train", "paper", "beyond", "stack"}:
        raise UsageError(f"{file} holds no results of ghal360 train or evaluate")
    return found
