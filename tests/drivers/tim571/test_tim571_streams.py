"""Streams: however they are cut the same scans come out, and long ones leave nothing behind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import lidar_soak
from drivers.tim571.codec import scandata
from drivers.tim571.codec.deframer import Damage, Deframer, Frame
from drivers.tim571.codec.dialect import Dialect, frame
from drivers.tim571.codec.scandata import ScanData
from drivers.tim571.codec.telegram import Receiver, Telegram
from drivers.tim571.device.intake import Intake
from drivers.tim571.device.scan import Scan
from fuzz import tim571 as fuzz_target


def scans_of(dialect: Dialect, chunks: list[bytes]) -> list[Scan]:
    receiver, intake = Receiver(dialect), Intake()
    events = [event for number, chunk in enumerate(chunks) for event in receiver.feed(chunk, number)]
    taken = [intake.take(event) for event in events if isinstance(event, Telegram)]
    return [scan for scan in taken if scan is not None]


@given(data=st.data())
@settings(max_examples=40, deadline=None)
@pytest.mark.parametrize("dialect", list(Dialect), ids=str)
def test_the_same_scans_come_out_of_a_stream_cut_anywhere(
    make_scan: Callable[..., ScanData], dialect: Dialect, data: st.DataObject
) -> None:
    frames = [scandata.encode(make_scan(number, beams=30), dialect).to_wire() for number in range(6)]
    damage = data.draw(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 400), st.integers(1, 255)), max_size=3))
    for number, at, change in damage:
        spoilt = bytearray(frames[number])
        spoilt[at % len(spoilt)] ^= change
        frames[number] = bytes(spoilt)
    stream = b"".join(frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=20)))
    chunks = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    whole, cut = scans_of(dialect, [stream]), scans_of(dialect, chunks)
    assert [scan.frame for scan in cut] == [scan.frame for scan in whole]
    assert [scan.scan_counter for scan in cut] == [scan.scan_counter for scan in whole]
    assert all(np.array_equal(a.ranges, b.ranges, equal_nan=True) for a, b in zip(cut, whole, strict=True))
    assert len(whole) >= 6 - 2 * len(damage)


def test_two_damaged_frames_in_a_row_are_two_even_if_the_second_header_is_hit() -> None:
    good = frame(Dialect.B, b"sSN LMDscandata " + bytes(range(40, 200)))
    payload_hit = good[:50] + b"\xff" + good[51:]
    for place in range(8):
        header_hit = good[:place] + bytes([good[place] ^ 0x10]) + good[place + 1 :]
        for size in (1, 7, 1000):
            deframer = Deframer(Dialect.B)
            stream = good + payload_hit + header_hit + good
            events = [e for at in range(0, len(stream), size) for e in deframer.feed(stream[at : at + size])]
            assert [type(event) for event in events + deframer.close()] == [Frame, Damage, Damage, Frame]


def test_the_monitor_stream_is_taken_only_where_there_is_no_other(make_scan: Callable[..., ScanData]) -> None:
    for others in (True, False):
        intake, taken = Intake(), []
        for number in range(20):
            for name in ("LMDscandata", "LMDscandatamon")[not others :]:
                content = {"telegram_counter": number + 9, "name": "x"} if name == "LMDscandatamon" else {}
                scan = scandata.encode(make_scan(number, **content), Dialect.B, "sSN", name).to_wire()
                (telegram,) = Receiver(Dialect.B).feed(scan, number * 66_667_000)
                assert isinstance(telegram, Telegram)
                taken.append(intake.take(telegram))
        assert sum(scan is not None for scan in taken) == 20
        assert intake.damaged == 0


@pytest.mark.parametrize("seed", range(2))
def test_mutations_of_everything_a_wire_can_carry_break_nothing(seed: int) -> None:
    assert fuzz_target.mutations(0.7, seed) > 20


async def test_a_soak_leaves_no_task_and_no_socket_behind() -> None:
    found = await lidar_soak.soak(1.5, 6, warm_up_s=0.5)
    assert (found.tasks_left, found.descriptors_left) == (0, 0)
    assert found.reconnects == 6
    assert found.received > 10


async def test_a_variable_is_read_while_scans_come(until: Any) -> None:
    from drivers.tim571 import TcpTransport, TiM571, Tim571Simulator, TimConfig
    from drivers.tim571.errors import TimRefusedError, TimUnreachableError

    async with Tim571Simulator(dialect="b") as simulator:
        lidar = TiM571(TcpTransport(simulator.host, simulator.port), TimConfig(backoff_first_s=5.0))
        async with lidar:
            await until(lambda: lidar.stats.received > 0)
            assert await lidar.read("DItype") == "TiM571-2050101"
            with pytest.raises(TimRefusedError, match="does not know the variable"):
                await lidar.read("LFErec")
            with pytest.raises(ValueError, match="no variable"):
                await lidar.read("Nonsense")
            await simulator.unplug()
            await until(lambda: lidar.stats.state.value == "backoff")
            with pytest.raises(TimUnreachableError, match="no link"):
                await lidar.read("DItype")
