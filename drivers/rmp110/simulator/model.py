"""The base on CAN: commands of the 0x500 family in, feedback out, in any of its dialects; no clock, no I/O."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Mapping, Sequence

from drivers.rmp110.codec import faults
from drivers.rmp110.codec.dialect import Action, Dialect
from drivers.rmp110.codec.fault_log import PACKET_WORDS, PACKETS
from drivers.rmp110.codec.frames import (
    CONFIG_ID,
    FEEDBACK_ID,
    MOTION_ID,
    Frame,
    unpack_words,
    word_to_float,
)
from drivers.rmp110.codec.parameters import RMP110_STORED, RMP110_TRACK_MINIMUM_M, Stored
from drivers.rmp110.codec.vocabulary import VOCABULARIES
from drivers.rmp110.simulator.machine import BOOT_S, Machine
from drivers.rmp110.simulator.readings import Reader
from drivers.rmp110.simulator.unknowns import Unknowns

STREAM_BACKLOG = 100
"""A second of the continuous stream, for whoever steps the model in strides."""
INTEGRATORS_M = (12.75, 12.5)
"""Right and left wheel at power-up: not zero, as in the logs."""


class RmpModel(Machine):
    """An RMP 110 on CAN. `step` it with a monotonic clock, give it frames with `receive`.

    `stored` may come from any dialect's table: what is not this dialect's is taken over by name,
    feedback bitmaps excepted.
    """

    def __init__(
        self,
        now_ns: int,
        stored: Stored | None = None,
        *,
        boot_s: float = BOOT_S,
        dialect: Dialect = Dialect.B2,
        integrators_m: tuple[float, float] = INTEGRATORS_M,
        unknowns: Unknowns | None = None,
    ) -> None:
        if dialect not in VOCABULARIES:
            raise ValueError(f"dialect {dialect.value} is not spoken on CAN")
        self.dialect = dialect
        self.book = VOCABULARIES[dialect]
        self._numbers = {parameter.number: parameter for parameter in self.book.parameters}
        self._actions = {number: action for action, number in self.book.actions.items()}
        self._force_config = False
        self._log_packet = 0
        self._streaming = False
        self._unsolicited: deque[tuple[int, tuple[Frame, ...]]] = deque(maxlen=STREAM_BACKLOG)
        self._readers: dict[tuple[int, ...], Reader] = {}
        self._last_taken_ns = -(10**18)
        super().__init__(now_ns, self._adopt(stored), boot_s=boot_s, integrators_m=integrators_m, unknowns=unknowns)

    def _adopt(self, stored: Stored | None) -> Stored:
        if stored is not None and stored.parameters == self.book.parameters:
            return stored
        values: Mapping[str, float] = RMP110_STORED
        if stored is not None:
            values = {parameter.name: stored[parameter.name] for parameter in stored.parameters}
        known = {name for name in (p.name for p in self.book.parameters) if not name.startswith("feedback_bitmap")}
        return Stored.of({n: v for n, v in values.items() if n in known}, parameters=self.book.parameters)

    def power_on(self, now_ns: int) -> None:
        self._unsolicited.clear()
        super().power_on(now_ns)

    def _restart(self, now_ns: int) -> None:
        super()._restart(now_ns)
        self._force_config = self._streaming = False
        self._log_packet = 0

    def receive(self, now_ns: int, frame: Frame) -> tuple[Frame, ...]:
        """One frame from the bus; the reply, in the state before the frame has any effect."""
        self.step(now_ns)
        if not self.powered or len(frame.data) != 8 or frame.can_id not in (MOTION_ID, CONFIG_ID):
            return ()
        if self.unknowns.most_hz is not None:
            if now_ns - self._last_taken_ns < 1e9 / self.unknowns.most_hz:
                return ()
            self._last_taken_ns = now_ns
        high, low = unpack_words(frame.data)
        log: tuple[Frame, ...] | None = None
        if frame.can_id == MOTION_ID:
            self._receive_motion(high, low)
        else:
            log = self._receive_config(high, low)
        if self._streaming and not self.unknowns.streaming_answers and log is None:
            return ()
        if not self.say_last_words():
            return ()
        return self._feedback() if log is None else log

    def take_unsolicited(self) -> list[tuple[int, tuple[Frame, ...]]]:
        """What the base sent of its own accord since the last call, with its stamps (B3's continuous data)."""
        taken = list(self._unsolicited)
        self._unsolicited.clear()
        return taken

    def _receive_motion(self, high: int, low: int) -> None:
        velocity, yaw_rate = word_to_float(high), word_to_float(low)
        if math.isfinite(velocity + yaw_rate) and abs(velocity) <= 1.0 and abs(yaw_rate) <= 1.0:
            self.command_motion(velocity, yaw_rate)
        elif self.unknowns.bad_motion_faults:
            self.raise_fault(1, faults.BAD_MOTION_COMMAND)

    def _receive_config(self, number: int, word: int) -> tuple[Frame, ...] | None:
        """Take a configuration command; frames where the reply is not the usual feedback."""
        if self.unknowns.poll_refreshes_motion:
            self.keep_motion()
        if number in self._numbers:
            self._store(number, word)
            return None
        match self._actions.get(number):
            case Action.NONE | Action.AUDIO:
                pass
            case Action.FORCE_CONFIG_FEEDBACK:
                self._force_config = word != 0
            case Action.MODE_REQUEST:
                self.request_mode(word)
            case Action.FAULT_LOG:
                self._log_packet = 0 if word else min(self._log_packet + 1, PACKETS - 1)
                return self._fault_log(self._log_packet)
            case Action.RESET_INTEGRATORS:
                self.reset_integrators(word)
            case Action.RESET_PARAMETERS:
                self._reset_parameters()
            case Action.CONTINUOUS_DATA:
                self._streaming = word != 0
            case None:
                if self.unknowns.unknown_command_faults:
                    self.raise_fault(1, faults.UNKNOWN_COMMAND)
        return None

    def _store(self, number: int, word: int) -> None:
        # Out of range keeps the old value, without a fault (fact sheet 9.9).
        parameter = self._numbers[number]
        accepted = parameter.accepts(word)
        if parameter.name == "track_width" and self.unknowns.narrow_track:
            accepted = RMP110_TRACK_MINIMUM_M - 1e-6 <= word_to_float(word) <= parameter.maximum
        if parameter.name == "input_bitmap" and word in self.unknowns.refused_bitmaps:
            accepted = False
        if accepted:
            self.stored = self.stored.with_values({parameter.name: parameter.value(word)})

    def _reset_parameters(self) -> None:
        kept = {f"feedback_bitmap_{n}": word for n, word in enumerate(self.stored.bitmaps, start=1)}
        factory = Stored.of({}, parameters=self.book.parameters)
        if self.unknowns.reset_spares_feedback:
            factory = factory.with_values({name: word for name, word in kept.items() if name in factory})
        self.stored = factory

    def _tick(self) -> None:
        super()._tick()
        if self._streaming and self.powered and self.say_last_words():
            frames = self._feedback()
            if frames:
                self._unsolicited.append((self._tick_ns, frames))

    def _feedback(self) -> tuple[Frame, ...]:
        if self._force_config:
            return _frames(_pack(self.stored.words, self.unknowns.odd_word))
        bitmaps = self._bitmaps
        reader = self._readers.get(bitmaps)
        if reader is None:
            self._readers.clear()
            words = self.book.layout(bitmaps).words
            pad = self.unknowns.odd_word if len(words) % 2 else None
            reader = self._readers[bitmaps] = Reader(words, pad_word=pad)
        return _frames(reader.read(self))

    def _take_over(self, stored: Stored) -> None:
        super()._take_over(stored)
        self._bitmaps = stored.bitmaps

    def _fault_log(self, packet: int) -> tuple[Frame, ...]:
        self.note_faults()
        words = self.memory.words(self.run_time_s, self.drive.odometer_m)
        return _frames(_pack(words[packet * PACKET_WORDS : (packet + 1) * PACKET_WORDS], self.unknowns.odd_word))


def _pack(words: Sequence[int], odd_word: int) -> bytes:
    padded = [*words, odd_word] if len(words) % 2 else words
    return struct.pack(f">{len(padded)}I", *padded)


def _frames(packed: bytes) -> tuple[Frame, ...]:
    return tuple(Frame(FEEDBACK_ID + k, packed[8 * k : 8 * k + 8]) for k in range(len(packed) // 8))
