"""The camera as the robot uses it: a decoder that stalls, and what the camera says of itself."""

from __future__ import annotations

import asyncio
import gc
import threading
from collections.abc import Iterator
from contextlib import AsyncExitStack
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.theta_v import AccessUnit, ThetaConfig
from drivers.theta_v.codec.ptp import Property
from drivers.theta_v.device import watch
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from ghal360_robot.config import ThetaSection
from ghal360_robot.hardware.camera import CameraInput
from ghal360_robot.messages import LinkStats
from ghal360_robot.perception import backlog
from ghal360_robot.perception.decode import QUEUE_UNITS, Picture, PictureDecoder
from tests.drivers.theta_v.pictures import KEY_INTERVAL, Feeder, stream, until

PICTURES = stream(30, 192, 96)
STALLED_PICTURES = 150  # five seconds of the camera's own rate
QUEUES = QUEUE_UNITS + ThetaConfig().queue_units


class Robot:
    """Camera, recorder and decoder as they are put together in the robot."""

    def __init__(self, server: UsbIpServer, decoder: PictureDecoder) -> None:
        self.recorded: list[int] = []
        recorder: Any = SimpleNamespace(access_unit=lambda stamp_ns, raw, sequence, *_: self.recorded.append(sequence))
        section = ThetaSection(transport="usbip", host=server.host, port=server.port)
        self.input = CameraInput(section, recorder, decoder)
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> Robot:
        await self.input.enter(self._stack)
        task = asyncio.create_task(self.input.run())
        self._stack.callback(task.cancel)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()


@pytest.fixture
def few_objects() -> Iterator[None]:
    """What there is already is left out of collections and counts: a walk through all of it stops every thread for so
    long that the computer seems held up to the camera's driver."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("few_objects")
async def test_a_decoder_that_stalls_costs_pictures_and_nothing_else() -> None:
    """Newest picture wins, drops are counted, memory stays bounded, and the camera streams on all the while."""
    go_on, stalled = threading.Event(), threading.Event()
    shown: list[Picture] = []

    def show(picture: Picture) -> None:
        shown.append(picture)
        if len(shown) == 5:
            stalled.set()
            assert go_on.wait(30)

    camera = SimulatedThetaV()
    with UsbIpServer(camera) as server, Feeder(camera, PICTURES), PictureDecoder(show) as decoder:
        async with Robot(server, decoder) as robot:
            await until(stalled.is_set)
            before = robot.input.stats()
            await until(lambda: robot.input.stats().received >= before.received + STALLED_PICTURES)
            gc.collect()
            # By type: isinstance() asks objects of other libraries for their class, and some complain.
            held = sum(issubclass(type(thing), AccessUnit | backlog.AccessUnit) for thing in gc.get_objects())
            meanwhile, newest = robot.input.stats(), len(robot.recorded)
            go_on.set()
            await until(lambda: len(shown) >= 8)
            after = robot.input.stats()
            dropped = decoder.stats().dropped
    assert (meanwhile.link, after.reconnects, after.damaged, after.lost) == ("streaming", 0, 0, 0)
    assert held <= QUEUES + 2, "no more pictures wait than the queues hold"
    assert robot.recorded == list(range(1, len(robot.recorded) + 1)), "the recorder misses none"
    assert dropped >= STALLED_PICTURES - QUEUES - KEY_INTERVAL
    resumed = shown[5]
    assert not resumed.tainted, "nothing is shown whose reference was dropped"
    assert resumed.number - shown[4].number - 1 == dropped, "each picture was shown, dropped and counted, or waits"
    behind = newest - resumed.number
    assert behind <= QUEUES + KEY_INTERVAL, "the newest pictures win"
    assert [p.number for p in shown[5:8]] == list(range(resumed.number, resumed.number + 3))


async def test_battery_charging_and_what_the_camera_complains_about_are_in_its_link(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(watch, "LULL_S", 0.02)
    camera = SimulatedThetaV()
    with UsbIpServer(camera) as server, Feeder(camera, PICTURES), PictureDecoder(lambda _: None) as decoder:
        async with Robot(server, decoder) as robot:

            def link() -> LinkStats:
                return robot.input.stats()

            await until(lambda: link().condition == "battery 98 %, charging" and link().link == "streaming")
            assert link().detail == ""
            camera.ptp.set(Property.ERROR_INFO, 0x00100000)
            await until(lambda: link().detail == "its board gets hot")
            camera.ptp.set(Property.BATTERY_STATUS, 0)
            camera.ptp.set(Property.BATTERY_LEVEL, 12)
            await until(lambda: "12 % and does not charge" in link().detail)
            camera.unplug()
            await until(lambda: "hot" not in link().detail and link().detail != "")
            assert link().condition == "", "what it said before it left is old"
