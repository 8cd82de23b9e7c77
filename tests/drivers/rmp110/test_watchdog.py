"""The thread that stops the base when the event loop is stuck: its rules by hand, then the thread itself."""

from __future__ import annotations

import asyncio
import time
from typing import Any

import pytest

from drivers.rmp110 import TRACTOR, Rmp110, Rmp110Config
from drivers.rmp110.codec.frames import MOTION_ID
from drivers.rmp110.device.watchdog import ThreadWatchdog, Watchdog
from drivers.rmp110.errors import RmpHeld, RmpSendDropped
from tests.drivers.rmp110.virtual_rig import READY_S, clock, drive, virtual_time
from tests.drivers.rmp110.virtual_rig import rig as virtual_rig

ZERO = bytes(8)


class Bench:
    """A watchdog with a clock that the test moves and a wire that it looks at."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.zeros = 0
        self.dog = Watchdog(self.zero, lambda: self.now_ns)

    def zero(self) -> bool:
        self.zeros += 1
        return True

    def after(self, seconds: float) -> bool:
        self.now_ns += round(seconds * 1e9)
        return self.dog.check()


def nothing() -> None:
    """A frame that goes out."""


def test_it_trips_when_a_motion_command_was_not_renewed_for_a_fifth_of_a_second() -> None:
    bench = Bench()
    assert bench.dog.pass_on(nothing, moving=True)
    assert not bench.after(0.199)
    assert bench.after(0.001)
    assert (bench.zeros, bench.dog.trips, bench.dog.tripped) == (1, 1, True)
    assert not bench.after(10), "once"


def test_it_does_not_trip_at_rest_nor_while_the_loop_runs() -> None:
    bench = Bench()
    assert not bench.after(10)
    bench.dog.pass_on(nothing, moving=True)
    for _ in range(20):
        assert not bench.after(0.1)
        bench.dog.renew()
    bench.dog.pass_on(nothing, moving=False)
    assert not bench.after(10)


def test_after_a_trip_nothing_moves_until_zero_was_commanded() -> None:
    bench = Bench()
    bench.dog.pass_on(nothing, moving=True)
    bench.after(0.2)
    assert not bench.dog.pass_on(nothing, moving=True)
    assert bench.dog.pass_on(nothing, moving=False)
    assert not bench.dog.pass_on(nothing, moving=True), "a zero of the driver's own accord is not the commander's"
    bench.dog.release()
    assert bench.dog.pass_on(nothing, moving=True)
    assert bench.after(0.2)
    assert bench.dog.trips == 2


def test_a_command_that_the_bus_did_not_take_renews_nothing() -> None:
    bench = Bench()

    def full() -> None:
        raise RmpSendDropped

    bench.dog.pass_on(nothing, moving=True)
    bench.now_ns += 150_000_000
    with pytest.raises(RmpSendDropped):
        bench.dog.pass_on(full, moving=True)
    with pytest.raises(RmpSendDropped):
        bench.dog.pass_on(full, moving=False)
    assert bench.after(0.05), "a zero that did not go out is none"


@virtual_time
async def test_a_stuck_loop_is_told_and_zero_has_to_be_commanded_first() -> None:
    async with virtual_rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.3)
        stuck(base)
        assert it.sent(MOTION_ID)[-1] == ZERO
        assert base.stats.watchdog_trips == 1
        with pytest.raises(RmpHeld, match=r"stuck for more than 0.2 s .* command zero first"):
            base.send_motion(0.2, 0.0)
        assert isinstance(base.refusal(), RmpHeld)
        base.send_motion(0.0, 0.0)
        await asyncio.sleep(0.02)
        await drive(base, 0.2, 0.0, 0.2)


@virtual_time
async def test_asking_for_tractor_again_is_a_way_out_too() -> None:
    async with virtual_rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.3)
        stuck(base)
        await base.request_mode(TRACTOR)
        assert it.sent(MOTION_ID)[-1] == ZERO
        await asyncio.sleep(0.02)
        await drive(base, 0.2, 0.0, 0.1)


@virtual_time
async def test_trips_are_counted_over_lost_links() -> None:
    async with virtual_rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.3)
        stuck(base)
        it.bus.go_down()
        await asyncio.sleep(0.01)
        assert base.stats.watchdog_trips == 1
        it.bus.go_up()
        await base.ready(READY_S)
        assert base.stats.watchdog_trips == 1


def stuck(base: Rmp110) -> None:
    """A quarter of a second in one callback, and what the thread would do meanwhile."""
    clock().now_ns += 250_000_000
    assert base._pilot is not None
    assert base._pilot._watchdog.check()


async def test_the_thread_stops_a_base_whose_loop_is_stuck(
    rig: Any, config: Rmp110Config, short_listening: None
) -> None:
    tape: list[tuple[int, bytes]] = []

    def hook(stamp_ns: int, way: str, can_id: int, data: bytes) -> None:
        if way == "tx" and can_id == MOTION_ID:
            tape.append((stamp_ns, data))

    async with rig() as it, Rmp110(it.transport, config, hook) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive_really(base)
        last_ns = tape[-1][0]
        time.sleep(0.5)  # noqa: ASYNC251 - exactly that
        stuck_until_ns = time.monotonic_ns()
        await asyncio.sleep(0)
        zeros = [stamp_ns for stamp_ns, data in tape if stamp_ns > last_ns and data == ZERO]
        assert 0.19 < (zeros[0] - last_ns) / 1e9 < 0.4
        assert zeros[0] < stuck_until_ns
        assert base.stats.watchdog_trips == 1
        for _ in range(200):
            if isinstance(base.refusal(), RmpHeld):
                break
            await asyncio.sleep(0.01)
        with pytest.raises(RmpHeld):
            base.send_motion(0.2, 0.0)
        assert base.stats.reconnects == 0, "the base did not fall silent, the program did"
        base.send_motion(0.0, 0.0)
        await asyncio.sleep(0.02)
        base.send_motion(0.2, 0.0)


async def drive_really(base: Rmp110) -> None:
    for _ in range(10):
        base.send_motion(0.2, 0.0)
        await asyncio.sleep(0.02)


def test_the_thread_insists_sleeps_and_ends() -> None:
    zeros: list[int] = []

    def zero() -> bool:
        zeros.append(time.monotonic_ns())
        return False

    dog = ThreadWatchdog(zero, time.monotonic_ns)
    dog.start()
    began_ns = time.monotonic_ns()
    dog.pass_on(nothing, moving=True)
    deadline = time.monotonic() + 5
    while len(zeros) < 5 and time.monotonic() < deadline:
        time.sleep(0.01)
    dog.stop()
    assert len(zeros) == 5, "said again while nobody else says anything"
    assert (zeros[0] - began_ns) / 1e9 >= 0.2
    assert not dog._thread.is_alive()
