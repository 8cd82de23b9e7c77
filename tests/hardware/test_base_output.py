"""The only path from the safety chain to the wheels, judged by the frames on the wire."""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field

import pytest

from drivers.rmp110.codec.parameters import OperationalState
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
    states: list[BaseState] = field(default_factory=list)

    def can_frame(self, stamp_ns: int, direction: str, can_id: int, data: bytes) -> None:
        if direction == "tx":
            self.sent.append((stamp_ns, can_id, data))

    def base_state(self, state: BaseState) -> None:
        self.states.append(state)

    def moving(self, since_ns: int = 0) -> list[int]:
        """When non-zero motion was sent."""
        return [t for t, i, data in self.sent if i == MOTION and t >= since_ns and any(struct.unpack(">2f", data))]

    def mode_requests(self, since_ns: int) -> list[int]:
        words = [struct.unpack(">2I", data) for t, i, data in self.sent if i == CONFIGURATION and t >= since_ns]
        return [value for number, value in words if number == MODE_REQUEST]


@asynccontextmanager
async def connected(wire: Wire) -> AsyncIterator[tuple[BaseOutput, RmpModel]]:
    """A base that is on, and what drives it."""
    model = RmpModel(time.monotonic_ns(), boot_s=0.1)
    async with serve(model=model) as simulated, AsyncExitStack() as stack:
        config = with_overrides(
            RobotConfig(), {"rmp110": {"interface": "socketcand", "host": "127.0.0.1", "port": simulated.port}}
        )
        base = BaseOutput(config.rmp110, config.safety, make_board(config, 20.0), wire)  # type: ignore[arg-type]
        running = asyncio.create_task(base.run())
        stack.push_async_callback(asyncio.wait, {running})
        await base.enter(stack)
        async with asyncio.timeout(10):
            while base.stats().link != "streaming":
                await asyncio.sleep(0.01)
        yield base, model


async def apply_until(
    base: BaseOutput, applied: Applied, condition: Callable[[], object], timeout_s: float = 5.0
) -> None:
    """One command every 20 ms, as the control loop has it."""
    async with asyncio.timeout(timeout_s):
        while not condition():
            base.apply(applied)
            await asyncio.sleep(0.02)


async def apply_for(base: BaseOutput, applied: Applied, seconds: float) -> None:
    end_ns = time.monotonic_ns() + round(seconds * 1e9)
    await apply_until(base, applied, lambda: time.monotonic_ns() >= end_ns)


async def driven(after_s: float, then: Applied) -> tuple[Wire, int]:
    """Arm and drive for `after_s`, then apply something else for a second; when that began."""
    wire = Wire()
    async with connected(wire) as (base, _):
        began = time.monotonic()
        while time.monotonic() - began < after_s or not (wire.moving() or after_s < 0.2):
            base.apply(FORWARD)
            await asyncio.sleep(0.02)
        changed_ns = time.monotonic_ns()
        await apply_for(base, then, 1.0)
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


async def test_an_intervention_of_one_packet_stops_the_robot_until_it_was_disarmed() -> None:
    wire = Wire()
    async with connected(wire) as (base, model):
        await apply_until(base, FORWARD, wire.moving)
        model.dynamic_response = 0x10
        await apply_until(base, FORWARD, lambda: wire.states[-1].faults)
        model.dynamic_response = 0
        since_ns = time.monotonic_ns()
        await apply_for(base, FORWARD, 1.2)
        assert wire.moving(since_ns) == []
        assert wire.mode_requests(since_ns) == []
        assert "of its own accord" in wire.states[-1].faults[0]
        await apply_until(base, DISARMED, lambda: not wire.states[-1].faults)
        assert model.state is OperationalState.STANDBY
        since_ns = time.monotonic_ns()
        await apply_until(base, FORWARD, lambda: wire.moving(since_ns))


async def test_after_the_watchdog_held_the_base_zero_comes_first_and_no_mode_is_asked_for() -> None:
    wire = Wire()
    async with connected(wire) as (base, _):
        await apply_until(base, FORWARD, wire.moving)
        await apply_for(base, FORWARD, 0.2)
        time.sleep(0.35)  # noqa: ASYNC251 - exactly that
        since_ns = time.monotonic_ns()
        await asyncio.sleep(0.1)
        await apply_until(base, FORWARD, lambda: wire.moving(since_ns))
        motions = [data for t, can_id, data in wire.sent if can_id == MOTION and t >= since_ns]
        assert motions[0] == bytes(8)
        assert wire.mode_requests(since_ns) == []


async def test_a_robot_that_ends_just_when_it_is_armed_leaves_the_base_in_standby() -> None:
    async with connected(Wire()) as (base, model):
        base.apply(FORWARD)
        await asyncio.sleep(0.01)
    await asyncio.sleep(0.2)
    model.step(time.monotonic_ns())
    assert model.state is OperationalState.STANDBY


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
