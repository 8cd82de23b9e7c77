"""The terminal, on threads of its own: a frozen ssh session or Ctrl-S must never hold the control loop up."""

from __future__ import annotations

import logging
import queue
import threading
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener
from typing import TYPE_CHECKING

from rich.live import Live
from rich.logging import RichHandler

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console, RenderableType

QUEUED_LINES = 1000
"""What a terminal that nobody reads may owe; the recording has every line anyway."""

REFRESH_S = 0.25
JOIN_S = 1.0
"""A terminal that is frozen is left behind at the end."""


class _DroppingHandler(QueueHandler):
    """Drops lines when the terminal does not take them, without a word: where would it go."""

    def enqueue(self, record: logging.LogRecord) -> None:
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            return


@contextmanager
def log_lines(console: Console, level: int) -> Iterator[None]:
    """Print log lines of `level` and above on `console`, from another thread."""
    lines: queue.Queue[logging.LogRecord] = queue.Queue(QUEUED_LINES)
    printer = RichHandler(level, console, show_path=False, markup=False, rich_tracebacks=False)
    handler = _DroppingHandler(lines)
    handler.setLevel(level)
    listener = QueueListener(lines, printer, respect_handler_level=True)
    root = logging.getLogger()
    root.setLevel(logging.INFO)
    root.addHandler(handler)
    listener.start()
    try:
        yield
    finally:
        root.removeHandler(handler)
        stopper = threading.Thread(target=listener.stop, daemon=True)
        stopper.start()
        stopper.join(JOIN_S)


@contextmanager
def status_line(console: Console, render: Callable[[], RenderableType]) -> Iterator[None]:
    """Draw `render()` four times a second at the bottom of a terminal; nothing where there is none."""
    if not console.is_terminal:
        yield
        return
    ended = threading.Event()

    def draw() -> None:
        with Live(console=console, auto_refresh=False, transient=True) as live:
            while not ended.wait(REFRESH_S):
                live.update(render(), refresh=True)

    drawing = threading.Thread(target=draw, name="status line", daemon=True)
    drawing.start()
    try:
        yield
    finally:
        ended.set()
        drawing.join(JOIN_S)
