"""What every part of a recording says once: codec, frames, names and colours, mounts, the run itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import rerun as rr

from ghal360_robot.logbook import entities

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ghal360_robot.logbook.clock import Anchor

APPLICATION_ID = "ghal360"
"""The key under which Rerun keeps a layout; the same for all recordings."""

STATE_COLORS: dict[str, tuple[int, int, int]] = {
    "none": (120, 120, 120),
    "left": (80, 150, 255),
    "right": (255, 170, 60),
    "confirm": (90, 200, 110),
    "disarmed": (120, 120, 120),
    "armed": (90, 200, 110),
    "estop": (230, 60, 60),
    "unknown": (120, 120, 120),
    "starting": (240, 200, 80),
    "standby": (80, 150, 255),
    "drive": (90, 200, 110),
    "off": (60, 60, 60),
}

FRAMES = {
    "lidar/scan": "lidar",
    "world/map": "odom",
    "world/target": "odom",
    "world/trail": "odom",
    "world/gaze": "theta",
    "sim/truth": "odom",
    "sim/map": "odom",
}

SERIES = {
    "scene/wedges": tuple(f"W{k}" for k in range(8)),
    "guidance/q": ("left", "right", "confirm"),
    "guidance/target": (*(f"wedge {k}" for k in range(8)), "not in view"),
    "intent/belief": tuple(f"wedge {k}" for k in range(8)),
    "cmd/wanted": ("wanted v m/s", "wanted w rad/s"),
    "cmd/applied": ("applied v m/s", "applied w rad/s"),
    "base/state": ("measured v m/s", "measured w rad/s", "battery %"),
    "operator/head": ("yaw rad", "pitch rad", "fov rad"),
    "loop/timing": ("lateness ms", "work ms"),
}

# The battery's hundred would flatten the speeds beside it.
HIDDEN_SERIES = {"base/state": (True, True, False)}


@dataclass(frozen=True, slots=True)
class Mount:
    """Where a sensor sits in the base frame: metres and radians."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0
    """How a camera leans: its pictures do, its frame stays level."""
    roll: float = 0.0


@dataclass(frozen=True, slots=True)
class Run:
    """What identifies a run; it stands in every part."""

    run_id: str
    anchor: Anchor
    config_json: str
    properties: Mapping[str, str]
    mounts: Mapping[str, Mount]
    calibration_json: str = "{}"


def log_statics(stream: rr.RecordingStream, run: Run) -> None:
    """Log all of it; a rotated part has only the statics that are logged again."""
    stream.send_recording_name(run.run_id)
    stream.send_recording_start_time_nanos(run.anchor.wall_ns)
    stream.send_property(
        "run",
        rr.DynamicArchetype(
            "Run",
            components={
                "run_id": [run.run_id],
                "config_json": [run.config_json],
                "monotonic_ns": [run.anchor.monotonic_ns],
                "wall_ns": [run.anchor.wall_ns],
            },
        ),
    )
    if run.properties:
        stream.send_property("robot", rr.DynamicArchetype("Robot", components=_texts(run.properties)))
    stream.log(entities.THETA_VIDEO.entity, rr.VideoStream(codec=rr.VideoCodec.H264), static=True)
    for sensor, mount in run.mounts.items():
        stream.log(f"tf/{sensor}", _transform(sensor, mount), static=True)
    for entity, frame in FRAMES.items():
        stream.log(entity, rr.CoordinateFrame(frame), static=True)
    for entity, names in SERIES.items():
        visible = HIDDEN_SERIES.get(entity)
        stream.log(entity, rr.SeriesLines(names=names, visible_series=visible), static=True)
    for entity, style in styles().items():
        stream.log(entity, style, static=True)
    states = rr.StateConfiguration(
        values=list(STATE_COLORS),
        labels=list(STATE_COLORS),
        colors=[list(color) for color in STATE_COLORS.values()],
    )
    for table in (entities.GUIDANCE_CUE, entities.STATE_ARM, entities.STATE_BASE):
        stream.log(table.entity, states, static=True)


def styles() -> dict[str, rr.AsComponents]:
    """Colours and sizes of what is drawn in the world; legible on light and on dark."""
    grey = rr.GridMap.from_fields(colormap=rr.components.Colormap.Grayscale)
    return {
        "world/map": grey,
        "sim/map": grey,
        "lidar/scan": rr.Points3D.from_fields(radii=0.02, colors=(40, 110, 220)),
        "world/trail": rr.Points3D.from_fields(radii=0.03, colors=(130, 130, 130)),
        "world/target": rr.Points3D.from_fields(radii=0.15, colors=(255, 170, 0), labels="target"),
        "sim/truth": rr.Points3D.from_fields(radii=0.08, colors=(90, 200, 110), labels="truth"),
        "world/gaze": rr.LineStrips3D.from_fields(radii=0.015),
        "tf/base": rr.TransformAxes3D(0.5),
    }


def _texts(properties: Mapping[str, str]) -> dict[str, list[str]]:
    """In lists, since Rerun leaves an empty text out."""
    return {name: [text] for name, text in properties.items()}


def _transform(sensor: str, mount: Mount) -> rr.Transform3D:
    return rr.Transform3D(
        translation=(mount.x, mount.y, mount.z),
        quaternion=rr.Quaternion(xyzw=(0.0, 0.0, math.sin(mount.yaw / 2), math.cos(mount.yaw / 2))),
        parent_frame="base",
        child_frame=sensor,
    )
