"""The entities of the log: the columns of each, and the order in which a flush writes them."""

from __future__ import annotations

import functools
import re

import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from ghal360_robot.logbook.table import (
    BLOB,
    BOOL,
    F32,
    F64,
    I64,
    IMAGE,
    TENSOR,
    TEXT,
    U8,
    U16,
    U32,
    Column,
    Table,
    own,
    strips,
    vector,
)

# An unchanged row is repeated this often, so that a lost row cannot mislead a reader for long.
KEEPALIVE_NS = 5_000_000_000

# Sources of text are code, not wires; the bound only keeps a mistake from filling the entity tree.
MAX_LOG_SOURCES = 64
OTHER_SOURCES = "other"

SCALARS = Column(rr.Scalars.descriptor_scalars(), F64)
STATE = Column(rr.StateChange.descriptor_state(), TEXT)
POSITIONS = Column(rr.Points3D.descriptor_positions(), vector(3))
SAID = (Column(rr.TextLog.descriptor_text(), TEXT), Column(rr.TextLog.descriptor_level(), TEXT))
TRANSFORM = (
    Column(rr.Transform3D.descriptor_translation(), vector(3)),
    Column(rr.Transform3D.descriptor_quaternion(), vector(4)),
    Column(rr.Transform3D.descriptor_parent_frame(), TEXT),
    Column(rr.Transform3D.descriptor_child_frame(), TEXT),
)
IMAGE_FORMAT = pa.struct(
    [
        pa.field("width", U32, nullable=False),
        pa.field("height", U32, nullable=False),
        pa.field("pixel_format", U8),
        pa.field("color_model", U8),
        pa.field("channel_datatype", U8),
    ]
)
GREY = rr.ColorModel.L.value
UNSIGNED_BYTE = rr.ChannelDatatype.U8.value

THETA_VIDEO = Table(
    "theta/video",
    (
        Column(rr.VideoStream.descriptor_sample(), BLOB),
        Column(rr.VideoStream.descriptor_is_keyframe(), BOOL),
        own("AccessUnit", "sequence", I64),
        own("AccessUnit", "tainted", BOOL),
        own("AccessUnit", "latency_ns", I64),
    ),
    direct=True,
)
KEYFRAME = 1
KEYFRAME_COLUMN = THETA_VIDEO.columns[KEYFRAME].name

THETA_OBJECTS = Table(
    "theta/objects",
    (
        Column(rr.Boxes2D.descriptor_centers(), vector(2)),
        Column(rr.Boxes2D.descriptor_half_sizes(), vector(2)),
        Column(rr.Boxes2D.descriptor_labels(), TEXT),
        Column(rr.Boxes2D.descriptor_class_ids(), U16),
        own("Detections", "picture", I64),
        own("Detections", "detector", TEXT),
        own("Detections", "names", TEXT),
        own("Detections", "values", F64),
    ),
)
"""`values` are score, yaw, pitch, width, height of each object."""

LIDAR_RAW = Table("lidar/raw", (own("Telegram", "bytes", U8),))
LIDAR_SCAN = Table(
    "lidar/scan",
    (
        POSITIONS,
        own("LidarScan", "ranges_mm", U16),
        own("LidarScan", "ranges_m", F32),
        own("LidarScan", "yaw", F32, sparse=True),
        own("LidarScan", "rssi_u8", U8),
        own("LidarScan", "rssi_u16", U16),
        own("LidarScan", "rssi", F32),
        own("LidarScan", "counters", I64),
        own("LidarScan", "device_ok", BOOL),
    ),
)
"""`counters` is scan counter, telegram counter, device time in microseconds."""

CAN_COLUMNS = (own("CanFrame", "id", U32), own("CanFrame", "data", U8))
CAN = {direction: Table(f"can/{direction}", CAN_COLUMNS) for direction in ("rx", "tx")}

BASE_STATE = Table(
    "base/state",
    (
        SCALARS,
        own("BaseState", "mode", TEXT, sparse=True),
        own("BaseState", "pose", F64),
        own("BaseState", "faults", TEXT, sparse=True),
        own("BaseState", "warnings", TEXT, sparse=True),
        own("BaseState", "temperature_degc", F64, sparse=True),
        own("BaseState", "covariance", F64, sparse=True),
    ),
)
"""Scalars are v, w, battery in percent; `covariance` is xx, xy, x yaw, yy, y yaw, yaw yaw of the pose."""

TF_BASE = Table("tf/base", TRANSFORM)
OPERATOR_HEAD = Table("operator/head", (SCALARS,))
"""Scalars are yaw, pitch, horizontal field of view."""
OPERATOR_COMMAND = Table(
    "operator/command",
    (
        own("OperatorInput", "head", F64),
        own("OperatorInput", "deadman", BOOL),
        own("OperatorInput", "stick", F64),
        own("OperatorInput", "presses", I64),
        own("OperatorInput", "holder", TEXT, sparse=True),
        own("OperatorInput", "latency_s", F64, sparse=True),
    ),
)
"""`stick` is v, w or empty; `presses` are arm, disarm, estop, found."""

