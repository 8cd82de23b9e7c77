"""The default layout of a recording, for whoever asks what the robot saw, decided and did."""

from __future__ import annotations

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
    return rrb.TimeSeriesView(name=name, origin="/", contents=[f"+ /{e}" for e in entities], time_ranges=[_recent()])


def operator_blueprint() -> rrb.Blueprint:
    """Panorama with boxes, the world in 3D, decisions, states, speeds, timing and text."""
    seen = rrb.Vertical(
        rrb.Spatial2DView(name="Panorama", origin="/theta/video", contents=["+ /theta/video", "+ /theta/objects"]),
        rrb.Spatial3DView(
            name="World",
            origin="/",
            contents=["+ /lidar/scan", "+ /tf/**", "+ /world/**", "+ /sim/truth"],
            spatial_information=rrb.SpatialInformation(target_frame="odom"),
            line_grid=True,
        ),
        row_shares=[1, 1],
    )
    decided = rrb.Vertical(
        rrb.StateTimelineView(
            name="States",
            origin="/",
            contents=["+ /state/**", "+ /guidance/cue", "+ /intent/intention"],
        ),
        rrb.Tabs(
            _plot("Intent belief", "intent/belief"),
            _plot("Guidance values", "guidance/q"),
            _plot("Wedges", "scene/wedges"),
            _plot("Operator's head", "operator/head"),
        ),
        rrb.Tabs(
            _plot("Speeds wanted, applied, measured", "cmd/wanted", "cmd/applied", "base/state"),
            _plot("Loop timing", "loop/timing"),
        ),
        rrb.TextLogView(name="Log", origin="/log", contents="/log/**"),
        row_shares=[2, 3, 3, 2],
    )
    return rrb.Blueprint(
        rrb.Horizontal(seen, decided, column_shares=[3, 2]),
        rrb.TimePanel(timeline="t", expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
    )
