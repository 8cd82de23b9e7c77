"""The simulated base at the end of its wire: frames out, feedback frames in, odometry from what they say.

What `drivers.rmp110.device` does on the bus, without a bus and without a clock: the same codec, the same
odometry, the same order of zero motion and mode requests.
"""

from __future__ import annotations

from drivers.rmp110.codec.assembler import Assembler
from drivers.rmp110.codec.commands import POLL, ZERO_MOTION, motion, request_mode
from drivers.rmp110.codec.faults import fault_texts
from drivers.rmp110.codec.feedback import COMPACT, COMPACT_BITMAPS
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.motion import MotionScale, normalise
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, OperationalState, Stored
from drivers.rmp110.device.odometry import Odometry
from drivers.rmp110.simulator.model import RmpModel
from ghal360_robot.messages import BaseMode, BaseState, Pose2, Twist

BUS_NS = 3_000_000
"""Request and eleven frames of feedback on a bus of 1 Mb/s, and the computer's wake-up."""
MODES = {OperationalState.STANDBY: BaseMode.STANDBY, OperationalState.TRACTOR: BaseMode.DRIVE}
BITMAPS = {f"feedback_bitmap_{n}": bits for n, bits in enumerate(COMPACT_BITMAPS, start=1)}


class WiredBase:
    """One RMP 110 and the driver's half of the conversation with it.

    `tyre` and `track` are what its parameters say of its tyres and its track, over what is true: odometry and
    speeds are off by as much, and everybody believes them.
    """

    def __init__(self, v_max: float, w_max: float, *, tyre: float = 1.0, track: float = 1.0) -> None:
        stored = Stored.of({**RMP110_STORED, **BITMAPS})
        metal = {"tire_diameter": tyre * stored["tire_diameter"], "track_width": track * stored["track_width"]}
        stored = stored.with_values(metal)
        self.model = RmpModel(0, stored, boot_s=0.1)
        self.scale = MotionScale(stored["max_velocity"], stored["max_yaw_rate"], v_max, w_max)
        self._track_m = stored["track_width"]
        self._assembler = Assembler(COMPACT.frame_count)
        self._odometry = Odometry()

    def exchange(self, now_ns: int, twist: Twist, *, drive: bool) -> BaseState:
        """Command the base for this tick; returns the state that its reply tells. `twist` must be finite."""
        driving = self.model.state is OperationalState.TRACTOR
        if driving and drive:
            command = normalise(twist.v, twist.w, self.scale)
            return self._ask(now_ns, motion(command.velocity, command.yaw_rate))
        if driving:
            self._ask(now_ns, ZERO_MOTION)
            return self._ask(now_ns, request_mode(ModeRequest.STANDBY))
        return self._ask(now_ns, request_mode(ModeRequest.TRACTOR) if drive else POLL)

    @property
    def twist(self) -> Twist:
        """What the wheels truly do to the body."""
        return Twist(*self.model.twist)

    def _ask(self, now_ns: int, frame: Frame) -> BaseState:
        state: BaseState | None = None
        for reply in self.model.receive(now_ns, frame):
            packet = self._assembler.feed(now_ns + BUS_NS, reply)
            if packet is not None:
                state = self._read(packet.last_ns, packet.words)
        if state is None:
            raise RuntimeError("The simulated base did not answer.")
        return state

    def _read(self, stamp_ns: int, words: tuple[int, ...]) -> BaseState:
        values = COMPACT.decode(words)
        right, left = values["right_front_pos_m"], values["left_front_pos_m"]
        odometry = self._odometry.advance(right, left, values["operational_time"], self._track_m)
        self._odometry = odometry
        turn = (values["right_front_vel_mps"] - values["left_front_vel_mps"]) / self._track_m
        return BaseState(
            stamp_ns=stamp_ns,
            mode=MODES.get(OperationalState.of(int(values["operational_state"])), BaseMode.STARTING),
            pose=Pose2(odometry.x, odometry.y, odometry.yaw),
            twist=Twist(values["linear_vel_mps"], turn),
            battery_percent=values["min_propulsion_batt_soc"],
            faults=fault_texts([int(values[f"fault_status_word_{n}"]) for n in (1, 2, 3, 4)]),
        )
