from __future__ import annotations

import pytest

from ghal360_robot.cli.scenario import checked_scenario, dressed
from ghal360_robot.config import RobotConfig, with_overrides


@pytest.mark.parametrize(("detector", "painted"), [("painted", True), ("centernet", False), ("none", False)])
def test_the_world_wears_paint_for_the_painted_detector_only(detector: str, painted: bool) -> None:
    config = with_overrides(RobotConfig(), {"perception": {"detector": detector}})
    scenario = checked_scenario(world="office", seed=3, target="tv")
    assert dressed(scenario, config).painted is painted
    assert dressed(scenario, config).target == "television"
