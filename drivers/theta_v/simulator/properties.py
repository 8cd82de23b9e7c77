"""The properties of a THETA V as it describes them: public dump of firmware 3.50.1 (fact sheet 4.1, 4.3)."""

from __future__ import annotations

from drivers.theta_v.codec.ptp import CaptureMode, Kind, Property, PropertyDescription, Value

OPERATIONS = (
    *range(0x1001, 0x100C), 0x100E, *range(0x1013, 0x1019), 0x101B, 0x101C, *range(0x9801, 0x9806),
    0x9001, 0x9991, *range(0x9999, 0x999E), *range(0x99A2, 0x99AC), 0x99AD, 0x99B2, 0x99B3, 0x99B5, 0x99B6,
    0x99B9, 0x99AE,
)  # fmt: skip
EVENTS = (0x4002, 0x4006, 0x400A, 0x400C, 0x400D)
PLAYBACK_FORMATS = (0x3001, 0x3801, 0xB982, 0xB802)

UNREADABLE = 0xD812  # listed, but answers InvalidFormat to every question
WHILE_ASLEEP = frozenset({0x5001, 0x5002, 0xD407, 0xD801, 0xD80C, 0xD80E, 0xD814, 0xD82C})
"""What a sleeping camera still answers; to the rest it says DeviceBusy (fact sheet 4.3)."""

_Span = tuple[int, int, int]
_Form = _Span | list[int] | None

_TABLE: tuple[tuple[int, Kind, bool, Value, _Form], ...] = (
    (0x5001, Kind.U8, False, 98, (0, 100, 1)),
    (0x5002, Kind.U16, False, 0, [0]),
    (0x5003, Kind.STRING, True, "5376x2688", None),
    (0x5005, Kind.U16, True, 2, [2, 4, 0x8001, 0x8002, 6, 0x8020, *range(0x8003, 0x8009)]),
    (0x500E, Kind.U16, True, 2, [1, 2, 4, 0x8003]),
    (0x500F, Kind.U16, True, 65535, [65535]),
    (0x5010, Kind.I16, True, 0,
     [2000, 1700, 1300, 1000, 700, 300, 0, -300, -700, -1000, -1300, -1700, -2000]),
    (0x5011, Kind.STRING, True, "20201128T140958+0100", None),
    (0x5012, Kind.U32, True, 0, (0, 10000, 1000)),
    (0x5013, Kind.U16, True, 1, [1, 3, 0x8002, 0x8004, 0x8005, 0x8006, 0x8007]),
    (0x501A, Kind.U16, True, 0, (0, 9999, 1)),
    (0x501B, Kind.U32, True, 4000, (4000, 3600000, 1000)),
    (0x502C, Kind.U32, True, 100, (0, 100, 1)),
    (0xD006, Kind.U32, False, 0, None),
    (0xD00F, Kind.U64, True, 0, [0]),
    (0xD407, Kind.U32, False, 1, None),
    (0xD801, Kind.STRING, True, "", None),
    (0xD803, Kind.U16, True, 180, (0, 65534, 1)),
    (0xD805, Kind.STRING, True, "", None),
    (0xD806, Kind.STRING, True, "", None),
    (0xD808, Kind.U8, False, 0, [0, 1, 2, 3, 4]),
    (0xD809, Kind.U16, False, 0, (0, 1499, 1)),
    (0xD80A, Kind.U16, False, 0, (0, 1500, 1)),
    (0xD80B, Kind.U8, True, 0, [0, 1, 2, 3, 4]),
    (0xD80C, Kind.U8, False, 1, [0, 1, 2]),
    (0xD80D, Kind.U16, False, 2797, None),
    (0xD80E, Kind.U8, True, 0, [0, 1]),
    (0xD812, Kind.U8, True, 0, None),
    (0xD813, Kind.U16, True, 5000, (2500, 10000, 100)),
    (0xD814, Kind.U8, True, 0, [0, 1]),
    (0xD815, Kind.STRING, True, "", None),
    (0xD816, Kind.STRING, True, "", None),
    (0xD817, Kind.U16, True, 1, [1]),
    (0xD818, Kind.U16, True, 1, [1, 2]),
    (0xD81A, Kind.U8, True, 0, [0, 1]),
    (0xD81B, Kind.U32, True, 64800, (0, 2592000, 60)),
    (0xD81C, Kind.U8, True, 0, [0, 1, 2]),
    (0xD81D, Kind.U8, True, 1, [0, 1]),
    (0xD81F, Kind.U8, True, 0, [0, 1, 2]),
    (0xD820, Kind.U8, True, 0, [*range(9)]),
    (0xD821, Kind.U8, True, 0, [0]),
    (0xD822, Kind.U16, False, 0, None),
    (0xD823, Kind.U16, True, 1500, [300, 1500]),
    (0xD825, Kind.U8, True, 0, [0, 1, 2, 3, 4]),
    (0xD826, Kind.U16, True, 1600,
     [200, 250, 320, 400, 500, 640, 800, 1000, 1250, 1600, 2000, 2500, 3200]),
    (0xD829, Kind.U16, True, 0, [0]),
    (0xD82A, Kind.U8, True, 1, [0, 1]),
    (0xD82C, Kind.U8, True, 2, [1, 2, 3]),
    (0xD831, Kind.STRING, False, "ProgressRate:000", None),
)  # fmt: skip


def factory_properties(serial: str, mode: CaptureMode, *, asleep: bool) -> dict[int, PropertyDescription]:
    """All properties of a camera just switched on."""
    wifi = f"THETAYL{serial}"
    now: dict[int, Value] = {
        Property.CAPTURE_MODE: int(mode),
        Property.SLEEP_MODE: int(asleep),
        0xD805: f"{wifi}.OSC",
        0xD806: serial,
        0xD815: wifi,
        0xD816: serial,
    }
    return {
        code: PropertyDescription(
            code,
            kind,
            writable,
            default,
            now.get(code, default),
            span=form if isinstance(form, tuple) else None,
            choices=tuple(form) if isinstance(form, list) else None,
        )
        for code, kind, writable, default, form in _TABLE
    }


def rounded(code: int, value: Value) -> Value:
    """What the camera makes of a delay below its minimum (fact sheet 4.3)."""
    if code == Property.SLEEP_DELAY_S and isinstance(value, int) and 0 < value < 60:
        return 60
    if code == Property.AUTO_POWER_OFF_S and isinstance(value, int) and 0 < value < 600:
        return 600
    return value
