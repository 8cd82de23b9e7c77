# ruff: noqa: PLC0414 - this module is the face of the world; what others need of it is named here
"""The simulated world: what the lidar measures, what blocks the robot, what a camera could see. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from ghal360_robot.messages import Pose2
from ghal360_robot.simulation import home, office
from ghal360_robot.simulation.objects import TARGETS as TARGETS
from ghal360_robot.simulation.objects import Role as Role
from ghal360_robot.simulation.objects import WorldObject as WorldObject
from ghal360_robot.simulation.placement import CAMERA_HEIGHT_M as CAMERA_HEIGHT_M
from ghal360_robot.simulation.placement import ROBOT_RADIUS_M as ROBOT_RADIUS_M
from ghal360_robot.simulation.placement import NoRoomError, Scene
from ghal360_robot.simulation.raycast import Shapes
from ghal360_robot.simulation.rooms import CEILING_M, FloorPlan
from ghal360_robot.simulation.rooms import Room as Room

if TYPE_CHECKING:
    from numpy.typing import NDArray

WorldName = Literal["office", "home"]
LAYOUTS = {"office": (office.PLAN, office.furnish), "home": (home.PLAN, home.furnish)}
DRAWS = 60
"""How often a furnishing is drawn anew when chance blocks a way; one draw in two or three is good."""


@dataclass(frozen=True)
class World:
    """A furnished building seen from above, with a robot's start and one thing to find in it. Metres, radians."""

    name: str
    seed: int
    plan: FloorPlan
    objects: tuple[WorldObject, ...]
    start: Pose2
    target: str

    @property
    def rooms(self) -> tuple[Room, ...]:
        return self.plan.rooms

    def target_object(self) -> WorldObject:
        """The one instance of the class searched for."""
        return next(item for item in self.objects if item.role is Role.TARGET)

    def room_at(self, x: float, y: float) -> Room | None:
        """The room around a point, None in a doorway or outside."""
        return next((room for room in self.rooms if room.contains(x, y)), None)

    def ranges(self, x: float, y: float, yaw_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance (k,) to the nearest solid along each world direction (k,) in the lidar's plane, inf if none."""
        return self._solids.ranges(x, y, np.asarray(yaw_rad, float))

    def clearance(self, x: float, y: float) -> float:
        """Distance from a point to the nearest solid surface; 0 inside one and outside of the building."""
        if not (0.0 < x < self.plan.width and 0.0 < y < self.plan.depth):
            return 0.0
        return float(self._solids.clearance(np.array([[x, y]]))[0])

    def clearances(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """`clearance` at many points of any shape inside the building."""
        points = np.column_stack((np.ravel(x), np.ravel(y)))
        return self._solids.clearance(points).reshape(np.shape(x))

    def visible(self, x: float, y: float, z: float, obj: WorldObject) -> bool:
        """Whether nothing stands between a camera at (x, y, z) and the middle of an object."""
        others = self._all_but(obj)
        aim = (obj.x, obj.y, obj.z + obj.size[2] / 2)
        return bool(others.sees(np.array([[x, y, z]]), aim)[0])

    @cached_property
    def _solids(self) -> Shapes:
        solid = (item for item in self.objects if item.solid)
        return Shapes.of(solid, self.plan.wall_boxes(), CEILING_M)

    @cached_property
    def _views(self) -> dict[WorldObject, Shapes]:
        return {}

    def _all_but(self, obj: WorldObject) -> Shapes:
        if obj not in self._views:
            others = (item for item in self.objects if item != obj)
            self._views[obj] = Shapes.of(others, self.plan.wall_boxes(), CEILING_M)
        return self._views[obj]


def build_world(name: WorldName | str, seed: int, target: str = "backpack") -> World:
    """The furnished world of that name; the same arguments always give the same world.

    Raises ValueError for a name or target that does not exist.
    """
    if name not in LAYOUTS:
        raise ValueError(f"There is no world {name!r}; choose one of {', '.join(LAYOUTS)}.")
    if target not in TARGETS:
        raise ValueError(f"Nothing called {target!r} can be searched for; choose one of {', '.join(TARGETS)}.")
    plan, furnish = LAYOUTS[name]
    for draw in range(DRAWS):
        rng = np.random.default_rng([seed, draw, len(name), TARGETS.index(target)])
        left_right, front_back = (bool(rng.integers(2)) for _ in range(2))
        drawn = plan.mirrored(left_right=left_right, front_back=front_back)
        furnished = furnish(rng).mirrored(plan, left_right=left_right, front_back=front_back)
        scene = Scene(drawn, list(furnished.items), rng)
        try:
            start = scene.fill(target, furnished.television_places)
        except NoRoomError:
            continue
        return World(name, seed, drawn, tuple(scene.objects), start, target)
    raise RuntimeError(f"Found no way to furnish the {name} with seed {seed} and target {target}; use another seed.")
