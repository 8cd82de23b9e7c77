"""Searches in simulated time: how many end, how fast, and how many simulated seconds a second of one core buys.

    python benchmarks/searches.py --seeds 20

The last line is one JSON object. The ratio to real time is the figure to compare between machines.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time

from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.simulation.lockstep import Outcome, search
from ghal360_robot.simulation.world import LAYOUTS, TARGETS, build_world

LIMIT_S = 240.0


def one(world: str, seed: int) -> Outcome:
    target = TARGETS[seed % len(TARGETS)]
    config = with_overrides(RobotConfig(), {"perception": {"target": target}})
    return search(build_world(world, seed, target), config, seed, LIMIT_S)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args().seeds
    outcomes: list[Outcome] = []
    began = time.process_time()
    for world in LAYOUTS:
        for seed in range(seeds):
            outcome = one(world, seed)
            outcomes.append(outcome)
            print(
                f"{world:7} {seed:3} found {outcome.found!s:5} {outcome.seconds:6.1f} s {outcome.distance_m:5.1f} m "
                f"nearest {outcome.least_clearance_m:.2f} m collisions {outcome.collisions} {outcome.cues}"
            )
    cpu_s = time.process_time() - began
    simulated_s = sum(outcome.seconds for outcome in outcomes)
    times = [outcome.seconds for outcome in outcomes if outcome.found]
    summary = {
        "searches": len(outcomes),
        "found": len(times),
        "collisions": sum(outcome.collisions for outcome in outcomes),
        "median_s": round(statistics.median(times), 1),
        "longest_s": round(max(times), 1),
        "least_clearance_m": round(min(outcome.least_clearance_m for outcome in outcomes), 3),
        "simulated_seconds_per_cpu_second": round(simulated_s / cpu_s, 1),
    }
    print(json.dumps(summary))


if __name__ == "__main__":
    main()
