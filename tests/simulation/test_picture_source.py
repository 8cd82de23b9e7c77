"""The picture process: it delivers, follows the pose, reports its death and never outlives its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from ghal360_robot.errors import GhalError
from ghal360_robot.messages import Pose2
from ghal360_robot.simulation.picture_source import (
    FolderPictureSource,
    PictureFolderError,
    PictureSource,
    PictureSourceError,
    RenderedPictureSource,
)

PATIENCE_S = 20.0


def wait_until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


class Received:
    """Collects what a source delivers, and decodes it as it comes."""

    def __init__(self, source: PictureSource) -> None:
        self.units: list[tuple[int, bytes]] = []
        self.errors: list[Exception] = []
        self.threads: set[int] = set()
        source.on_access_unit(self._take)
        source.on_error(self.errors.append)

    def _take(self, stamp_ns: int, unit: bytes) -> None:
        self.threads.add(threading.get_ident())
        self.units.append((stamp_ns, unit))

    def pictures(self) -> list[np.ndarray]:
        decoder = av.CodecContext.create("h264", "r")
        decoded = [decoder.decode(av.Packet(unit)) for _, unit in list(self.units)]
        assert all(len(frames) == 1 for frames in decoded)
        return [frames[0].to_ndarray(format="rgb24") for frames in decoded]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, colour in (("a.png", (200, 60, 60)), ("b.jpg", (60, 200, 60))):
        cv2.imwrite(str(tmp_path / name), np.full((100, 200, 3), colour, np.uint8))
    (tmp_path / "notes.txt").write_text("not a picture")
    return tmp_path


def test_a_rendered_source_delivers_pictures_that_follow_the_pose() -> None:
    source = RenderedPictureSource("home", 1, "laptop", fps=10)
    received = Received(source)
    before_ns = time.monotonic_ns()
    with source:
        wait_until(lambda: len(received.units) >= 3, "three pictures")
        for index in range(2000):
            source.set_pose(Pose2(3.0, 3.0, index * 0.001))
        known = len(received.units)
        wait_until(lambda: len(received.units) >= known + 4, "pictures after the pose")
        statistics = source.statistics()
    assert not received.errors
    stamps = [stamp for stamp, _ in received.units]
    assert stamps == sorted(stamps)
    assert before_ns < stamps[0] < stamps[-1] < time.monotonic_ns()
    pictures = received.pictures()
    assert pictures[0].shape == (960, 1920, 3)
    still = np.abs(pictures[1].astype(int) - pictures[2]).mean()
    moved = np.abs(pictures[1].astype(int) - pictures[-1]).mean()
    assert moved > 5 * still + 3
    assert received.threads.isdisjoint({threading.get_ident()})
    assert statistics.pictures >= 7
    assert 1.0 < statistics.fps <= 10.5
    assert statistics.draw_ms > 0 < statistics.encode_ms


def test_a_folder_shows_its_pictures_in_turn(folder: Path) -> None:
    source = FolderPictureSource(folder, fps=10, seconds_each=0.5)
    received = Received(source)
    with source:
        wait_until(lambda: len(received.units) >= 12, "twelve pictures")
        source.set_pose(Pose2(1.0, 2.0, 3.0))
    shades = [picture.mean(axis=(0, 1)) for picture in received.pictures()]
    assert any(np.abs(shade - (60, 60, 200)).max() < 12 for shade in shades)
    assert any(np.abs(shade - (60, 200, 60)).max() < 12 for shade in shades)


def test_the_death_of_the_process_is_reported_once_and_closing_is_quick(folder: Path) -> None:
    source = FolderPictureSource(folder)
    received = Received(source)
    with source:
        wait_until(lambda: bool(received.units), "a picture")
        assert source._process is not None
        source._process.kill()
        wait_until(lambda: bool(received.errors), "the report")
        source.set_pose(Pose2())
        began = time.monotonic()
    assert time.monotonic() - began < 2.0
    assert len(received.errors) == 1
    assert isinstance(received.errors[0], PictureSourceError)
    assert source.error is received.errors[0]


def test_a_callback_that_fails_is_reported_and_does_not_hang_anything(folder: Path) -> None:
    source = FolderPictureSource(folder)
    received = Received(source)

    def stumble(stamp_ns: int, unit: bytes) -> None:
        raise KeyError(stamp_ns, len(unit))

    source.on_access_unit(stumble)
    with source:
        wait_until(lambda: bool(received.errors), "the report")
    assert isinstance(received.errors[0], KeyError)


@pytest.mark.alone
def test_closing_is_bounded_even_if_the_process_hangs(folder: Path) -> None:
    source = FolderPictureSource(folder)
    received = Received(source)
    with source:
        wait_until(lambda: bool(received.units), "a picture")
        process = source._process
        assert process is not None
        process.send_signal(signal.SIGSTOP)
        for _ in range(5000):
            source.set_pose(Pose2())
        began = time.monotonic()
    assert time.monotonic() - began < 5.0
    assert process.returncode == -signal.SIGKILL
    assert not received.errors
    source.close()


def test_a_failure_in_the_process_comes_back_as_its_sentence(folder: Path) -> None:
    source = FolderPictureSource(folder)
    for path in folder.glob("*.*g"):
        path.write_bytes(b"gone bad after the check")
    # It may go wrong before or after the process said that it is ready.
    with suppress(PictureSourceError):
        source.start()
    wait_until(lambda: source.error is not None, "the failure")
    source.close()
    assert isinstance(source.error, GhalError)
    assert "not a readable picture" in str(source.error)


def test_the_process_ends_when_its_parent_is_killed(folder: Path) -> None:
    script = (
        "import os, signal, sys\n"
        "from ghal360_robot.simulation.picture_source import FolderPictureSource\n"
        f"source = FolderPictureSource({str(folder)!r})\n"
        "source.start()\n"
        "print(source._process.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    parent = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60)
    assert parent.returncode == -signal.SIGKILL
    wait_until(lambda: not alive(int(parent.stdout)), "the orphan's end")


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state not in "ZX"


def test_worlds_and_folders_that_do_not_exist_are_refused_before_anything_starts(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="choose one of"):
        RenderedPictureSource("castle", 1)
    with pytest.raises(PictureFolderError, match="Cannot read the folder"):
        FolderPictureSource(tmp_path / "missing")
    with pytest.raises(PictureFolderError, match="no JPEG or PNG"):
        FolderPictureSource(tmp_path)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "not a readable picture"),
        (b"\xff\xd8\xff\xe0 not really", "not a readable picture"),
        (cv2.imencode(".png", np.zeros((100, 150, 3), np.uint8))[1].tobytes(), "twice as wide as high"),
    ],
)
def test_a_file_that_is_no_panorama_is_named(folder: Path, content: bytes, complaint: str) -> None:
    (folder / "c.jpg").write_bytes(content)
    with pytest.raises(PictureFolderError, match=rf"c\.jpg.*{complaint}"):
        FolderPictureSource(folder)


def test_no_descriptors_are_left_behind(folder: Path) -> None:
    def open_descriptors() -> int:
        return len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - a count, no paths

    before = open_descriptors()
    for _ in range(2):
        with FolderPictureSource(folder):
            pass
    assert open_descriptors() == before
