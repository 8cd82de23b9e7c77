"""The lidar over USB: the same frames in transfers of any size, on a fake pair of bulk endpoints."""

from __future__ import annotations

import asyncio
import errno
import queue
import sys
import threading
import time
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.tim571 import TiM571, Tim571Simulator, TimConfig
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.device.probe import probe
from drivers.tim571.device.stats import LinkState
from drivers.tim571.errors import TimUnreachableError
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.transport.usb import INBOX_BYTES, MOST_HALTS, PyUsbPipe, UsbTransport

Until = Callable[[Callable[[], bool]], Awaitable[None]]
HASTY = TimConfig(
    dialects=(Dialect.A, Dialect.B), dialect_timeout_s=0.15, answer_timeout_s=0.5, backoff_first_s=0.02,
    backoff_max_s=0.1,
)  # fmt: skip


class FakePipe:
    """Bulk endpoints whose other end is a simulated lidar's socket; transfers hold whatever is there."""

    def __init__(self, simulator: Tim571Simulator) -> None:
        import socket

        self.link = socket.create_connection((simulator.host, simulator.port))
        self.gone: OSError | None = None
        self.closed = False

    def read(self, size: int, timeout_s: float) -> bytes:
        if self.gone:
            raise self.gone
        self.link.settimeout(timeout_s)
        try:
            return self.link.recv(min(size, 1000))
        except TimeoutError:
            return b""

    def write(self, data: bytes, timeout_s: float) -> None:
        if self.gone:
            raise self.gone
        self.link.settimeout(timeout_s)
        self.link.sendall(data + b"\x00")  # some hosts append a NUL

    def close(self) -> None:
        self.closed = True
        self.link.close()


async def test_scans_come_over_usb_and_again_after_the_cable_was_pulled(until: Until) -> None:
    pipes: list[FakePipe] = []

    def plug(_serial: str | None) -> FakePipe:
        pipes.append(FakePipe(simulator))
        return pipes[-1]

    async with Tim571Simulator(settings=DeviceSettings(scan_rate_hz=60.0)) as simulator:
        async with TiM571(UsbTransport(open_pipe=plug), HASTY) as lidar:
            await until(lambda: lidar.stats.received >= 5)
            pipes[-1].gone = OSError(errno.ENODEV, "No such device")
            await until(lambda: lidar.stats.state is LinkState.BACKOFF)
            assert "TiM571 at USB 19a2:5001 is gone (No such device)" in lidar.stats.detail
            received = lidar.stats.received
            await until(lambda: lidar.stats.received >= received + 5)
            assert (lidar.stats.reconnects, lidar.stats.damaged) == (1, 0)
        assert all(pipe.closed for pipe in pipes)
        assert not any("19a2:5001" in thread.name for thread in threading.enumerate())


async def test_a_flood_that_nobody_reads_stays_bounded(until: Until) -> None:
    sent = queue.Queue[bytes]()
    for number in range(40):
        sent.put(bytes([number]) * 20_000)

    class Flood:
        def read(self, _size: int, _timeout_s: float) -> bytes:
            time.sleep(0.001)
            return b"" if sent.empty() else sent.get()

        def write(self, data: bytes, timeout_s: float) -> None: ...

        def close(self) -> None: ...

    transport = UsbTransport(open_pipe=lambda _serial: Flood())
    await transport.open()
    assert transport._inbox is not None
    inbox = transport._inbox
    await until(lambda: sent.empty() and inbox._chunks[-1][1][0] == 39)
    assert inbox._size <= INBOX_BYTES
    assert (await transport.read())[1][0] > 20
    await transport.close()


