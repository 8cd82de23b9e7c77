"""A writer of Rerun's that is slow, dead or lost is told from one that is well, in bounded time."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import pytest

from ghal360_robot.logbook import flusher
from ghal360_robot.logbook.flusher import STUCK, Flusher
from tests.logbook import robot

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


class Stream:
    """Flushes as it is told to."""

    def __init__(self, *flushes: Callable[[], None]) -> None:
        self.calls = 0
        self._flushes = iter(flushes)

    def flush(self, timeout_sec: float) -> None:
        assert timeout_sec > 0
        self.calls += 1
        next(self._flushes, lambda: None)()


def begun(*flushes: Callable[[], None]) -> tuple[Any, Flusher]:
    stream: Any = Stream(*flushes)
    return stream, Flusher(stream)


def fails(words: str) -> Callable[[], None]:
    def flush() -> None:
        raise RuntimeError(words)

    return flush


@pytest.fixture
def gate() -> Iterator[threading.Event]:
    event = threading.Event()
    yield event
    event.set()


def test_what_arrives_and_what_does_not_is_told_apart() -> None:
    stream, asked = begun(lambda: None, fails("File-writer thread shut down prematurely"))
    assert asked.flush() is None
    assert not asked.pending
    assert asked.flush() == "File-writer thread shut down prematurely"
    assert not asked.stuck
    asked.close()
    assert stream.calls == 2


def test_a_slow_disk_is_waited_for_and_asked_again_for_what_came_meanwhile(
    monkeypatch: pytest.MonkeyPatch, gate: threading.Event
) -> None:
    monkeypatch.setattr(flusher, "ANSWER_S", 0.05)
    stream, asked = begun(fails("Flush timed out"), lambda: (gate.wait(60), None)[1])
    assert asked.flush() is None
    assert asked.pending
    gate.set()
    robot.wait_for(lambda: asked.flush() is None and not asked.pending)
    assert stream.calls == 3
    asked.close()


def test_a_flush_that_never_comes_back_is_left_behind(monkeypatch: pytest.MonkeyPatch, gate: threading.Event) -> None:
    monkeypatch.setattr(flusher, "ANSWER_S", 0.02)
    monkeypatch.setattr(flusher, "STUCK_S", 0.2)
    _, asked = begun(lambda: (gate.wait(60), None)[1])
    begin = time.monotonic()
    robot.wait_for(lambda: asked.flush() == STUCK)
    assert asked.stuck
    assert time.monotonic() - begin > 0.2
