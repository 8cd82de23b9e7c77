"""What stands, hangs or lies in the simulated world, and the catalogue of all kinds with their sizes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Role(Enum):
    """What an object is for the search."""

    TARGET = "target"
    """The one thing looked for."""
    CLUTTER = "clutter"
    """Detectable, but not looked for."""
    FURNITURE = "furniture"
    """Blocks the way, carries things."""
    DECORATION = "decoration"
    """Only to be looked at; never in the way."""


@dataclass(frozen=True, slots=True)
class WorldObject:
    """One thing. `yaw` turns local axes; the front of a thing looks along its local -y."""

    name: str
    role: Role
    x: float
    y: float
    z: float
    """Centre of the footprint and height of the bottom, m."""
    yaw: float
    size: tuple[float, float, float]
    """Width (local x), depth (local y), height, m."""
    solid: bool
    """Its footprint blocks the robot and reflects the lidar."""
    round: bool = False
    """The footprint is a circle of diameter `size[0]` instead of a rectangle."""

    @property
    def top(self) -> float:
        """Height of the upper side, m."""
        return self.z + self.size[2]


@dataclass(frozen=True, slots=True)
class Kind:
    """Size and nature of one kind of thing; `carries` says that small things may stand on it."""

    size: tuple[float, float, float]
    solid: bool = True
    round: bool = False
    carries: bool = False


TARGETS = ("backpack", "laptop", "bottle", "television")

CATALOGUE: dict[str, Kind] = {
    # Things a detector knows (paper, section IV, and clutter in the same scenes).
    "backpack": Kind((0.34, 0.22, 0.48)),
    "laptop": Kind((0.36, 0.30, 0.25), solid=False),
    "bottle": Kind((0.09, 0.09, 0.30), solid=False, round=True),
    "television": Kind((1.10, 0.09, 0.64), solid=False),
    "potted plant": Kind((0.36, 0.36, 1.15), round=True),
    "vase": Kind((0.15, 0.15, 0.30), solid=False, round=True),
    "suitcase": Kind((0.42, 0.26, 0.66)),
    "cushion": Kind((0.42, 0.16, 0.40), solid=False),
    # Office.
    "desk": Kind((1.40, 0.70, 0.74), carries=True),
    "executive desk": Kind((1.70, 0.80, 0.75), carries=True),
    "office chair": Kind((0.50, 0.50, 0.95)),
    "meeting table": Kind((2.60, 0.95, 0.74), carries=True),
    "filing cabinet": Kind((0.80, 0.42, 0.75), carries=True),
    "copier": Kind((0.62, 0.58, 1.05)),
    "whiteboard": Kind((1.80, 0.04, 1.00), solid=False),
    "monitor": Kind((0.56, 0.16, 0.46), solid=False),
    "keyboard": Kind((0.44, 0.15, 0.02), solid=False),
    "paper tray": Kind((0.26, 0.32, 0.14), solid=False),
    "desk divider": Kind((1.36, 0.03, 0.32), solid=False),
    "waste bin": Kind((0.26, 0.26, 0.32), round=True),
    "round table": Kind((0.90, 0.90, 0.74), round=True, carries=True),
    "coat rack": Kind((0.40, 0.40, 1.75), round=True),
    "wall clock": Kind((0.32, 0.05, 0.32), solid=False),
    # Home.
    "sofa": Kind((2.10, 0.90, 0.82)),
    "armchair": Kind((0.90, 0.85, 0.84)),
    "coffee table": Kind((1.10, 0.60, 0.42), carries=True),
    "tv stand": Kind((1.60, 0.42, 0.48)),
    "sideboard": Kind((1.50, 0.42, 0.80), carries=True),
    "bookshelf": Kind((0.95, 0.34, 1.90)),
    "dining table": Kind((1.40, 0.85, 0.75), carries=True),
    "chair": Kind((0.44, 0.46, 0.90)),
    "kitchen unit": Kind((0.60, 0.60, 0.90), carries=True),
    "stove": Kind((0.60, 0.60, 0.90)),
    "sink unit": Kind((0.90, 0.60, 0.90)),
    "wall cabinet": Kind((0.60, 0.35, 0.65), solid=False),
    "fridge": Kind((0.62, 0.64, 1.85)),
    "bed": Kind((1.60, 2.05, 0.55)),
    "nightstand": Kind((0.45, 0.40, 0.52), carries=True),
    "wardrobe": Kind((1.60, 0.58, 2.10)),
    "shoe bench": Kind((1.10, 0.36, 0.48), carries=True),
    "floor lamp": Kind((0.34, 0.34, 1.60), round=True),
    "table lamp": Kind((0.26, 0.26, 0.44), solid=False, round=True),
    "book pile": Kind((0.24, 0.18, 0.14), solid=False),
    "fruit bowl": Kind((0.28, 0.28, 0.12), solid=False, round=True),
    "mug": Kind((0.09, 0.09, 0.10), solid=False, round=True),
    "rug": Kind((2.40, 1.60, 0.01), solid=False),
    "picture": Kind((0.80, 0.04, 0.60), solid=False),
    "mirror": Kind((0.55, 0.04, 1.30), solid=False),
}


def thing(
    name: str,
    x: float,
    y: float,
    yaw: float = 0.0,
    *,
    z: float = 0.0,
    role: Role | None = None,
    width: float | None = None,
) -> WorldObject:
    """A thing of the catalogue at a place; `width` overrides the kind's own."""
    kind = CATALOGUE[name]
    if role is None:
        role = Role.FURNITURE if kind.solid else Role.DECORATION
    size = kind.size if width is None else (width, *kind.size[1:])
    return WorldObject(name, role, x, y, z, yaw, size, kind.solid, kind.round)
