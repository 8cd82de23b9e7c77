"""Configuration commands of dialect B2 and the parameters a base has stored (fact sheet section 6).

Stored parameters live in F-RAM: they survive power-off and may be written without limit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum

from drivers.rmp110.codec.frames import as_float32, float_to_word, word_to_float


class Kind(Enum):
    """How a 32-bit word is read."""

    FLOAT = "float"
    UINT = "uint"
    HEX = "hex"
    IP = "ip"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One stored parameter: the configuration command that writes it and its documented range."""

    number: int
    name: str
    kind: Kind
    unit: str
    factory: float
    minimum: float = 0
    maximum: float = 0xFFFFFFFF

    def word(self, value: float) -> int:
        """The word on the wire for a value in the parameter's unit."""
        return float_to_word(value) if self.kind is Kind.FLOAT else int(value)

    def value(self, word: int) -> float:
        """A word from the wire in the parameter's unit."""
        return word_to_float(word) if self.kind is Kind.FLOAT else word

    def accepts(self, word: int) -> bool:
        """Whether the word is a number within the documented range, ends included."""
        value = self.value(word)
        if self.kind is not Kind.FLOAT:
            return self.minimum <= value <= self.maximum
        # The machine compares float32 with float32: 0.506476 as typed is not 0.506476 as stored.
        return math.isfinite(value) and as_float32(self.minimum) <= value <= as_float32(self.maximum)


class Number(IntEnum):
    """Configuration command numbers, id 0x501 (fact sheet 6.1, 6.2)."""

    NONE = 0
    MAX_VELOCITY = 1
    MAX_ACCEL = 2
    MAX_DECEL = 3
    MAX_DTZ_DECEL = 4
    COASTDOWN_DECEL = 5
    MAX_YAW_RATE = 6
    MAX_YAW_ACCEL = 7
    TIRE_DIAMETER = 8
    WHEEL_BASE = 9
    TRACK_WIDTH = 10
    GEAR_RATIO = 11
    INPUT_BITMAP = 12
    IP_ADDRESS = 13
    IP_PORT = 14
    SUBNET_MASK = 15
    GATEWAY = 16
    FEEDBACK_1 = 17
    FEEDBACK_2 = 18
    FEEDBACK_3 = 19
    FEEDBACK_4 = 20
    FORCE_CONFIG_FEEDBACK = 30
    AUDIO = 31
    MODE_REQUEST = 32
    FAULT_LOG = 33
    RESET_INTEGRATORS = 34
    RESET_PARAMETERS = 35


class ModeRequest(IntEnum):
    """Parameter of MODE_REQUEST; not the numbering of the reported state (fact sheet section 5)."""

    DISABLE = 1
    POWERDOWN = 2
    DTZ = 3
    STANDBY = 4
    TRACTOR = 5
    BALANCE = 6


class OperationalState(IntEnum):
    """What the base reports (fact sheet section 5)."""

    CCU_INIT = 0
    INIT_PROPULSION = 1
    CHECK_STARTUP = 2
    STANDBY = 3
    TRACTOR = 4
    DISABLED_OR_BALANCE = 5
    POWERDOWN = 6
    UNKNOWN = -1

    @classmethod
    def of(cls, word: int) -> OperationalState:
        """The state with this number, UNKNOWN for numbers nobody documented."""
        return cls(word) if 0 <= word <= 6 else cls.UNKNOWN


@dataclass(frozen=True, slots=True)
class InputBits:
    """What bits of the input bitmap say about how the base moves; zero where a protocol has no such bit."""

    charging: int
    """Allows driving while the charger is plugged in."""
    acceleration: int
    """The velocity command is an acceleration."""
    filters: int
    """Low-pass filters of the commands, down to 0.2 Hz."""
    limit_mapping: int
    """The yaw rate is what was commanded, whatever the lateral acceleration; here it is the missing bit that is odd."""

    @property
    def unwanted(self) -> int:
        """Bits that are never written from here."""
        return self.charging | self.acceleration | self.filters

    def cleaned(self, bitmap: int) -> int:
        """The bitmap of a base that follows velocity commands as its limits say, and not on its charger's cable."""
        return bitmap & ~self.unwanted | self.limit_mapping


CAN_INPUT_BITS = InputBits(charging=0x8, acceleration=0x2, filters=0x1E00, limit_mapping=0x1)
"""Fact sheet 6.4."""

