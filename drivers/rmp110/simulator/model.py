"""The base itself: commands in, feedback out, 10 ms at a time; no clock of its own, no I/O.

Where nobody published what the real base does, this one does the worse of what it might do.
"""

from __future__ import annotations

import math
from collections import deque

from drivers.rmp110.codec import faults
from drivers.rmp110.codec.feedback import FACTORY_BITMAPS, Dialect, Layout, split_frames
from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, float_to_word, unpack_words, word_to_float
from drivers.rmp110.codec.parameters import (
    BY_NUMBER,
    PARAMETERS,
    RMP110_STORED,
    ModeRequest,
    Number,
    OperationalState,
    Stored,
)
from drivers.rmp110.simulator.dynamics import DT, TICK_NS, Drive

LATENCY_TICKS = 4
"""Command to effect 40 ms; a mode shows 40 to 50 ms after its request (fact sheet 3.5)."""
COMMAND_TIMEOUT_TICKS = 50
"""Without a motion frame for 0.50 s the targets ramp to zero; polls do not count (fact sheet 9.6)."""
BOOT_S = 8.96
"""Power-on to STANDBY, as logged on a real machine (fact sheet section 5)."""
KILL_RESPONSE = 0x200
"""`dynamic_response` in the last packet after the kill switch."""
STANDBY_MPS = 0.05
"""Faster than this a STANDBY request is ignored."""
TRUE_TIRE_M, TRUE_TRACK_M = RMP110_STORED["tire_diameter"], RMP110_STORED["track_width"]
"""The metal of the simulated base, whatever its parameters say."""
LATERAL_TERM_MPS2 = 4.905
"""Dialect B3's twenty-first parameter."""
FAULT_LOG_WORDS, FAULT_LOG_PACKETS = 52, 6


