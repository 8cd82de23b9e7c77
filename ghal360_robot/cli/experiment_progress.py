"""What the experiments' commands share: a progress bar, and the files of results."""

from __future__ import annotations

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ghal360_robot.atomic import write_atomically
from ghal360_robot.errors import GhalError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rich.console import Console


@contextmanager
def progress(console: Console, what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar that is told how many pieces are done; drawn only then, so that no thread runs while processes fork."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=console, auto_refresh=False, transient=True)
    task = bar.add_task(what, total=total)
    shown = console.is_terminal and not console.quiet

    def on_done(count: int) -> None:
        bar.update(task, completed=count)
        if shown:
            bar.refresh()

    if shown:
        bar.start()
    try:
        yield on_done
    finally:
        if shown:
            bar.stop()


def write_results(folder: Path, name: str, results: dict[str, Any], csv: str) -> None:
    """`<name>.json` and `<name>.csv`. Raises GhalError where they cannot be written."""
    try:
        write_atomically(folder / f"{name}.json", (json.dumps(results, indent=1) + "\n").encode())
        write_atomically(folder / f"{name}.csv", csv.encode())
    except OSError as error:
        raise GhalError(f"cannot write results to {folder}: {error.strerror}") from error
