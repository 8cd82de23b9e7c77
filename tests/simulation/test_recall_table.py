"""The table of recall: read, asked, refused where it was edited by hand."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from ghal360_robot.simulation.recall_table import Row, as_text, config_hash, table_of

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
