"""A thread that works off what it is given until it is closed."""

from __future__ import annotations

import logging
import threading
from typing import Self

log = logging.getLogger(__name__)


class Worker:
    """Base of the threads that decode and detect: start, close, and the condition that guards what they share.

    `_run` of the subclass ends soon after `_closing` was set and `_changed` notified. Use as a context manager.
    """

    def __init__(self, name: str, close_timeout_s: float) -> None:
        self._close_timeout_s = close_timeout_s
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """End the thread after what it is at; what still waits is left."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(self._close_timeout_s)
            if self._thread.is_alive():
                log.error(
                    "The thread '%s' does not end; it is left behind and dies with the process.", self._thread.name
                )

    def _run(self) -> None:
        raise NotImplementedError
