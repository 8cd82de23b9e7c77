"""The base: its states onto the board, every CAN frame into the logbook, and the only hand on its motion."""

from __future__ import annotations

import asyncio
import logging
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING, Any

from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, OperationalState
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.rmp110 import STANDBY, TRACTOR, Rmp110
from drivers.rmp110.device.state import LinkState
from drivers.rmp110.errors import RmpError, RmpHeld
from drivers.rmp110.transport.can_bus import CanTransport
from drivers.rmp110.transport.datagram import PORT as V3_PORT
from drivers.rmp110.transport.datagram import DatagramTransport
from drivers.rmp110.transport.serial_port import SerialTransport
from ghal360_robot.hardware.link_stats import link_stats
from ghal360_robot.messages import STILL, ArmState, BaseMode, BaseState, Pose2, Twist

if TYPE_CHECKING:
    from drivers.rmp110.device.state import State
    from drivers.rmp110.transport.base import Transport
    from ghal360_robot.board import Board
    from ghal360_robot.config import Rmp110Section, SafetySection
    from ghal360_robot.logbook.recorder import Recorder
    from ghal360_robot.messages import Applied, LinkStats

logger = logging.getLogger(__name__)

MODES = {
    OperationalState.CCU_INIT: BaseMode.STARTING,
    OperationalState.INIT_PROPULSION: BaseMode.STARTING,
    OperationalState.CHECK_STARTUP: BaseMode.STARTING,
    OperationalState.STANDBY: BaseMode.STANDBY,
    OperationalState.TRACTOR: BaseMode.DRIVE,
    OperationalState.DISABLED_OR_BALANCE: BaseMode.OFF,
    OperationalState.POWERDOWN: BaseMode.OFF,
    OperationalState.UNKNOWN: BaseMode.UNKNOWN,
}

LINK_WORDS = {LinkState.PROBING: LinkState.IDENTIFYING.value}
"""All devices share one set of words."""

RETRY_NS = 500_000_000
"""A refused TRACTOR is asked for again at this pace while the operator keeps the robot armed."""


class BaseOutput:
    """An RMP-110 that runs until the robot ends; `apply` is the actuator of the control loop.

    `base` is the device to run, by default the one that `config` describes.
    """

    name = "rmp110"

    def __init__(
        self,
        config: Rmp110Section,
        safety: SafetySection,
        board: Board,
        recorder: Recorder,
        base: Rmp110 | None = None,
    ) -> None:
        self._board = board
        self._recorder = recorder
        self._base = base or Rmp110(lambda: transport(config), driver_config(config, safety), recorder.can_frame)
        self._mode_change: asyncio.Task[None] | None = None
        self._asked_ns = 0
        self._said = ""
        self._warned: set[str] = set()

    async def enter(self, stack: AsyncExitStack) -> None:
        await stack.enter_async_context(self._base)
        stack.push_async_callback(self._end_mode_change)

    async def run(self) -> None:
        async for state in self._base.states():
            message = base_state(state)
            self._board.put_base(message)
            self._recorder.base_state(message)
            for sentence in set(state.warnings) - self._warned:
                logger.warning("base: %s", sentence)
            self._warned = set(state.warnings)

    def apply(self, applied: Applied) -> None:
        """Send one motion command where the base may be driven, and keep its mode what arming asks for."""
        latest = self._base.latest
        if latest is None or self._base.link is not LinkState.STREAMING:
            return
        armed = applied.arm is ArmState.ARMED
        if self._mode_change is not None and not self._mode_change.done():
            return  # on the way to STANDBY the driver sends zero itself, and nothing moves before TRACTOR
        refusal = self._base.refusal()
        if refusal is None or isinstance(refusal, RmpHeld):
            # Held by the driver's watchdog: it takes a zero for an acknowledgement.
            self._send(applied.twist if armed and refusal is None else STILL)
        elif armed and latest.stamp_ns - self._asked_ns >= RETRY_NS:
            self._asked_ns = latest.stamp_ns
            self._ask(TRACTOR)
        over = latest.latched is not None and latest.trouble_now is None
        if not armed and (over or latest.mode is OperationalState.TRACTOR):
            self._ask(STANDBY)  # after the zero, and never put off; who armed has been told of any trouble

    def stats(self) -> LinkStats:
        stats = self._base.stats
        return link_stats(LINK_WORDS.get(stats.link, stats.link.value), stats)

    def _send(self, twist: Twist) -> None:
        try:
            self._base.send_motion(twist.v, twist.w)
        except RmpError as error:
            self._say(f"base: {error}")

    def _ask(self, mode: ModeRequest) -> None:
        self._mode_change = asyncio.create_task(self._change(mode), name=f"base to {mode.name}")

    async def _change(self, mode: ModeRequest) -> None:
        try:
            await self._base.request_mode(mode)
            self._said = ""
        except RmpError as error:
            self._say(f"base: {error}")

    async def _end_mode_change(self) -> None:
        """At the end nobody wants TRACTOR any more; the driver itself leaves the base in STANDBY."""
        if self._mode_change is not None:
            self._mode_change.cancel()
            await asyncio.wait({self._mode_change})

    def _say(self, sentence: str) -> None:
        """Once, not fifty times a second."""
        if sentence != self._said:
            self._said = sentence
            logger.warning("%s", sentence)


def transport(config: Rmp110Section) -> Transport:
    """The way to the base that the configuration names; a fresh one for every attempt to connect."""
    if config.protocol == "v3-udp":
        return DatagramTransport(config.host, config.port or V3_PORT)
    if config.protocol == "v3-usb":
        return SerialTransport(config.device)
    options: dict[str, Any] = {"host": config.host, "port": config.port} if config.host else {}
    return CanTransport(config.interface, config.channel, **options)


def driver_config(config: Rmp110Section, safety: SafetySection) -> Rmp110Config:
    """What the driver may do, and what it expects to find stored in the base."""
    return Rmp110Config(
        max_v_mps=safety.v_max,
        max_w_rps=safety.w_max,
        track_m=config.track_m,
        expected={
            **RMP110_STORED,
            "max_accel": config.stored_accel,
            "max_decel": safety.decel,
            "max_yaw_accel": config.stored_w_accel,
            "tire_diameter": config.tire_m,
            "track_width": config.track_m,
            "gear_ratio": config.gear_ratio,
        },
        write_parameters=config.write_parameters,
        write_feedback_set=config.write_feedback_set,
        protocol="can" if config.protocol == "can" else "v3",
        dialect=config.dialect,
    )


def base_state(state: State) -> BaseState:
    """The driver's state as the robot's message."""
    return BaseState(
        stamp_ns=state.stamp_ns,
        mode=MODES[state.mode],
        pose=Pose2(state.x, state.y, state.yaw),
        twist=Twist(state.v, state.w),
        battery_percent=state.battery_percent,
        faults=(state.trouble,) if state.trouble else (),
        temperature_degc=state.temperature_degc,
        covariance=state.covariance,
        warnings=state.slipping,
    )
