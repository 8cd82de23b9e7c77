"""An independent judge of the frames on the wire: it knows the protocol from its fact sheet, not from our code.

It is told what happens around the robot (`Witness`) and sees every frame; what must not be, it puts down in
`violations`. Its conditions are necessary ones: it never asks for more than was promised.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from dataclasses import dataclass, field

from tests.virtual_time.wire import OnWire

MOTION, CONFIG, FIRST, LAST = 0x500, 0x501, 0x502, 0x50C
"""The compact feedback set ends with 0x50C."""
MODE_REQUEST, TRACTOR, STANDBY = 32, 5, 4
REPORTED_TRACTOR = 4
LINEAR_VEL = 11
"""Twelfth word of the compact set; after it the clockwise turn rate."""
ALLOWED_CONFIG = {
    0: {0},
    17: {0x7B800F0F},
    18: {0x03030026},
    19: {0},
    20: {0},
    30: {0, 1},
    MODE_REQUEST: {TRACTOR, STANDBY},
}
"""What a driver that may not write parameters ever has to say."""

MAX_RATE_HZ = 100
DEADLINE_S = 0.3
"""From any loss to zero on the wire."""
TICK_S = 0.021
"""The loop notices a loss at its next tick."""
LOST_S = {"operator": 1.0, "lidar": 1.0, "base": 1.0, "video": 2.0}
HOLD_S = {"operator": DEADLINE_S, "lidar": DEADLINE_S, "base": DEADLINE_S + TICK_S, "video": 0.7 + TICK_S}
"""Nobody promised 0.3 s for pictures: a frozen one holds the robot from 0.7 s on."""
LIDAR_X_M, RADIUS_M, DECEL_MPS2 = 0.2, 0.4, 0.5
REACTION_S = 0.25
"""Scan, one missed scan, processing, bus, base."""
SAMPLED_M = 0.08
"""The chain looks along its way in steps of 5 cm and sees walls as points."""
CRAWL_MPS = 0.1


@dataclass(slots=True)
class Witness:
    """Seconds when each input last gave a sign of life, and the operator's right to move."""

    alive_s: dict[str, float] = field(default_factory=dict)
    deadman: bool = False
    presses_needed: int = 1
    why_needed: str = "nobody armed it since the start"
    arm_count: int | None = None
    disarm_count: int = 0
    estop_count: int = 0
    expired: set[str] = field(default_factory=set)
    wall_m: float | None = None
    """What the newest scan shows: a wall across the way, this far in front of the lidar."""

    def lives(self, name: str, now_s: float, stamp_s: float) -> None:
        """An input arrived; it is as old as it says, or as its arrival where it claims to be from the future."""
        sign_s = min(now_s, stamp_s)
        before_s = self.alive_s.get(name, sign_s)
        if now_s - before_s > LOST_S[name] + 2 * TICK_S and name not in self.expired:
            self.revoke(f"the {name} was lost for {now_s - before_s:.2f} s")
        self.expired.discard(name)
        self.alive_s[name] = max(sign_s, before_s)

    def expire(self, now_s: float) -> None:
        """What is lost by now was lost before whatever happens next."""
        for name, alive_s in self.alive_s.items():
            if now_s - alive_s > LOST_S[name] and name not in self.expired:
                self.expired.add(name)
                self.revoke(f"the {name} was lost")

    def revoke(self, why: str, presses: int = 1) -> None:
        if presses >= self.presses_needed:
            self.presses_needed, self.why_needed = presses, why

    def restart(self) -> None:
        """A robot that starts is disarmed and knows no emergency stop of an earlier life: one press arms it."""
        self.presses_needed, self.why_needed = 1, "the robot was restarted"

    def presses(self, now_s: float, arm: int, disarm: int, estop: int, *, steers: bool, first: bool) -> None:
        """Counts of a message that reached the robot; only one that steers can arm, any can stop."""
        self.expire(now_s)
        if estop > self.estop_count:
            self.revoke("emergency stop", presses=2)
        if disarm > self.disarm_count:
            self.revoke("disarmed by the operator")
        elif steers and not first and self.arm_count is not None and arm > self.arm_count and estop <= self.estop_count:
            self.presses_needed = max(0, self.presses_needed - 1)
        self.disarm_count, self.estop_count = max(self.disarm_count, disarm), max(self.estop_count, estop)
        if steers:
            self.arm_count = arm


