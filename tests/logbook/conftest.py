from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import rerun as rr

from ghal360_robot.logbook.recorder import Recorder

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture(autouse=True)
def strict_rerun() -> Iterator[None]:
    """Rerun raises on bad data here; on the robot it would warn and drop."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    recording = Recorder(tmp_path, properties={"robot": "test"}, config_json='name = "test"\n')
    yield recording
    recording.close()
