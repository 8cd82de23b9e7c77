"""What the page is told about the robot: plain values in the shape of `protocol.State` and `protocol.Scan`. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.angles import wrap
from ghal360_robot.telepresence.protocol import MAX_APPROACHING, MAX_BOXES, MAX_REASONS, MAX_WORDS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ghal360_robot.messages import Applied, Decision, Detections, Inputs, LinkStats, Pose2, Surroundings, Twist
    from ghal360_robot.safety.people import Person

STEPS = 240
"""Of the ring: 1.5 degrees each, half of what a thumb covers on a phone."""

MAX_CM = 10_000
AHEAD = math.radians(4)
"""Half the angle in which the lidar is asked how far the target is: a backpack at 6 m."""

MOVED_NS = 1_200_000_000
"""Who was not seen moving for so long stands."""

NEAR_M, CLOSE_M = 5.0, 1.5
CLOSER_M = 0.10
LOOK_BACK_NS = 500_000_000
SAME_M = 0.8


@dataclass(frozen=True, slots=True)
class Sighting:
    """Who moved, and where, at one instant; odometry frame."""

    stamp_ns: int = 0
    places: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Watch:
    """People then and now, so that those who come closer can be told from those who walk by."""

    before: Sighting = Sighting()
    now: Sighting = Sighting()

    def step(self, people: Sequence[Person], stamp_ns: int) -> Watch:
        """One more look; people who have not moved lately are left out."""
        places = tuple((p.x, p.y) for p in people if p.confirmed and stamp_ns - p.moved_ns < MOVED_NS)
        seen = Sighting(stamp_ns, places)
        return Watch(self.now if stamp_ns - self.before.stamp_ns > LOOK_BACK_NS else self.before, seen)

    def approaching(self, pose: Pose2) -> list[float]:
        """Directions in the base frame of who comes closer, or moves close by."""
        found = []
        for x, y in self.now.places:
            away = math.hypot(x - pose.x, y - pose.y)
            if away > NEAR_M:
                continue
            old = min(self.before.places, key=lambda place: math.dist(place, (x, y)), default=None)
            same = old is not None and math.dist(old, (x, y)) < SAME_M
            closer = same and old is not None and math.dist(old, (pose.x, pose.y)) - away > CLOSER_M
            if closer or away < CLOSE_M:
                found.append(wrap(math.atan2(y - pose.y, x - pose.x) - pose.yaw))
        return found[:MAX_APPROACHING]


def state(
    inputs: Inputs,
    decision: Decision,
    applied: Applied,
    *,
    blockers: Sequence[str],
    links: Mapping[str, LinkStats],
    found: bool,
    cue_ns: int,
    target: str,
    approaching: Sequence[float],
) -> dict[str, Any]:
    """Fields of `protocol.State` without its kind."""
    base, detections = inputs.base, inputs.detections
    around = inputs.surroundings
    aim = decision.target_yaw
    return {
        "t_us": inputs.stamp_ns // 1000,
        "tick": inputs.tick,
        "arm": applied.arm.value,
        "blockers": _words(blockers),
        "cue": decision.cue.value,
        "cue_us": cue_ns // 1000,
        "target": aim,
        "target_m": None if aim is None or around is None else _distance(around, aim),
        "intention": _intention(inputs, decision),
        "found": found,
        "boxes": [] if detections is None else _boxes(detections, target),
        "boxes_us": 0 if detections is None else detections.stamp_ns // 1000,
        "approaching": [round(yaw, 3) for yaw in approaching],
        "wanted": _speed(_wish(inputs, decision)),
        "applied": _speed(applied.twist),
        "source": applied.source,
        "reasons": _words(applied.reasons),
        "clearance_m": _finite(applied.clearance_m),
        "pose": None if base is None else _place(base.pose),
        "speed": None if base is None else _speed(base.twist),
        "battery_percent": None if base is None else _finite(base.battery_percent),
        "base": "unknown" if base is None else base.mode.value,
        "devices": {name: _device(name, links, inputs) for name in links},
    }


def scan(around: Surroundings) -> dict[str, Any]:
    """Fields of `protocol.Scan` without its kind: the nearest return of each step, seen from the base's origin."""
    points = around.points
    ranges = np.hypot(points[:, 0], points[:, 1])
    step = math.tau / STEPS
    which = np.floor((np.arctan2(points[:, 1], points[:, 0]) + math.pi) / step).astype(np.intp) % STEPS
    nearest = np.full(STEPS, np.inf)
    np.minimum.at(nearest, which, ranges)
    cm = np.where(np.isfinite(nearest), np.clip(np.rint(nearest * 100.0), 1, MAX_CM), 0).astype(int)
    return {"t_us": around.stamp_ns // 1000, "first": -math.pi, "step": step, "cm": cm.tolist()}


def blind_sector(bearings: Sequence[float]) -> tuple[float, float]:
    """The widest gap between beam directions (base frame, radians), counter-clockwise from its start to its end."""
    ordered = sorted(bearings)
    if not ordered:
        return -math.pi, math.pi
    gaps = [(after - before, before, after) for before, after in pairwise(ordered)]
    gaps.append((ordered[0] + math.tau - ordered[-1], ordered[-1], ordered[0]))
    _, first, last = max(gaps)
    return wrap(first), wrap(last)


def _wish(inputs: Inputs, decision: Decision) -> Twist:
    """What the driver asks for: the hand's wish before the brain's."""
    operator = inputs.operator
    return decision.wanted if operator is None or operator.stick is None else operator.stick


def _intention(inputs: Inputs, decision: Decision) -> float | None:
    if decision.intention is None or inputs.base is None:
        return None
    return wrap(-decision.intention * math.tau / len(decision.belief) - _place(inputs.base.pose)["yaw"])


def _distance(around: Surroundings, yaw: float) -> float | None:
    points = around.points
    off = np.abs(np.angle(np.exp(1j * (np.arctan2(points[:, 1], points[:, 0]) - yaw))))
    ahead = points[off < AHEAD]
    return None if len(ahead) == 0 else round(float(np.median(np.hypot(ahead[:, 0], ahead[:, 1]))), 2)


def _boxes(detections: Detections, target: str) -> list[dict[str, Any]]:
    best = sorted(detections.objects, key=lambda found: (found.name != target, -found.score))[:MAX_BOXES]
    return [
        {
            "name": found.name[:64],
            "score": round(found.score, 3),
            "yaw": round(found.yaw, 4),
            "pitch": round(found.pitch, 4),
            "width": round(min(max(found.width, 1e-3), 6.28), 4),
            "height": round(min(max(found.height, 1e-3), 6.28), 4),
            "target": found.name == target,
        }
        for found in best
    ]


def _device(name: str, links: Mapping[str, LinkStats], inputs: Inputs) -> dict[str, Any]:
    fresh = inputs.freshness.get(name)
    link = links[name]
    good = link.link == "streaming" and fresh is not None and fresh.alive and fresh.rate_ok and fresh.valid
    return {
        "link": link.link[:64],
        "detail": link.detail[:MAX_WORDS],
        "age_s": None if fresh is None else _finite(fresh.age_s),
        "ok": good,
    }


def _speed(twist: Twist) -> dict[str, float]:
    return {"v": _finite(twist.v) or 0.0, "w": _finite(twist.w) or 0.0}


def _place(pose: Pose2) -> dict[str, float]:
    return {"x": _finite(pose.x) or 0.0, "y": _finite(pose.y) or 0.0, "yaw": wrap(_finite(pose.yaw) or 0.0)}


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(max(-1e6, min(value, 1e6)), 4)


def _words(reasons: Sequence[str]) -> list[str]:
    return [reason[:MAX_WORDS] for reason in reasons[:MAX_REASONS]]
