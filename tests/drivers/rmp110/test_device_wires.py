"""The driver over what it really uses: python-can, TCP, UDP, a serial device; in real time, so only what needs it."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import pty
import re
import subprocess
import sys
import time
import tty
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from drivers.rmp110 import TRACTOR, CanTransport, Rmp110, Rmp110Config
from drivers.rmp110.codec.bytestream import pack_command
from drivers.rmp110.codec.commands import motion
from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import RMP110_STORED, OperationalState, Stored
from drivers.rmp110.codec.v3.commands import ZERO_MOTION, continuous_data
from drivers.rmp110.codec.v3.packets import STATUS, pack_status
from drivers.rmp110.codec.v3.words import LAYOUT, PARAMETERS
from drivers.rmp110.device.state import LinkState
from drivers.rmp110.errors import RmpForbiddenFrame, RmpInterfaceError, RmpLinkError, RmpNotIdentified, RmpWrongMode
from drivers.rmp110.simulator.packet_wires import PtyWire, UdpWire
from drivers.rmp110.simulator.serve import SimulatedV3, serve_v3
from drivers.rmp110.simulator.v3_model import V3Model
from drivers.rmp110.transport.base import Transport
from drivers.rmp110.transport.datagram import DatagramTransport
from drivers.rmp110.transport.serial_port import SerialTransport
from tests.drivers.rmp110.conftest import BRISK

pytestmark = pytest.mark.usefixtures("short_listening")

BUSES = pytest.mark.parametrize("interface", ["virtual", "socketcand"])
WIRES = pytest.mark.parametrize("wire", ["udp", "usb"])
READY_S = 5.0
STATUS_PACKET = pack_status(LAYOUT.encode({"machine_id": 8, "operational_state": 3}))


async def drive(base: Rmp110, v: float, w: float, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        base.send_motion(v, w)
        await asyncio.sleep(0.02)


@BUSES
async def test_identified_driven_and_left_in_standby(interface: str, rig: Any, config: Rmp110Config) -> None:
    async with rig(interface) as it, Rmp110(it.transport, config) as base:
        assert (await base.ready(READY_S)).dialect is Dialect.B2
        await base.request_mode(TRACTOR)
        await drive(base, 0.3, 0.3, 0.5)
        assert it.sim.model.twist == pytest.approx((0.3, 0.3), abs=0.02)
        assert base.latest is not None
        assert (base.latest.v, base.latest.w) == pytest.approx((0.3, 0.3), abs=0.02)
    assert it.sim.model.state is OperationalState.STANDBY


OTHER_PROCESS = """
import asyncio, sys, time
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.serve import serve

async def main():
    async with serve("socketcand", "can0", model=RmpModel(time.monotonic_ns(), boot_s=0.1)) as base:
        print(base.port, flush=True)
        await asyncio.to_thread(sys.stdin.read)

