"""Does the base's reader keep up with all 48 feedback frames a hundred times a second, and at what price?

    python benchmarks/can_feedback.py --seconds 60

The last line is one JSON object; the exit status is 1 when anything was lost.
"""

from __future__ import annotations

import argparse
import json
import sys

from ghal360_robot.bench.can_feedback import INTERFACES, measure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    runs = [measure(interface, seconds) for interface in INTERFACES]
    for run in runs:
        print(
            f"{run.interface:10} {run.polls} polls, {run.packets} packets of 48 frames, {run.lost} lost, "
            f"{run.torn} torn, {run.damaged} damaged; of a core: reader {run.reader_cpu:.1%}, loop {run.loop_cpu:.1%}"
        )
    print(json.dumps({run.interface: run.to_json() for run in runs}))
    sys.exit(0 if all(run.passed for run in runs) else 1)


if __name__ == "__main__":
    main()
