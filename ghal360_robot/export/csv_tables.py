"""A run as CSV files in a folder: one table for each thing that has numbers, stamped in seconds."""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from ghal360_robot.logbook.reader import RunReader
    from ghal360_robot.messages import Pose2

Row = tuple[Any, ...]


def write_csv(reader: RunReader, folder: Path) -> dict[str, int]:
    """Write all tables; returns the number of rows by file. Raises OSError where the folder cannot be written.

    `t_s` counts from the run's first instant on the robot's monotonic clock, `wall_s` is Unix time.
    """
    folder.mkdir(parents=True, exist_ok=True)
    counts = {}
    for name, columns, rows in _tables(reader):
        counts[name] = _write(folder / name, reader, columns, rows)
    return counts


def _write(path: Path, reader: RunReader, columns: tuple[str, ...], rows: Iterable[Row]) -> int:
    count = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("t_s", "wall_s", *columns))
        for stamp_ns, *values in rows:
            t_s = (stamp_ns - reader.anchor.monotonic_ns) / 1e9
            table.writerow((f"{t_s:.6f}", f"{reader.anchor.to_wall(stamp_ns) / 1e9:.6f}", *values))
            count += 1
    return count


def _tables(reader: RunReader) -> Iterator[tuple[str, tuple[str, ...], Iterable[Row]]]:
    yield (
        "base.csv",
        ("mode", "x_m", "y_m", "yaw_rad", "v_mps", "w_radps", "battery_percent", "faults"),
        (
            (s.stamp_ns, s.mode.value, *_pose(s.pose), s.twist.v, s.twist.w, s.battery_percent, "; ".join(s.faults))
            for s in reader.base_states()
        ),
    )
    yield (
        "operator.csv",
        ("head_yaw_rad", "head_pitch_rad", "fov_rad", "deadman", "stick_v_mps", "stick_w_radps",
         "arm_presses", "disarm_presses", "estop_presses", "found_presses"),
        (
            (m.stamp_ns, m.head.yaw, m.head.pitch, m.head.fov, int(m.deadman),
             *(("", "") if m.stick is None else (m.stick.v, m.stick.w)),
             m.arm_presses, m.disarm_presses, m.estop_presses, m.found_presses)
            for m in reader.operator_inputs()
        ),
    )  # fmt: skip
    yield (
        "ticks.csv",
        ("tick", "cue", "target_yaw_rad", "intention", "wanted_v_mps", "wanted_w_radps", "wanted_because",
         "applied_v_mps", "applied_w_radps", "arm", "applied_because", "clearance_m", "lateness_ms", "work_ms"),
        (
            (t.stamp_ns, t.tick, t.decision.cue.value, _or_blank(t.decision.target_yaw),
             _or_blank(t.decision.intention), t.decision.wanted.v, t.decision.wanted.w,
             "; ".join(t.decision.reasons), t.applied.twist.v, t.applied.twist.w, t.applied.arm.value,
             "; ".join(t.applied.reasons), _or_blank(t.applied.clearance_m), t.lateness_ms, t.work_ms)
            for t in reader.ticks()
        ),
    )  # fmt: skip
    yield (
        "detections.csv",
        ("picture", "detector", "name", "score", "yaw_rad", "pitch_rad", "width_rad", "height_rad"),
        (
            (d.stamp_ns, d.picture, d.detector, o.name, o.score, o.yaw, o.pitch, o.width, o.height)
            for d in reader.detections()
            for o in d.objects
        ),
    )
    yield (
        "scans.csv",
        ("scan_counter", "telegram_counter", "device_time_us", "device_ok", "ranges_m"),
        (
            (s.stamp_ns, s.scan_counter, s.telegram_counter, s.device_time_us, int(s.device_ok),
             " ".join("nan" if math.isnan(r) else f"{r:.3f}" for r in s.ranges.tolist()))
            for s in reader.scans()
        ),
    )  # fmt: skip
    yield (
        "video.csv",
        ("sequence", "keyframe", "tainted", "bytes"),
        ((u.stamp_ns, u.sequence, int(u.keyframe), int(u.tainted), len(u.data)) for u in reader.access_units()),
    )
    yield (
        "can.csv",
        ("direction", "id_hex", "data_hex"),
        ((f.stamp_ns, f.direction, f"{f.can_id:03X}", f.data.hex()) for f in reader.can_frames()),
    )
    yield "log.csv", ("source", "level", "text"), ((t.stamp_ns, t.source, t.level, t.text) for t in reader.texts())


def _pose(pose: Pose2) -> tuple[float, float, float]:
    return pose.x, pose.y, pose.yaw


def _or_blank(value: float | None) -> float | str:
    return "" if value is None else value