asyncio.run(main())
"""


async def test_a_base_in_another_process_is_driven_and_its_death_noticed(config: Rmp110Config, until: Any) -> None:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", OTHER_PROCESS, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    try:
        port = int(await asyncio.wait_for(process.stdout.readline(), 20))
        gentle = dataclasses.replace(config, expected=RMP110_STORED)
        async with Rmp110(lambda: CanTransport("socketcand", "can0", host="127.0.0.1", port=port), gentle) as base:
            await base.ready(READY_S)
            await until(lambda: base.latest and base.latest.mode is OperationalState.STANDBY)
            await base.request_mode(TRACTOR)
            await drive(base, 0.5, 0.0, 0.4)
            assert base.latest is not None
            assert base.latest.v > 0.05
            process.kill()
            await until(lambda: base.link is LinkState.BACKOFF)
            # A killed process leaves its end closed or reset, whatever its kernel found unread.
            assert re.search("failed: (the server closed|connection to the server lost)", base.stats.detail)
            await until(lambda: "Connection refused; check that the server" in base.stats.detail)
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def test_a_closed_connection_is_noticed_and_mended(rig: Any, config: Rmp110Config, until: Any) -> None:
    async with rig("socketcand") as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        it.sim.unplug()
        started = time.monotonic()
        await until(lambda: base.link is not LinkState.STREAMING)
        assert time.monotonic() - started < 0.25, "sooner than silence would tell"
        assert "failed" in base.stats.detail
        assert isinstance(base.refusal(), RmpNotIdentified)
        it.sim.plug()
        await base.ready(READY_S)


@BUSES
async def test_somebody_else_on_the_bus_is_heard(interface: str, rig: Any, config: Rmp110Config, until: Any) -> None:
    async with rig(interface) as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        other = it.transport(exclusive=False)
        await other.open(lambda _stamp, _frame: None, lambda _reason: None)
        try:
            other.send(motion(0.5, 0.0))
            await until(lambda: base.refusal() is not None)
            assert "another program or panel commands this base" in base.stats.detail
        finally:
            await other.close()
        await base.ready(READY_S)
        assert isinstance(base.refusal(), RmpWrongMode)


async def test_a_missing_can_interface_is_one_sentence(config: Rmp110Config, until: Any) -> None:
    async with Rmp110(lambda: CanTransport("socketcan", "can987"), config) as base:
        await until(lambda: "CAN interface can987 not found" in base.stats.detail)


@asynccontextmanager
async def v3_base(wire: str, folder: Path) -> AsyncIterator[tuple[SimulatedV3, Callable[[], Transport]]]:
    values = {n: v for n, v in BRISK.items() if n in {p.name for p in PARAMETERS}}
    stored = Stored.of({**values, "input_bitmap": 0}, parameters=PARAMETERS)
    model = V3Model(time.monotonic_ns(), stored, boot_s=0.0)
    path = folder / "ttyACM0"
    end = UdpWire("127.0.0.1", 0, notice_port=NOTICE_PORT) if wire == "udp" else PtyWire(path)
    async with serve_v3(end, model=model) as sim:
        ways: dict[str, Callable[[], Transport]] = {
            "udp": lambda: DatagramTransport("127.0.0.1", sim.port, notice_port=NOTICE_PORT),
            "usb": lambda: SerialTransport(str(path)),
        }
        yield sim, ways[wire]


NOTICE_PORT = 36234
"""Not the real one: another program of this machine may have it."""


@WIRES
async def test_a_v3_base_is_driven_over_udp_and_usb(
    wire: str, tmp_path: Path, config: Rmp110Config, until: Any
) -> None:
    v3 = dataclasses.replace(config, protocol="v3", read_fault_log=True)
    async with v3_base(wire, tmp_path) as (sim, way):
        async with Rmp110(way, v3) as base:
            identity = await base.ready(READY_S)
            assert identity.dialect is Dialect.V3
            assert identity.fault_log is not None
            await base.request_mode(TRACTOR)
            await drive(base, 0.3, 0.3, 0.5)
            assert sim.model.twist == pytest.approx((0.3, 0.3), abs=0.02)
            assert base.stats.damaged == 0
        assert sim.model.state is OperationalState.STANDBY


async def test_a_v3_base_that_is_switched_off_says_so_over_udp(
    tmp_path: Path, config: Rmp110Config, until: Any
) -> None:
    v3 = dataclasses.replace(config, protocol="v3")
    async with v3_base("udp", tmp_path) as (sim, way), Rmp110(way, v3) as base:
        await base.ready(READY_S)
        sim.model.press_power_button()
        await until(lambda: base.link is not LinkState.STREAMING)
        assert "says that it switches off" in base.stats.detail


async def test_an_unplugged_usb_cable_is_noticed_and_mended(tmp_path: Path, config: Rmp110Config, until: Any) -> None:
    v3 = dataclasses.replace(config, protocol="v3")
    async with v3_base("usb", tmp_path) as (sim, way), Rmp110(way, v3) as base:
        await base.ready(READY_S)
        sim.unplug()
        await until(lambda: base.link is not LinkState.STREAMING)
        assert "was unplugged or switched off" in base.stats.detail
        await until(lambda: "is not there: plug in the base's USB cable" in base.stats.detail)
        sim.plug()
        await base.ready(READY_S)


class Ears:
    """What a transport hands over."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.lost: list[str] = []

    def hear(self, _stamp_ns: int, frame: Frame) -> None:
        self.frames.append(frame)


