"""Which sightings may lead to a question."""

from __future__ import annotations

from math import atan, pi

import pytest

from ghal360_robot.messages import Detection
from ghal360_robot.perception.bearing_out import AskSettings

SETTINGS = AskSettings(score=0.45, score_class={"backpack": 0.23}, sizes={"backpack": (0.25, 0.8)})


def on_floor(size_m: float, distance_m: float, score: float = 0.4) -> Detection:
    """A box as wide as high of a thing that stands on the floor, seen from 1.2 m above it."""
    foot, top = -atan(1.2 / distance_m), -atan((1.2 - size_m) / distance_m)
    return Detection("backpack", score, 0.0, (foot + top) / 2, 2 * atan(size_m / 2 / distance_m), top - foot)


@pytest.mark.parametrize(
    ("name", "score", "bears_out"),
    [("bin", 0.45, True), ("bin", 0.44, False), ("backpack", 0.23, True), ("backpack", 0.22, False)],
)
def test_a_strong_sighting_is_one_of_its_class_s_own_score(name: str, score: float, bears_out: bool) -> None:
    assert SETTINGS.bears_out(name, Detection(name, score, 0.0, 0.0, 0.1, 0.1), None) is bears_out


@pytest.mark.parametrize("distance_m", [0.8, 1.5, 3.0, 5.0])
def test_an_armchair_is_no_backpack_and_a_purse_is_none_either(distance_m: float) -> None:
    """The lidar meets things on the floor within a hand's breadth of the box's own foot."""
    for off_m in (-0.1, 0.0, 0.1):
        sizes = [
            m for m in (0.1, 0.5, 1.1) if SETTINGS.bears_out("backpack", on_floor(m, distance_m), distance_m + off_m)
        ]
        assert sizes == [0.5]


def test_a_backpack_on_a_table_is_not_taken_for_one_as_large_as_far_as_the_wall_behind_the_table() -> None:
    """Except where its foot, so far away, would be on the floor: then it has to be seen from elsewhere."""
    high = Detection("backpack", 0.4, 0.0, -0.1, 0.45, 0.45)
    assert [SETTINGS.bears_out("backpack", high, range_m) for range_m in (1.0, 2.0, 3.0, 5.0)] == [
        True,
        True,
        False,
        True,
    ]


def test_without_a_range_or_a_known_size_the_score_decides() -> None:
    assert SETTINGS.bears_out("backpack", on_floor(1.1, 2.0), None)
    assert SETTINGS.bears_out("bin", Detection("bin", 0.5, 0.0, -0.5, 1.0, 1.0), 2.0)


def test_what_a_lidar_could_measure_and_did_not_has_to_wait() -> None:
    found = on_floor(0.5, 2.0)
    assert SETTINGS.bears_out("backpack", found, None)
    assert not SETTINGS.bears_out("backpack", found, None, measurable=True)
    assert SETTINGS.bears_out("bin", Detection("bin", 0.5, 0.0, -0.5, 0.2, 0.2), None, measurable=True)


def test_a_box_around_half_of_the_robot_has_no_size_and_bears_nothing_out() -> None:
    for angle in (0.9 * pi, 2 * pi):
        assert not SETTINGS.bears_out("backpack", Detection("backpack", 0.9, 0.0, -1.5, angle, 3.0), 0.5)
