"""The base with Stanley Innovation's firmware: command packets in, status packets out; no clock, no I/O."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Mapping

from drivers.rmp110.codec import faults
from drivers.rmp110.codec.bytestream import crc16, unpack_command
from drivers.rmp110.codec.frames import word_to_float
from drivers.rmp110.codec.parameters import Stored
from drivers.rmp110.codec.v3.commands import CONFIG_ID, ETHERNET_ID, GENERAL_ID, MOTION_ID, General
from drivers.rmp110.codec.v3.packets import RMP110, pack_fault_log
from drivers.rmp110.codec.v3.words import CONFIG_WORDS, LAYOUT, PARAMETERS
from drivers.rmp110.simulator.dynamics import DT, V3_BITS
from drivers.rmp110.simulator.machine import BOOT_S, Machine, Reading
from drivers.rmp110.simulator.model import INTEGRATORS_M, STREAM_BACKLOG
from drivers.rmp110.simulator.power import CURRENT_LIMIT_A
from drivers.rmp110.simulator.readings import READINGS, Reader
from drivers.rmp110.simulator.unknowns import Unknowns

BAD_CHECKSUM = 0x40
"""Bit of fault status word 2."""
COMMAND_BYTES = {MOTION_ID: 16, CONFIG_ID: 52, ETHERNET_ID: 20, GENERAL_ID: 12}
SHORTEST_BYTES = 8
"""An id, a word and the checksum."""
POWER_DROPS_S = 30.0
"""From the power-down notice to the power going (fact sheet section 11)."""


V3_READINGS: Mapping[str, Reading] = {
    **READINGS,
    # Counter-clockwise here, clockwise on CAN (fact sheet 3.3).
    "yaw_rate_target_rps": lambda machine: -machine.drive.yaw_target,
    "odom_yaw_rate_rps": lambda machine: -machine.drive.yaw,
    "odom_x_acc_mps2": lambda machine: machine.drive.accel,
    "aux_batt_1_soc": READINGS["aux_batt_soc"],
    "aux_batt_1_voltage_V": READINGS["aux_batt_voltage_V"],
    "aux_batt_1_current_A": READINGS["aux_batt_current_A"],
    "aux_batt_1_temp_degC": READINGS["aux_batt_temp_degC"],
}


def _stored(name: str) -> Reading:
    return lambda machine: machine.stored[name]


class V3Model(Machine):
    """An RMP 110 on UDP or USB. `step` it with a monotonic clock, give it whole packets with `receive`.

    `order` is the byte order of its replies, which nobody wrote down; little-endian is the likely one.
    """

    bitmap_bits = V3_BITS

    def __init__(
        self,
        now_ns: int,
        stored: Stored | None = None,
        *,
        boot_s: float = BOOT_S,
        integrators_m: tuple[float, float] = INTEGRATORS_M,
        unknowns: Unknowns | None = None,
        machine_id: int = RMP110,
        order: str = "<",
    ) -> None:
        self.machine_id = machine_id
        self.torque_limit = 1.0
        self._order = order
        named: dict[str, Reading] = {
            "machine_id": lambda _: self.machine_id,
            "right_front_current_limit_A0pk": lambda _: CURRENT_LIMIT_A * self.torque_limit,
            "left_front_current_limit_A0pk": lambda _: CURRENT_LIMIT_A * self.torque_limit,
        }
        readings = {**V3_READINGS, **named} | {
            f"stored_{parameter.name}": _stored(parameter.name) for parameter in PARAMETERS
        }
        self._reader = Reader(LAYOUT.words, order, readings=readings)
        self._streaming = False
        self._unsolicited: deque[tuple[int, tuple[bytes, ...]]] = deque(maxlen=STREAM_BACKLOG)
        self._notices = 0
        self._drops_at_tick: int | None = None
        if stored is None or stored.parameters != PARAMETERS:
            known = {parameter.name for parameter in PARAMETERS}
            values = {p.name: stored[p.name] for p in stored.parameters if p.name in known} if stored else {}
            stored = Stored.of(values, parameters=PARAMETERS)
        super().__init__(now_ns, stored, boot_s=boot_s, integrators_m=integrators_m, unknowns=unknowns)

    def _restart(self, now_ns: int) -> None:
        super()._restart(now_ns)
        self._streaming = False
        self._drops_at_tick = None
        self.torque_limit = 1.0

    def receive(self, now_ns: int, packet: bytes) -> tuple[bytes, ...]:
        """One packet; the replies, in the state before the packet has any effect.

        A packet that is damaged latches the checksum fault and gets no reply, nor does one of a wrong length.
        """
        self.step(now_ns)
        if not self.powered:
            return ()
        can_id = int.from_bytes(packet[:2], "big")
        if len(packet) < SHORTEST_BYTES or len(packet) != COMMAND_BYTES.get(can_id, len(packet)):
            return ()
        frame = unpack_command(packet)
        if frame is None:
            self.raise_fault(1, BAD_CHECKSUM)
            return ()
        log = self._obey(can_id, frame.data)
        if log is not None:
            return (log,)
        if self._streaming or not self.say_last_words():
            return ()
        return (self._status(),)

    def take_unsolicited(self) -> list[tuple[int, tuple[bytes, ...]]]:
        """The continuous stream since the last call, with its stamps."""
        taken = list(self._unsolicited)
        self._unsolicited.clear()
        return taken

    def take_notices(self) -> int:
        """How many power-down notices were sent since the last call."""
        taken, self._notices = self._notices, 0
        return taken

    def press_power_button(self) -> None:
        """Switch off in the orderly way: a notice to the computer now, the power half a minute later."""
        self._notices += 1
        self._drops_at_tick = self._ticks + round(POWER_DROPS_S / DT)

    def _obey(self, can_id: int, data: bytes) -> bytes | None:
        """Take a command; a packet where the reply is not the usual status."""
        if can_id == MOTION_ID:
            self._receive_motion(data)
        elif can_id == CONFIG_ID:
            self._store(0, struct.unpack(f">{CONFIG_WORDS}I", data))
        elif can_id == ETHERNET_ID:
            self._store(CONFIG_WORDS, struct.unpack(">4I", data))
        elif can_id == GENERAL_ID:
            return self._receive_general(*struct.unpack(">2I", data))
        elif self.unknowns.unknown_command_faults:
            self.raise_fault(1, faults.UNKNOWN_COMMAND)
        return None

    def _receive_motion(self, data: bytes) -> None:
        v, _sideways, w = struct.unpack(">3f", data)
        if not (math.isfinite(v) and math.isfinite(w)):
            if self.unknowns.bad_motion_faults:
                self.raise_fault(1, faults.BAD_MOTION_COMMAND)
            return
        # The firmware limits to its stored maxima; the machine takes shares of them, clockwise.
        self.command_motion(_share(v, self.settings.velocity), -_share(w, self.settings.yaw_rate))

    def _receive_general(self, command: int, word: int) -> bytes | None:
        if self.unknowns.poll_refreshes_motion:
            self.keep_motion()
        match command:
            case General.NONE | General.AUDIO:
                pass
            case General.MODE_REQUEST:
                self.request_mode(word)
            case General.FAULT_LOG:
                self.note_faults()
                return pack_fault_log(self.memory.words(self.run_time_s, self.drive.odometer_m), self._order)
            case General.RESET_INTEGRATORS:
                self.reset_integrators(word)
            case General.RESET_PARAMETERS:
                self.stored = Stored.of({}, parameters=PARAMETERS)
            case General.CONTINUOUS_DATA:
                self._streaming = word != 0
            case General.TORQUE_LIMIT:
                share = word_to_float(word)
                if 0.0 <= share <= 1.0:
                    self.torque_limit = share
            case _:
                if self.unknowns.unknown_command_faults:
                    self.raise_fault(1, faults.UNKNOWN_COMMAND)
        return None

    def _store(self, first: int, words: tuple[int, ...]) -> None:
        # Each parameter out of range keeps its old value, without a fault.
        changed = {
            parameter.name: parameter.value(word)
            for parameter, word in zip(PARAMETERS[first:], words, strict=False)
            if parameter.accepts(word)
        }
        self.stored = self.stored.with_values(changed)

    def _tick(self) -> None:
        super()._tick()
        if self._drops_at_tick is not None and self._ticks >= self._drops_at_tick:
            self.power_off()
        if self._streaming and self.powered and self.say_last_words():
            self._unsolicited.append((self._tick_ns, (self._status(),)))

    def _shut_down(self) -> None:
        before = self.state
        super()._shut_down()
        self._notices += self.state is not before

    def _status(self) -> bytes:
        body = self._reader.read(self) + b"\x00\x00"
        return body + crc16(body).to_bytes(2, "big")


def _share(value: float, limit: float) -> float:
    return max(-1.0, min(1.0, value / limit)) if limit else 0.0
