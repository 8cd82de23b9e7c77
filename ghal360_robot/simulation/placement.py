"""Where movable things go and where the robot starts: seeded, and only where the robot keeps its way free."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import Pose2
from ghal360_robot.simulation.floor_grid import CELL_M, flood, walking_distance
from ghal360_robot.simulation.objects import CATALOGUE, TARGETS, Role, WorldObject, thing
from ghal360_robot.simulation.raycast import Shapes
from ghal360_robot.simulation.rooms import CEILING_M, FloorPlan, Side

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

ROBOT_RADIUS_M = 0.38
CAMERA_HEIGHT_M = 1.20
COMFORT_M = 0.52
"""Half of the narrowest passage through which every room and the target can be reached."""
START_CLEARANCE_M = 0.60
APPROACH_M = 2.2
"""The target can be seen from a comfortable place at most this far away."""
ARRIVED_M = 2.0
"""A robot this close to the target, with it in view, has arrived."""
VIEW_M, VIEW_SHARE = 6.0, 0.65
"""The target can be seen whole from this share of its room's floor within so far: whoever looks in will see it."""
WALK_M = (4.6, 8.2)
"""Walk from the start to the arrival, measured on the grid (which overstates by up to 8 %)."""
DOORWAY_M = 0.95
"""Nothing movable stands closer than this to the middle of a doorway."""
FACING_ITS_USER = ("laptop", "television")
"""Things that are put where someone in front of them can use them."""
TRIES = 400


class NoRoomError(RuntimeError):
    """Chance left no place for something; another draw is needed."""


