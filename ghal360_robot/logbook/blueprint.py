"""The default layout of a recording, for whoever asks what the robot saw, decided and did."""

from __future__ import annotations

from typing import Any

import rerun as rr
import rerun.blueprint as rrb

# How much of the past the plots show beside the cursor.
PLOT_SECONDS = 20


def _recent() -> rrb.VisibleTimeRange:
    return rrb.VisibleTimeRange(
        "t",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-PLOT_SECONDS),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=PLOT_SECONDS / 4),
    )


def _plot(name: str, *entities: str) -> rrb.TimeSeriesView:
    """With what a replay would have decided, where such a recording is opened beside."""
    contents = [f"+ {root}/{entity}" for entity in entities for root in ("", "/replayed")]
    # Without this the viewer draws whatever numbers it finds in an entity, a covariance as well as a speed.
    lines: dict[Any, Any] = {path.removeprefix("+ /"): rr.SeriesLines().visualizer() for path in contents}
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=contents,
        time_ranges=[_recent()],
        overrides=lines,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightBottom),
    )


def _panorama() -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        name="Panorama, objects, wedges from the gaze, the operator's view and cue",
        origin="/theta/video",
        contents=[
            "+ /theta/video",
            "+ /theta/objects",
            "+ /replayed/theta/objects",
            "+ /theta/wedges",
            "+ /theta/view",
        ],
    )


def _world() -> rrb.Spatial3DView:
    driven = rrb.VisibleTimeRanges(
        rrb.VisibleTimeRange(
            "t", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative(seconds=0)
        )
    )
    return rrb.Spatial3DView(
        name="Scan, map, path, target, gaze",
        origin="/",
        contents=["+ /lidar/scan", "+ /tf/**", "+ /world/**", "+ /sim/truth"],
        overrides={"world/trail": driven},
        spatial_information=rrb.SpatialInformation(target_frame="odom"),
        line_grid=True,
    )


def operator_blueprint() -> rrb.Blueprint:
    """Panorama with boxes, wedges and cue; the world in 3D; belief and values as bars; states; speeds; timing; text."""
    seen = rrb.Vertical(_panorama(), _world(), row_shares=[1, 1])
    decided = rrb.Vertical(
        rrb.StateTimelineView(
            name="States",
            origin="/",
            contents=[
                "+ /state/**",
                "+ /guidance/cue",
                "+ /intent/intention",
                "+ /replayed/guidance/cue",
                "+ /replayed/intent/intention",
                "+ /replayed/state/**",
            ],
        ),
        rrb.Horizontal(
            rrb.BarChartView(name="Belief: wedge 0 to 7", origin="/intent/bars"),
            rrb.BarChartView(name="Q: left, right, confirm", origin="/guidance/bars"),
        ),
        rrb.Tabs(
            _plot("Speeds wanted, applied, measured", "cmd/wanted", "cmd/applied", "base/state"),
            _plot("Loop timing", "loop/timing"),
            _plot("Intent belief", "intent/belief"),
            _plot("Guidance values", "guidance/q"),
            _plot("Where the target is", "guidance/target"),
            _plot("Wedges", "scene/wedges"),
            _plot("Operator's head", "operator/head"),
        ),
        rrb.Tabs(
            rrb.TextLogView(name="Why this speed", origin="/cmd/why", contents="/cmd/why"),
            rrb.TextLogView(name="Log", origin="/log", contents=["+ /log/**", "+ /operator/refused"]),
            active_tab="Log",
        ),
        row_shares=[2, 2, 3, 2],
    )
    return rrb.Blueprint(
        rrb.Horizontal(seen, decided, column_shares=[3, 2]),
        rrb.TimePanel(timeline="t", expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
    )
