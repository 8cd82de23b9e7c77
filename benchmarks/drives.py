"""Random drives among walking people: who ran into whom, and whether the robot ever stood still without need.

    python benchmarks/drives.py --drives 2000            # the campaign, two processes; exits 1 on a failure
    python benchmarks/drives.py --seed 417               # one drive, contact by contact
    python benchmarks/drives.py --seed 417 --plot a.png  # and its picture

The last line is one JSON object. What counts as what says `ghal360_robot/simulation/drive_judge.py`.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import statistics
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ghal360_robot.config import RobotConfig
from ghal360_robot.simulation.drive_judge import Contact, Fault
from ghal360_robot.simulation.drive_picture import draw
from ghal360_robot.simulation.drives import DRIVE_S, WORLDS, Outcome, drive_of, run
from ghal360_robot.simulation.random_driver import STYLES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

PROCESSES = 2


def one(number: int, seconds: float) -> Outcome:
    return run(drive_of(number, seconds), RobotConfig())


def campaign(first: int, drives: int, seconds: float, processes: int) -> list[Outcome]:
    # Drives of one world in a row: its floor is worked out once.
    numbers = sorted(range(first, first + drives), key=lambda number: (number % WORLDS, number))
    outcomes = []
    with multiprocessing.Pool(processes) as pool:
        for done, outcome in enumerate(pool.imap(partial(one, seconds=seconds), numbers, chunksize=5), start=1):
            outcomes.append(outcome)
            for line in trouble(outcome):
                print(line, flush=True)
            if done % 100 == 0:
                print(f"{done} of {drives} drives", file=sys.stderr, flush=True)
    return outcomes


def trouble(outcome: Outcome) -> Iterable[str]:
    """A line for everything but a person who walked into the robot."""
    drive = outcome.drive
    manners = "courteous" if drive.courteous else "ignoring"
    where = f"{drive.number:5} {drive.world} {drive.seed:2}, {drive.people} {manners}, {drive.style}"
    for contact in outcome.contacts:
        if contact.fault is not Fault.WALKED_INTO:
            yield f"{where}: {described(contact)}"
    for still in outcome.stuck:
        yield f"{where}: {still.at_s:4.1f} s STUCK, {len(still.free)} motions were free"
    for still in outcome.wedged:
        yield f"{where}: {still.at_s:4.1f} s wedged"


def described(contact: Contact) -> str:
    what = "something standing" if contact.person is None else f"person {contact.person}"
    seen = "" if contact.person is None else f", seen {contact.seen_s:.2f} s, needs {contact.need_s:.2f} s"
    sudden = "" if contact.foreseeable else ", suddenly"
    return (
        f"{contact.at_s:4.1f} s {contact.fault.value.upper()}: {what} at {contact.bearing_deg:.0f} deg, "
        f"robot {contact.towards_mps:.2f} m/s towards it, it {contact.person_mps:.2f} m/s{seen}{sudden}"
    )


def summary(outcomes: list[Outcome], wall_s: float) -> dict[str, object]:
    contacts = [contact for outcome in outcomes for contact in outcome.contacts]
    hidden = sorted(contact.towards_mps for contact in contacts if contact.fault is Fault.OUT_OF_HIDING)
    stepped = sorted(contact.towards_mps for contact in contacts if contact.fault is Fault.STEPPED_IN)
    own = [contact for contact in contacts if contact.fault is Fault.OWN_MOTION]
    asked_s = sum(outcome.asked_s for outcome in outcomes)
    return {
        "drives": len(outcomes),
        "simulated_h": round(sum(outcome.drive.seconds for outcome in outcomes) / 3600, 2),
        "own_motion": len(own),
        "own_motion_standing_things": sum(contact.person is None for contact in own),
        "out_of_hiding": len(hidden),
        "out_of_hiding_median_mps": round(statistics.median(hidden), 2) if hidden else None,
        "out_of_hiding_max_mps": round(hidden[-1], 2) if hidden else None,
        "stepped_in": len(stepped),
        "stepped_in_max_mps": round(stepped[-1], 2) if stepped else None,
        "walked_into": sum(contact.fault is Fault.WALKED_INTO for contact in contacts),
        "stuck": sum(len(outcome.stuck) for outcome in outcomes),
        "wedged": sum(len(outcome.wedged) for outcome in outcomes),
        "distance_km": round(sum(outcome.distance_m for outcome in outcomes) / 1000, 2),
        "asked_and_moved_percent": round(100 * sum(outcome.moved_s for outcome in outcomes) / max(asked_s, 1e-9), 1),
        "least_clearance_m": round(min(outcome.least_clearance_m for outcome in outcomes), 3),
        "wall_s": round(wall_s, 1),
        "failed": [outcome.drive.number for outcome in outcomes if outcome.failed][:50],
    }


GROUPS: list[tuple[str, Callable[[Outcome], bool]]] = [
    ("all", lambda _: True),
    ("people ignore the robot", lambda outcome: not outcome.drive.courteous),
    ("people give way", lambda outcome: outcome.drive.courteous),
    *((style, lambda outcome, style=style: outcome.drive.style == style) for style in STYLES),
    ("office", lambda outcome: outcome.drive.world == "office"),
    ("home", lambda outcome: outcome.drive.world == "home"),
]


def table(outcomes: list[Outcome]) -> None:
    print(f"{'':26} drives  own motion  out of hiding  stepped in  walked into  stuck  wedged  m/drive  moved")
    for name, belongs in GROUPS:
        group = [outcome for outcome in outcomes if belongs(outcome)]
        if not group:
            continue
        own, hidden, stepped, walked = (sum(outcome.count(fault) for outcome in group) for fault in Fault)
        stuck, wedged = sum(len(outcome.stuck) for outcome in group), sum(len(outcome.wedged) for outcome in group)
        metres = sum(outcome.distance_m for outcome in group) / len(group)
        share = sum(outcome.moved_s for outcome in group) / max(sum(outcome.asked_s for outcome in group), 1e-9)
        print(
            f"{name:26} {len(group):6} {own:11} {hidden:14} {stepped:11} {walked:12} {stuck:6} {wedged:7}"
            f" {metres:8.1f} {share:6.0%}"
        )


def replay(number: int, seconds: float, picture: Path | None) -> Outcome:
    outcome = run(drive_of(number, seconds), RobotConfig(), keep=True)
    print(outcome.drive)
    before: tuple[str, ...] = ()
    for tick, moment in enumerate(outcome.moments):
        reasons = tuple(reason.split(" 0.")[0] for reason in moment.applied.reasons if reason != "ramp")
        if reasons != before:
            twist, applied = moment.wish.twist, moment.applied.twist
            print(
                f"{tick * 0.02:6.2f} s asked {twist.v:6.2f} {twist.w:6.2f} got {applied.v:5.2f} {applied.w:5.2f} "
                f"{', '.join(moment.applied.reasons)}"
            )
            before = reasons
    for contact in outcome.contacts:
        print(described(contact))
    for line in trouble(outcome):
        print(line)
    if picture is not None:
        draw(outcome, picture)
    return outcome


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="number of the first drive")
    parser.add_argument("--seconds", type=float, default=DRIVE_S, help="simulated seconds of a drive")
    parser.add_argument("--processes", type=int, default=PROCESSES)
    parser.add_argument("--seed", type=int, help="one drive by its number")
    parser.add_argument("--plot", type=Path, help="with --seed: where to put its picture (PNG)")
    options = parser.parse_args()
    began = time.monotonic()
    if options.seed is not None:
        outcomes = [replay(options.seed, options.seconds, options.plot)]
    else:
        outcomes = campaign(options.first, options.drives, options.seconds, options.processes)
        table(outcomes)
    print(json.dumps(summary(outcomes, time.monotonic() - began)))
    return int(any(outcome.failed for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
