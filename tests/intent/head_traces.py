"""Synthetic operators: 30 s of looking around, then a turn to one wedge that is held for 8 s.

Saccades of 30-90 degrees at 60 degrees/s, 30 % of them reversing; fixations of 0.2 s plus an exponential
0.4 s; 2.8 degrees of wander (Ornstein-Uhlenbeck, 0.4 s). The mean stay in a wedge is 1.17 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import wedge_of
from ghal360_robot.intent.exact import IntentState
from ghal360_robot.intent.head_motion import HeadSettings, HeadState, step_head

if TYPE_CHECKING:
    from ghal360_robot.intent.exact import ExactFilter

FINE_HZ = 100
SCAN_S, HOLD_S = 30.0, 8.0
SPEED_DEG = 60.0
WANDER_DEG, WANDER_S = 2.8, 0.4


@dataclass(frozen=True)
class Trace:
    yaw: NDArray[np.float64]
    """(n,) radians CCW at 100 Hz, with wander."""
    goal: int
    entered_s: float
    """When the head, wander aside, entered the goal's wedge for good."""
    mean_stay_s: float


def trace(rng: np.random.Generator) -> Trace:
    yaw, side, path = rng.uniform(-180, 180), rng.choice([-1, 1]), list[float]()
    while len(path) < SCAN_S * FINE_HZ:
        path += [yaw] * round((0.2 + rng.exponential(0.4)) * FINE_HZ)
        side = -side if rng.random() < 0.3 else side
        path += turn(yaw, side * rng.uniform(30, 90))
        yaw = path[-1]
    path = path[: int(SCAN_S * FINE_HZ)]
    looked = [wedge_of(-math.radians(y)) for y in path]
    goal = int(rng.integers(8))
    path += turn(path[-1], (-45.0 * goal - path[-1] + 180) % 360 - 180)
    path += [path[-1]] * int(HOLD_S * FINE_HZ)
    entered = next(i for i in range(int(SCAN_S * FINE_HZ), len(path)) if wedge_of(-math.radians(path[i])) == goal)
    return Trace(
        yaw=np.radians(np.array(path) + WANDER_DEG * wander(rng, len(path))),
        goal=goal,
        entered_s=entered / FINE_HZ,
        mean_stay_s=SCAN_S / (1 + np.count_nonzero(np.diff(looked))),
    )


def turn(yaw: float, by: float) -> list[float]:
    steps = max(1, round(abs(by) / SPEED_DEG * FINE_HZ))
    return (yaw + by * np.arange(1, steps + 1) / steps).tolist()


def wander(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    keep = math.exp(-1 / FINE_HZ / WANDER_S)
    kicks = rng.normal(size=n) * math.sqrt(1 - keep * keep)
    values, value = np.empty(n), rng.normal()
    for i in range(n):
        value = keep * value + kicks[i]
        values[i] = value
    return values


@dataclass(frozen=True)
class Score:
    false_per_min: float
    latencies_s: NDArray[np.float64]
    """From entering the goal's wedge to the right intention; inf where it never came."""
    wrong_hold_share: float
    """Share of traces that end in a wrong intention."""


def score(intent: ExactFilter, traces: list[Trace], hz: int) -> Score:
    """Run the filter on the traces, sampled at `hz`."""
    false, latencies, wrong = 0, [], 0
    for each in traces:
        head, state = HeadState(), IntentState()
        before, latency = None, math.inf
        for i in range(0, len(each.yaw), FINE_HZ // hz):
            now = i / FINE_HZ
            head = step_head(HeadSettings(), head, float(each.yaw[i]), i * 1_000_000_000 // FINE_HZ)
            if head.evidence is None:
                continue
            state = intent.step(state, head.evidence, 1 / hz)
            now_wanted = intent.intention(state)
            if now < SCAN_S:
                false += now_wanted is not None and now_wanted != before
            elif now_wanted == each.goal and now >= each.entered_s:
                latency = min(latency, now - each.entered_s)
            before = now_wanted
        latencies.append(latency)
        wrong += before not in (None, each.goal)
    return Score(false / (len(traces) * SCAN_S / 60), np.array(latencies), wrong / len(traces))