_IP_MAX = 0xFFFFFFFF
PARAMETERS: tuple[Parameter, ...] = (
    Parameter(1, "max_velocity", Kind.FLOAT, "m/s", 2.2352, 0, 8.047),
    Parameter(2, "max_accel", Kind.FLOAT, "m/s^2", 3.923, 0, 7.848),
    Parameter(3, "max_decel", Kind.FLOAT, "m/s^2", 3.923, 0, 7.848),
    Parameter(4, "max_dtz_decel", Kind.FLOAT, "m/s^2", 3.923, 0, 7.848),
    Parameter(5, "coastdown_decel", Kind.FLOAT, "m/s^2", 0.1962, 0, 1.961),
    Parameter(6, "max_yaw_rate", Kind.FLOAT, "rad/s", 3.0, 0, 4.5),
    Parameter(7, "max_yaw_accel", Kind.FLOAT, "rad/s^2", 28.274, 0, 28.274),
    Parameter(8, "tire_diameter", Kind.FLOAT, "m", 0.46228, 0.1524, 1.0),
    Parameter(9, "wheel_base", Kind.FLOAT, "m", 0.5842, 0.4142, 1.0),
    Parameter(10, "track_width", Kind.FLOAT, "m", 0.569976, 0.506476, 1.0),
    Parameter(11, "gear_ratio", Kind.FLOAT, "", 24.2667, 1, 200),
    Parameter(12, "input_bitmap", Kind.HEX, "", 0x101),
    Parameter(13, "ip_address", Kind.IP, "", 0x2800A8C0, maximum=_IP_MAX),
    Parameter(14, "ip_port", Kind.UINT, "", 8080),
    Parameter(15, "subnet_mask", Kind.IP, "", 0x00FFFFFF, maximum=_IP_MAX),
    Parameter(16, "gateway", Kind.IP, "", 0x0100A8C0, maximum=_IP_MAX),
    Parameter(17, "feedback_bitmap_1", Kind.HEX, "", 0xFFFFFFFF),
    Parameter(18, "feedback_bitmap_2", Kind.HEX, "", 0xFFFFFFFF),
    Parameter(19, "feedback_bitmap_3", Kind.HEX, "", 0xFFFFFFFF),
    Parameter(20, "feedback_bitmap_4", Kind.HEX, "", 0, maximum=0),
)
"""In command order; factory values are those of the 0.46 m tyre machines, addresses in wire order (x86)."""

BY_NUMBER: Mapping[int, Parameter] = {parameter.number: parameter for parameter in PARAMETERS}
BY_NAME: Mapping[str, Parameter] = {parameter.name: parameter for parameter in PARAMETERS}

RMP110_TRACK_MINIMUM_M = 0.3556
"""Track widths down to here exist in the 110's own tools; dialect B2 documents 0.506476 (fact sheet 1, 7)."""

RMP110_STORED: Mapping[str, float] = {
    "max_velocity": 0.5,
    "max_accel": 0.5,
    "max_decel": 0.5,
    "max_dtz_decel": 1.0,
    "max_yaw_rate": 1.0,
    "max_yaw_accel": 1.5,
    "tire_diameter": 0.46228,
    "track_width": 0.481224,
    "gear_ratio": 24.2667,
}
"""What Stanley Innovation stores in an RMP 110 (fact sheet section 7)."""


@dataclass(frozen=True, slots=True)
class Stored:
    """All stored parameters as the base holds them, bit for bit, in the order of its dialect's table."""

    words: tuple[int, ...]
    parameters: tuple[Parameter, ...] = PARAMETERS

    def __post_init__(self) -> None:
        if len(self.words) != len(self.parameters):
            raise ValueError(f"{len(self.words)} parameter words, this dialect has {len(self.parameters)}")

    @classmethod
    def of(
        cls,
        values: Mapping[str, float],
        base: Sequence[int] | None = None,
        parameters: tuple[Parameter, ...] = PARAMETERS,
    ) -> Stored:
        """Parameters by name over `base` words, or over the factory's; KeyError for an unknown name."""
        words = base if base is not None else [p.word(p.factory) for p in parameters]
        return cls(tuple(words), parameters).with_values(values)

    def __getitem__(self, name: str) -> float:
        parameter, word = self._find(name)
        return parameter.value(word)

    def __contains__(self, name: str) -> bool:
        return any(parameter.name == name for parameter in self.parameters)

    def with_values(self, values: Mapping[str, float]) -> Stored:
        """The same with these values by name; KeyError for an unknown name."""
        unknown = [name for name in values if name not in self]
        if unknown:
            raise KeyError(unknown[0])
        words = (
            parameter.word(values[parameter.name]) if parameter.name in values else word
            for parameter, word in zip(self.parameters, self.words, strict=True)
        )
        return Stored(tuple(words), self.parameters)

    @property
    def bitmaps(self) -> tuple[int, int, int, int]:
        """The user-defined feedback bitmaps 1..4; zero where a dialect has none."""
        one, two, three, four = (
            int(self[name]) if name in self else 0 for name in (f"feedback_bitmap_{n}" for n in (1, 2, 3, 4))
        )
        return one, two, three, four

    def differing(self, wanted: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Name to (stored, wanted) where the stored bits are not the float32 bits of the wanted value.

        Names that this dialect does not store cannot differ.
        """
        found = {}
        for name, value in wanted.items():
            if name in self:
                parameter, word = self._find(name)
                if word != parameter.word(value):
                    found[name] = (parameter.value(word), value)
        return found

    def _find(self, name: str) -> tuple[Parameter, int]:
        for parameter, word in zip(self.parameters, self.words, strict=True):
            if parameter.name == name:
                return parameter, word
        raise KeyError(name)
