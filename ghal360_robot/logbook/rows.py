"""From messages to rows: pure functions, one per thing that is logged."""

from __future__ import annotations

import math
import zlib
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.logbook import entities, scan_values
from ghal360_robot.logbook.table import Row
from ghal360_robot.messages import BaseMode
from ghal360_robot.perception.panorama import CameraView, in_picture
from ghal360_robot.perception.sphere import PictureSize, SphereBox, parts_of_box

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ghal360_robot.logbook.table import Table
    from ghal360_robot.messages import (
        Applied,
        BaseState,
        Bookmark,
        Decision,
        Detections,
        Inputs,
        LidarScan,
        LinkStats,
        OperatorInput,
        Pose2,
        Received,
    )

# Boxes are drawn over a stream of this size.
PICTURE = PictureSize(1920, 960)

# The picture for the eye: every third beam (1 degree) of every sixth scan (2.5 Hz) is enough to see
# by, and 1/18 of the size; the exact ranges are in every row.
DRAWN_BEAMS, DRAWN_SCANS = 3, 6
# A transform for the eye at 10 Hz; the exact pose is in every row of base/state.
TF_EVERY = 5

NO_STAMP = -1
NO_INTENTION = -1


def access_unit(
    stamp_ns: int, data: bytes, sequence: int, keyframe: bool, tainted: bool, latency_ns: int
) -> Iterator[Row]:
    """The unit as received. The keyframe mark is sparse: Rerun wants True on an IDR and nothing elsewhere."""
    values = ([data], [True] if keyframe else None, [sequence], [tainted], [latency_ns])
    yield Row(entities.THETA_VIDEO, stamp_ns, values)


def detections(found: Detections, camera: CameraView | float) -> Iterator[Row]:
    drawn = [
        (part, f"{o.name} {o.score:.2f}", zlib.crc32(o.name.encode()) & 0x7FFF)
        for o in found.objects
        for part in parts_of_box(in_picture(SphereBox(o.yaw, o.pitch, o.width, o.height), PICTURE, camera), PICTURE)
    ]
    yield Row(
        entities.THETA_OBJECTS,
        found.stamp_ns,
        (
            [(box.left + box.width / 2, box.top + box.height / 2) for box, _, _ in drawn],
            [(box.width / 2, box.height / 2) for box, _, _ in drawn],
            [label for _, label, _ in drawn],
            [class_id for _, _, class_id in drawn],
            [found.picture],
            [found.detector],
            [o.name for o in found.objects],
            [value for o in found.objects for value in (o.score, o.yaw, o.pitch, o.width, o.height)],
        ),
    )


def lidar_telegram(stamp_ns: int, data: bytes) -> Iterator[Row]:
    yield Row(entities.LIDAR_RAW, stamp_ns, (np.frombuffer(data, np.uint8),))


def lidar_scan(scan: LidarScan) -> Iterator[Row]:
    whole = scan_values.millimetres(scan.ranges)
    rssi_u8 = rssi_u16 = None
    if scan.rssi is not None:
        rssi_u8 = scan_values.counts(scan.rssi, np.uint8)
        rssi_u16 = scan_values.counts(scan.rssi, np.uint16) if rssi_u8 is None else None
    exact = rssi_u8 is not None or rssi_u16 is not None
    yield Row(
        entities.LIDAR_SCAN,
        scan.stamp_ns,
        (
            _points(scan) if scan.scan_counter % DRAWN_SCANS == 0 else None,
            whole,
            scan.ranges if whole is None else None,
            scan.yaw,
            rssi_u8,
            rssi_u16,
            None if exact else scan.rssi,
            [scan.scan_counter, scan.telegram_counter, scan.device_time_us],
            [scan.device_ok],
        ),
    )


def _points(scan: LidarScan) -> NDArray[np.float32]:
    ranges, yaw = scan.ranges[::DRAWN_BEAMS], scan.yaw[::DRAWN_BEAMS]
    seen = np.isfinite(ranges)
    points = np.zeros((int(seen.sum()), 3), np.float32)
    points[:, 0] = ranges[seen] * np.cos(yaw[seen])
    points[:, 1] = ranges[seen] * np.sin(yaw[seen])
    return points


