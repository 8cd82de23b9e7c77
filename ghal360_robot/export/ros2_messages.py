"""What the robot recorded as ROS 2 messages: pure functions to plain dictionaries.

Frames follow REP-103 and REP-105.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibration.mounting import CameraMount, LidarMount
    from ghal360_robot.logbook.records import AccessUnit, Text
    from ghal360_robot.messages import BaseState, HeadPose, LidarScan, Pose2, Twist

ODOM, BASE, LASER, CAMERA = "odom", "base_link", "laser", "theta"

SCAN_S = 1.0 / 15.0
BEAM_S = 1.0 / 16_200
"""TiM571: 15 revolutions a second, 16.2 kHz measuring frequency (operating instructions)."""
RANGE_M = (0.05, 25.0)

LEVELS = {"TRACE": 10, "DEBUG": 10, "INFO": 20, "WARN": 30, "ERROR": 40, "CRITICAL": 50}

# Rows of the 6 x 6 matrix: x, y, z, roll, pitch, yaw. The base moves in the plane.
XX, XY, X_YAW, YX, YY, Y_YAW, YAW_X, YAW_Y, YAW_YAW = 0, 1, 5, 6, 7, 11, 30, 31, 35


def time_of(wall_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(wall_ns, 1_000_000_000)
    return {"sec": seconds, "nanosec": nanoseconds}


def header(wall_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": time_of(wall_ns), "frame_id": frame}


def laser_scan(wall_ns: int, scan: LidarScan) -> dict[str, Any]:
    """`wall_ns` is the last beam's instant; ROS wants the first one's.

    A beam that brought nothing usable is NaN: whether nothing was there (+inf in REP-117) is not known.
    """
    count = len(scan.ranges)
    first, last = float(scan.yaw[0]), float(scan.yaw[-1])
    return {
        "header": header(wall_ns - round((count - 1) * BEAM_S * 1e9), LASER),
        "angle_min": first,
        "angle_max": last,
        "angle_increment": (last - first) / (count - 1) if count > 1 else 0.0,
        "time_increment": BEAM_S,
        "scan_time": SCAN_S,
        "range_min": RANGE_M[0],
        "range_max": RANGE_M[1],
        "ranges": scan.ranges.tolist(),
        "intensities": [] if scan.rssi is None else scan.rssi.tolist(),
    }


def odometry(wall_ns: int, state: BaseState) -> dict[str, Any]:
    return {
        "header": header(wall_ns, ODOM),
        "child_frame_id": BASE,
        "pose": {"pose": pose(state.pose), "covariance": covariance(state.covariance)},
        "twist": {"twist": twist(state.twist), "covariance": [0.0] * 36},
    }


def covariance(upper: tuple[float, float, float, float, float, float]) -> list[float]:
    """The 6 x 6 matrix in rows, from xx, xy, x yaw, yy, y yaw, yaw yaw."""
    matrix = [0.0] * 36
    xx, xy, x_yaw, yy, y_yaw, yaw_yaw = upper
    for index, value in (
        (XX, xx), (XY, xy), (YX, xy), (X_YAW, x_yaw), (YAW_X, x_yaw),
        (YY, yy), (Y_YAW, y_yaw), (YAW_Y, y_yaw), (YAW_YAW, yaw_yaw),
    ):  # fmt: skip
        matrix[index] = value
    return matrix


def twist_stamped(wall_ns: int, velocity: Twist) -> dict[str, Any]:
    """The paper's teleoperation message: what was sent to the base, in the base's frame."""
    return {"header": header(wall_ns, BASE), "twist": twist(velocity)}


def head_pose(wall_ns: int, head: HeadPose) -> dict[str, Any]:
    """Where the operator looks, as a rotation in the base's frame (pitch up is a negative rotation about y)."""
    return {
        "header": header(wall_ns, BASE),
        "pose": {"position": _xyz(0.0, 0.0, 0.0), "orientation": quaternion(head.yaw, -head.pitch)},
    }


def base_transform(wall_ns: int, state: BaseState) -> dict[str, Any]:
    return {"transforms": [_transform(wall_ns, ODOM, BASE, _xyz(state.pose.x, state.pose.y, 0.0), state.pose.yaw)]}


def mount_transforms(wall_ns: int, lidar: LidarMount, camera: CameraMount) -> dict[str, Any]:
    """Where the sensors sit, for /tf_static."""
    roll = math.pi if lidar.upside_down else 0.0
    return {
        "transforms": [
            _transform(wall_ns, BASE, LASER, _xyz(lidar.x, lidar.y, lidar.z), lidar.yaw, roll),
            _transform(wall_ns, BASE, CAMERA, _xyz(camera.x, camera.y, camera.z), camera.yaw),
        ]
    }


def compressed_video(wall_ns: int, unit: AccessUnit) -> dict[str, Any]:
    """The camera's own access unit (Annex B), not encoded again."""
    return {"timestamp": time_of(wall_ns), "frame_id": CAMERA, "data": unit.data, "format": "h264"}


def battery(wall_ns: int, state: BaseState) -> dict[str, Any]:
    return {"header": header(wall_ns, BASE), "percentage": state.battery_percent / 100.0, "present": True}


def log(wall_ns: int, text: Text) -> dict[str, Any]:
    return {
        "stamp": time_of(wall_ns),
        "level": LEVELS.get(text.level, 20),
        "name": text.source,
        "msg": text.text,
        "file": "",
        "function": "",
        "line": 0,
    }


def pose(of: Pose2) -> dict[str, Any]:
    return {"position": _xyz(of.x, of.y, 0.0), "orientation": quaternion(of.yaw)}


def twist(of: Twist) -> dict[str, Any]:
    return {"linear": _xyz(of.v, 0.0, 0.0), "angular": _xyz(0.0, 0.0, of.w)}


def quaternion(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> dict[str, float]:
    """Of the rotation roll about x, then pitch about y, then yaw about z, all about fixed axes."""
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(a / 2), math.sin(a / 2)) for a in (yaw, pitch, roll))
    return {
        "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy,
        "z": cr * cp * sy - sr * sp * cy,
        "w": cr * cp * cy + sr * sp * sy,
    }


def _transform(
    wall_ns: int, parent: str, child: str, at: dict[str, float], yaw: float, roll: float = 0.0
) -> dict[str, Any]:
    return {
        "header": header(wall_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": at, "rotation": quaternion(yaw, roll=roll)},
    }


def _xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}