class RmpModel:
    """An RMP 110. `step` it with a monotonic clock, give it frames with `receive`.

    Of dialect B3 only the longer configuration reply is modelled, for drivers that have to tell them apart.
    """

    def __init__(
        self,
        now_ns: int,
        stored: Stored | None = None,
        *,
        boot_s: float = BOOT_S,
        dialect: Dialect = Dialect.B2,
        integrators_m: tuple[float, float] = (12.75, 12.5),
    ) -> None:
        self.stored = stored or Stored.of(RMP110_STORED)
        self._boot_ticks = round(boot_s / DT)
        self._dialect = dialect
        self._integrators_m = integrators_m
        self.battery_percent = 96.875
        self.power_cycles = 0
        self.power_on(now_ns)

    def power_on(self, now_ns: int) -> None:
        """The power button; the wheel integrators do not start at zero."""
        self.powered = True
        self.power_cycles += 1
        self._tick_ns = now_ns
        self._ticks = 0
        self.state = OperationalState.CCU_INIT
        self.fault_words = [0, 0, 0, 0]
        self._dynamic_response = 0
        self._last_words = False
        self._stopping = False
        self._force_config = False
        self._log_packet = 0
        self._command = (0.0, 0.0)
        self._motion_tick = 0
        self._pending: deque[tuple[int, tuple[float, float] | ModeRequest]] = deque(maxlen=1024)
        self.drive = Drive(*self._integrators_m)

    def power_off(self) -> None:
        """Battery out: silent at once, wheels brake."""
        self.powered = False

    def kill_switch(self) -> None:
        """State 6 and fault 0x40 in one more packet, then silence until the power button."""
        self.fault_words[0] |= faults.KILL_SWITCH
        self._dynamic_response = KILL_RESPONSE
        self._shut_down()

    def block(self) -> None:
        """The wheels stand against an obstacle: targets go on, speeds and positions do not."""
        self.drive.blocked = True

    def unblock(self) -> None:
        self.drive.blocked = False

    @property
    def twist(self) -> tuple[float, float]:
        """What the base really does on the floor: m/s forward, rad/s counter-clockwise (REP-103)."""
        right, left = self.drive.wheels(self.stored["track_width"])
        slip = TRUE_TIRE_M / self.stored["tire_diameter"]
        return slip * (right + left) / 2, slip * (right - left) / TRUE_TRACK_M

    def step(self, now_ns: int) -> None:
        """Advance to `now_ns` in whole ticks."""
        while self._tick_ns + TICK_NS <= now_ns:
            self._tick_ns += TICK_NS
            self._tick()

    def receive(self, now_ns: int, frame: Frame) -> tuple[Frame, ...]:
        """One frame from the bus; the reply, in the state before the frame has any effect."""
        self.step(now_ns)
        if not self.powered or len(frame.data) != 8 or frame.can_id not in (MOTION_ID, CONFIG_ID):
            return ()
        high, low = unpack_words(frame.data)
        reply: tuple[int, ...] | None = None
        if frame.can_id == MOTION_ID:
            self._receive_motion(high, low)
        else:
            reply = self._receive_config(high, low)
        if self.state is OperationalState.POWERDOWN:
            if not self._last_words:
                self.powered = False
                return ()
            self._last_words = False
        return split_frames(reply if reply is not None else self._feedback())

    def _receive_motion(self, high: int, low: int) -> None:
        velocity, yaw_rate = word_to_float(high), word_to_float(low)
        if not all(math.isfinite(value) and abs(value) <= 1.0 for value in (velocity, yaw_rate)):
            self.fault_words[1] |= faults.BAD_MOTION_COMMAND
            return
        self._motion_tick = self._ticks
        self._pending.append((self._ticks + LATENCY_TICKS, (velocity, yaw_rate)))

    def _receive_config(self, number: int, word: int) -> tuple[int, ...] | None:
        """Take a configuration command; words where the reply is not the usual feedback."""
        if number in BY_NUMBER:
            self._store(number, word)
        elif number == Number.FORCE_CONFIG_FEEDBACK:
            self._force_config = word != 0
        elif number == Number.MODE_REQUEST and word in list(ModeRequest):
            self._pending.append((self._ticks + LATENCY_TICKS, ModeRequest(word)))
        elif number == Number.FAULT_LOG:
            self._log_packet = 0 if word else min(self._log_packet + 1, FAULT_LOG_PACKETS - 1)
            return self._fault_log(self._log_packet)
        elif number == Number.RESET_INTEGRATORS:
            self._reset_integrators(word)
        elif number == Number.RESET_PARAMETERS:
            self.stored = Stored(tuple(parameter.word(parameter.factory) for parameter in PARAMETERS))
        elif number not in (Number.NONE, Number.AUDIO) and not (number == 21 and self._dialect is Dialect.B3):
            self.fault_words[1] |= faults.UNKNOWN_COMMAND
        return None

    def _store(self, number: int, word: int) -> None:
        # Out of range keeps the old value, without a fault (fact sheet 9.9).
        if BY_NUMBER[number].accepts(word):
            words = list(self.stored.words)
            words[number - 1] = word
            self.stored = Stored(tuple(words))

    def _reset_integrators(self, bits: int) -> None:
        if bits & 2:
            self.drive.right_m = 0.0
        if bits & 4:
            self.drive.left_m = 0.0

    def _tick(self) -> None:
        self._ticks += 1
        while self._pending and self._pending[0][0] <= self._ticks:
            action = self._pending.popleft()[1]
            if isinstance(action, ModeRequest):
                self._change_mode(action)
            else:
                self._command = action
        if self._ticks - self._motion_tick >= COMMAND_TIMEOUT_TICKS + LATENCY_TICKS:
            self._command = (0.0, 0.0)
        self._boot()
        self._drive()

    def _boot(self) -> None:
        if self.state >= OperationalState.STANDBY:
            return
        done = self._ticks / max(self._boot_ticks, 1)
        # Early states are short in the logs; the startup check takes most of the time.
        self.state = OperationalState(3 if done >= 1 else 2 if done >= 0.3 else 1 if done >= 0.1 else 0)

    def _change_mode(self, request: ModeRequest) -> None:
        running = self.state in (OperationalState.STANDBY, OperationalState.TRACTOR)
        slow = max(abs(speed) for speed in self.drive.wheels(self.stored["track_width"])) < STANDBY_MPS
        if request is ModeRequest.DISABLE:
            self.fault_words[0] |= faults.COMMANDED_DISABLE
            self._shut_down()
        elif request is ModeRequest.POWERDOWN or (request is ModeRequest.DTZ and slow):
            self._shut_down()
        elif request is ModeRequest.DTZ:
            self._stopping = True
        elif request is ModeRequest.TRACTOR and running and not any(self.fault_words):
            self.state = OperationalState.TRACTOR
        elif request is ModeRequest.STANDBY and running and slow:
            self.state = OperationalState.STANDBY

    def _shut_down(self) -> None:
        self.state = OperationalState.POWERDOWN
        self._last_words = True

    def _drive(self) -> None:
        drive, stored = self.drive, self.stored
        decel = stored["max_decel"]
        command = self._command
        if self.state is OperationalState.TRACTOR and self.powered:
            drive.open_limits(stored)
        else:
            drive.shut_limits()
        if self._stopping or not self.powered or self.state is OperationalState.POWERDOWN:
            command, decel = (0.0, 0.0), stored["max_dtz_decel"]
        drive.follow(*command, stored, decel)
        if self._stopping and drive.v == 0 and drive.yaw == 0:
            self._stopping = False
            self._shut_down()
        load_w = 40.0 + 200.0 * abs(drive.v)
        self.battery_percent = max(0.0, self.battery_percent - load_w * DT / 3600 / 770 * 100)

    def _feedback(self) -> tuple[int, ...]:
        if self._force_config:
            extra = (float_to_word(LATERAL_TERM_MPS2),) if self._dialect is Dialect.B3 else ()
            return self.stored.words + extra
        return Layout.of(self.stored.bitmaps).encode(self._values())

    def _values(self) -> dict[str, float]:
        drive, stored = self.drive, self.stored
        right, left = drive.wheels(stored["track_width"])
        charge = math.floor(self.battery_percent * 2.56) / 2.56
        values: dict[str, float] = {
            **{f"fault_status_word_{n}": word for n, word in enumerate(self.fault_words, start=1)},
            "operational_time": self._ticks * DT,
            "operational_state": int(self.state),
            "dynamic_response": self._dynamic_response,
            "min_propulsion_batt_soc": charge,
            "aux_batt_soc": 249 / 2.55,
            "yaw_rate_limit_rps": drive.yaw_limit,
            "vel_limit_mps": drive.v_limit,
            "linear_vel_mps": drive.v,
            "differential_wheel_vel_rps": drive.yaw,
            "right_front_vel_mps": right,
            "left_front_vel_mps": left,
            "right_front_pos_m": drive.right_m,
            "left_front_pos_m": drive.left_m,
            "linear_pos_m": (drive.right_m + drive.left_m) / 2,
            "right_front_current_limit_A0pk": 34.991,
            "left_front_current_limit_A0pk": 34.991,
            "front_base_batt_1_soc": charge,
            "front_base_batt_1_temp_degC": 26.25,
            "vel_target_mps": drive.v_target,
            "yaw_rate_target_rps": drive.yaw_target,
            "aux_batt_voltage_V": 76.75,
            "aux_batt_current_A": 0.1015625,
            "aux_batt_temp_degC": 27.25,
            "ccu_sp_sw_build_id": 1246,
            "ccu_uip_sw_build_id": 1279,
        }
        names = [word.name for word in Layout.of(FACTORY_BITMAPS).words[76:]]
        return values | {name: p.value(word) for name, p, word in zip(names, PARAMETERS, stored.words, strict=True)}

    def _fault_log(self, packet: int) -> tuple[int, ...]:
        """An empty fault log: eleven header words, then room for twenty entries (fact sheet section 8)."""
        seconds, metres = float_to_word(self._ticks * DT), float_to_word(abs(self.drive.right_m))
        header = (1, 311, 0, 0, 0, 110, 1246, 1279, seconds, metres, self.power_cycles)
        words = (*header, *[0] * (FAULT_LOG_WORDS * FAULT_LOG_PACKETS - len(header)))
        return words[packet * FAULT_LOG_WORDS : (packet + 1) * FAULT_LOG_WORDS]
