"""`ghal360 detectors`: which detectors there are, how to add one, how good and how fast they are here."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.perception.detectors import store
from ghal360_robot.perception.detectors.base import CENTERNET, DETECTORS, DetectorOptions

if TYPE_CHECKING:
    from ghal360_robot.perception.detectors.measure import Accuracy, Speed

app = typer.Typer(help="Detectors and their weights.", no_args_is_help=True)

AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")]


class Precision(StrEnum):
    AUTO = "auto"
    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"
    FLOAT16 = "float16"


class Device(StrEnum):
    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"


@dataclass(frozen=True, slots=True)
class Result:
    """What was measured of one detector."""

    name: str
    speeds: list[Speed]
    accuracy: Accuracy | None

    def to_json(self) -> dict[str, Any]:
        return {
            "detector": self.name,
            "speed": [speed.to_json() for speed in self.speeds],
            "accuracy": None if self.accuracy is None else asdict(self.accuracy),
        }


LIMIT_RATIO = 1.2
"""Cutting, scaling, reading and merging may take a fifth of what the bare network takes on the same tiles."""


@app.command("list", epilog="Example: ghal360 detectors list --json")
def list_(as_json: AsJson = False) -> None:
    """Detectors that can be chosen on this machine, and where their weights are."""
    rows: dict[str, dict[str, Any]] = {name: {"kind": "built in", "ready": True, "files": []} for name in DETECTORS}
    kept = store.entries()
    rows[CENTERNET] = {"kind": CENTERNET, "ready": CENTERNET in kept, "files": []}
    for name, entry in kept.items():
        rows[name] = {"kind": entry.kind, "ready": True, "files": [str(path) for path, _ in entry.files.values()]}
    if as_json:
        print(json.dumps({"folder": str(store.cache_folder()), "detectors": rows}))
        return
    for name, row in rows.items():
        print(f"{name:16} {row['kind']}{'' if row['ready'] else f': run `ghal360 detectors add {name}`'}")


@app.command(epilog="Example: ghal360 detectors add yolov3 yolov3.cfg yolov3.weights")
def add(
    name: Annotated[str, typer.Argument(help="What it is to be called; centernet is fetched with npm")],
    paths: Annotated[
        list[Path] | None,
        typer.Argument(help="One .onnx file, or a .cfg and a .weights file; for centernet the packed npm package"),
    ] = None,
    classes: Annotated[Path | None, typer.Option(help="Class names, one a line; COCO's eighty without")] = None,
) -> None:
    """Keep a detector's weights on this machine, checked by hash and by loading them once."""
    from ghal360_robot.perception.detectors import adding  # noqa: PLC0415 - torch takes seconds to import

    entry = adding.add(name, paths or [], classes)
    print(f"added {entry.name} ({entry.kind}) in {store.cache_folder()}")


@app.command(epilog="Example: ghal360 detectors bench centernet --coco ../shared/data/coco50 --json")
def bench(
    names: Annotated[list[str] | None, typer.Argument(help="Which ones; all that are ready without")] = None,
    coco: Annotated[Path | None, typer.Option(help="COCO folder for average precision; only speed without")] = None,
    plan: Annotated[str, typer.Option(help="How the panorama is cut into tiles")] = "default",
    precision: Annotated[
        Precision, typer.Option(help="Number format; auto is half precision on CUDA")
    ] = Precision.AUTO,
    device: Annotated[Device, typer.Option(help="auto takes CUDA where there is some")] = Device.AUTO,
    repeat: Annotated[int, typer.Option(help="Panoramas timed", min=3, max=1000)] = 12,
    as_json: AsJson = False,
) -> None:
    """Milliseconds per panorama with one and two threads, against the bare network, and average precision.

    Exit status 1 where cutting and merging cost more than a fifth of the network. Times need an idle machine.
    """
    from ghal360_robot.perception.detectors import measure  # noqa: PLC0415 - torch takes seconds to import
    from ghal360_robot.perception.detectors.networks import make_network  # noqa: PLC0415

    chosen = names or list(store.entries())
    if not chosen:
        raise UsageError("no detector with weights is on this machine: run `ghal360 detectors add centernet`")
    panorama = measure.mosaic(coco)
    results = []
    for name in chosen:
        options = [DetectorOptions(plan, threads=n, precision=precision.value, device=device.value) for n in (1, 2)]
        speeds = [measure.speed(name, each, panorama, repeat) for each in options]
        accuracy = measure.accuracy(make_network(name, options[0]), coco) if coco is not None else None
        results.append(Result(name, speeds, accuracy))
    if as_json:
        print(
            json.dumps(
                {"plan": plan, "machine": measure.machine(), "detectors": [result.to_json() for result in results]}
            )
        )
    else:
        Console(highlight=False).print(_table(results))
    slow = [result.name for result in results if result.speeds[0].ratio > LIMIT_RATIO]
    if slow:
        raise GhalError(
            f"{', '.join(slow)}: a panorama takes more than {LIMIT_RATIO:g} times what the bare network takes; "
            "on a machine that is busy with something else, measure again"
        )


def _table(results: list[Result]) -> Table:
    table = Table(box=None, padding=(0, 2), pad_edge=False)
    table.add_column("detector")
    for title in ("1 thread ms", "2 threads ms", "of the bare network", "AP", "AP50"):
        table.add_column(title, justify="right")
    for result in results:
        one, two = result.speeds
        figures = result.accuracy
        ap = ("", "") if figures is None else (f"{figures.ap:.3f}", f"{figures.ap50:.3f}")
        table.add_row(result.name, f"{one.least_ms:.0f}", f"{two.least_ms:.0f}", f"{one.ratio:.2f}", *ap)
    return table
