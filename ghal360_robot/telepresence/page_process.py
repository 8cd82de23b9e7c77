"""The page's process: a web server between the robot's two sockets and the pages.

Started by `operator.PageProcess` with the descriptors of two socket pairs; ends when they close. It may be killed at
any time: the robot stands still and starts it again.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import signal
import socket
import ssl
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.errors import GhalError
from ghal360_robot.floor_map import FloorMap
from ghal360_robot.telepresence import link
from ghal360_robot.telepresence.access import Sessions, load_tokens
from ghal360_robot.telepresence.hub import Hub
from ghal360_robot.telepresence.protocol import Floor
from ghal360_robot.telepresence.server import NOT_BUILT, PageServer
from ghal360_robot.telepresence.settings import PageSettings
from ghal360_robot.telepresence.streams import Streams

if TYPE_CHECKING:
    from collections.abc import Callable

BUILT = Path(__file__).parent / "page" / "dist"
FLOOR_S = 1.0
NICENESS = 5
"""Below the control loop, above everything that can wait."""

logger = logging.getLogger("ghal360_robot.telepresence")


class Telling(logging.Handler):
    """What there is to say goes into the robot's log, and so into the recording."""

    def __init__(self, tell: Callable[[str, Any], object]) -> None:
        super().__init__(logging.INFO)
        self._tell = tell
        self.formatter = logging.Formatter("%(message)s")

    def emit(self, record: logging.LogRecord) -> None:
        self._tell("log", [record.levelno, self.format(record)[:500]])


class Process:
    """One run of the page's process."""

    def __init__(self, settings: PageSettings, writer: asyncio.StreamWriter) -> None:
        self._writer = writer
        self._floor = FloorMap()
        self._pose: tuple[float, float, float] | None = None
        self.hub = Hub(settings, self.tell, time.monotonic_ns)
        self.streams = Streams(settings)
        sessions = Sessions(load_tokens(Path(settings.token_file))) if settings.need_token else None
        self.server = PageServer(settings, self.hub, self.streams, sessions, BUILT)

    def tell(self, kind: str, value: Any) -> None:
        """One line to the robot."""
        link.send(self._writer, kind, value)

    async def listen(self, reader: asyncio.StreamReader) -> None:
        """What the robot says, until it is gone."""
        while (line := await link.receive(reader)) is not None:
            kind, value = line
            if kind == "state":
                place = value["pose"]
                self._pose = None if place is None else (place["x"], place["y"], place["yaw"])
            elif kind == "scan":
                self._map(value)
            if kind in {"state", "scan"}:
                self.hub.broadcast(kind, json.dumps({"kind": kind, **value}, separators=(",", ":")))

    async def watch(self, reader: asyncio.StreamReader) -> None:
        """The camera's access units, until the robot is gone."""
        while (frame := await link.receive_frame(reader)) is not None:
            self.streams.feed(frame)

    async def draw(self) -> None:
        """The map, once a second."""
        while True:
            await asyncio.sleep(FLOOR_S)
            if not self._floor.path or not self.hub.connections:
                continue
            x, y = self._floor.corner
            floor = Floor(
                kind="floor",
                png=await asyncio.to_thread(self._floor.png),
                resolution_m=0.1,
                x=round(x, 3),
                y=round(y, 3),
                path=tuple(self._floor.path),
            )
            self.hub.broadcast("floor", floor.model_dump_json())

    def _map(self, scan: dict[str, Any]) -> None:
        if self._pose is None:
            return
        ranges = np.asarray(scan["cm"], float) / 100.0
        yaws = scan["first"] + scan["step"] * (np.arange(len(ranges)) + 0.5)
        self._floor.add(self._pose, yaws, ranges)


async def serve(control: socket.socket, video: socket.socket) -> None:
    """One process, from its settings to the end of the robot's sockets."""
    reader, writer = await asyncio.open_connection(sock=control, limit=link.MAX_LINE_BYTES)
    first = await link.receive(reader)
    if first is None:
        return
    frames, video_writer = await asyncio.open_connection(sock=video, limit=4 << 20)
    try:
        process = Process(PageSettings.from_json(json.dumps(first[1])), writer)
        await process.server.start()
    except (GhalError, OSError, ssl.SSLError, ValueError) as error:
        link.send(writer, "error", _sentence(error))
        await writer.drain()
        return
    handler = Telling(process.tell)
    logging.getLogger("ghal360_robot").addHandler(handler)
    logging.getLogger("ghal360_robot").setLevel(logging.INFO)
    logging.getLogger("ghal360_robot").propagate = False
    link.send(writer, "listening", process.server.port)
    if not (BUILT / "index.html").is_file():
        logger.warning(NOT_BUILT)
    works = (process.listen(reader), process.watch(frames), process.draw(), process.server.beat())
    tasks = {asyncio.create_task(work) for work in works}
    try:
        with process.streams:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await process.server.close()
        logging.getLogger("ghal360_robot").removeHandler(handler)
        video_writer.close()
        writer.close()


def _sentence(error: Exception) -> str:
    if isinstance(error, ssl.SSLError):
        return f"the page's certificate and key do not fit or are none ({error}): make them with `ghal360 tls init`"
    if isinstance(error, OSError):
        return f"the page cannot be served: {error.strerror or error}; choose another [page] listen or port"
    return str(error)


def main() -> None:
    logging.basicConfig(level=logging.WARNING, format="page: %(message)s")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the robot's to handle: it still says good-bye to us
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
    control, video = (socket.socket(fileno=int(word)) for word in sys.argv[1:3])
    with contextlib.suppress(ConnectionError):
        asyncio.run(serve(control, video))


if __name__ == "__main__":
    main()
