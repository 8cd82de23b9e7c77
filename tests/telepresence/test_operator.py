"""The robot's end with a real process behind it, and a page that is no browser in front."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import time
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import aiohttp
import pytest

from drivers.theta_v.codec.access_units import AccessUnit
from ghal360_robot.board import Board, make_board
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.errors import UsageError
from ghal360_robot.logbook import recorder as logbook
from ghal360_robot.logbook.inspection import inspect_run
from ghal360_robot.messages import OperatorInput, Received
from ghal360_robot.telepresence.frames import HEADER
from ghal360_robot.telepresence.operator import PageError, PageOperator
from ghal360_robot.telepresence.settings import PageSettings

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable


@dataclass
class Recorder:
    operators: list[OperatorInput] = field(default_factory=list)
    wishes: list[Received] = field(default_factory=list)

    def received(self, wish: Received) -> None:
        self.wishes.append(wish)


@dataclass
class Robot:
    """As much of one as the page needs."""

    board: Board = field(default_factory=lambda: make_board(RobotConfig(), 20.0))
    recorder: Recorder = field(default_factory=Recorder)
    loop: Any = field(default_factory=lambda: SimpleNamespace(newest=None))
    bookmark: Any = None

    def take_operator(self, message: OperatorInput) -> None:
        self.board.put_operator(message)
        self.recorder.operators.append(message)


async def met(condition: Callable[[], object], what: str, timeout_s: float = 20.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"waited {timeout_s} s for: {what}"
        await asyncio.sleep(0.01)


@asynccontextmanager
async def running(robot: Robot) -> AsyncIterator[PageOperator]:
    async with PageOperator(PageSettings(port=0)) as page:
        task = asyncio.create_task(page.run(robot), name="page")  # type: ignore[arg-type]
        try:
            yield page
            assert not task.done(), task.exception()
        finally:
            task.cancel()
            await asyncio.wait([task])


@asynccontextmanager
async def opened(
    page: PageOperator,
) -> AsyncIterator[tuple[aiohttp.ClientWebSocketResponse, str, aiohttp.ClientSession]]:
    async with (
        aiohttp.ClientSession() as http,
        http.ws_connect(page.url + "ctl", headers={"Origin": page.url.rstrip("/")}) as ws,
    ):
        hello = await ws.receive_json()
        yield ws, hello["conn"], http


def wish(conn: str, seq: int, **changes: Any) -> dict[str, Any]:
    return {
        "kind": "operate", "conn": conn, "seq": seq, "sent_us": time.monotonic_ns() // 1000, "yaw": 0.5, "pitch": 0.0,
        "fov_h": 1.8, "fov_v": 1.3, "mode": "screen", "deadman": False, "stick": None, "arm": 0, "disarm": 0,
        "found": 0, **changes,
    }  # fmt: skip


async def look(video: aiohttp.ClientWebSocketResponse, shown: list[int]) -> None:
    async for message in video:
        shown[:] = [HEADER.unpack(message.data[:24])[3]]


def unit(sequence: int) -> AccessUnit:
    data = b"\0\0\0\1\x65" + bytes(200)
    return AccessUnit(data, data, time.monotonic_ns(), time.monotonic_ns(), sequence, True, 64, 32)


async def test_what_the_driver_does_is_on_the_board_and_in_the_recording() -> None:
    robot = Robot()
    async with running(robot) as page:
        async with opened(page) as (ws, conn, http):
            await ws.send_json({"kind": "lease", "wish": "ask"})
            await met(lambda: robot.board.lease is not None, "the lease")
            async with http.ws_connect(
                f"{page.url}video?conn={conn}", headers={"Origin": page.url.rstrip("/")}
            ) as video:
                shown: list[int] = []
                looking = asyncio.create_task(look(video, shown))
                for attempt in range(40):  # a picture that is late on a busy machine locks driving
                    page.offer(unit(attempt))
                    await asyncio.sleep(0.1)
                    if shown:
                        await ws.send_json({"kind": "shown", "seq": shown[-1], "dropped": 0})
                        await ws.send_json(wish(conn, 2 * attempt))
                        await ws.send_json(wish(conn, 2 * attempt + 1, deadman=True, stick={"v": 1.0, "w": 0.0}))
                        await asyncio.sleep(0.1)
                    if robot.board.operator is not None and robot.board.operator.deadman:
                        break
                looking.cancel()
            operator, lease = robot.board.operator, robot.board.lease
            assert operator is not None
            assert lease is not None
            assert operator.stick is not None
            assert (operator.holder, operator.stick.v) == (lease.holder, 0.5)
            assert 0 <= time.monotonic_ns() - operator.stamp_ns < 2_000_000_000
            assert operator.latency_s > 0.0
            assert robot.board.locks["operator's picture"].engaged is False
            await ws.send_json({"kind": "stop", "level": "estop", "press": 1})
            await met(lambda: robot.board.stops.estop == 1, "the emergency stop")
            await ws.send_json(wish(conn, 0, deadman=True))
            await met(lambda: robot.recorder.wishes[-1].verdict != "taken", "the replayed wish in the recording")
        await met(lambda: not robot.recorder.operators[-1].deadman, "closing the page lets go")
        await met(lambda: robot.board.lease is None, "and gives the controls back")
    assert [w.verdict for w in robot.recorder.wishes[:2]] == ["taken", "taken"]
    assert robot.recorder.wishes[-1].verdict == "replayed or overtaken"


async def test_a_bookmark_of_the_page_is_in_the_recording(tmp_path: Path) -> None:
    robot = Robot()
    with logbook.Recorder(tmp_path, properties={}, config_json="") as recording:
        robot.bookmark = recording.bookmark
        async with running(robot) as page, opened(page) as (ws, _, _):
            await ws.send_json({"kind": "bookmark", "note": "the door is locked"})
            await met(lambda: recording.bookmarks, "the bookmark")
    (mark,) = inspect_run(recording.folder).bookmarks
    assert mark.holder.startswith("page-1-")
    assert mark.note == "the door is locked"


async def test_a_process_that_dies_takes_the_lease_with_it_and_comes_back_at_its_address(
    caplog: pytest.LogCaptureFixture,
) -> None:
    robot = Robot()
    async with running(robot) as page:
        async with opened(page) as (ws, _, _):
            await ws.send_json({"kind": "lease", "wish": "ask"})
            await met(lambda: robot.board.lease is not None, "the lease")
            port = page.port
            assert page.pid is not None
            os.kill(page.pid, signal.SIGKILL)
            await met(lambda: robot.board.lease is None, "the lease is gone")
        await met(lambda: page.restarts == 1 and page.pid is not None, "a new process")
        await met(lambda: page._tap is not None, "its pictures")
        async with opened(page) as (ws, _, _):
            assert page.port == port
    assert "has ended" in caplog.text


async def test_an_address_that_is_taken_is_one_sentence() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(PageError, match="cannot be served"):
            async with PageOperator(PageSettings(port=taken.getsockname()[1])):
                pass


async def test_a_certificate_that_is_none_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "page.crt"
    path.write_text("nonsense")
    with pytest.raises(PageError, match="tls init"):
        async with PageOperator(PageSettings(port=0, certificate=str(path), key=str(path))):
            pass


def test_another_address_needs_tls_and_asks_for_a_token() -> None:
    with pytest.raises(UsageError, match="tls init"):
        with_overrides(RobotConfig(), {"page": {"listen": "192.168.1.20"}})
    outside = with_overrides(RobotConfig(), {"page": {"listen": "192.168.1.20", "certificate": "a", "key": "b"}})
    assert PageSettings.of(outside).need_token
    assert not PageSettings.of(RobotConfig()).need_token
    assert PageSettings.of(with_overrides(RobotConfig(), {"page": {"ask_token": True}})).need_token
    with pytest.raises(UsageError, match="belong together"):
        with_overrides(RobotConfig(), {"page": {"certificate": "a"}})


def test_the_configured_page_is_where_the_process_will_be() -> None:
    settings = PageSettings.of(RobotConfig())
    assert (settings.listen, settings.port, settings.v_max) == ("127.0.0.1", 8360, 0.5)
    assert Path(settings.token_file).is_absolute()
    assert settings.blind[0] > 2.3 > -2.3 > settings.blind[1]
