"""Fixtures of the lidar's tests: real recordings, and streams and scans made for a purpose."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.tim571.codec import commands
from drivers.tim571.codec.access import PASSWORDS, Level, password_hash
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.scandata import Channel, ScanData
from drivers.tim571.codec.telegram import Receiver, Telegram

RECORDINGS = Path(__file__).resolve().parents[4] / "shared" / "data" / "tim"


def recording(name: str) -> Path:
    """A file of real recordings, or skip: they are not part of the repository (licences)."""
    path = RECORDINGS / name
    if not path.exists():
        pytest.skip(f"real recordings are not here: {path} is missing")
    return path


def frames_of(path: Path) -> list[bytes]:
    """The framed telegrams of a `.rec` file."""
    data, at, frames = path.read_bytes(), 0, []
    while at < len(data):
        _, size = struct.unpack_from("<dI", data, at)
        frames.append(data[at + 12 : at + 12 + size])
        at += 12 + size
    return frames


@pytest.fixture(scope="session")
def rec() -> Callable[[str], Path]:
    """The path of a real recording by its file name."""
    return recording


@pytest.fixture(scope="session")
def cola_a_scans() -> list[bytes]:
    """51 real scan telegrams of a TiM561 in CoLa-A."""
    return frames_of(recording("tim561_cola_a.rec"))


@pytest.fixture(scope="session")
def cola_b_frames() -> list[bytes]:
    """277 real frames of a TiM781S in CoLa-B, both directions."""
    return frames_of(recording("tim781s_cola_b.rec"))


@pytest.fixture(scope="session")
def cola_b_scans(cola_b_frames: list[bytes]) -> list[bytes]:
    """The 140 scan telegrams among them."""
    return [frame for frame in cola_b_frames if frame[8:].startswith(b"sSN LMDscandata")]


@pytest.fixture(scope="session")
def command_pairs() -> list[dict[str, Any]]:
    """143 real requests with their answers."""
    lines = recording("command_pairs_colab.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]


@pytest.fixture(params=list(Dialect), ids=str)
def dialect(request: pytest.FixtureRequest) -> Dialect:
    """Each dialect in turn."""
    value: Dialect = request.param
    return value


@pytest.fixture(scope="session")
def make_scan() -> Callable[..., ScanData]:
    """A maker of plausible scans: `make_scan(counter, beams, **fields to replace)`."""
    return _make_scan


def _make_scan(counter: int = 7, beams: int = 811, **changes: Any) -> ScanData:
    """A plausible scan of a TiM571; `changes` replace fields."""
    samples = (np.arange(beams) * 7 + 500).astype(np.uint16)
    plain: dict[str, Any] = {
        "version": 1,
        "device": 1,
        "serial": 17461662,
        "status": (0, 0),
        "telegram_counter": counter,
        "scan_counter": counter + 2,
        "scan_tick_us": 1_000_000 + 66_667 * counter,
        "transmit_tick_us": 1_007_100 + 66_667 * counter,
        "inputs": (0, 0),
        "outputs": (1, 0),
        "layer": 0,
        "scan_frequency_chz": 1500,
        "measuring_frequency_100hz": 162,
        "channels16": (Channel("DIST1", 1.0, 0.0, -450000, 3333, samples),),
    }
    return ScanData(**(plain | changes))


Until = Callable[[Callable[[], bool]], Awaitable[None]]


@pytest.fixture
def until() -> Until:
    """Wait for a condition; fail after a minute."""

    async def wait(condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(60):
            while not condition():
                await asyncio.sleep(0.005)

    return wait


class Terminal:
    """A SOPAS client that does only what it is told."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, dialect: Dialect) -> None:
        self.reader = reader
        self.writer = writer
        self.receiver = Receiver(dialect)
        self.received: list[Telegram] = []

    async def next(self, kind: str = "", timeout_s: float = 5.0) -> Telegram:
        """The next telegram, or the next of a kind."""
        async with asyncio.timeout(timeout_s):
            while True:
                while self.received:
                    telegram = self.received.pop(0)
                    if kind in telegram.kind:
                        return telegram
                data = await self.reader.read(1 << 16)
                if not data:
                    raise EOFError
                events = self.receiver.feed(data)
                self.received += [event for event in events if isinstance(event, Telegram)]

    async def ask(self, request: Telegram | bytes) -> Telegram:
        """The answer to a request; scans in between are skipped."""
        self.writer.write(request if isinstance(request, bytes) else request.to_wire())
        while (answer := await self.next()).kind == "sSN":
            pass
        return answer

    async def silent(self, timeout_s: float = 0.15) -> bool:
        """Whether nothing at all arrives for a while."""
        try:
            await self.next(timeout_s=timeout_s)
        except TimeoutError:
            return True
        return False

    async def login(self, level: Level = Level.AUTHORISED_CLIENT) -> None:
        """Log in with the password of the manual."""
        request = commands.invoke(self.receiver.dialect, "SetAccessMode", level, password_hash(PASSWORDS[level]))
        assert commands.values_of(await self.ask(request)) == (1,)


@pytest.fixture
async def terminal() -> AsyncIterator[Callable[[int, Dialect], Awaitable[Terminal]]]:
    """Opens plain connections to a port: `await terminal(port, dialect)`."""
    opened: list[Terminal] = []

    async def connect(port: int, dialect: Dialect) -> Terminal:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        opened.append(Terminal(reader, writer, dialect))
        return opened[-1]

    yield connect
    for one in opened:
        one.writer.transport.abort()
        with suppress(ConnectionError):
            await one.writer.wait_closed()