def can_frame(stamp_ns: int, direction: str, can_id: int, data: bytes) -> Iterator[Row]:
    yield Row(entities.CAN[direction], stamp_ns, ([can_id], np.frombuffer(data, np.uint8)))


def base_state(state: BaseState, count: int) -> Iterator[Row]:
    """`count` is the running number of the state, which thins out the transform."""
    pose, twist = state.pose, state.twist
    yield Row(
        entities.BASE_STATE,
        state.stamp_ns,
        (
            [twist.v, twist.w, state.battery_percent],
            [state.mode.value],
            [pose.x, pose.y, pose.yaw],
            state.faults,
            state.warnings,
            [] if state.temperature_degc is None else [state.temperature_degc],
            list(state.covariance),
        ),
    )
    if count % TF_EVERY == 0:
        turn = (0.0, 0.0, math.sin(pose.yaw / 2), math.cos(pose.yaw / 2))
        yield Row(entities.TF_BASE, state.stamp_ns, ([(pose.x, pose.y, 0.0)], [turn], ["odom"], ["base"]))


def operator(message: OperatorInput) -> Iterator[Row]:
    head = [message.head.yaw, message.head.pitch, message.head.fov]
    stick = [] if message.stick is None else [message.stick.v, message.stick.w]
    presses = [
        message.arm_presses,
        message.disarm_presses,
        message.estop_presses,
        message.found_presses,
    ]
    yield Row(entities.OPERATOR_HEAD, message.stamp_ns, (head,))
    values = (head, [message.deadman], stick, presses, [message.holder], [message.latency_s])
    yield Row(entities.OPERATOR_COMMAND, message.stamp_ns, values)


def received(wish: Received) -> Iterator[Row]:
    stick = [] if wish.stick is None else list(wish.stick)
    values = ([wish.holder], [wish.sequence], [wish.sent_ns], [wish.verdict], [wish.deadman], stick)
    yield Row(entities.OPERATOR_RECEIVED, wish.stamp_ns, values)


def operator_refused(stamp_ns: int, holder: str, reason: str) -> Iterator[Row]:
    yield Row(entities.OPERATOR_REFUSED, stamp_ns, ([f"{holder or 'somebody'}: {reason}"], ["WARN"]))


def bookmark(mark: Bookmark) -> Iterator[Row]:
    text = f"{mark.holder}: {mark.note}" if mark.note else mark.holder
    yield Row(entities.LOG_BOOKMARK, mark.stamp_ns, ([text], ["INFO"], [mark.holder], [mark.note]))


def link(stamp_ns: int, device: str, stats: LinkStats) -> Iterator[Row]:
    counts = [stats.received, stats.lost, stats.damaged, stats.reconnects]
    last = [] if stats.last_ns is None else [stats.last_ns]
    values = ([stats.link], [stats.link], [stats.detail], counts, [stats.rate_hz], last, [stats.condition])
    yield Row(entities.link_table(device), stamp_ns, values)


def truth(stamp_ns: int, pose: Pose2, target: tuple[float, float] | None) -> Iterator[Row]:
    yield Row(entities.SIM_TRUTH, stamp_ns, ([(pose.x, pose.y, 0.0)], [pose.x, pose.y, pose.yaw]))
    drawn = [] if target is None else [(*target, 0.0)]
    yield Row(entities.WORLD_TARGET, stamp_ns, (drawn, [] if target is None else list(target)))


