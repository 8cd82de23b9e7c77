"""Ten minutes of the whole simulated robot, recorded, read back and replayed.

    python -m benchmarks.logbook_round_trip [--seconds 600] [--record DIR]

What the drivers hand over is hashed on its way into the recorder; what comes out of the files has to give the same
hashes. Then `replay --check`: every decision bit for bit, at ten times real time of one core at least.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import ghal360_robot.robot
from ghal360_robot.cli.replay import compare
from ghal360_robot.cli.scenario import checked_scenario, with_target
from ghal360_robot.cli.session import Session, run_session
from ghal360_robot.config import RobotConfig, parse_config, with_overrides
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder

if TYPE_CHECKING:
    from hashlib import _Hash

TIMES_REAL_TIME = 10.0


class Tap:
    """A hash and a count for each kind of raw input."""

    def __init__(self) -> None:
        self._hashes: dict[str, _Hash] = {}
        self.counts: dict[str, int] = {}

    def take(self, kind: str, stamp_ns: int, data: bytes) -> None:
        self._hashes.setdefault(kind, hashlib.sha256()).update(stamp_ns.to_bytes(8, "big") + data)
        self.counts[kind] = self.counts.get(kind, 0) + 1

    def digests(self) -> dict[str, tuple[int, str]]:
        return {kind: (self.counts[kind], found.hexdigest()) for kind, found in sorted(self._hashes.items())}


class TappedRecorder(Recorder):
    """The robot's recorder, with everything raw hashed at its door."""

    tap = Tap()

    def access_unit(self, stamp_ns: int, data: bytes, sequence: int, keyframe: bool, tainted: bool) -> None:
        self.tap.take("access units", stamp_ns, data)
        super().access_unit(stamp_ns, data, sequence, keyframe, tainted)

    def lidar_telegram(self, stamp_ns: int, data: bytes) -> None:
        self.tap.take("telegrams", stamp_ns, data)
        super().lidar_telegram(stamp_ns, data)

    def can_frame(self, stamp_ns: int, direction: Literal["rx", "tx"], can_id: int, data: bytes) -> None:
        self.tap.take(f"CAN {direction}", stamp_ns, can_id.to_bytes(4, "big") + data)
        super().can_frame(stamp_ns, direction, can_id, data)


def read_back(reader: RunReader) -> Tap:
    tap = Tap()
    for unit in reader.access_units():
        tap.take("access units", unit.stamp_ns, unit.data)
    for telegram in reader.telegrams():
        tap.take("telegrams", telegram.stamp_ns, telegram.data)
    for frame in reader.can_frames():
        tap.take(f"CAN {frame.direction}", frame.stamp_ns, frame.can_id.to_bytes(4, "big") + frame.data)
    return tap


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--record", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="ghal360-round-trip-") as folder:
        report = round_trip(options.seconds, options.record or Path(folder))
    print(json.dumps(report, indent=1))
    return 0 if report["passed"] else 1


def round_trip(seconds: float, record_to: Path) -> dict[str, Any]:
    ghal360_robot.robot.Recorder = TappedRecorder  # type: ignore[misc]
    config = with_overrides(RobotConfig(), {"perception": {"detector": "painted"}, "logbook": {"part_minutes": 2.0}})
    scenario = checked_scenario(world="office", seed=1, target="backpack")
    ended = run_session(
        Session(
            config=with_target(config, "backpack"),
            scenario=scenario,
            virtual_operator=True,
            duration_s=seconds,
            until_found=False,
            record_to=record_to,
            quiet=True,
        )
    )
    given = TappedRecorder.tap.digests()
    with RunReader(Path(str(ended.report.recording))) as reader:
        found = read_back(reader).digests()
        parts, entities, damage = len(reader.parts), len(reader.entities()), reader.damage
        began_s, spent_s = time.perf_counter(), time.process_time()
        comparison = compare(reader, parse_config(reader.config_json, "the recording"))
        times = comparison.span_s / (time.process_time() - spent_s)
        times_here = comparison.span_s / (time.perf_counter() - began_s)
    checks = {
        "raw inputs identical": given == found,
        "no damage": not damage,
        "every decision the same": comparison.differing_ticks == 0,
        "ten times real time": times >= TIMES_REAL_TIME,
    }
    return {
        "passed": all(checks.values()),
        "checks": checks,
        "given": given,
        "found": found,
        "parts": parts,
        "entities": entities,
        "bytes": ended.report.recording_bytes,
        "ticks": comparison.ticks,
        "differing_ticks": comparison.differing_ticks,
        "times_real_time": round(times, 1),
        "times_real_time_beside_what_else_ran": round(times_here, 1),
        "logbook": ended.report.logbook,
        "tick_lateness_ms": ended.report.tick_lateness_ms,
    }


if __name__ == "__main__":
    sys.exit(main())
