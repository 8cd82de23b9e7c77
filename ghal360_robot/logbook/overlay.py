"""A second recording over the first: what today's code, or another part, would have decided in the same run.

It bears the first one's id, so that a viewer shows both as one; everything in it is under `replayed/`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import rerun as rr

from ghal360_robot.logbook import entities, rows
from ghal360_robot.logbook.batches import Batches
from ghal360_robot.logbook.blueprint import operator_blueprint
from ghal360_robot.logbook.encoding import chunk, identified
from ghal360_robot.logbook.errors import RecordingNotWritableError
from ghal360_robot.logbook.statics import APPLICATION_ID, SERIES, STATE_COLORS
from ghal360_robot.logbook.table import Row, Table
from ghal360_robot.perception.panorama import UPRIGHT, CameraView

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from ghal360_robot.logbook.clock import Anchor
    from ghal360_robot.logbook.replay import Replayed
    from ghal360_robot.messages import Detections

PREFIX = "replayed"

SHOWN = (
    entities.SCENE_WEDGES,
    entities.GUIDANCE_CUE,
    entities.GUIDANCE_Q,
    entities.GUIDANCE_TARGET,
    entities.INTENT_BELIEF,
    entities.INTENT_INTENTION,
    entities.CMD_WANTED,
    entities.CMD_APPLIED,
    entities.STATE_ARM,
)
"""What a decision consists of; the inputs are in the first recording."""

TICKS_AT_ONCE = 500


class Overlay:
    """Writes the second recording of one run. Raises RecordingNotWritableError."""

    def __init__(self, path: Path, run_id: str, anchor: Anchor, camera: CameraView = UPRIGHT) -> None:
        # Ids of rows begin with an instant of the run's; these must not be those of its rows.
        self._batches = Batches(anchor, first_row=1 << 62)
        self._camera = camera
        self._waiting = 0
        self._stream = rr.RecordingStream(APPLICATION_ID, recording_id=run_id, send_properties=False)
        try:
            self._stream.save(path, default_blueprint=operator_blueprint())  # a file without one takes the layout away
        except (RuntimeError, OSError) as error:
            raise RecordingNotWritableError(f"{path} cannot be written ({error}): choose another place.") from error
        for table in SHOWN:
            names = SERIES.get(table.entity)
            if names is not None:
                lines = rr.SeriesLines(names=[f"{name} (replayed)" for name in names])
                self._stream.log(f"{PREFIX}/{table.entity}", lines, static=True)
        states = rr.StateConfiguration(
            values=list(STATE_COLORS),
            labels=list(STATE_COLORS),
            colors=[list(color) for color in STATE_COLORS.values()],
        )
        for table in (entities.GUIDANCE_CUE, entities.STATE_ARM):
            self._stream.log(f"{PREFIX}/{table.entity}", states, static=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._send()
        self._stream.flush()
        self._stream.disconnect()

    def tick(self, tick: Replayed) -> None:
        made = rows.tick(tick.inputs, tick.decision, tick.applied, 0.0, 0.0)
        self._add(row for row in made if row.table in SHOWN)

    def detections(self, found: Detections) -> None:
        self._add(rows.detections(found, self._camera))

    def _add(self, made: Iterable[Row]) -> None:
        for row in made:
            self._batches.add(Row(_under_prefix(row.table), row.stamp_ns, row.values, row.tick))
        self._waiting += 1
        if self._waiting >= TICKS_AT_ONCE:
            self._send()

    def _send(self) -> None:
        self._waiting = 0
        for _, batch in self._batches.take():
            self._stream.send_chunks(chunk(identified(batch)))


@cache
def _under_prefix(table: Table) -> Table:
    return replace(table, entity=f"{PREFIX}/{table.entity}")
