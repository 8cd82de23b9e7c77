"""A drive as a picture from above: where robot and people went, brighter as time goes on, and where they met."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.simulation.drive_judge import Fault
from ghal360_robot.simulation.drives import TICK_S, ground_of
from ghal360_robot.simulation.world import ROBOT_RADIUS_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.simulation.drives import Moment, Outcome
    from ghal360_robot.simulation.world import World

    Canvas = NDArray[np.uint8]
    Colour = tuple[int, int, int]

SCALE = 80
"""Pixels per metre."""
ROBOT: Colour = (40, 40, 40)
PEOPLE: tuple[Colour, ...] = ((200, 80, 0), (0, 140, 0), (190, 0, 190), (0, 130, 200))
"""Blue, green, purple, orange."""
FAULTS: dict[Fault, Colour] = {
    Fault.OWN_MOTION: (0, 0, 230),
    Fault.OUT_OF_HIDING: (0, 160, 255),
    Fault.STEPPED_IN: (0, 200, 200),
    Fault.WALKED_INTO: (160, 160, 0),
}
BODY_EVERY_S, TEXT_EVERY_S = 1.0, 5.0


def draw(outcome: Outcome, path: Path) -> None:
    """Write a PNG of an outcome that kept its moments. Raises OSError where the file cannot be written."""
    drive = outcome.drive
    world = ground_of(drive.world, drive.seed).world
    canvas = _floor(world)
    count = len(outcome.moments)
    for tick, moment in enumerate(outcome.moments):
        fade = 0.35 + 0.65 * tick / count
        for index, (x, y, radius) in enumerate(moment.people):
            _person(canvas, (x, y), radius, _faded(PEOPLE[index % len(PEOPLE)], fade), body=_due(tick, BODY_EVERY_S))
        _robot(canvas, moment, tick, _faded(ROBOT, fade))
    for contact in outcome.contacts:
        moment = outcome.moments[min(round(contact.at_s / TICK_S), count) - 1]
        _mark(canvas, moment, FAULTS[contact.fault], f"{contact.at_s:.1f} s")
    for word, stills in (("STUCK", outcome.stuck), ("wedged", outcome.wedged)):
        for still in stills:
            moment = outcome.moments[min(round(still.at_s / TICK_S), count) - 1]
            _mark(canvas, moment, (0, 0, 160), f"{word} {still.at_s:.1f} s")
    manners = "give way" if drive.courteous else "ignore the robot"
    for line, (fault, colour) in enumerate(FAULTS.items()):
        _text(canvas, (10, canvas.shape[0] - 36 - 20 * line), f"{fault.value}: {outcome.count(fault)}", colour, 0.5)
    title = f"{drive.number}: {drive.world} {drive.seed}, {drive.people} people {manners}, {drive.style}"
    _text(canvas, (10, canvas.shape[0] - 12), title, (0, 0, 0), 0.6)
    coded, data = cv2.imencode(".png", canvas)
    if not coded:
        raise OSError(f"the picture {path} could not be encoded")
    path.write_bytes(data.tobytes())


def _floor(world: World) -> Canvas:
    rows, columns = round(world.plan.depth * SCALE), round(world.plan.width * SCALE)
    x = (np.arange(columns) + 0.5) / SCALE
    canvas = np.full((rows, columns, 3), 255, np.uint8)
    for row in range(rows):
        solid = world.clearances(x, np.full(columns, (rows - row - 0.5) / SCALE)) <= 0.0
        canvas[row, solid] = (150, 150, 150)
    return canvas


def _robot(canvas: Canvas, moment: Moment, tick: int, colour: Colour) -> None:
    pose = moment.pose
    here = _pixel(canvas, pose.x, pose.y)
    cv2.circle(canvas, here, 2, colour, -1)
    if _due(tick, BODY_EVERY_S):
        cv2.circle(canvas, here, round(ROBOT_RADIUS_M * SCALE), colour, 1, cv2.LINE_AA)
        nose = ROBOT_RADIUS_M * math.cos(pose.yaw), ROBOT_RADIUS_M * math.sin(pose.yaw)
        cv2.line(canvas, here, _pixel(canvas, pose.x + nose[0], pose.y + nose[1]), colour, 1, cv2.LINE_AA)
    if _due(tick, TEXT_EVERY_S):
        _text(canvas, (here[0] + 4, here[1] - 4), f"{tick * TICK_S:.0f} s", colour, 0.4)


def _person(canvas: Canvas, at: tuple[float, float], radius: float, colour: Colour, *, body: bool) -> None:
    here = _pixel(canvas, *at)
    cv2.circle(canvas, here, 1, colour, -1)
    if body:
        cv2.circle(canvas, here, round(radius * SCALE), colour, 1, cv2.LINE_AA)


def _mark(canvas: Canvas, moment: Moment, colour: Colour, words: str) -> None:
    here = _pixel(canvas, moment.pose.x, moment.pose.y)
    cv2.circle(canvas, here, round(ROBOT_RADIUS_M * SCALE), colour, 3, cv2.LINE_AA)
    for x, y, radius in moment.people:
        if math.hypot(x - moment.pose.x, y - moment.pose.y) < ROBOT_RADIUS_M + radius + 0.02:
            cv2.circle(canvas, _pixel(canvas, x, y), round(radius * SCALE), colour, 3, cv2.LINE_AA)
    _text(canvas, (here[0] + 12, here[1] + 18), words, colour, 0.5)


def _text(canvas: Canvas, at: tuple[int, int], words: str, colour: Colour, size: float) -> None:
    (width, height), below = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    cv2.rectangle(canvas, (at[0], at[1] - height), (at[0] + width, at[1] + below), (255, 255, 255), -1)
    cv2.putText(canvas, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def _pixel(canvas: Canvas, x: float, y: float) -> tuple[int, int]:
    return round(x * SCALE), round(canvas.shape[0] - y * SCALE)


def _due(tick: int, every_s: float) -> bool:
    return tick % round(every_s / TICK_S) == 0


def _faded(colour: Colour, share: float) -> Colour:
    """Towards white as the share falls."""
    blue, green, red = (round(255 - (255 - part) * share) for part in colour)
    return blue, green, red