OPERATOR_RECEIVED = Table(
    "operator/received",
    (
        own("Received", "holder", TEXT, sparse=True),
        own("Received", "sequence", I64),
        own("Received", "sent_ns", I64),
        own("Received", "verdict", TEXT, sparse=True),
        own("Received", "deadman", BOOL),
        own("Received", "stick", F64),
    ),
)
"""Every wish of a remote operator as it came in; those that counted are in `operator/command` as well."""

OPERATOR_REFUSED = Table(
    "operator/refused",
    SAID,
)
"""Messages that were not taken in: who claims to have sent them, and why they were refused."""

LOG_BOOKMARK = Table(
    "log/bookmark",
    (
        *SAID,
        own("Bookmark", "holder", TEXT),
        own("Bookmark", "note", TEXT),
    ),
)

SCENE_WEDGES = Table("scene/wedges", (SCALARS,), on_change=True, keepalive_ns=KEEPALIVE_NS)
GUIDANCE_CUE = Table("guidance/cue", (STATE, own("Cue", "target_yaw", F64)), on_change=True, keepalive_ns=KEEPALIVE_NS)
GUIDANCE_Q = Table("guidance/q", (SCALARS,), on_change=True, keepalive_ns=KEEPALIVE_NS)
GUIDANCE_TARGET = Table("guidance/target", (SCALARS,), on_change=True, keepalive_ns=KEEPALIVE_NS)
"""The chance of each wedge of the world to hold the target, and that none does."""
INTENT_BELIEF = Table("intent/belief", (SCALARS,), on_change=True, keepalive_ns=KEEPALIVE_NS)
INTENT_INTENTION = Table(
    "intent/intention", (STATE, own("Intention", "wedge", I64)), on_change=True, keepalive_ns=KEEPALIVE_NS
)
CMD_WANTED = Table(
    "cmd/wanted", (SCALARS, own("Command", "reasons", TEXT, sparse=True)), on_change=True, keepalive_ns=KEEPALIVE_NS
)
CMD_APPLIED = Table(
    "cmd/applied",
    (
        SCALARS,
        own("Command", "reasons", TEXT, sparse=True),
        own("Command", "arm", TEXT, sparse=True),
        own("Command", "clearance_m", F64),
        own("Command", "source", TEXT, sparse=True),
    ),
    on_change=True,
    keepalive_ns=KEEPALIVE_NS,
)
CMD_ASKED = Table(
    "cmd/asked",
    (
        own("Asked", "sources", TEXT),
        own("Asked", "stamps", I64),
        own("Asked", "twists", F64),
    ),
    on_change=True,
    keepalive_ns=KEEPALIVE_NS,
)
"""What others than operator and brain ask for; `twists` are v, w of each source."""

CMD_RIGHTS = Table(
    "cmd/rights",
    (
        own("Rights", "locks", TEXT),
        own("Rights", "lock_stamps", I64),
        own("Rights", "engaged", BOOL),
        own("Rights", "holder", TEXT),
        own("Rights", "lease_stamp", I64),
        own("Rights", "stops", I64),
    ),
    on_change=True,
    keepalive_ns=KEEPALIVE_NS,
)
"""Who may drive: locks, the lease's holder (empty without a lease), and others' stops (disarm, estop)."""

STATE_ARM = Table("state/arm", (STATE,), on_change=True)
STATE_BASE = Table("state/base", (STATE,), on_change=True)
LOOP_TIMING = Table("loop/timing", (SCALARS,))
"""Scalars are lateness and work in milliseconds."""
LOOP_INPUTS = Table(
    "loop/inputs",
    (
        own("Inputs", "stamps", I64),
        own("Inputs", "devices", TEXT, sparse=True),
        own("Inputs", "health", U8),
        own("Inputs", "age_s", F64),
    ),
)
"""`stamps` of base, scan, detections, operator (-1 for none); `health` bits are alive, rate_ok, valid."""

