"""What a tick saw and decided, drawn for the eye: over the panorama, in the world, as bars.

Drawn a few times a second only; the exact values are in rows of every tick.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.guidance.egocentric import CLUTTER, N_WEDGES, TARGET, WEDGE_WIDTH, wedge_centre
from ghal360_robot.logbook import entities, rows
from ghal360_robot.logbook.floor_drawing import FloorDrawing
from ghal360_robot.logbook.rows import PICTURE
from ghal360_robot.logbook.table import Row
from ghal360_robot.messages import Cue, HeadPose
from ghal360_robot.perception.sphere import SphereBox, parts_of_box, pixel_box, unit_vector

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from ghal360_robot.logbook.statics import Mount
    from ghal360_robot.messages import Applied, Decision, Inputs, Pose2

DRAW_NS = 200_000_000
"""Five times a second is enough to follow a head."""

TRAIL_STEP_M = 0.1
FRUSTUM_M = 2.0

WEDGE_COLOURS = {0: 0x969696A0, CLUTTER: 0x78DCFFFF, TARGET: 0xFFC828FF, TARGET | CLUTTER: 0xFF7828FF}
"""As in the exported film: distinct in lightness as well as in hue."""
VIEW_COLOUR = 0xE64BC8FF
"""Neither of the world's nor of the page's colours: seen on light and on dark."""
CUE_COLOUR = 0x46E678FF
RING_Y = PICTURE.height * 0.97
RING_RADIUS = 12.0
RING_GAP = 0.04
"""Radians between neighbours."""

CUE_WORDS = {Cue.NONE: "", Cue.LEFT: "◀ left", Cue.RIGHT: "right ▶", Cue.CONFIRM: "confirm"}


class TickRows:
    """All rows of one tick, in the order of ticks; used by the writer's thread alone."""

    def __init__(self, mounts: Mapping[str, Mount]) -> None:
        camera = mounts.get("theta")
        self._camera_yaw = 0.0 if camera is None else camera.yaw
        self._floor = FloorDrawing()
        self._drawn_ns: int | None = None
        self._trail: tuple[float, float] | None = None

    def rows(
        self, inputs: Inputs, decision: Decision, applied: Applied, lateness_ms: float, work_ms: float
    ) -> Iterator[Row]:
        yield from rows.tick(inputs, decision, applied, lateness_ms, work_ms)
        yield from self._floor.rows(inputs)
        if self._drawn_ns is None or inputs.stamp_ns - self._drawn_ns >= DRAW_NS:
            self._drawn_ns = inputs.stamp_ns
            yield from self._drawing(inputs, decision)
            yield why(inputs.stamp_ns, decision, applied)

    def _drawing(self, inputs: Inputs, decision: Decision) -> Iterator[Row]:
        stamp = inputs.stamp_ns
        head = HeadPose() if inputs.operator is None else inputs.operator.head
        if not all(map(math.isfinite, (head.yaw, head.pitch, head.fov))):
            head = HeadPose()
        yield wedge_ring(stamp, decision.wedges, head.yaw, self._camera_yaw)
        yield view(stamp, head, decision.cue, self._camera_yaw)
        yield frustum(stamp, head, self._camera_yaw)
        yield Row(entities.INTENT_BARS, stamp, (np.asarray(decision.belief, np.float64),))
        yield Row(entities.GUIDANCE_BARS, stamp, (np.asarray(decision.q or (0.0, 0.0, 0.0), np.float64),))
        if inputs.base is not None:
            yield from self._step(stamp, inputs.base.pose)

    def _step(self, stamp_ns: int, pose: Pose2) -> Iterator[Row]:
        here = (pose.x, pose.y)
        if self._trail is None or math.dist(self._trail, here) >= TRAIL_STEP_M:
            self._trail = here
            yield Row(entities.WORLD_TRAIL, stamp_ns, ([(*here, 0.0)],))


def why(stamp_ns: int, decision: Decision, applied: Applied) -> Row:
    """The reasons for the speed, as a line that appears when they change."""
    wanted, let = "; ".join(decision.reasons) or "nothing", "; ".join(applied.reasons)
    text = f"wanted: {wanted}" + (f" | applied: {let}" if let else "")
    return Row(entities.CMD_WHY, stamp_ns, ([text], ["WARN" if let else "INFO"]))


def wedge_ring(stamp_ns: int, wedges: tuple[int, ...], gaze_yaw: float, camera_yaw: float) -> Row:
    """The eight wedges as a band at the picture's lower edge, W0 below the gaze."""
    lines: list[NDArray[np.float32]] = []
    colours: list[int] = []
    for index, value in zip(range(N_WEDGES), wedges, strict=False):
        yaw = gaze_yaw - wedge_centre(index)  # wedges are clockwise, yaws are not
        box = SphereBox(yaw, 0.0, WEDGE_WIDTH - RING_GAP, 0.1)
        for part in parts_of_box(pixel_box(box, PICTURE, camera_yaw), PICTURE):
            lines.append(np.array([(part.left, RING_Y), (part.left + part.width, RING_Y)], np.float32))
            colours.append(WEDGE_COLOURS.get(value, WEDGE_COLOURS[0]))
    return Row(entities.THETA_WEDGES, stamp_ns, (lines, colours, [RING_RADIUS] * len(lines)))


def view(stamp_ns: int, head: HeadPose, cue: Cue, camera_yaw: float) -> Row:
    """The operator's field of view in the panorama, with the cue in words."""
    box = SphereBox(head.yaw, head.pitch, min(head.fov, math.tau), min(head.fov * 9 / 16, math.pi))
    parts = parts_of_box(pixel_box(box, PICTURE, camera_yaw), PICTURE)
    colour = VIEW_COLOUR if cue is Cue.NONE else CUE_COLOUR
    values = (
        [(part.left + part.width / 2, part.top + part.height / 2) for part in parts],
        [(part.width / 2, part.height / 2) for part in parts],
        [CUE_WORDS[cue]] * len(parts),
        [colour] * len(parts),
    )
    return Row(entities.THETA_VIEW, stamp_ns, values)


def frustum(stamp_ns: int, head: HeadPose, camera_yaw: float) -> Row:
    """Where the operator looks, as a pyramid from the camera, in the camera's frame."""
    half = min(head.fov, math.radians(150)) / 2
    half_height = math.atan(math.tan(half) * 9 / 16)
    yaw = head.yaw - camera_yaw
    corners = [(yaw + a * half, head.pitch + b * half_height) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    rim = FRUSTUM_M * np.array([unit_vector(*corner) for corner in corners], np.float32)
    apex = np.zeros(3, np.float32)
    lines = [np.vstack((rim, rim[:1])), *(np.vstack((apex, corner)) for corner in rim)]
    return Row(entities.WORLD_GAZE, stamp_ns, (lines, [VIEW_COLOUR]))
