"""What a base's stored parameters mean for driving it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum

from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.fault_log import FaultLog
from drivers.rmp110.codec.faults import GROUPS, Group
from drivers.rmp110.codec.feedback import Layout
from drivers.rmp110.codec.frames import as_float32
from drivers.rmp110.codec.motion import MotionScale
from drivers.rmp110.codec.parameters import InputBits, Parameter, Stored
from drivers.rmp110.codec.whitelist import RANGED, track_allowed
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.language import Language
from drivers.rmp110.device.state import NEEDED, Identity
from drivers.rmp110.errors import RmpUnsupported

MUST_MATCH = ("max_accel", "max_decel", "max_yaw_accel", "tire_diameter", "gear_ratio")
"""Stored parameters that change how far and how fast the base really goes for the same command."""

CHARGING = (
    "the base is set to drive while its charger is plugged in (AC-present check disabled in its input bitmap): "
    "it can tear the cable; unplug before driving"
)
LATERAL = (
    "the base is set to turn slower the faster it drives (yaw mapping by lateral acceleration in its input bitmap): "
    "it may turn less than commanded"
)
ACCELERATION = (
    "the base is set to take velocity commands for accelerations (input bitmap 0x{:X}): it would not stop when told "
    "to; {}"
)
FILTERED = "the base is set to filter commands (input bitmap 0x{:X}), which makes it stop later than its limits say: {}"


class Unwritten(Enum):
    """Why a base's parameter is not the expected one, and what to do about it."""

    FORBIDDEN = "allow the driver to write it (write_parameters) or correct the configuration"
    REFUSED = "the driver wrote it and the base did not take it; correct the configuration"
    POSTPONED = "it is written as soon as the base is in STANDBY; request that where the base is in TRACTOR"


def check_plausible(stored: Stored) -> None:
    """Raise RmpUnsupported where these words cannot be an RMP's parameters."""
    for parameter, word in zip(stored.parameters, stored.words, strict=True):
        if not _plausible(parameter, word):
            raise RmpUnsupported(
                f"the base's reply does not look like stored parameters ({parameter.name} reads "
                f"{parameter.value(word):g}); this is not the RMP that it was taken for"
            )


def _plausible(parameter: Parameter, word: int) -> bool:
    if parameter.name == "track_width":
        return track_allowed(word)
    return parameter.name not in RANGED or parameter.accepts(word)


def judge(
    dialect: Dialect,
    stored: Stored,
    layout: Layout,
    config: Rmp110Config,
    speak: Callable[[MotionScale], Language],
    *,
    input_bits: InputBits,
    unwritten: Unwritten = Unwritten.FORBIDDEN,
    firmware: str = "",
    fault_log: FaultLog | None = None,
    fault_groups: Sequence[Group] = GROUPS,
) -> Identity:
    """What the driver may do with a base that has these parameters. Raises RmpUnsupported."""
    missing = layout.missing(NEEDED)
    if missing:
        raise RmpUnsupported(
            f"the base's feedback set lacks {', '.join(missing[:3])}{' and more' if len(missing) > 3 else ''}: "
            "allow the driver to write it (write_feedback_set)"
        )
    for name in ("max_velocity", "max_yaw_rate"):
        if stored[name] <= 0:
            raise RmpUnsupported(f"the base has stored {name} = 0 and cannot move: {unwritten.value}")
    scale = MotionScale(
        stored["max_velocity"],
        stored["max_yaw_rate"],
        config.max_v_mps,
        config.max_w_rps,
        as_float32(config.track_m) / stored["track_width"],
    )
    bitmap = int(stored["input_bitmap"])
    differences = stored.differing(config.expected)
    return Identity(
        dialect=dialect,
        stored=stored,
        layout=layout,
        scale=scale,
        language=speak(scale),
        differences=differences,
        refusal=_bitmap_refusal(bitmap, input_bits, unwritten) or _refusal(stored, config, unwritten),
        postponed=unwritten is Unwritten.POSTPONED and bool(differences or bitmap != input_bits.cleaned(bitmap)),
        warnings=_warnings(bitmap, input_bits),
        firmware=firmware,
        fault_log=fault_log,
        fault_groups=tuple(fault_groups),
    )


def _warnings(bitmap: int, bits: InputBits) -> tuple[str, ...]:
    charging = (CHARGING,) if bitmap & bits.charging else ()
    lateral = (LATERAL,) if bits.limit_mapping & ~bitmap else ()
    return charging + lateral


def _bitmap_refusal(bitmap: int, bits: InputBits, unwritten: Unwritten) -> str | None:
    if bitmap & bits.acceleration:
        return ACCELERATION.format(bitmap, unwritten.value)
    return FILTERED.format(bitmap, unwritten.value) if bitmap & bits.filters else None


def _refusal(stored: Stored, config: Rmp110Config, unwritten: Unwritten) -> str | None:
    differing = stored.differing({name: config.expected[name] for name in MUST_MATCH if name in config.expected})
    for name, (have, want) in differing.items():
        unit = next(p.unit for p in stored.parameters if p.name == name)
        return f"the base has stored {name} = {have:g} {unit}, the configuration expects {want:g}: {unwritten.value}"
    return None
