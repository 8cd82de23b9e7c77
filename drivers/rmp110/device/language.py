"""How an identified base is spoken to: the same few sentences in every protocol.

Values of feedback words come out under the vendor's names and in the 0x500 family's signs (yaw clockwise),
whatever is on the wire, so that everything above reads one kind of packet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drivers.rmp110.codec import commands as can_commands
from drivers.rmp110.codec.assembler import Assembler
from drivers.rmp110.codec.dialect import Action
from drivers.rmp110.codec.feedback import Layout
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.motion import MotionScale, Normalised, in_si, normalise
from drivers.rmp110.codec.parameters import ModeRequest
from drivers.rmp110.codec.v3 import commands as v3_commands
from drivers.rmp110.codec.v3.packets import STATUS, unpack_words
from drivers.rmp110.codec.v3.words import LAYOUT
from drivers.rmp110.codec.vocabulary import Vocabulary

SILENT = (
    "the base does not answer: switch it on (after a kill switch it needs its power button), "
    "check the CAN cable and the bit rate of 1 Mbit/s; an old RMP with 0x400 ids cannot be used"
)
SILENT_V3 = (
    "the base does not answer in V3: switch it on (after a kill switch it needs its power button), "
    "check the cable, and that it has the firmware that this protocol belongs to"
)


@dataclass(frozen=True, slots=True)
class Report:
    """One complete feedback packet; stamps are those of its first and last frame."""

    first_ns: int
    last_ns: int
    values: Mapping[str, float]


class Listener(Protocol):
    """Makes reports of received frames."""

    @property
    def damaged(self) -> int:
        """Frames that no healthy base of this kind sends."""

    def feed(self, stamp_ns: int, frame: Frame) -> Report | None:
        """One frame; a report when this frame completes it."""


class Language(Protocol):
    """What can be said to a base, and how its feedback is read."""

    @property
    def zero(self) -> Frame:
        """Zero motion."""

    @property
    def nudge(self) -> Frame:
        """Asks for feedback: one packet, or the stream."""

    @property
    def unsolicited(self) -> bool:
        """Whether packets come by themselves, every 10 ms."""

    @property
    def goodbye(self) -> Frame | None:
        """Last frame on a link."""

    @property
    def silence(self) -> str:
        """What to look at when the base says nothing."""

    def motion(self, v: float, w: float) -> tuple[Frame, Normalised]:
        """The frame for `v` m/s and `w` rad/s (counter-clockwise), and what it means. Raises RmpBadCommand."""

    def mode(self, request: ModeRequest) -> Frame:
        """The frame that asks for a mode."""

    def listener(self) -> Listener:
        """A fresh one, at the beginning of a stream."""


@dataclass(frozen=True, slots=True)
class CanLanguage:
    """Dialects B1 to B3: request and reply, velocities as shares of the stored limits."""

    book: Vocabulary
    layout: Layout
    scale: MotionScale
    zero: Frame = can_commands.ZERO_MOTION
    nudge: Frame = can_commands.POLL
    unsolicited: bool = False
    goodbye: Frame | None = None
    silence: str = SILENT

    def motion(self, v: float, w: float) -> tuple[Frame, Normalised]:
        command = normalise(v, w, self.scale)
        return can_commands.motion(command.velocity, command.yaw_rate), command

    def mode(self, request: ModeRequest) -> Frame:
        return self.book.act(Action.MODE_REQUEST, request)

    def listener(self) -> Listener:
        return CanListener(self.layout)


class CanListener:
    """Packets from CAN frames."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._assembler = Assembler(layout.frame_count)

    @property
    def damaged(self) -> int:
        return self._assembler.damaged

    def feed(self, stamp_ns: int, frame: Frame) -> Report | None:
        packet = self._assembler.feed(stamp_ns, frame)
        if packet is None:
            return None
        return Report(packet.first_ns, packet.last_ns, self._layout.decode(packet.words))


@dataclass(frozen=True, slots=True)
class V3Language:
    """V3: a stream of status packets; m/s and rad/s, counter-clockwise. `order` is that of the base's replies."""

    order: str
    scale: MotionScale
    zero: Frame = v3_commands.ZERO_MOTION
    nudge: Frame = v3_commands.continuous_data(on=True)
    unsolicited: bool = True
    goodbye: Frame | None = v3_commands.continuous_data(on=False)
    silence: str = SILENT_V3

    def motion(self, v: float, w: float) -> tuple[Frame, Normalised]:
        command = in_si(v, w, self.scale)
        return v3_commands.motion(command.velocity, command.yaw_rate), command

    def mode(self, request: ModeRequest) -> Frame:
        return v3_commands.request_mode(request)

    def listener(self) -> Listener:
        return V3Listener(self.order)


class V3Listener:
    """Reports from status packets; anything else in between is damage."""

    def __init__(self, order: str) -> None:
        self._order = order
        self.damaged = 0

    def feed(self, stamp_ns: int, frame: Frame) -> Report | None:
        if frame.can_id != STATUS:
            self.damaged += 1
            return None
        return Report(stamp_ns, stamp_ns, read_status(frame.data, self._order))


def read_status(data: bytes, order: str) -> dict[str, float]:
    """Values of a status packet by name, yaw clockwise as on CAN."""
    values = LAYOUT.decode(unpack_words(data, order))
    values["yaw_rate_target_rps"] = 0.0 - values["yaw_rate_target_rps"]
    return values
