"""Definitions of the ROS 2 messages that a run is exported as, in the concatenated form that MCAP files carry.

Field names and types are those of common_interfaces, geometry2 and foxglove_msgs; readers match them by name.
"""

from __future__ import annotations

from functools import cache

FIELDS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "sensor_msgs/LaserScan": (
        "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n"
        "float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\n"
        "float32[] ranges\nfloat32[] intensities"
    ),
    "sensor_msgs/BatteryState": "std_msgs/Header header\nfloat32 percentage\nbool present",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "foxglove_msgs/CompressedVideo": (
        "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format"
    ),
    "rcl_interfaces/Log": (
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line"
    ),
    "std_msgs/String": "string data",
}
"""Type to its fields, one per line."""


def ros2_name(kind: str) -> str:
    """`sensor_msgs/LaserScan` as ROS 2 tools name it: `sensor_msgs/msg/LaserScan`."""
    package, name = kind.split("/")
    return f"{package}/msg/{name}"


@cache
def definition(kind: str) -> str:
    """The type's own fields, then every type it is made of, in the order of first use.

    Raises KeyError for a type that is not in the table.
    """
    separator = "=" * 80
    return FIELDS[kind] + "".join(f"\n{separator}\nMSG: {part}\n{FIELDS[part]}" for part in _parts(kind))


def _parts(kind: str) -> list[str]:
    found: list[str] = []
    queue = [kind]
    while queue:
        for line in FIELDS[queue.pop(0)].splitlines():
            used = line.split()[0].partition("[")[0]
            if used in FIELDS and used not in found:
                found.append(used)
                queue.append(used)
    return found