def grid_map(
    table: Table, stamp_ns: int, cells: NDArray[np.uint8], resolution_m: float, origin: Pose2
) -> Iterator[Row]:
    """`cells` (rows, columns), row 0 at the top (largest y), as in a map's picture file."""
    if cells.ndim != 2 or cells.dtype != np.uint8:
        raise ValueError(f"a map is a two-dimensional uint8 array, not {cells.dtype} {cells.shape}")
    rows, columns = cells.shape
    image = {
        "width": columns,
        "height": rows,
        "pixel_format": None,
        "color_model": entities.GREY,
        "channel_datatype": entities.UNSIGNED_BYTE,
    }
    turn = (0.0, 0.0, math.sin(origin.yaw / 2), math.cos(origin.yaw / 2))
    yield Row(
        table,
        stamp_ns,
        (
            [cells.tobytes()],
            [image],
            [resolution_m],
            [(origin.x, origin.y, 0.0)],
            [turn],
            [origin.x, origin.y, origin.yaw],
            [resolution_m],
        ),
    )


def text(stamp_ns: int, source: str, level: str, message: str) -> Iterator[Row]:
    yield Row(entities.log_table(source), stamp_ns, ([message], [level]))


def tick(inputs: Inputs, decision: Decision, applied: Applied, lateness_ms: float, work_ms: float) -> Iterator[Row]:
    """Everything one tick saw and decided; the rows of `loop/inputs` are the list of ticks."""
    stamp, number = inputs.stamp_ns, inputs.tick
    mode = inputs.base.mode if inputs.base is not None else BaseMode.UNKNOWN
    intention = NO_INTENTION if decision.intention is None else decision.intention
    aim = "none" if decision.intention is None else f"wedge {decision.intention}"
    target = [] if decision.target_yaw is None else [decision.target_yaw]
    clearance = [] if applied.clearance_m is None else [applied.clearance_m]
    stamps = [
        NO_STAMP if message is None else message.stamp_ns
        for message in (inputs.base, inputs.scan, inputs.detections, inputs.operator)
    ]
    fresh = inputs.freshness.values()
    health = [f.alive | f.rate_ok << 1 | f.valid << 2 for f in fresh]
    wanted, let = decision.wanted, applied.twist
    yield Row(entities.SCENE_WEDGES, stamp, (decision.wedges,), number)
    yield Row(entities.GUIDANCE_CUE, stamp, ([decision.cue.value], target), number)
    yield Row(entities.GUIDANCE_Q, stamp, (decision.q or (),), number)
    yield Row(entities.GUIDANCE_TARGET, stamp, (decision.target_chances,), number)
    yield Row(entities.INTENT_BELIEF, stamp, (decision.belief,), number)
    yield Row(entities.INTENT_INTENTION, stamp, ([aim], [intention]), number)
    yield Row(entities.CMD_WANTED, stamp, ([wanted.v, wanted.w], decision.reasons), number)
    yield Row(
        entities.CMD_APPLIED,
        stamp,
        ([let.v, let.w], applied.reasons, [applied.arm.value], clearance, [applied.source]),
        number,
    )
    yield from _authority(inputs)
    yield Row(entities.STATE_ARM, stamp, ([applied.arm.value],), number)
    yield Row(entities.STATE_BASE, stamp, ([mode.value],), number)
    yield Row(entities.LOOP_TIMING, stamp, ([lateness_ms, work_ms],), number)
    yield Row(
        entities.LOOP_INPUTS,
        stamp,
        (stamps, list(inputs.freshness), health, [f.age_s for f in fresh]),
        number,
    )


def _authority(inputs: Inputs) -> Iterator[Row]:
    """Who else asks for motion, and who may."""
    commands, locks, lease, stops = inputs.commands, inputs.locks, inputs.lease, inputs.stops
    asked = (
        [command.source for command in commands],
        [command.stamp_ns for command in commands],
        [value for command in commands for value in (command.twist.v, command.twist.w)],
    )
    rights = (
        [lock.name for lock in locks],
        [lock.stamp_ns for lock in locks],
        [lock.engaged for lock in locks],
        [] if lease is None else [lease.holder],
        [] if lease is None else [lease.stamp_ns],
        [stops.disarm, stops.estop],
    )
    yield Row(entities.CMD_ASKED, inputs.stamp_ns, asked, inputs.tick)
    yield Row(entities.CMD_RIGHTS, inputs.stamp_ns, rights, inputs.tick)
