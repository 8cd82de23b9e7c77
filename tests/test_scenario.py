from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from ghal360_robot.cli.scenario import checked_scenario, detector_of_demo, dressed
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.perception.detectors import store

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(("detector", "painted"), [("painted", True), ("centernet", False), ("none", False)])
def test_the_world_wears_paint_for_the_painted_detector_only(detector: str, painted: bool) -> None:
    config = with_overrides(RobotConfig(), {"perception": {"detector": detector}})
    scenario = checked_scenario(world="office", seed=3, target="tv")
    assert dressed(scenario, config).painted is painted
    assert dressed(scenario, config).target == "television"


def test_the_demo_searches_with_a_real_detector_and_says_why_where_it_cannot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(store.CACHE_VARIABLE, str(tmp_path))
    detector, why_not = detector_of_demo()
    assert detector == "painted"
    assert "ghal360 detectors add centernet" in why_not
    store.save("centernet", "centernet", {"json": ("centernet.json", b"{}")})
    assert detector_of_demo() == ("centernet", "")
