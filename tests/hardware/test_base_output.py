"""The only path from the safety chain to the wheels, judged by the frames on the wire."""

from __future__ import annotations

import asyncio
import struct
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass, field

import pytest

from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.serve import serve
from drivers.rmp110.transport.can_bus import CanTransport
from drivers.rmp110.transport.datagram import DatagramTransport
from drivers.rmp110.transport.serial_port import SerialTransport
from ghal360_robot.board import make_board
from ghal360_robot.config import Rmp110Section, RobotConfig, SafetySection, with_overrides
from ghal360_robot.hardware.base import BaseOutput, driver_config, transport
from ghal360_robot.messages import STILL, Applied, ArmState, BaseState, Twist

FORWARD = Applied(Twist(0.3, 0.2), ArmState.ARMED, ())
HELD = Applied(STILL, ArmState.ARMED, ("dead man released",))
DISARMED = Applied(STILL, ArmState.DISARMED, ("disarmed by the operator",))
ESTOP = Applied(STILL, ArmState.ESTOP, ("emergency stop pressed",))
MOTION, CONFIGURATION, MODE_REQUEST, TO_STANDBY = 0x500, 0x501, 32, 4


@dataclass
class Wire:
    """Stands for the logbook: every frame sent, with its time."""

    sent: list[tuple[int, int, bytes]] = field(default_factory=list)

    def can_frame(self, stamp_ns: int, direction: str, can_id: int, data: bytes) -> None:
        if direction == "tx":
            self.sent.append((stamp_ns, can_id, data))

    def base_state(self, state: BaseState) -> None:
        """Not looked at."""

    def moving(self, since_ns: int = 0) -> list[int]:
        """When non-zero motion was sent."""
        return [t for t, i, data in self.sent if i == MOTION and t >= since_ns and any(struct.unpack(">2f", data))]

    def mode_requests(self, since_ns: int) -> list[int]:
        words = [struct.unpack(">2I", data) for t, i, data in self.sent if i == CONFIGURATION and t >= since_ns]
        return [value for number, value in words if number == MODE_REQUEST]


async def driven(after_s: float, then: Applied) -> tuple[Wire, int]:
    """Arm and drive for `after_s`, then apply something else for a second; when that began."""
    wire = Wire()
    async with serve(model=RmpModel(time.monotonic_ns(), boot_s=0.1)) as simulated, AsyncExitStack() as stack:
        config = with_overrides(
            RobotConfig(), {"rmp110": {"interface": "socketcand", "host": "127.0.0.1", "port": simulated.port}}
        )
        base = BaseOutput(config.rmp110, config.safety, make_board(config, 20.0), wire)  # type: ignore[arg-type]
        await base.enter(stack)
        async with asyncio.timeout(10):
            while base.stats().link != "streaming":
                await asyncio.sleep(0.01)
        began = time.monotonic()
        while time.monotonic() - began < after_s or not (wire.moving() or after_s < 0.2):
            base.apply(FORWARD)
            await asyncio.sleep(0.02)
        changed_ns = time.monotonic_ns()
        while time.monotonic_ns() - changed_ns < 1_000_000_000:
            base.apply(then)
            await asyncio.sleep(0.02)
        return Wire(list(wire.sent)), changed_ns  # what closing sends does not count


@pytest.mark.parametrize("then", [DISARMED, ESTOP], ids=["disarm", "estop"])
@pytest.mark.parametrize("after_s", [0.03, 0.1, 0.3, 1.0])
async def test_a_disarm_is_zero_at_once_and_standby_soon_however_short_the_drive(after_s: float, then: Applied) -> None:
    wire, changed_ns = await driven(after_s, then)
    assert wire.moving(changed_ns) == []
    assert wire.mode_requests(changed_ns)[-1] == TO_STANDBY


@pytest.mark.parametrize("after_s", [0.3, 1.0])
async def test_a_released_dead_man_is_zero_at_once_and_keeps_the_mode(after_s: float) -> None:
    wire, changed_ns = await driven(after_s, HELD)
    assert wire.moving()
    assert wire.moving(changed_ns) == []
    assert wire.mode_requests(changed_ns) == []


def test_the_configured_protocol_picks_the_way_to_the_base() -> None:
    can = Rmp110Section(interface="virtual", dialect="b3")
    assert isinstance(transport(can), CanTransport)
    assert (driver_config(can, SafetySection()).protocol, driver_config(can, SafetySection()).dialect) == ("can", "b3")
    udp = Rmp110Section(protocol="v3-udp", host="10.66.171.5")
    assert isinstance(transport(udp), DatagramTransport)
    assert driver_config(udp, SafetySection()).protocol == "v3"
    assert isinstance(transport(Rmp110Section(protocol="v3-usb")), SerialTransport)


def test_the_base_is_expected_to_have_stored_what_the_configuration_says() -> None:
    section = Rmp110Section(track_m=0.542391, tire_m=0.48, gear_ratio=24.0, stored_accel=0.7, stored_w_accel=2.0)
    expected = driver_config(section, SafetySection(decel=0.6)).expected
    assert (expected["track_width"], expected["tire_diameter"], expected["gear_ratio"]) == (0.542391, 0.48, 24.0)
    assert (expected["max_accel"], expected["max_decel"], expected["max_yaw_accel"]) == (0.7, 0.6, 2.0)