@dataclass
class Scene:
    """A building while it is being filled. The grid's cells are `CELL_M` wide, cell (0, 0) at the origin."""

    plan: FloorPlan
    objects: list[WorldObject]
    rng: Generator

    def __post_init__(self) -> None:
        columns, rows = round(self.plan.width / CELL_M), round(self.plan.depth / CELL_M)
        ys, xs = np.mgrid[0:rows, 0:columns]
        self.points = (np.column_stack((xs.ravel(), ys.ravel())) + 0.5) * CELL_M
        self.shape = (rows, columns)
        walls = self.plan.wall_boxes()
        solid = Shapes.of((item for item in self.objects if item.solid), walls, CEILING_M)
        self.clearance: NDArray[np.float64] = solid.clearance(self.points).reshape(self.shape)

    def fill(self, target: str, television_places: tuple[WorldObject, ...]) -> Pose2:
        """Add the target, the other known things and clutter; return the robot's start."""
        self._require(self._passable(self.clearance), "the furniture itself blocks the way")
        for name in sorted(TARGETS, key=lambda other: other != "television"):
            role = Role.TARGET if name == target else Role.CLUTTER
            if name == "television":
                place = television_places[int(self.rng.integers(len(television_places)))]
                self.objects.append(replace(place, role=role))
            elif CATALOGUE[name].solid:
                self._on_floor(name, role)
            else:
                self._on_furniture(name, role)
        for name, most in (("potted plant", 4), ("suitcase", 1)):
            for _ in range(int(self.rng.integers(1, most + 1))):
                self._on_floor(name, Role.CLUTTER)
        for name, most in (("vase", 2), ("mug", 3), ("book pile", 2)):
            role = Role.CLUTTER if name == "vase" else Role.DECORATION
            for _ in range(int(self.rng.integers(1, most + 1))):
                self._on_furniture(name, role)
        self._cushions()
        self._waste_bins()
        return self._start(next(item for item in self.objects if item.role is Role.TARGET))

    def _cushions(self) -> None:
        seats = [item for item in self.objects if item.name in {"sofa", "armchair", "bed"}]
        for seat in seats:
            if self.rng.random() < 0.3 and seat is not seats[0]:
                continue
            width, depth, _ = seat.size
            reach = max(0.0, width / 2 - 0.45)
            right = float(self.rng.choice((-1.0, 1.0))) * reach * float(self.rng.uniform(0.8, 1.0))
            back, height = (depth / 2 - 0.36, 0.43) if seat.name != "bed" else (depth / 2 - 0.62, 0.55)
            x = seat.x + right * math.cos(seat.yaw) - back * math.sin(seat.yaw)
            y = seat.y + right * math.sin(seat.yaw) + back * math.cos(seat.yaw)
            lean = float(self.rng.uniform(-0.15, 0.15))
            self.objects.append(thing("cushion", x, y, seat.yaw + lean, z=height, role=Role.CLUTTER))

    def _waste_bins(self) -> None:
        for desk in [item for item in self.objects if item.name in {"executive desk", "copier"}]:
            for right in (-1.0, 1.0):
                away = desk.size[0] / 2 + 0.18
                x, y = desk.x + right * away * math.cos(desk.yaw), desk.y + right * away * math.sin(desk.yaw)
                if self._try_solid(thing("waste bin", x, y)):
                    break

    def _on_floor(self, name: str, role: Role) -> None:
        """Stand a solid thing with its back to a wall, out of the robot's way."""
        width, depth, _ = CATALOGUE[name].size
        sides: tuple[Side, ...] = ("n", "s", "e", "w")
        for _ in range(TRIES):
            room = self.plan.rooms[int(self.rng.integers(len(self.plan.rooms)))]
            side = sides[int(self.rng.integers(4))]
            low, high = (room.x0, room.x1) if side in {"n", "s"} else (room.y0, room.y1)
            along = float(self.rng.uniform(low + width / 2 + 0.05, high - width / 2 - 0.05))
            x, y, yaw = room.against(side, along, depth, gap=float(self.rng.uniform(0.04, 0.10)))
            item = thing(name, x, y, yaw + float(self.rng.uniform(-0.12, 0.12)), role=role)
            if self._approachable(item) and self._try_solid(item):
                return
        raise NoRoomError(f"no place on the floor for a {name}")

    def _try_solid(self, item: WorldObject) -> bool:
        if any(math.hypot(item.x - door.x, item.y - door.y) < DOORWAY_M for door in self.plan.doors):
            return False
        reach = math.hypot(item.size[0], item.size[1]) / 2
        if self._free_around(item.x, item.y) < reach + 0.01 and self._overlaps(item):
            return False
        alone = Shapes.of((item,), (), CEILING_M).clearance(self.points).reshape(self.shape)
        clearance = np.minimum(self.clearance, alone)
        if not self._passable(clearance):
            return False
        self.clearance = clearance
        self.objects.append(item)
        return True

    def _free_around(self, x: float, y: float) -> float:
        row, column = int(y / CELL_M), int(x / CELL_M)
        return float(self.clearance[row, column]) - CELL_M

    def _overlaps(self, item: WorldObject) -> bool:
        """Whether the outline of a small thing touches another solid thing or a wall (sampled every few cm)."""
        width, depth, _ = item.size
        ticks = np.linspace(-0.5, 0.5, 9)
        right, back = (ticks[:, None] * width + 0 * ticks).ravel(), (ticks * depth + 0 * ticks[:, None]).ravel()
        cos, sin = math.cos(item.yaw), math.sin(item.yaw)
        outline = np.column_stack((item.x + right * cos - back * sin, item.y + right * sin + back * cos))
        others = (other for other in self.objects if other.solid)
        shapes = Shapes.of(others, self.plan.wall_boxes(), CEILING_M)
        return bool((shapes.clearance(outline) < 0.02).any())

    def _on_furniture(self, name: str, role: Role) -> None:
        """Put a small thing near an edge of something that carries, where the robot can look at it."""
        supports = [item for item in self.objects if item.name in CATALOGUE and CATALOGUE[item.name].carries]
        size = CATALOGUE[name].size
        for _ in range(TRIES):
            support = supports[int(self.rng.integers(len(supports)))]
            bearing = int(self.rng.integers(4)) * math.pi / 2
            half = np.array(support.size[:2]) / 2
            inset = math.hypot(size[0], size[1]) / 2 + 0.03
            if support.round:
                bearing = float(self.rng.uniform(-math.pi, math.pi))
                right, back = math.cos(bearing) * (half[0] - inset), math.sin(bearing) * (half[0] - inset)
            else:
                slide = float(self.rng.uniform(-1.0, 1.0))
                out, across = np.maximum(half - inset, 0.0) @ np.abs(
                    [[math.cos(bearing), math.sin(bearing)], [math.sin(bearing), math.cos(bearing)]]
                )
                right = math.cos(bearing) * out - math.sin(bearing) * across * slide
                back = math.sin(bearing) * out + math.cos(bearing) * across * slide
            cos, sin = math.cos(support.yaw), math.sin(support.yaw)
            x, y = support.x + right * cos - back * sin, support.y + right * sin + back * cos
            # The front looks along local -y, so towards the edge: bearing + 90 degrees.
            yaw = support.yaw + bearing + math.pi / 2 + float(self.rng.uniform(-0.3, 0.3))
            item = thing(name, x, y, yaw, z=support.top, role=role)
            if self._fits_on_top(item) and (role is Role.DECORATION or self._approachable(item)):
                self.objects.append(item)
                return
        raise NoRoomError(f"no place on any furniture for a {name}")

    def _fits_on_top(self, item: WorldObject) -> bool:
        reach = math.hypot(item.size[0], item.size[1]) / 2
        for other in self.objects:
            if other.z < item.z - 0.01 or other.z > item.top:
                continue
            apart = math.hypot(item.x - other.x, item.y - other.y)
            if apart < reach + math.hypot(other.size[0], other.size[1]) / 2 + 0.01:
                return False
        # Under a wall cabinet or beside a chair's back a small thing would be hidden or pierced.
        return not any(
            other.solid and other.top > item.z + 0.05 and math.hypot(item.x - other.x, item.y - other.y) < reach + 0.3
            for other in self.objects
        )

    def _approachable(self, item: WorldObject) -> bool:
        """Whether several comfortable places within reach look at the thing, from its front if it has one."""
        away = self.points - (item.x, item.y)
        distance = np.hypot(away[:, 0], away[:, 1])
        near = (distance < APPROACH_M) & (distance > 0.7) & (self.clearance.ravel() > COMFORT_M)
        if item.name in FACING_ITS_USER:
            front = math.sin(item.yaw) * away[:, 0] - math.cos(item.yaw) * away[:, 1]
            near &= front > 0.5 * distance
        if near.sum() < 12:
            return False
        places = self.points[near]
        return bool(self._sees(places, item).sum() >= 12)

    def _sees(self, places: NDArray[np.float64], item: WorldObject) -> NDArray[np.bool_]:
        """From which places (k, 2) the camera sees both flanks and the middle of a thing."""
        others = [other for other in self.objects if other is not item]
        shapes = Shapes.of(others, self.plan.wall_boxes(), CEILING_M)
        eyes = np.column_stack((places, np.full(len(places), CAMERA_HEIGHT_M)))
        seen = np.ones(len(places), bool)
        cos, sin = math.cos(item.yaw), math.sin(item.yaw)
        for right in (0.0, -0.4 * item.size[0], 0.4 * item.size[0]):
            aim = (item.x + right * cos, item.y + right * sin, item.z + 0.6 * item.size[2])
            seen &= shapes.sees(eyes, aim)
        return seen

    def _passable(self, clearance: NDArray[np.float64]) -> bool:
        """Whether no free cell is cut off, and a comfortable way joins all rooms."""
        inside = np.zeros(self.shape, bool)
        inside[1:-1, 1:-1] = True
        free = (clearance > ROBOT_RADIUS_M) & inside
        comfortable = (clearance > COMFORT_M) & inside
        seed = np.unravel_index(int(np.argmax(clearance * inside)), self.shape)
        if (flood(free, seed) != free).any():
            return False
        reached = flood(comfortable, seed).ravel()
        return all(self._count_in(room.name, reached) >= 20 for room in self.plan.rooms)

    def _count_in(self, name: str, mask: NDArray[np.bool_]) -> int:
        room = self.plan.room(name)
        x, y = self.points[mask].T
        return int(((x > room.x0) & (x < room.x1) & (y > room.y0) & (y < room.y1)).sum())

    def _start(self, target: WorldObject) -> Pose2:
        """A roomy place a few metres' walk from the target, out of its sight if there is one."""
        self._require(self._approachable(target), "something stands before the target")
        free = self.clearance > ROBOT_RADIUS_M
        near = np.hypot(*(self.points - (target.x, target.y)).T).reshape(self.shape) < ARRIVED_M
        arrived = free & near
        arrived[arrived] = self._sees(self.points[arrived.ravel()], target)
        self._require(bool(arrived.any()), "the target cannot be approached")
        self._require(self._in_the_open(target, free), "the target is in a nook of its room")
        walk = walking_distance(free, arrived)
        roomy = (self.clearance > START_CLEARANCE_M) & (walk >= WALK_M[0]) & (walk <= WALK_M[1])
        candidates = self.points[roomy.ravel()]
        self._require(len(candidates) > 0, "no place to start from")
        hidden = candidates[~self._glimpses(candidates, target)]
        chosen = hidden if len(hidden) else candidates
        x, y = chosen[int(self.rng.integers(len(chosen)))]
        return Pose2(float(x), float(y), float(self.rng.uniform(-math.pi, math.pi)))

    def _in_the_open(self, target: WorldObject, free: NDArray[np.bool_]) -> bool:
        room = next(room for room in self.plan.rooms if room.contains(target.x, target.y))
        x, y = self.points.T
        near = np.hypot(x - target.x, y - target.y) < VIEW_M
        inside = (x > room.x0) & (x < room.x1) & (y > room.y0) & (y < room.y1)
        places = self.points[free.ravel() & near & inside]
        return bool(self._sees(places, target).mean() >= VIEW_SHARE)

    def _glimpses(self, places: NDArray[np.float64], item: WorldObject) -> NDArray[np.bool_]:
        shapes = Shapes.of((other for other in self.objects if other is not item), self.plan.wall_boxes(), CEILING_M)
        eyes = np.column_stack((places, np.full(len(places), CAMERA_HEIGHT_M)))
        return shapes.sees(eyes, (item.x, item.y, item.z + item.size[2] / 2))

    @staticmethod
    def _require(holds: bool, what: str) -> None:
        if not holds:
            raise NoRoomError(what)