class FakeDevice:
    """What pyusb shows of a TiM571."""

    def __init__(self, serial: str = "17461662") -> None:
        self.serial_number = serial
        self.calls: list[Any] = []
        self.answers: list[bytes | OSError] = []

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def call(*values: Any) -> bool:
            self.calls.append((name, *values))
            return name == "is_kernel_driver_active"

        return call

    def read(self, endpoint: int, size: int, timeout_ms: int) -> bytes:
        self.calls.append(("read", endpoint, size, timeout_ms))
        answer = self.answers.pop(0) if self.answers else OSError(errno.ETIMEDOUT, "timed out")
        if isinstance(answer, OSError):
            raise answer
        return answer


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> list[FakeDevice]:
    """The devices that a fake pyusb finds."""
    devices: list[FakeDevice] = []
    calls = FakeDevice()

    class NoBackendError(ValueError):
        pass

    core = SimpleNamespace(find=lambda **_wanted: devices, NoBackendError=NoBackendError)
    util = SimpleNamespace(claim_interface=calls.claim, dispose_resources=calls.dispose)
    for name, module in (("usb", SimpleNamespace()), ("usb.core", core), ("usb.util", util)):
        monkeypatch.setitem(sys.modules, name, module)
    return devices


def test_the_interface_is_claimed_from_the_kernel_and_read_with_a_time_out(plugged: list[FakeDevice]) -> None:
    device = FakeDevice()
    plugged.append(device)
    device.answers = [b"\x02sRA", OSError(errno.ETIMEDOUT, "timed out"), OSError(errno.EPIPE, "pipe"), b"x"]
    pipe = PyUsbPipe(None)
    assert [pipe.read(64, 0.2) for _ in range(4)] == [b"\x02sRA", b"", b"", b"x"]
    pipe.write(b"\x02sRN SCdevicestate\x03", 1.0)
    pipe.close()
    names = [call[0] for call in device.calls]
    assert names[:3] == ["is_kernel_driver_active", "detach_kernel_driver", "set_configuration"]
    assert ("clear_halt", 0x81) in device.calls
    assert ("read", 0x81, 64, 200) in device.calls
    assert device.calls[-1] == ("write", 0x02, b"\x02sRN SCdevicestate\x03", 1000)


def test_a_halt_that_comes_back_every_time_is_an_error(plugged: list[FakeDevice]) -> None:
    device = FakeDevice()
    plugged.append(device)
    device.answers = [OSError(errno.EPIPE, "pipe")] * 10
    pipe = PyUsbPipe(None)
    assert [pipe.read(64, 0.2) for _ in range(MOST_HALTS)] == [b""] * MOST_HALTS
    with pytest.raises(OSError, match="pipe"):
        pipe.read(64, 0.2)


async def test_no_device_or_too_many_are_told_apart(plugged: list[FakeDevice]) -> None:
    with pytest.raises(TimUnreachableError, match=r"No TiM5xx on USB \(19a2:5001\): check its cable, and its 24 V"):
        await probe(UsbTransport(), HASTY)
    plugged += [FakeDevice("1"), FakeDevice("2")]
    with pytest.raises(TimUnreachableError, match=r"2 TiM5xx on USB .* give the serial number of one"):
        await UsbTransport().open()
    with pytest.raises(TimUnreachableError, match="No TiM5xx with serial number 3"):
        await UsbTransport("3").open()
    second = UsbTransport("2")
    await second.open()
    await second.close()


async def test_a_device_of_root_alone_says_what_to_do(plugged: list[FakeDevice]) -> None:
    def refuse(*_values: object) -> None:
        raise OSError(errno.EACCES, "Permission denied")

    device = FakeDevice()
    device.__dict__["set_configuration"] = refuse
    plugged.append(device)
    with pytest.raises(TimUnreachableError, match=r"Permission denied.*udev gives you access to 19a2:5001"):
        await UsbTransport().open()


async def test_without_pyusb_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "usb.core", None)
    with pytest.raises(TimUnreachableError, match="pip install pyusb"):
        await UsbTransport().open()


async def test_a_device_opened_after_nobody_waits_any_more_is_closed(until: Until) -> None:
    plugging, closed = threading.Event(), threading.Event()

    def slow(_serial: str | None) -> Any:
        plugging.wait(5)
        return SimpleNamespace(close=closed.set)

    opening = asyncio.create_task(UsbTransport(open_pipe=slow).open())
    await asyncio.sleep(0.01)
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    plugging.set()
    await until(closed.is_set)
