"""The hue of each thing that the simulation's colour detector knows: the contract between picture and detector."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

PAINT: Mapping[str, float] = MappingProxyType(
    {
        "backpack": 20.0,
        "laptop": 185.0,
        "bottle": 220.0,
        "television": 275.0,
        "potted plant": 120.0,
        "vase": 52.0,
        "suitcase": 352.0,
        "cushion": 320.0,
    }
)
"""Hue in degrees (HSV, 0..360)."""

BAND_DEG = 12.0
"""Half width of the hue band that belongs to each class."""
MIN_PAINT_SATURATION = 0.65
"""A painted surface keeps at least this HSV saturation in the encoded picture."""
MAX_OTHER_SATURATION = 0.35
"""Everything else stays below this, or outside every band."""
