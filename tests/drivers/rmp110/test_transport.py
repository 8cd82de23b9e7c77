"""The bus itself: opening, sending right now or never, and telling how it ended."""

from __future__ import annotations

import asyncio
import errno
import socket
import threading
import time
from typing import Any

import can
import pytest

from drivers.rmp110 import CanTransport
from drivers.rmp110.codec.commands import POLL, motion, request_mode
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import ModeRequest
from drivers.rmp110.errors import RmpForbiddenFrame, RmpInterfaceError, RmpLinkError, RmpSendDropped, RmpUnacknowledged
from drivers.rmp110.transport import can_bus, reader
from drivers.rmp110.transport.base import Transport


class FakeBus(can.BusABC):
    """A bus whose next results are given by the test: messages to receive, or errors to raise."""

    def __init__(self) -> None:
        super().__init__(channel="fake")
        self.script: list[can.Message | BaseException] = []
        self.sent: list[can.Message] = []
        self.send_error: BaseException | None = None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.script:
            step = self.script.pop(0)
            if isinstance(step, BaseException):
                raise step
            return step, True
        time.sleep(min(timeout or 0, 0.005))
        return None, True

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.send_error:
            raise self.send_error
        self.sent.append(msg)


class Ear:
    """What a transport hands over."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, Frame]] = []
        self.reasons: list[str] = []

    async def open(self, transport: Transport) -> None:
        await transport.open(lambda stamp, frame: self.frames.append((stamp, frame)), self.reasons.append)


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> FakeBus:
    bus = FakeBus()
    monkeypatch.setattr(can_bus, "open_bus", lambda *_: bus)
    return bus


@pytest.fixture
def ear() -> Ear:
    return Ear()


def message(can_id: int, data: bytes = bytes(8), **kind: Any) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, **{"is_extended_id": False, **kind})


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (OSError(errno.ENODEV, "No such device"), r"CAN interface can7 not found: plug in .* 'ip link set can7 up"),
        (OSError(errno.EAFNOSUPPORT, "Address family"), r"CAN interface can7 not found: this kernel has no CAN"),
        (PermissionError(errno.EPERM, "Operation not permitted"), "may not be opened by this user"),
        (NotImplementedError("CAN interface 'x' not supported"), "unknown to python-can"),
        (can.CanInterfaceNotImplementedError("msgpack not installed"), "pip install msgpack"),
        (can.CanInitializationError("hm"), r"could not be opened: hm"),
    ],
)
async def test_an_interface_that_cannot_be_opened_is_one_sentence(
    error: Exception, sentence: str, monkeypatch: pytest.MonkeyPatch, ear: Ear
) -> None:
    def fail(*_: object, **__: object) -> can.BusABC:
        raise error

    monkeypatch.setattr(can, "Bus", fail)
    transport = CanTransport("socketcan", "can7")
    with pytest.raises(RmpInterfaceError, match=sentence) as raised:
        await ear.open(transport)
    assert "\n" not in str(raised.value)
    await transport.close()


async def test_a_missing_real_interface_is_said_to_be_missing(ear: Ear) -> None:
    transport = CanTransport("socketcan", "can987")
    with pytest.raises(RmpInterfaceError, match="CAN interface can987 not found"):
        await ear.open(transport)
    await transport.close()


async def test_a_missing_server_is_said_to_be_missing(ear: Ear) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    transport = CanTransport("socketcand", "can0", host="127.0.0.1", port=port)
    with pytest.raises(
        RmpInterfaceError, match=rf"no CAN bus can0 at socketcand server 127.0.0.1:{port}: Connection refused; check"
    ):
        await ear.open(transport)
    await transport.close()


async def test_frames_come_with_the_stamp_of_their_reception(bus: FakeBus, ear: Ear, until: Any) -> None:
    transport = CanTransport("virtual", "x")
    before = time.monotonic_ns()
    await ear.open(transport)
    bus.script.extend([message(0x502, bytes(range(8))), message(0x503, b"\x01")])
    await until(lambda: len(ear.frames) == 2)
    await transport.close()
    stamps = [stamp for stamp, _ in ear.frames]
    assert before < stamps[0] <= stamps[1] <= time.monotonic_ns()
    assert [frame for _, frame in ear.frames] == [Frame(0x502, bytes(range(8))), Frame(0x503, b"\x01")]


async def test_frames_that_no_base_sends_are_counted_and_kept_away(bus: FakeBus, ear: Ear, until: Any) -> None:
    transport = CanTransport("virtual", "x")
    await ear.open(transport)
    bus.script.extend(
        [
            message(0x502, is_extended_id=True),
            message(0x502, is_remote_frame=True, data=b""),
            message(0x502, is_fd=True),
            message(0x503),
        ]
    )
    await until(lambda: ear.frames)
    assert transport.damaged == 3
    await transport.close()


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (can.CanOperationError("Network is down", errno.ENETDOWN), "can0 is down: run 'ip link set can0 up"),
        (can.CanOperationError("No such device", errno.ENODEV), "adapter was unplugged"),
        (AssertionError("only requested a single extra field"), "can0 failed"),
    ],
)
async def test_a_reader_that_dies_reports_why(
    error: Exception, reason: str, bus: FakeBus, ear: Ear, until: Any
) -> None:
    transport = CanTransport("virtual", "can0")
    await ear.open(transport)
    bus.script.append(error)
    await until(lambda: ear.reasons)
    assert len(ear.reasons) == 1
    assert reason in ear.reasons[0]
    await transport.close()


async def test_error_frames_pass_pythons_own_filter_on_the_way_in(ear: Ear, until: Any) -> None:
    transport = CanTransport("virtual", "error-frames")
    await ear.open(transport)
    other = can.Bus("error-frames", "virtual", ignore_config=True)
    try:
        for can_id in (0x004, 0x123, 0x502):
            other.send(message(can_id, is_error_frame=can_id == 0x004))
        await until(lambda: ear.frames)
        assert [frame.can_id for _, frame in ear.frames] == [0x502], "other devices' traffic is nobody's business"
        assert (transport.error_frames, transport.damaged, transport.stats.received) == (1, 0, 1)
    finally:
        other.shutdown()
        await transport.close()


@pytest.mark.parametrize("trouble", [(0x020, bytes(8)), (0x004, bytes.fromhex("0020000000008000"))])
async def test_nothing_that_moves_is_queued_while_nobody_acknowledges(
    bus: FakeBus, ear: Ear, until: Any, trouble: tuple[int, bytes]
) -> None:
    transport = CanTransport("socketcan", "can0", on_warning=lambda _: None)
    await ear.open(transport)
    bus.script.append(message(*trouble, is_error_frame=True))
    await until(lambda: transport.error_frames)
    with pytest.raises(RmpUnacknowledged, match="nobody acknowledges"):
        transport.send(motion(0.1, 0.0))
    transport.send(motion(0.0, 0.0))
    transport.send(POLL)
    bus.script.append(message(0x502))
    await until(lambda: ear.frames)
    transport.send(motion(0.1, 0.0))
    assert [sent.arbitration_id for sent in bus.sent] == [0x500, 0x501, 0x500]
    assert transport.stats.dropped == 1
    await transport.close()


async def test_error_passive_is_told_as_a_warning_and_the_bus_goes_on(bus: FakeBus, ear: Ear, until: Any) -> None:
    warnings: list[str] = []
    transport = CanTransport("socketcan", "can0", on_warning=warnings.append)
    await ear.open(transport)
    passive = message(0x004, bytes.fromhex("0020000000008000"), is_error_frame=True)
    bus.script.extend([passive, passive, message(0x502)])
    await until(lambda: ear.frames)
    assert len(warnings) == 1
    assert "error-passive (128 transmit" in warnings[0]
    assert ear.reasons == []
    transport.send(POLL)
    assert (transport.stats.errors.passive, transport.stats.sent) == (2, 1)
    await transport.close()


@pytest.mark.parametrize("first", ["controller", "reader", "sender"])
async def test_a_lost_bus_is_told_once_whoever_notices_first(first: str, bus: FakeBus, ear: Ear, until: Any) -> None:
    transport = CanTransport("socketcan", "can0")
    await ear.open(transport)
    down = can.CanOperationError("Network is down", errno.ENETDOWN)
    off = message(0x040, is_error_frame=True)
    if first == "sender":
        bus.send_error = down
        with pytest.raises(RmpLinkError, match="is down"):
            transport.send(POLL)
        await until(lambda: ear.reasons)
        bus.script.extend([off, off, down])
    else:
        bus.script.extend([off, off, down] if first == "controller" else [down])
    await until(lambda: ear.reasons and not bus.script)
    bus.send_error = down
    for _ in range(3):
        with pytest.raises(RmpLinkError, match="bus-off" if first == "controller" else "is down"):
            transport.send(POLL)
    await until(lambda: not transport._reader or not transport._reader._thread.is_alive())
    await asyncio.sleep(0)
    assert len(ear.reasons) == 1
    await transport.close()
    assert len(ear.reasons) == 1


async def test_after_bus_off_nothing_reaches_the_queue_of_a_controller_that_may_restart(
    bus: FakeBus, ear: Ear, until: Any
) -> None:
    transport = CanTransport("socketcan", "can0")
    await ear.open(transport)
    bus.script.append(message(0x040, is_error_frame=True))
    await until(lambda: ear.reasons)
    bus.script.append(message(0x100, is_error_frame=True))
    await until(lambda: transport.stats.errors.restarted)
    with pytest.raises(RmpLinkError, match="restart-ms 100"):
        transport.send(motion(0.2, 0.0))
    assert bus.sent == []
    await transport.close()


class ClosedBus(FakeBus):
    """Answers like some of python-can's backends once they are closed: with nothing, at once."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return None


