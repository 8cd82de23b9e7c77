"""The libusb transport against a strict stand-in for `usb1`; the real one meets a real kernel in `make test-usb`."""

from __future__ import annotations

import asyncio
import ctypes
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import libusb_package
import pytest
import usb1

from drivers.theta_v.codec.access_units import AccessUnit, AccessUnitTracker
from drivers.theta_v.codec.descriptors import BULK, ISOCHRONOUS, Endpoint
from drivers.theta_v.codec.h264 import opens_stream
from drivers.theta_v.codec.payload import Assembler, Packet
from drivers.theta_v.codec.probe import Probe
from drivers.theta_v.errors import (
    ThetaError,
    ThetaGone,
    ThetaMalformed,
    ThetaNotFound,
    ThetaRefused,
    ThetaStall,
    ThetaTimeout,
)
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.transport import usb1_api
from drivers.theta_v.transport.libusb import LibUsbTransport
from drivers.theta_v.transport.libusb_video import Queue
from drivers.theta_v.transport.microframes import Listening
from tests.drivers.theta_v.fake_usb1 import Machine
from tests.drivers.theta_v.pictures import Feeder, stream, until

PICTURES = stream(30, 192, 96)
VIDEO = Endpoint(0x84, ISOCHRONOUS, 3072, 1)
SMALL = Queue(8, 16)


@asynccontextmanager
async def opened(
    machine: Machine, gone: list[str] | None = None, queue: Queue = SMALL
) -> AsyncIterator[LibUsbTransport]:
    transport = LibUsbTransport(queue=queue, open_context=machine.context)
    await transport.open(None, (gone if gone is not None else []).append)
    try:
        yield transport
    finally:
        await transport.close()
        assert machine.offences == []
        assert machine.contexts == 0


async def negotiated(transport: LibUsbTransport) -> None:
    await transport.claim(2)
    block = Probe(format_index=1, frame_index=2, interval_100ns=333_667).encode(48)
    for control in (0x0100, 0x0200):
        await transport.control(0x21, 0x01, control, 2, block)
    await transport.set_interface(2, 1)


async def test_the_camera_is_identified_by_what_it_says_of_itself() -> None:
    async with opened(Machine(SimulatedThetaV())) as transport:
        who = transport.identity
        assert (who.product, who.serial, who.is_theta) == ("RICOH THETA V", "00105377", True)
        assert len(transport.configuration) == 432


async def test_packets_come_until_the_stream_is_stopped_and_none_after() -> None:
    machine = Machine(SimulatedThetaV())
    seen: list[Packet] = []
    threads: set[str] = set()

    def sink(_stamp_ns: int, packets: list[Packet]) -> None:
        seen.extend(packets)
        threads.add(threading.current_thread().name)

    async with opened(machine) as transport:
        await negotiated(transport)
        await transport.start_video(VIDEO, 3072, sink)
        with pytest.raises(RuntimeError, match="already"):
            await transport.start_video(VIDEO, 3072, sink)
        with Feeder(machine.camera, PICTURES):
            await until(lambda: len(seen) > 40)
            await transport.stop_video()
            count = len(seen)
            await asyncio.sleep(0.05)
            assert len(seen) == count
            await transport.set_interface(2, 0)
            await transport.set_interface(2, 1)
            await transport.start_video(VIDEO, 3072, sink)
            await until(lambda: len(seen) > count)
    assert threads == {"theta-usb"}
    assert b"".join(bytes(data[2:]) for _, data in seen).startswith(PICTURES[0] + PICTURES[1])


async def test_what_the_camera_sent_while_this_process_was_held_up_is_known_to_be_lost() -> None:
    """The queue of 16 ms runs dry in the middle of the stream, and the bus tells nobody."""
    machine = Machine(SimulatedThetaV())
    machine.loses_unheard = True
    assembler, tracker = Assembler(opens=opens_stream), AccessUnitTracker()
    units: list[AccessUnit] = []
    held_up = threading.Event()

    def sink(stamp_ns: int, packets: list[Packet]) -> None:
        for unit in assembler.feed(stamp_ns, packets):
            picture = tracker.feed(unit)
            if picture is not None:
                units.append(picture)
        if len(units) > 12 and not held_up.is_set():
            held_up.set()
            time.sleep(0.2)  # the event thread itself: nothing is submitted meanwhile

    async with opened(machine) as transport:
        await negotiated(transport)
        await transport.start_video(VIDEO, 3072, sink)
        with Feeder(machine.camera, PICTURES):
            await until(lambda: len(units) > 40)
    clean = [unit.raw for unit in units if not unit.tainted]
    assert any("USB packet lost" in unit.taint for unit in units)
    assert set(clean) <= set(PICTURES)
    sound = -1
    for unit in units:
        if not unit.tainted:
            index = PICTURES.index(unit.raw)
            assert unit.keyframe or index == sound + 1, "what it builds upon was lost"
            sound = index


