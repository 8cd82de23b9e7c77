"""The base itself, whatever protocol it speaks: modes, motion, power, faults, 10 ms at a time.

No clock of its own, no I/O. Where nobody published what the real base does, `Unknowns` says what this one does.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from drivers.rmp110.codec import faults
from drivers.rmp110.codec.parameters import ModeRequest, OperationalState, Stored
from drivers.rmp110.simulator.dynamics import CAN_BITS, DT, TICK_NS, Drive, Settings
from drivers.rmp110.simulator.fault_memory import FaultMemory
from drivers.rmp110.simulator.power import LOW_PERCENT, Power
from drivers.rmp110.simulator.unknowns import Unknowns

LATENCY_TICKS = 4
"""Command to effect 40 ms; a mode shows 40 to 50 ms after its request (fact sheet 3.5)."""
COMMAND_TIMEOUT_TICKS = 50
"""Without a motion frame for 0.50 s the targets ramp to zero (fact sheet 9.6)."""
BOOT_S = 8.96
"""Power-on to STANDBY, as logged on a real machine (fact sheet section 5)."""
BOOT_STATES = ((1.0, 3), (0.3, 2), (0.1, 1), (0.0, 0))
"""From which share of the boot time on a state shows; the startup check takes most of it in the logs."""
KILL_RESPONSE = 0x200
"""`dynamic_response` in the last packet after the kill switch."""
STANDBY_MPS = 0.05
"""Faster than this a STANDBY request is ignored."""
LAST_WORDS_TICKS = 100
"""A base that switches off and is not asked any more is off after a second."""
BOOKING_TICKS = 100
"""Charge and temperature change slowly."""
STILL = (0.0, 0.0)

MCU_LOW, MCU_EMPTY = 0x10, 0x80
"""Bits of `mcu_1_fault_status`."""
MCU1_SLOWER, MCU1_STOP = 0x40, 0x80
"""Bits of fault status word 4: motor controller 1 requests reduced performance, requests zero speed."""

RUNNING = (OperationalState.STANDBY, OperationalState.TRACTOR)


class Machine:
    """An RMP 110 without its wire; subclasses take commands and tell its state."""

    bitmap_bits = CAN_BITS

    def __init__(
        self,
        now_ns: int,
        stored: Stored,
        *,
        boot_s: float = BOOT_S,
        integrators_m: tuple[float, float] = (12.75, 12.5),
        unknowns: Unknowns | None = None,
    ) -> None:
        self.unknowns = unknowns or Unknowns()
        self.stored = stored
        self.power = Power()
        self.memory = FaultMemory()
        self.charging = False
        """The charger is plugged in."""
        self.modes_stuck = False
        """Mode requests have no effect, as if the base were busy with itself."""
        self._boot_ticks = round(boot_s / DT)
        self._integrators_m = integrators_m
        self._blocked = False
        self._grip = (1.0, 1.0)
        self._odometer_m = 0.0
        self._ticks = 0
        self.power_on(now_ns)

    @property
    def stored(self) -> Stored:
        """The stored parameters, bit for bit."""
        return self._stored

    @stored.setter
    def stored(self, stored: Stored) -> None:
        self._stored = stored
        self._take_over(stored)

    def _take_over(self, stored: Stored) -> None:
        """What is derived from the stored parameters."""
        self.settings = Settings.of(stored, self.bitmap_bits)

    def power_on(self, now_ns: int) -> None:
        """The power button; the wheel integrators do not start at zero."""
        self.memory.power_on(self._ticks * DT)
        self._restart(now_ns)
        self.state = OperationalState.CCU_INIT

    def restart(self, now_ns: int) -> None:
        """A watchdog reset of its processor: at once in STANDBY, as if nothing had been commanded."""
        self._restart(now_ns)
        self.state = OperationalState.STANDBY

    def _restart(self, now_ns: int) -> None:
        self.powered = True
        self._tick_ns = now_ns
        self._ticks = 0
        self.fault_words = [0, 0, 0, 0]
        self.mcu_faults = [0, 0, 0, 0]
        self.dynamic_response = 0
        self._last_words_ticks = 0
        self._stopping = False
        self._command = STILL
        self._motion_tick = -COMMAND_TIMEOUT_TICKS - LATENCY_TICKS
        self._pending: deque[tuple[int, tuple[float, float] | ModeRequest]] = deque(maxlen=1024)
        self.odom = (0.0, 0.0, 0.0)
        right_m, left_m = self._integrators_m
        float32 = self.unknowns.float32_positions
        self.drive = Drive(right_m, left_m, (right_m + left_m) / 2, float32=float32, odometer_m=self._odometer_m)
        self.drive.blocked, self.drive.grip = self._blocked, self._grip

    def power_off(self) -> None:
        """Battery out: silent at once, wheels brake."""
        self.powered = False

    def kill_switch(self) -> None:
        """State 6 and fault 0x40 in one more packet, then silence until the power button."""
        self.dynamic_response = KILL_RESPONSE
        self.raise_fault(0, faults.KILL_SWITCH)
        self._shut_down()

    def block(self) -> None:
        """The wheels stand against an obstacle: targets go on, speeds and positions do not."""
        self.drive.blocked = self._blocked = True

    def unblock(self) -> None:
        self.drive.blocked = self._blocked = False

    def slip(self, left: float, right: float) -> None:
        """From now on only this share of what each wheel turns moves the base; 1 is full grip, 0 spins in place."""
        if not (0.0 <= left <= 1.0 and 0.0 <= right <= 1.0):
            raise ValueError(f"grip is between 0 and 1, not {left}, {right}")
        self.drive.grip = self._grip = (left, right)

    def recharge(self, percent: float = 100.0) -> None:
        """Another charge in the propulsion pack; its fault goes with the next power cycle."""
        self.power.percent = percent

    @property
    def battery_percent(self) -> float:
        return self.power.percent

    @property
    def power_cycles(self) -> int:
        return self.memory.power_cycles

    @property
    def run_time_s(self) -> float:
        """Since power-on, in steps of 10 ms."""
        return self._ticks * DT

    @property
    def twist(self) -> tuple[float, float]:
        """What the base really does on the floor: m/s forward, rad/s counter-clockwise (REP-103)."""
        return self.drive.twist(self.settings)

    def step(self, now_ns: int) -> None:
        """Advance to `now_ns` in whole ticks."""
        while self._tick_ns + TICK_NS <= now_ns:
            self._tick_ns += TICK_NS
            self._tick()

    def raise_fault(self, word: int, bits: int) -> None:
        """Set bits of fault status word 1..4 (`word` 0..3); they stay until the next power-on."""
        self.fault_words[word] |= bits
        self.note_faults()

    def note_faults(self) -> None:
        """Write what is new in the fault words into the base's own log."""
        self.memory.note(self.fault_words, self.run_time_s, self.drive.odometer_m)

    def command_motion(self, velocity: float, yaw_rate: float) -> None:
        """A normalised command, clockwise-positive; has its effect after the latency, and only in TRACTOR."""
        self._motion_tick = self._ticks
        self._pending.append((self._ticks + LATENCY_TICKS, (velocity, yaw_rate)))

    def keep_motion(self) -> None:
        """The motion timeout starts anew without a new command."""
        self._motion_tick = max(self._motion_tick, self._ticks)

    @property
    def commands_fresh(self) -> bool:
        """Whether the last motion command has not run out yet."""
        return self._ticks - self._motion_tick < COMMAND_TIMEOUT_TICKS + LATENCY_TICKS

    def request_mode(self, word: int) -> None:
        """Ask for a mode; numbers that mean none are ignored."""
        if not self.modes_stuck and word in list(ModeRequest):
            self._pending.append((self._ticks + LATENCY_TICKS, ModeRequest(word)))

    def reset_integrators(self, bits: int) -> None:
        """Bits: 1 linear, 2 right, 4 left; the rear wheels of a 110 are casters."""
        drive = self.drive
        if bits & 1:
            drive.linear_m = 0.0
        if bits & 2:
            drive.right_m = 0.0
        if bits & 4:
            drive.left_m = 0.0

    def say_last_words(self) -> bool:
        """Whether a reply may still go out: always while on, once more while switching off."""
        if not self.powered:
            return False
        if self.state is not OperationalState.POWERDOWN:
            return True
        self.powered = False
        return self._last_words_ticks > 0

    def _tick(self) -> None:
        self._ticks += 1
        pending = self._pending
        while pending and pending[0][0] <= self._ticks:
            action = pending.popleft()[1]
            if isinstance(action, ModeRequest):
                self._change_mode(action)
            else:
                self._command = action
        if not self.commands_fresh:
            self._command = STILL
        if self.state not in RUNNING:
            self._boot_or_end()
        self._move()
        if self._ticks % BOOKING_TICKS == 0:
            self._book()

    def _boot_or_end(self) -> None:
        if self.state is OperationalState.POWERDOWN:
            self._last_words_ticks -= 1
            self.powered = self.powered and self._last_words_ticks > 0
            return
        done = self._ticks / max(self._boot_ticks, 1)
        self.state = OperationalState(next(state for share, state in BOOT_STATES if done >= share))

    def _change_mode(self, request: ModeRequest) -> None:
        running = self.state in RUNNING
        slow = max(abs(speed) for speed in self.drive.wheels(self.settings.track_m)) < STANDBY_MPS
        if request is ModeRequest.DISABLE:
            self.raise_fault(0, faults.COMMANDED_DISABLE)
            self._shut_down()
        elif request is ModeRequest.POWERDOWN:
            self._shut_down()
        elif request is ModeRequest.DTZ and running:
            self._stopping = True
        elif request is ModeRequest.TRACTOR and running and self._may_drive():
            self.state = OperationalState.TRACTOR
        elif request is ModeRequest.STANDBY and running and (slow or self.unknowns.standby_while_rolling):
            self.state = OperationalState.STANDBY

    def _may_drive(self) -> bool:
        held = self.charging and self.unknowns.charger_blocks and not self.settings.drive_while_charging
        return not (held or self._stopping or any(self.fault_words))

    def _shut_down(self) -> None:
        if self.state is not OperationalState.POWERDOWN:
            self.state = OperationalState.POWERDOWN
            self._last_words_ticks = LAST_WORDS_TICKS

    def _move(self) -> None:
        drive, settings = self.drive, self.settings
        if self.powered and self.state is OperationalState.TRACTOR:
            drive.open_limits(settings)
        else:
            drive.shut_limits()
            if drive.resting:
                # Nothing turns and nothing may: most of a base's life.
                if self._stopping:
                    self._end_stopping()
                self.power.tick(drive)
                return
        command, decel = self._command, settings.decel
        if self._stopping or not self.powered or self.state is OperationalState.POWERDOWN:
            command, decel = STILL, settings.dtz_decel
        drive.follow(*command, settings, decel)
        self.power.tick(drive)
        if drive.v or drive.yaw:
            x, y, yaw = self.odom
            yaw -= drive.yaw * DT
            self.odom = x + drive.v * DT * math.cos(yaw), y + drive.v * DT * math.sin(yaw), yaw
        if self._stopping and drive.resting:
            self._end_stopping()

    def _end_stopping(self) -> None:
        self._stopping = False
        if self.unknowns.dtz_switches_off:
            self._shut_down()
        elif self.state is OperationalState.TRACTOR:
            self.state = OperationalState.STANDBY

    def _book(self) -> None:
        """Once a second: the batteries, and what is wrong with them."""
        self._odometer_m = self.drive.odometer_m
        if self.powered:
            self.power.settle(BOOKING_TICKS * DT)
        if self.power.percent < LOW_PERCENT:
            self.mcu_faults[1] |= MCU_LOW
            self.fault_words[3] |= MCU1_SLOWER
        if self.power.percent <= 0.0 and self.unknowns.empty_switches_off and self.state in RUNNING:
            self.mcu_faults[1] |= MCU_EMPTY
            self.fault_words[3] |= MCU1_STOP
            self._stopping = True
        self.note_faults()


Reading = Callable[[Machine], float]
"""One feedback word's value; whole numbers for words that are no floats."""
