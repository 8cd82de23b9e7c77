"""The table of recall: read, asked, refused where it was edited by hand."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from ghal360_robot.config import RobotConfig
from ghal360_robot.simulation.recall_table import Row, Share, as_text, config_hash, shipped, table_of, within

ROWS = [
    Row("centernet", "laptop", "all", 0.5, 1.0, 10, 0.9, 1.0, 0.6),
    Row("centernet", "laptop", "all", 1.0, 2.0, 10, 0.5, 0.8, 0.4),
    Row("centernet", "laptop", "home", 1.0, 2.0, 5, 0.4, 0.6, 0.4),
]


def document() -> dict[str, object]:
    config = {"seeds": [0, 5]}
    return {"config": config, "config_hash": config_hash(config), "rows": [asdict(row) for row in ROWS]}


@pytest.mark.parametrize(
    ("distance", "single", "fused"),
    [(0.1, 0.9, 1.0), (1.0, 0.9, 1.0), (1.01, 0.5, 0.8), (2.0, 0.5, 0.8), (2.01, 0.0, 0.0)],
)
def test_recall_is_that_of_the_distance(distance: float, single: float, fused: float) -> None:
    table = table_of(document())
    assert table.recall("centernet", "laptop", distance) == single
    assert table.recall("centernet", "laptop", distance, fused=True) == fused
    assert table.recall("centernet", "laptop", 1.5, world="home") == 0.4


def test_what_was_not_measured_is_not_guessed() -> None:
    with pytest.raises(KeyError, match="'bottle' by 'centernet'"):
        table_of(document()).recall("centernet", "bottle", 1.0)


def test_another_configuration_than_the_measured_one_is_refused() -> None:
    changed = document() | {"config": {"seeds": [0, 6]}}
    with pytest.raises(ValueError, match="write it anew"):
        table_of(changed)


def test_the_configuration_s_hash_does_not_depend_on_its_order() -> None:
    assert config_hash({"a": 1, "b": 2}) == config_hash(json.loads('{"b": 2, "a": 1}'))


def test_the_text_has_a_line_for_each_class_and_distance() -> None:
    lines = as_text(ROWS).splitlines()
    assert len(lines) == 1 + len(ROWS)
    assert "0.50     0.80" in lines[2]


def test_views_within_a_distance_are_counted_over_both_worlds() -> None:
    assert within(ROWS, "centernet", "laptop", 1.5) == Share(10, 10)
    assert within(ROWS, "centernet", "laptop", 2.0) == Share(18, 20)
    low, high = Share(18, 20).interval()
    assert (low, high) == (pytest.approx(0.699, abs=0.001), pytest.approx(0.972, abs=0.001))
    assert Share(0, 0).interval() == (0.0, 1.0)


@pytest.mark.parametrize(
    ("detector", "name", "limit_m", "least"),
    [
        ("centernet", "television", 4.0, 0.8),
        ("centernet", "laptop", 2.5, 0.8),
        ("centernet", "bottle", 1.5, 0.6),
        ("centernet", "backpack", 2.0, 0.6),
    ],
)
def test_the_shipped_table_says_that_real_detectors_find_the_simulated_things(
    detector: str, name: str, limit_m: float, least: float
) -> None:
    found = within(shipped().rows, detector, name, limit_m)
    assert found.of >= 20
    assert found.share >= least


def test_in_the_shipped_table_what_is_far_is_found_no_oftener_than_what_is_near() -> None:
    """But for chance: by more than three standard errors of either distance."""
    rows = [row for row in shipped().rows if row.world == "all"]
    for row in rows:
        for other in rows:
            if (row.detector, row.name) == (other.detector, other.name) and row.far_m <= other.near_m:
                spread = 3 * (0.25 / min(row.views, other.views)) ** 0.5
                assert other.fused <= row.fused + spread, (row, other)


def test_the_shipped_table_is_of_the_settings_that_are_the_default() -> None:
    perception = shipped().config["perception"]
    default = RobotConfig().perception.model_dump(mode="json", include=set(perception))
    assert perception == default
