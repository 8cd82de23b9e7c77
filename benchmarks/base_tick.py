"""Feedback in, safety chain, motion frame out: many more ticks than `ghal360 bench tick`, and where they spend time.

    python benchmarks/base_tick.py --ticks 100000
    python benchmarks/base_tick.py --profile

The last line is one JSON object; the exit status is 1 when the budget is missed.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import sys

from ghal360_robot.bench.tick import WARM_UP, measure, taped


def profile(ticks: int) -> None:
    """Print which functions cost most; the profiler itself makes everything about twice as slow."""
    ticker, _ = taped(WARM_UP + ticks)
    for _ in range(WARM_UP):
        ticker.tick()
    profiler = cProfile.Profile()
    profiler.enable()
    for _ in range(ticks):
        ticker.tick()
    profiler.disable()
    pstats.Stats(profiler).sort_stats("tottime").print_stats(20)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=100_000)
    parser.add_argument("--profile", action="store_true", help="Say which functions cost what, and no more")
    options = parser.parse_args()
    if options.profile:
        profile(min(options.ticks, 10_000))
        return
    cost = measure(options.ticks)
    for name in ("decode", "chain", "encode", "total", "scan", "floor"):
        spread = getattr(cost, name)
        print(f"{name:7} p50 {spread.p50_us:7.1f}  p99 {spread.p99_us:7.1f}  max {spread.max_us:8.1f} us")
    print(json.dumps(cost.to_json()))
    sys.exit(0 if cost.passed else 1)


if __name__ == "__main__":
    main()