async def test_a_bus_that_is_closed_and_does_not_say_so_is_noticed(
    monkeypatch: pytest.MonkeyPatch, ear: Ear, until: Any
) -> None:
    bus = ClosedBus()
    monkeypatch.setattr(can_bus, "open_bus", lambda *_: bus)
    transport = CanTransport("socketcan", "can0")
    await ear.open(transport)
    await until(lambda: ear.reasons)
    assert ear.reasons == ["CAN interface can0 failed: the bus is closed"]
    await transport.close()


async def test_a_bus_shut_down_under_a_transport_is_reported_once(ear: Ear, until: Any) -> None:
    transport = CanTransport("virtual", "shut-down-under")
    await ear.open(transport)
    assert transport._bus is not None
    transport._bus.shutdown()
    await until(lambda: ear.reasons)
    assert len(ear.reasons) == 1
    assert "closed bus" in ear.reasons[0]
    await transport.close()


async def test_any_thread_may_send_and_a_close_meanwhile_hurts_nobody(bus: FakeBus, ear: Ear) -> None:
    transport = CanTransport("socketcan", "can0")
    await ear.open(transport)
    overlapping = 0
    inside = threading.Lock()

    def careful(msg: can.Message, timeout: float | None = None) -> None:
        nonlocal overlapping
        assert msg.arbitration_id == 0x501
        assert timeout == 0, "no send waits"
        if not inside.acquire(blocking=False):
            overlapping += 1
            return
        time.sleep(0.0002)
        inside.release()
        assert not bus._is_shutdown

    bus.send = careful  # type: ignore[method-assign]
    ended: list[str] = []

    def flood() -> None:
        try:
            while True:
                transport.send(POLL)
        except RmpLinkError as error:
            ended.append(str(error))

    threads = [threading.Thread(target=flood) for _ in range(4)]
    for thread in threads:
        thread.start()
    while transport.stats.sent < 200:
        await asyncio.sleep(0.005)
    await transport.close()
    for thread in threads:
        thread.join(5)
    assert overlapping == 0
    assert ended == ["CAN interface can0 is not open"] * 4
    assert ear.reasons == []


