"""A row's values made into the message that they were recorded of. Pure but for what a row leaves out since it is as
in the row before: those readers carry it on.

What flipped bits have made senseless raises one of `errors.MADE_OF_FLIPPED_BITS`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ghal360_robot.logbook import scan_values
from ghal360_robot.logbook.records import AccessUnit, CanFrame, Link, Map, Telegram, Text, Truth
from ghal360_robot.messages import (
    BaseMode,
    BaseState,
    Bookmark,
    Detection,
    Detections,
    HeadPose,
    LidarScan,
    LinkStats,
    OperatorInput,
    Pose2,
    Twist,
)

Values = dict[str, Any]
"""By column, as `rrd.StoredRow` holds them."""

RSSI = ("LidarScan:rssi_u8", "LidarScan:rssi_u16", "LidarScan:rssi")


def access_unit(stamp_ns: int, values: Values) -> AccessUnit:
    return AccessUnit(
        stamp_ns,
        values["VideoStream:sample"][0],
        bool(values.get("VideoStream:is_keyframe", [False])[0]),
        int(values["AccessUnit:sequence"][0]),
        bool(values["AccessUnit:tainted"][0]),
        int(values["AccessUnit:latency_ns"][0]),
    )


def detections(stamp_ns: int, values: Values) -> Detections:
    numbers = values["Detections:values"].reshape(-1, 5).tolist()
    objects = tuple(Detection(name, *five) for name, five in zip(values["Detections:names"], numbers, strict=True))
    return Detections(stamp_ns, int(values["Detections:picture"][0]), values["Detections:detector"][0], objects)


def telegram(stamp_ns: int, values: Values) -> Telegram:
    return Telegram(stamp_ns, values["Telegram:bytes"].tobytes())


def can_frame(direction: str, stamp_ns: int, values: Values) -> CanFrame:
    return CanFrame(stamp_ns, direction, int(values["CanFrame:id"][0]), values["CanFrame:data"].tobytes())


def text(source: str, stamp_ns: int, values: Values) -> Text:
    return Text(stamp_ns, source, values["TextLog:level"][0], values["TextLog:text"][0])


def bookmark(stamp_ns: int, values: Values) -> Bookmark:
    return Bookmark(stamp_ns, values["Bookmark:holder"][0], values["Bookmark:note"][0])


def truth(stamp_ns: int, values: Values) -> Truth:
    return Truth(stamp_ns, Pose2(*values["Truth:pose"].tolist()))


def grid_map(stamp_ns: int, values: Values) -> Map:
    shape = values["GridMap:format"][0]
    cells = np.frombuffer(values["GridMap:data"][0], np.uint8).reshape(shape["height"], shape["width"])
    return Map(stamp_ns, cells, float(values["Map:resolution_m"][0]), Pose2(*values["Map:origin"].tolist()))


def link(device: str, stamp_ns: int, values: Values) -> Link:
    last = values["LinkStats:last_ns"].tolist()
    received, lost, damaged, reconnects = values["LinkStats:counts"].tolist()
    stats = LinkStats(
        values["LinkStats:link"][0],
        values["LinkStats:detail"][0],
        received,
        lost,
        damaged,
        reconnects,
        float(values["LinkStats:rate_hz"][0]),
        last[0] if last else None,
        values["LinkStats:condition"][0] if "LinkStats:condition" in values else "",
    )
    return Link(stamp_ns, device, stats)


class Scans:
    """Of `lidar/scan`; the beams' directions are recorded when they change."""

    def __init__(self) -> None:
        self._yaw = np.empty(0, np.float32)

    def __call__(self, stamp_ns: int, values: Values) -> LidarScan:
        self._yaw = values.get("LidarScan:yaw", self._yaw)
        whole = values.get("LidarScan:ranges_mm")
        ranges = values["LidarScan:ranges_m"] if whole is None else scan_values.metres(whole)
        rssi = next((values[name] for name in RSSI if name in values), None)
        scan_counter, telegram_counter, device_time_us = values["LidarScan:counters"].tolist()
        return LidarScan(
            stamp_ns,
            ranges,
            self._yaw,
            scan_counter,
            telegram_counter,
            device_time_us,
            bool(values["LidarScan:device_ok"][0]),
            None if rssi is None else rssi.astype(np.float32),
        )


class BaseStates:
    """Of `base/state`; mode, faults, warnings, temperature and covariance are recorded when they change."""

    def __init__(self) -> None:
        self._mode = BaseMode.UNKNOWN
        self._faults: tuple[str, ...] = ()
        self._warnings: tuple[str, ...] = ()
        self._temperature: float | None = None
        self._covariance = [0.0] * 6

    def __call__(self, stamp_ns: int, values: Values) -> BaseState:
        if "BaseState:mode" in values:
            self._mode = BaseMode(values["BaseState:mode"][0])
        if "BaseState:faults" in values:
            self._faults = tuple(values["BaseState:faults"])
        if "BaseState:warnings" in values:
            self._warnings = tuple(values["BaseState:warnings"])
        if "BaseState:temperature_degc" in values:
            self._temperature = next(iter(values["BaseState:temperature_degc"].tolist()), None)
        if "BaseState:covariance" in values:
            self._covariance = values["BaseState:covariance"].tolist()
        v, w, battery = values["Scalars:scalars"].tolist()
        pose = Pose2(*values["BaseState:pose"].tolist())
        xx, xy, x_yaw, yy, y_yaw, yaw_yaw = self._covariance
        return BaseState(
            stamp_ns,
            self._mode,
            pose,
            Twist(v, w),
            battery,
            self._faults,
            self._temperature,
            (xx, xy, x_yaw, yy, y_yaw, yaw_yaw),
            self._warnings,
        )


class OperatorInputs:
    """Of `operator/command`; who holds the robot and how late they are is recorded when it changes."""

    def __init__(self) -> None:
        self._holder, self._latency_s = "", 0.0

    def __call__(self, stamp_ns: int, values: Values) -> OperatorInput:
        self._holder = values.get("OperatorInput:holder", [self._holder])[0]
        self._latency_s = float(values.get("OperatorInput:latency_s", [self._latency_s])[0])
        stick = values["OperatorInput:stick"].tolist()
        arm, disarm, estop, found = values["OperatorInput:presses"].tolist()
        return OperatorInput(
            stamp_ns,
            HeadPose(*values["OperatorInput:head"].tolist()),
            bool(values["OperatorInput:deadman"][0]),
            Twist(*stick) if stick else None,
            arm,
            disarm,
            estop,
            found,
            self._holder,
            self._latency_s,
        )