@dataclass(slots=True)
class WireChecker:
    """Feed it every frame; look at `violations`. Without a witness only the frames themselves are judged."""

    witness: Witness | None
    v_max: float = 0.5
    w_max: float = 0.8
    reverse_max: float = 0.15
    accel: float = 0.5
    w_accel: float = 1.5
    stored_v: float = 0.5
    stored_w: float = 1.0
    violations: list[str] = field(default_factory=list)
    moving: int = 0
    """Frames that asked for motion; a run without any proves nothing."""
    moving_s: float = -math.inf
    """When the last of them was sent."""
    _sent_s: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_RATE_HZ + 1))
    _motion: tuple[float, float, float] = (-math.inf, 0.0, 0.0)
    _measured: tuple[float, float] = (0.0, 0.0)
    """What the base reported last: a command may take over from there."""
    _packet: list[bytes] = field(default_factory=list)
    _state: int = -1
    _troubled: bool = False
    _base_time_s: float = -math.inf
    _asked_standby_s: float = -math.inf
    _excused_s: float = -math.inf

    def excuse(self, now_s: float) -> None:
        """The bus takes nothing now, or nobody is there to send: no zero can be asked for."""
        self._excused_s = now_s

    def feed(self, frame: OnWire) -> None:
        now_s = frame.stamp_ns / 1e9
        if not frame.to_base:
            if self.witness:
                self._feedback(now_s, frame, self.witness)
            return
        self._rate(now_s, frame)
        if len(frame.data) != 8:
            self._complain(now_s, f"a frame of {len(frame.data)} bytes")
        elif frame.can_id == MOTION:
            self._motion_frame(now_s, *struct.unpack(">2f", frame.data))
        elif frame.can_id == CONFIG:
            self._config_frame(now_s, *struct.unpack(">2I", frame.data))
        else:
            self._complain(now_s, f"id 0x{frame.can_id:X}")

    def look(self, now_s: float) -> None:
        """Called at any time: a motion frame must have been followed by another, or by zero."""
        sent_s, v, w = self._motion
        if (v or w) and now_s - sent_s > DEADLINE_S + TICK_S and self._excused_s < sent_s:
            self._complain(now_s, f"({v:.3f}, {w:.3f}) was left standing for {now_s - sent_s:.3f} s")

    def robot_gone(self, now_s: float, *, orderly: bool) -> None:
        """The robot's process ended; in order it said zero, killed it could not."""
        if orderly and self._excused_s < self._motion[0] and any(self._motion[1:]):
            self._complain(now_s, "the robot left without saying zero")
        self._motion = (now_s, 0.0, 0.0)
        if self.witness:
            self.witness.restart()

    def _rate(self, now_s: float, frame: OnWire) -> None:
        self._sent_s.append(now_s)
        full = len(self._sent_s) > MAX_RATE_HZ
        if full and now_s - self._sent_s[0] < 0.999:
            self._complain(now_s, f"{MAX_RATE_HZ + 1} frames within {now_s - self._sent_s[0]:.3f} s")
        if frame.can_id == MOTION and any(frame.data) and now_s - self.moving_s < 0.0099:
            self._complain(now_s, f"two motion frames {1e3 * (now_s - self.moving_s):.2f} ms apart")

    def _config_frame(self, now_s: float, number: int, word: int) -> None:
        if word not in ALLOWED_CONFIG.get(number, set()):
            self._complain(now_s, f"configuration command {number} with 0x{word:X}")
        if number == MODE_REQUEST and word == STANDBY:
            self._asked_standby_s = now_s
        witness = self.witness
        if number == MODE_REQUEST and word == TRACTOR and witness and witness.presses_needed:
            self._complain(now_s, f"TRACTOR without a press after: {witness.why_needed}")

    def _motion_frame(self, now_s: float, velocity: float, yaw_rate: float) -> None:
        if not (math.isfinite(velocity) and math.isfinite(yaw_rate) and max(abs(velocity), abs(yaw_rate)) <= 1):
            self._complain(now_s, f"motion ({velocity}, {yaw_rate})")
            return
        v, w = velocity * self.stored_v, -yaw_rate * self.stored_w
        self._envelope(now_s, v, w)
        if v or w:
            self.moving += 1
            if self.witness:
                self._right_to_move(now_s, self.witness)
                self._room(now_s, v, w, self.witness.wall_m)
            self.moving_s = now_s
        self._motion = (now_s, v, w)

    def _envelope(self, now_s: float, v: float, w: float) -> None:
        if not -self.reverse_max - 1e-6 <= v <= self.v_max + 1e-6 or abs(w) > self.w_max + 1e-6:
            self._complain(now_s, f"({v:.4f}, {w:.4f}) is beyond the limits")
        before_s, v_before, w_before = self._motion
        dt_s = min(now_s - before_s, DEADLINE_S + TICK_S)
        for name, value, before, measured, accel in (
            ("v", v, v_before, self._measured[0], self.accel),
            ("w", w, w_before, self._measured[1], self.w_accel),
        ):
            slower = abs(value) <= abs(before) and value * before >= 0
            beyond = max(min(before, measured) - value, value - max(before, measured))
            if not slower and beyond > accel * dt_s * 1.01 + 1e-3:
                self._complain(
                    now_s, f"{name} from {before:.3f} (measured {measured:.3f}) to {value:.3f} within {dt_s:.3f} s"
                )

    def _right_to_move(self, now_s: float, witness: Witness) -> None:
        for name, hold_s in HOLD_S.items():
            age_s = now_s - witness.alive_s.get(name, -math.inf)
            if age_s > hold_s + 1e-6:
                self._complain(now_s, f"motion {age_s:.3f} s after the {name}'s last sign of life")
        if not witness.deadman:
            self._complain(now_s, "motion without the dead man's switch")
        if witness.presses_needed:
            self._complain(now_s, f"motion without {witness.presses_needed} press(es) after: {witness.why_needed}")
        if self._state != REPORTED_TRACTOR or self._troubled:
            self._complain(now_s, f"motion while the base reports state {self._state}, trouble {self._troubled}")

    def _room(self, now_s: float, v: float, w: float, wall_m: float | None) -> None:
        """Forwards there is room to react and brake in before the wall that the newest scan shows."""
        if v <= 1e-3 or wall_m is None:
            return
        room_m = _free_m(wall_m, v, w)
        left_m = room_m + SAMPLED_M
        fastest = DECEL_MPS2 * (math.sqrt(REACTION_S**2 + 2 * left_m / DECEL_MPS2) - REACTION_S)
        if room_m <= 0:
            fastest = CRAWL_MPS
        if v > fastest + 1e-3:
            self._complain(now_s, f"{v:.3f} m/s with {room_m:.2f} m of room")

    def _feedback(self, now_s: float, frame: OnWire, witness: Witness) -> None:
        if frame.can_id == FIRST:
            self._packet.clear()
        if frame.can_id != FIRST + len(self._packet) or len(frame.data) != 8:
            self._packet.clear()
            return
        self._packet.append(frame.data)
        if frame.can_id != LAST:
            return
        words = struct.unpack(">4I f 2I f I 4f", b"".join(self._packet)[:52])
        self._packet.clear()
        witness.lives("base", now_s, now_s)
        time_s, state = words[4], words[5]
        troubled = any(words[:4]) or words[6] != 0
        if troubled:
            witness.revoke("the base reported a fault")
        if time_s < self._base_time_s:
            witness.revoke("the base was restarted")
        if self._state == REPORTED_TRACTOR != state and self._asked_standby_s < now_s - 1.0:
            witness.revoke(f"the base left tractor mode by itself (state {state})")
        self._state, self._troubled, self._base_time_s = state, troubled, time_s
        self._measured = (words[LINEAR_VEL], -words[LINEAR_VEL + 1])

    def _complain(self, now_s: float, what: str) -> None:
        self.violations.append(f"{now_s:.3f}: {what}")


def _free_m(wall_m: float, v: float, w: float) -> float:
    """How far the robot gets on its arc before it touches the wall."""
    step, at_x, yaw, gone = 0.01, 0.0, 0.0, 0.0
    while gone < 1.0:
        if at_x + RADIUS_M > LIDAR_X_M + wall_m:
            return gone
        at_x, yaw = at_x + step * math.cos(yaw), yaw + step * w / v
        gone += step
    return math.inf