async def test_a_bus_that_is_late_is_no_gap_while_transfers_are_in_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    """As an emulated one is: time says that the queue ended, and one of its transfers has not ended yet."""
    monkeypatch.setattr(Listening, "gap", lambda *_: 1)
    machine = Machine(SimulatedThetaV())
    seen: list[Packet] = []
    async with opened(machine, queue=Queue(64, 16)) as transport:
        await negotiated(transport)
        await transport.start_video(VIDEO, 3072, lambda _, packets: seen.extend(packets))
        with Feeder(machine.camera, PICTURES):
            await until(lambda: len(seen) > 200)
    assert not any(status for status, _ in seen)


async def test_a_kernel_without_memory_for_the_queue_is_reported_with_the_remedy() -> None:
    machine = Machine(SimulatedThetaV(), memory_bytes=300_000)
    async with opened(machine) as transport:
        await negotiated(transport)
        with pytest.raises(ThetaRefused, match="usbfs_memory_mb"):
            await transport.start_video(VIDEO, 3072, lambda *_: None)
        machine.memory_bytes = 16 << 20
        await transport.start_video(VIDEO, 3072, lambda *_: None)


def test_the_default_queue_leaves_half_of_what_the_kernel_lends_to_others() -> None:
    queue = Queue()
    assert queue.transfers * queue.packets * 3072 < 8 << 20
    assert queue.transfers * queue.packets / 8000 >= 0.128, "seconds: what a virtual machine needed"


async def test_a_camera_that_leaves_is_reported_once_and_everything_pending_ends() -> None:
    for refusals in ({}, {"hotplug": usb1.USBErrorNotSupported}):
        machine = Machine(SimulatedThetaV())
        machine.refusals = dict(refusals)
        gone: list[str] = []
        async with opened(machine, gone) as transport:
            await negotiated(transport)
            await transport.start_video(VIDEO, 3072, lambda *_: None)
            await transport.claim(0)
            waiting = asyncio.create_task(transport.interrupt_in(0x82, 28, 10))
            await asyncio.sleep(0.02)
            machine.camera.unplug()
            with pytest.raises(ThetaGone, match="left the bus"):
                await waiting
            await until(lambda: bool(gone))  # noqa: B023 awaited in this very turn
            with pytest.raises(ThetaGone):
                await transport.control(0x80, 6, 0x0100, 0, 18)
            await asyncio.sleep(0.05)
        assert gone == [usb1_api.LEFT_THE_BUS]


async def test_a_session_does_not_see_a_camera_that_came_later_but_the_next_one_does() -> None:
    machine = Machine(SimulatedThetaV())
    machine.camera.unplug()
    transport = LibUsbTransport(open_context=machine.context)
    with pytest.raises(ThetaNotFound, match="plugged in"):
        await transport.open(None, lambda _: None)
    machine.camera.replug()
    async with opened(machine) as again:
        assert again.identity.is_theta
    assert machine.contexts == 0


@pytest.mark.parametrize(
    ("method", "error", "expected", "words"),
    [
        ("open", usb1.USBErrorAccess, ThetaRefused, "udev"),
        ("open", usb1.USBErrorNoDevice, ThetaGone, "left the bus"),
        ("open_context", usb1.USBErrorOther, ThetaGone, "USB error"),
    ],
)
async def test_what_libusb_refuses_at_opening_is_said_in_words(
    method: str, error: type[Exception], expected: type[ThetaError], words: str
) -> None:
    machine = Machine(SimulatedThetaV())
    machine.refusals[method] = error
    transport = LibUsbTransport(open_context=machine.context)
    with pytest.raises(expected, match=words):
        await transport.open(None, lambda _: None)
    await transport.close()
    assert machine.offences == []


@pytest.mark.parametrize(
    ("method", "error", "expected", "words"),
    [
        ("claim", usb1.USBErrorBusy, ThetaRefused, "another program"),
        ("claim", usb1.USBErrorNoDevice, ThetaGone, "left the bus"),
        ("set_alternate", usb1.USBErrorOther, ThetaRefused, "another port"),
        ("set_alternate", usb1.USBErrorNoDevice, ThetaGone, "left the bus"),
    ],
)
async def test_what_libusb_refuses_later_is_said_in_words(
    method: str, error: type[Exception], expected: type[ThetaError], words: str
) -> None:
    machine = Machine(SimulatedThetaV())
    async with opened(machine) as transport:
        machine.refusals[method] = error
        with pytest.raises(expected, match=words):
            await negotiated(transport)


async def test_another_handle_on_the_same_interface_is_refused() -> None:
    machine = Machine(SimulatedThetaV())
    async with opened(machine) as one:
        await one.claim(2)
        await one.claim(2)
        two = LibUsbTransport(open_context=machine.context)
        await two.open(None, lambda _: None)
        with pytest.raises(ThetaRefused, match="another program"):
            await two.claim(2)
        await one.release(2)
        await two.claim(2)
        await two.close()