async def test_bus_off_ends_the_link_and_other_error_frames_are_counted(bus: FakeBus, ear: Ear, until: Any) -> None:
    transport = CanTransport("socketcan", "can0")
    await ear.open(transport)
    bus.script.append(message(0x004, is_error_frame=True))
    await until(lambda: transport.error_frames == 1)
    assert not ear.reasons
    bus.script.append(message(0x040, is_error_frame=True))
    await until(lambda: ear.reasons)
    assert "bus-off" in ear.reasons[0]
    await transport.close()


@pytest.mark.parametrize(
    "error",
    [can.CanOperationError("No buffer space available", errno.ENOBUFS), can.CanOperationError("Transmit buffer full")],
)
async def test_a_full_bus_drops_the_frame_and_says_so(error: Exception, bus: FakeBus, ear: Ear) -> None:
    transport = CanTransport("socketcan", "can0")
    await ear.open(transport)
    bus.send_error = error
    with pytest.raises(RmpSendDropped, match="transmit buffer full"):
        transport.send(motion(0.1, 0))
    bus.send_error = None
    transport.send(POLL)
    assert [bytes(m.data) for m in bus.sent] == [POLL.data], "the dropped frame does not come later"
    await transport.close()


async def test_any_other_send_error_ends_the_link(bus: FakeBus, ear: Ear) -> None:
    transport = CanTransport("socketcan", "can0")
    await ear.open(transport)
    bus.send_error = can.CanOperationError("Network is down", errno.ENETDOWN)
    with pytest.raises(RmpLinkError, match="is down"):
        transport.send(POLL)
    await transport.close()
    with pytest.raises(RmpLinkError, match="not open"):
        transport.send(POLL)


