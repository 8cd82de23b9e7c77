"""A run as an MCAP file with ROS 2 messages, for Foxglove and `ros2 bag`. Needs the extra [export]."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from ghal360_robot.errors import GhalError
from ghal360_robot.export import ros2_messages as ros
from ghal360_robot.export.ros2_definitions import definition, ros2_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from calibration.mounting import CameraMount, LidarMount
    from ghal360_robot.logbook.reader import RunReader

NEEDS_EXTRA = "MCAP export needs the extra [export]: pip install 'ghal360-robot[export]'"


class Stamped(NamedTuple):
    """One message on its way into the file; ordered by time alone, then by topic."""

    wall_ns: int
    topic: str
    number: int
    kind: str
    message: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Mounts:
    """Where the sensors sat during the run."""

    lidar: LidarMount
    camera: CameraMount


def write_mcap(reader: RunReader, out: Path, mounts: Mounts) -> dict[str, int]:
    """Write the whole run; returns the number of messages by topic.

    Raises GhalError where the extra is missing, OSError where the file cannot be written.
    """
    try:
        from mcap_ros2.writer import Writer  # noqa: PLC0415 - an optional extra
    except ImportError as error:
        raise GhalError(NEEDS_EXTRA) from error
    counts: dict[str, int] = {}
    with out.open("wb") as file:
        writer = Writer(file)
        schemas = {}
        for wall_ns, topic, number, kind, message in messages(reader, mounts):
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(ros2_name(kind), definition(kind))
            writer.write_message(topic, schemas[kind], message, wall_ns, wall_ns, number)
            counts[topic] = counts.get(topic, 0) + 1
        writer.add_metadata("ghal360", {"run_id": reader.run_id, **reader.properties})
        writer.finish()  # type: ignore[no-untyped-call]
    return counts


def messages(reader: RunReader, mounts: Mounts) -> Iterator[Stamped]:
    """Every message of the run in time order; stamps are the recorded robot's monotonic ones on its wall clock."""
    wall = reader.anchor.to_wall

    def stream(
        topic: str, kind: str, items: Iterator[Any], make: Callable[[int, Any], dict[str, Any]]
    ) -> Iterator[Stamped]:
        for number, item in enumerate(items):
            yield Stamped(wall(item.stamp_ns), topic, number, kind, make(wall(item.stamp_ns), item))

    head = (message for message in reader.operator_inputs())
    merged = heapq.merge(
        stream("/theta/video", "foxglove_msgs/CompressedVideo", reader.access_units(), ros.compressed_video),
        stream("/scan", "sensor_msgs/LaserScan", reader.scans(), ros.laser_scan),
        stream("/odom", "nav_msgs/Odometry", reader.base_states(), ros.odometry),
        stream("/tf", "tf2_msgs/TFMessage", reader.base_states(), ros.base_transform),
        stream("/battery", "sensor_msgs/BatteryState", reader.base_states(), ros.battery),
        stream("/operator/head", "geometry_msgs/PoseStamped", head, lambda ns, m: ros.head_pose(ns, m.head)),
        stream(
            "/cmd_vel",
            "geometry_msgs/TwistStamped",
            reader.ticks(),
            lambda ns, t: ros.twist_stamped(ns, t.applied.twist),
        ),
        stream(
            "/cmd_vel_wanted",
            "geometry_msgs/TwistStamped",
            reader.ticks(),
            lambda ns, t: ros.twist_stamped(ns, t.decision.wanted),
        ),
        stream("/guidance/cue", "std_msgs/String", reader.ticks(), lambda _, t: {"data": t.decision.cue.value}),
        stream("/rosout", "rcl_interfaces/Log", reader.texts(), ros.log),
    )
    first = next(merged, None)
    if first is None:
        return
    static = ros.mount_transforms(first.wall_ns, mounts.lidar, mounts.camera)
    yield Stamped(first.wall_ns, "/tf_static", 0, "tf2_msgs/TFMessage", static)
    yield first
    yield from merged