async def test_a_request_without_an_answer_ends_in_time_and_hinders_no_other() -> None:
    async with opened(Machine(SimulatedThetaV())) as transport:
        await transport.claim(0)
        with pytest.raises(ThetaTimeout, match=r"within 0\.05 s"):
            await transport.bulk_in(0x81, 512, 0.05)
        with pytest.raises(ThetaStall):
            await transport.control(0xA1, 0x81, 0x0900, 2, 4)
        assert len(await transport.control(0x80, 6, 0x0100, 0, 18)) == 18


async def test_an_interface_must_be_claimed_before_its_endpoints_are_used() -> None:
    async with opened(Machine(SimulatedThetaV())) as transport:
        with pytest.raises(RuntimeError, match="not claimed"):
            await transport.bulk_in(0x81, 512)
        with pytest.raises(RuntimeError, match="not claimed"):
            await transport.set_interface(2, 1)
        with pytest.raises(RuntimeError, match="no endpoint"):
            await transport.interrupt_in(0x8F, 8)


async def test_closing_ends_what_is_under_way_and_may_be_done_twice() -> None:
    machine = Machine(SimulatedThetaV())
    transport = LibUsbTransport(queue=SMALL, open_context=machine.context)
    await transport.open(None, lambda _: None)
    await negotiated(transport)
    await transport.start_video(VIDEO, 3072, lambda *_: None)
    await transport.claim(0)
    waiting = asyncio.create_task(transport.bulk_in(0x81, 512, 10))
    await asyncio.sleep(0.02)
    await asyncio.gather(transport.close(), transport.close())
    with pytest.raises(ThetaGone, match="closed"):
        await waiting
    assert (machine.offences, machine.contexts) == ([], 0)
    assert machine.camera.demand is None, "alternate setting 0 again"
    with pytest.raises(ThetaGone, match="not open"):
        await transport.claim(0)


async def test_a_mistake_in_the_sink_ends_the_stream_in_words() -> None:
    machine = Machine(SimulatedThetaV())
    gone: list[str] = []

    def sink(_stamp_ns: int, _packets: list[Packet]) -> None:
        raise KeyError("mistake")

    async with opened(machine, gone) as transport:
        await negotiated(transport)
        await transport.start_video(VIDEO, 3072, sink)
        with Feeder(machine.camera, PICTURES):
            await until(lambda: bool(gone))
    assert "mistake" in gone[0]


async def test_a_reset_and_a_cleared_endpoint_reach_the_camera() -> None:
    machine = Machine(SimulatedThetaV())
    async with opened(machine) as transport:
        await negotiated(transport)
        await transport.claim(0)
        with pytest.raises(ThetaStall):
            await transport.bulk_out(0x01, bytes(64))
        with pytest.raises(ThetaStall):
            await transport.bulk_in(0x81, 64)
        await transport.clear_halt(0x81)
        await transport.reset()
        assert machine.camera.demand is None
        machine.refusals["reset"] = usb1.USBErrorNotFound
        with pytest.raises(ThetaGone, match="reset"):
            await transport.reset()


async def test_a_bulk_payload_larger_than_any_is_refused() -> None:
    async with opened(Machine(SimulatedThetaV())) as transport:
        await transport.claim(0)
        with pytest.raises(ThetaMalformed, match="payloads"):
            await transport.start_video(Endpoint(0x81, BULK, 512, 0), 1 << 30, lambda *_: None)


def test_libusbs_own_table_says_what_its_iterator_says() -> None:
    """Against the real library: a transfer that was never submitted, filled in by hand."""
    try:
        usb1.loadLibrary()
    except OSError:
        usb1.loadLibrary(ctypes.CDLL(str(libusb_package.get_library_path()), use_errno=True))
    nothing = lambda *_, **__: lambda: None  # noqa: E731
    transfer = usb1.USBTransfer(None, None, 4, nothing, nothing, nothing, False, False)
    transfer.setIsochronous(0x84, 4 * 8)
    table = usb1_api.iso_table(transfer)
    assert table is not None
    assert table[:, 0].tolist() == [8] * 4
    table[:, 1] = [3, 0, 8, 0]
    table[:, 2] = [0, 0, 0, usb1.TRANSFER_ERROR]
    transfer.getBuffer()[:] = bytes(range(32))
    assert [(status, bytes(data)) for status, data in transfer.iterISO()] == [
        (0, bytes([0, 1, 2])),
        (0, b""),
        (0, bytes(range(16, 24))),
        (usb1.TRANSFER_ERROR, b""),
    ]
    assert usb1_api.iso_table(object()) is None  # type: ignore[arg-type]