async def test_the_whitelist_stands_right_before_the_wire(bus: FakeBus, ear: Ear) -> None:
    transport = CanTransport("virtual", "x")
    await ear.open(transport)
    for frame in (request_mode(ModeRequest.DISABLE), motion(2.0, 0), Frame(0x123, bytes(8))):
        with pytest.raises(RmpForbiddenFrame):
            transport.send(frame)
    assert bus.sent == []
    await transport.close()


async def test_own_frames_that_multicast_brings_back_are_not_received(bus: FakeBus, ear: Ear, until: Any) -> None:
    transport = CanTransport("udp_multicast", "239.0.0.1")
    await ear.open(transport)
    transport.send(POLL)
    bus.script.extend([message(0x501), message(0x501)])
    await until(lambda: ear.frames)
    assert [frame for _, frame in ear.frames] == [POLL], "the echo is swallowed, the second is somebody else's"
    await transport.close()


async def test_a_busy_loop_loses_the_oldest_frames_and_counts_them(
    bus: FakeBus, ear: Ear, until: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "BACKLOG", 10)
    transport = CanTransport("virtual", "x")
    await ear.open(transport)
    bus.script.extend(message(0x502, bytes([k])) for k in range(50))
    while bus.script:
        time.sleep(0.001)  # noqa: ASYNC251 - the loop is held up on purpose
    await until(lambda: ear.frames and ear.frames[-1][1].data == b"\x31")
    assert transport.damaged >= 1
    assert transport.damaged + len(ear.frames) == 50
    await transport.close()


async def test_closing_twice_or_without_opening_is_fine() -> None:
    transport = CanTransport("virtual", "x")
    await transport.close()
    await transport.close()


async def test_a_cancelled_opening_leaves_no_bus_behind(monkeypatch: pytest.MonkeyPatch, ear: Ear, until: Any) -> None:
    bus = FakeBus()

    def slowly(*_: object) -> can.BusABC:
        time.sleep(0.1)
        return bus

    monkeypatch.setattr(can_bus, "open_bus", slowly)
    opening = asyncio.create_task(ear.open(CanTransport("virtual", "x")))
    await asyncio.sleep(0.02)
    opening.cancel()
    await asyncio.wait({opening})
    await until(lambda: bus._is_shutdown)
