"""Groups of furniture that belong together, placed by their anchor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ghal360_robot.simulation.objects import CATALOGUE, WorldObject, thing

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.rooms import FloorPlan


@dataclass(frozen=True, slots=True)
class Furnished:
    """What a layout put into its building, and where a television may hang or stand."""

    items: tuple[WorldObject, ...]
    television_places: tuple[WorldObject, ...]

    def mirrored(self, plan: FloorPlan, *, left_right: bool, front_back: bool) -> Furnished:
        """The same furniture in the mirrored building; each thing keeps its own shape."""

        def turn(item: WorldObject) -> WorldObject:
            x, y, yaw = item.x, item.y, item.yaw
            if left_right:
                x, yaw = plan.width - x, -yaw
            if front_back:
                y, yaw = plan.depth - y, math.pi - yaw
            return replace(item, x=x, y=y, yaw=math.remainder(yaw, math.tau))

        return Furnished(tuple(map(turn, self.items)), tuple(map(turn, self.television_places)))


def local(x: float, y: float, yaw: float, right: float, back: float) -> tuple[float, float]:
    """The world point `right` along the local x and `back` along the local y of a pose."""
    return x + right * math.cos(yaw) - back * math.sin(yaw), y + right * math.sin(yaw) + back * math.cos(yaw)


def chair_at(name: str, x: float, y: float, yaw: float, rng: Generator, tucked: float = 0.08) -> WorldObject:
    """A chair pushed `tucked` metres under the table edge at (x, y), whose outward side is local -y of `yaw`.

    The sitter looks against the outward side; people leave chairs a little turned.
    """
    depth = CATALOGUE[name].size[1]
    cx, cy = local(x, y, yaw, float(rng.uniform(-0.06, 0.06)), -(depth / 2 - tucked))
    return thing(name, cx, cy, yaw + math.pi + float(rng.uniform(-0.3, 0.3)))


def workplace(
    desk: str, x: float, y: float, yaw: float, rng: Generator, *, screen_first: bool = False
) -> list[WorldObject]:
    """A desk whose user sits at its local -y side, with chair, screen, keyboard and some paper."""
    width, depth, height = CATALOGUE[desk].size
    items = [thing(desk, x, y, yaw)]
    edge = local(x, y, yaw, 0.0, -depth / 2)
    items.append(chair_at("office chair", *edge, yaw, rng))
    if screen_first or rng.random() < 0.75:
        sx, sy = local(x, y, yaw, 0.0, 0.20)
        items.append(thing("monitor", sx, sy, yaw + float(rng.uniform(-0.15, 0.15)), z=height))
        kx, ky = local(x, y, yaw, 0.0, -0.12)
        items.append(thing("keyboard", kx, ky, yaw, z=height))
    if rng.random() < 0.6:
        px, py = local(x, y, yaw, (width / 2 - 0.2) * (1.0 if rng.random() < 0.5 else -1.0), 0.12)
        items.append(thing("paper tray", px, py, yaw, z=height))
    return items
