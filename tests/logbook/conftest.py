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


@pytest.fixture(autouse=True, scope="session")
def patience() -> Iterator[None]:
    """What the robot gives up for the sake of a quick end is written here, however busy the machine is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ghal360_robot.logbook.recorder.CLOSE_TIMEOUT_S", 60.0)
        yield


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    recording = Recorder(tmp_path, properties={"robot": "test"}, config_json='name = "test"\n')
    yield recording
    recording.close()