MAP_COLUMNS = (
    Column(rr.GridMap.descriptor_data(), IMAGE),
    Column(rr.GridMap.descriptor_format(), IMAGE_FORMAT),
    Column(rr.GridMap.descriptor_cell_size(), F32),
    Column(rr.GridMap.descriptor_translation(), vector(3)),
    Column(rr.GridMap.descriptor_quaternion(), vector(4)),
    own("Map", "origin", F64),
    own("Map", "resolution_m", F64),
)
# Repeated often enough that a part, or a viewer that comes late, is not without one for long.
MAP_KEEPALIVE_NS = 60_000_000_000
WORLD_MAP = Table("world/map", MAP_COLUMNS, on_change=True, keepalive_ns=MAP_KEEPALIVE_NS, direct=True)
SIM_MAP = Table("sim/map", MAP_COLUMNS, on_change=True, keepalive_ns=MAP_KEEPALIVE_NS, direct=True)
# What follows is drawn for the eye alone, from values that other entities keep exactly.
THETA_WEDGES = Table(
    "theta/wedges",
    (
        Column(rr.LineStrips2D.descriptor_strips(), strips(2)),
        Column(rr.LineStrips2D.descriptor_colors(), U32),
        Column(rr.LineStrips2D.descriptor_radii(), F32),
    ),
    on_change=True,
    keepalive_ns=KEEPALIVE_NS,
)
THETA_VIEW = Table(
    "theta/view",
    (
        Column(rr.Boxes2D.descriptor_centers(), vector(2)),
        Column(rr.Boxes2D.descriptor_half_sizes(), vector(2)),
        Column(rr.Boxes2D.descriptor_labels(), TEXT),
        Column(rr.Boxes2D.descriptor_colors(), U32),
    ),
    on_change=True,
    keepalive_ns=KEEPALIVE_NS,
)
WORLD_GAZE = Table(
    "world/gaze",
    (Column(rr.LineStrips3D.descriptor_strips(), strips(3)), Column(rr.LineStrips3D.descriptor_colors(), U32)),
    on_change=True,
    keepalive_ns=KEEPALIVE_NS,
)
WORLD_TRAIL = Table("world/trail", (POSITIONS,))
CMD_WHY = Table(
    "cmd/why",
    SAID,
    on_change=True,
)
INTENT_BARS = Table(
    "intent/bars", (Column(rr.BarChart.descriptor_values(), TENSOR),), on_change=True, keepalive_ns=KEEPALIVE_NS
)
GUIDANCE_BARS = Table(
    "guidance/bars", (Column(rr.BarChart.descriptor_values(), TENSOR),), on_change=True, keepalive_ns=KEEPALIVE_NS
)

WORLD_TARGET = Table("world/target", (POSITIONS, own("Target", "position", F64)), on_change=True)
SIM_TRUTH = Table("sim/truth", (POSITIONS, own("Truth", "pose", F64)))

# A flush writes in this order. `loop/inputs` comes after everything its tick decided, so that whoever
# reads a torn file may trust every tick it finds there.
ORDER = (
    THETA_VIDEO,
    LIDAR_RAW,
    CAN["rx"],
    CAN["tx"],
    LIDAR_SCAN,
    THETA_OBJECTS,
    BASE_STATE,
    TF_BASE,
    OPERATOR_HEAD,
    OPERATOR_COMMAND,
    OPERATOR_RECEIVED,
    WORLD_MAP,
    WORLD_TARGET,
    SIM_TRUTH,
    SIM_MAP,
    SCENE_WEDGES,
    GUIDANCE_CUE,
    GUIDANCE_Q,
    GUIDANCE_TARGET,
    INTENT_BELIEF,
    INTENT_INTENTION,
    CMD_WANTED,
    CMD_ASKED,
    CMD_RIGHTS,
    CMD_APPLIED,
    STATE_ARM,
    STATE_BASE,
    LOOP_TIMING,
    LOOP_INPUTS,
)


_log_tables: dict[str, Table] = {}


def log_table(source: str) -> Table:
    """`log/<source>`: text and level. Dots of a logger's name become branches of the tree."""
    path = "/".join(part for part in re.split(r"[^A-Za-z0-9_-]+", source) if part) or OTHER_SOURCES
    if path not in _log_tables and len(_log_tables) >= MAX_LOG_SOURCES:
        path = OTHER_SOURCES
    columns = SAID
    return _log_tables.setdefault(path, Table(f"log/{path}", columns))


@functools.lru_cache(maxsize=16)
def link_table(device: str) -> Table:
    """`state/<device>`: the link's state as a state change, and its counts every few seconds.

    `counts` are received, lost, damaged, reconnects.
    """
    columns = (
        Column(rr.StateChange.descriptor_state(), TEXT, sparse=True),
        own("LinkStats", "link", TEXT),
        own("LinkStats", "detail", TEXT),
        own("LinkStats", "counts", I64),
        own("LinkStats", "rate_hz", F64),
        own("LinkStats", "last_ns", I64),
        own("LinkStats", "condition", TEXT),
    )
    entity = f"state/{re.sub(r'[^A-Za-z0-9_-]+', '_', device)}"
    return Table(entity, columns, on_change=True, keepalive_ns=KEEPALIVE_NS, compared=3)
