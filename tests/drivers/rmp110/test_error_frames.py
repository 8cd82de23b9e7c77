"""What Linux' error frames mean, and what a person is told about them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.transport.bus_health import BusHealth
from drivers.rmp110.transport.error_frames import Controller, ErrorClass, ErrorFrame, parse_error_frame

ERROR_FLAG = 0x20000000


def hexed(text: str) -> bytes:
    return bytes.fromhex(text)


@pytest.mark.parametrize(
    ("can_id", "data", "expected"),
    [
        (0x040, "00 00 00 00 00 00 00 00", ErrorFrame(ErrorClass.BUS_OFF)),
        (0x100, "00 00 00 00 00 00 00 00", ErrorFrame(ErrorClass.RESTARTED)),
        (0x020, "00 00 00 00 00 00 00 00", ErrorFrame(ErrorClass.NO_ACK)),
        # As mcp251x and gs_usb send them: controller problem, with both counters.
        (0x204, "00 08 00 00 00 00 60 00", ErrorFrame(ErrorClass(0x204), Controller.TX_WARNING, 96, 0)),
        (0x004, "00 20 00 00 00 00 80 00", ErrorFrame(ErrorClass.CONTROLLER, Controller.TX_PASSIVE, 128, 0)),
        (0x004, "00 10 00 00 00 00 00 87", ErrorFrame(ErrorClass.CONTROLLER, Controller.RX_PASSIVE, 0, 135)),
        (0x004, "00 40 00 00 00 00 5F 00", ErrorFrame(ErrorClass.CONTROLLER, Controller.ACTIVE, 95, 0)),
        (0x004, "00 01 00 00 00 00 00 00", ErrorFrame(ErrorClass.CONTROLLER, Controller.RX_OVERFLOW)),
        # Without the controller class, byte 1 says nothing.
        (0x088, "00 20 04 19 00 00 00 00", ErrorFrame(ErrorClass.PROTOCOL | ErrorClass.BUS_ERROR)),
        (ERROR_FLAG | 0x0A8, "", ErrorFrame(ErrorClass.PROTOCOL | ErrorClass.NO_ACK | ErrorClass.BUS_ERROR)),
    ],
)
def test_error_frames_as_linux_sends_them(can_id: int, data: str, expected: ErrorFrame) -> None:
    assert parse_error_frame(can_id, hexed(data)) == expected


@given(st.integers(0, 0xFFFFFFFF), st.binary(max_size=64))
def test_any_error_frame_is_read_and_judged_without_raising(can_id: int, data: bytes) -> None:
    frame = parse_error_frame(can_id, data)
    health = BusHealth("can0")
    warning, lost = health.judge(frame)
    assert (lost is not None) == bool(can_id & 0x40)
    assert health.counts.frames == 1
    assert warning is None or "\n" not in warning


def test_error_passive_is_a_warning_with_counters_and_told_once_until_the_controller_recovers() -> None:
    health = BusHealth("can3")
    passive = parse_error_frame(0x004, hexed("00 20 00 00 00 00 80 03"))
    active = parse_error_frame(0x004, hexed("00 40 00 00 00 00 10 00"))
    warning, lost = health.judge(passive)
    assert lost is None
    assert warning is not None
    assert warning.startswith("CAN interface can3 is error-passive (128 transmit, 3 receive errors)")
    assert "termination" in warning
    assert health.judge(passive) == (None, None)
    assert health.judge(active) == (None, None)
    assert health.judge(passive)[0] == warning
    assert (health.counts.passive, health.counts.frames) == (3, 4)


def test_bus_off_says_what_brings_it_back() -> None:
    health = BusHealth("can3")
    warning, lost = health.judge(ErrorFrame(ErrorClass.BUS_OFF))
    assert warning is None
    assert lost is not None
    assert "bus-off" in lost
    # The kernel takes restart-ms only while the interface is down.
    assert lost.index("set can3 down") < lost.index("type can bitrate 1000000 restart-ms 100")
    assert health.counts.bus_off == 1


def test_nobody_acknowledging_and_lost_frames_are_told_apart() -> None:
    health = BusHealth("can0")
    assert "nobody acknowledges" in (health.judge(ErrorFrame(ErrorClass.NO_ACK))[0] or "")
    full = ErrorFrame(ErrorClass.CONTROLLER, Controller.RX_OVERFLOW)
    assert "lost frames" in (health.judge(full)[0] or "")
    assert health.judge(ErrorFrame(ErrorClass.CONTROLLER, Controller.RX_WARNING)) == (None, None)
    counts = health.counts
    assert (counts.no_ack, counts.overflow, counts.warning, counts.passive) == (1, 1, 1, 0)