@asynccontextmanager
async def serial() -> AsyncIterator[tuple[SerialTransport, Ears, int]]:
    """An open transport and the other end of its wire."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    ears, transport = Ears(), SerialTransport(os.ttyname(theirs))
    try:
        await transport.open(ears.hear, ears.lost.append)
        yield transport, ears, ours
    finally:
        await transport.close()
        os.close(ours)
        os.close(theirs)


async def test_the_serial_stream_is_cut_into_packets_and_damage_counted(until: Any) -> None:
    async with serial() as (transport, ears, wire):
        transport.send(ZERO_MOTION)
        await until(lambda: os.read(wire, 100) == pack_command(ZERO_MOTION))
        for part in (STATUS_PACKET[:100], STATUS_PACKET[100:] + b"noise", STATUS_PACKET, STATUS_PACKET):
            os.write(wire, part)
            await asyncio.sleep(0.01)
        await until(lambda: len(ears.frames) == 3)
        assert {frame.can_id for frame in ears.frames} == {STATUS}
        assert transport.damaged == 1


async def test_a_serial_device_has_one_owner_and_refuses_what_must_not_be_sent() -> None:
    async with serial() as (transport, _, _):
        with pytest.raises(RmpInterfaceError, match="in use by another program"):
            await SerialTransport(transport._device).open(Ears().hear, Ears().lost.append)
        for frame in (motion(0.1, 0.0), Frame(0x1802, bytes(16))):
            with pytest.raises(RmpForbiddenFrame):
                transport.send(frame)
    with pytest.raises(RmpLinkError, match="not open"):
        transport.send(ZERO_MOTION)


async def test_a_serial_device_that_nobody_reads_drops_or_ends_but_never_queues() -> None:
    async with serial() as (transport, ears, _):
        with pytest.raises(OSError, match=r"did not take a command|took half a command"):
            send_much(transport)
        assert len(ears.lost) <= 1


def send_much(transport: SerialTransport) -> None:
    for _ in range(100_000):
        transport.send(ZERO_MOTION)


@pytest.mark.parametrize(("path", "sentence"), [("none", "is not there"), ("file", "not a serial device")])
async def test_a_wrong_serial_device_is_one_sentence(path: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RmpInterfaceError, match=sentence):
        await SerialTransport(str(tmp_path / path)).open(Ears().hear, Ears().lost.append)


async def test_datagrams_of_others_and_garbage_are_counted_and_not_believed(until: Any) -> None:
    class Base(asyncio.DatagramProtocol):
        def connection_made(self, transport: Any) -> None:
            self.transport = transport

        def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
            for answer in (b"garbage", STATUS_PACKET[:-1], STATUS_PACKET + b"x", STATUS_PACKET):
                self.transport.sendto(answer, addr)

    loop = asyncio.get_running_loop()
    server, _ = await loop.create_datagram_endpoint(Base, local_addr=("127.0.0.1", 0))
    stranger, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0))
    ears = Ears()
    transport = DatagramTransport("127.0.0.1", server.get_extra_info("sockname")[1], notice_port=NOTICE_PORT)
    try:
        await transport.open(ears.hear, ears.lost.append)
        with pytest.raises(RmpForbiddenFrame):
            transport.send(motion(0.1, 0.0))
        assert transport._socket is not None
        stranger.sendto(STATUS_PACKET, ("127.0.0.1", transport._socket.getsockname()[1]))
        stranger.sendto(b"garbage", ("127.0.0.1", NOTICE_PORT))
        transport.send(continuous_data(on=True))
        await until(lambda: ears.frames and transport.damaged == 4)
        assert [frame.can_id for frame in ears.frames] == [STATUS]
        server.close()
        await asyncio.sleep(0)
        transport.send(ZERO_MOTION)
        await until(lambda: ears.lost)
        assert "nobody answers at 127.0.0.1" in ears.lost[0]
        with pytest.raises(RmpLinkError, match="nobody answers"):
            transport.send(ZERO_MOTION)
    finally:
        await transport.close()
        server.close()
        stranger.close()


async def test_an_unknown_address_is_one_sentence() -> None:
    with pytest.raises(RmpInterfaceError, match=r"is unknown: give its IPv4 address"):
        await DatagramTransport("300.1.2.3").open(Ears().hear, Ears().lost.append)
