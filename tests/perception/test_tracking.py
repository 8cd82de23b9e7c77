"""From sightings to objects: evidence, hysteresis, places, and what is remembered behind something."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.angles import wrap
from ghal360_robot.messages import Detection, Detections, Pose2, Surroundings
from ghal360_robot.perception.place import Place
from ghal360_robot.perception.sphere import angular_distance
from ghal360_robot.perception.tracking import (
    Remembered,
    Standpoint,
    TrackSettings,
    apart,
    camera_at,
    current,
    height_m,
    step_objects,
)

SETTINGS = TrackSettings()
S = 1_000_000_000
HERE = Pose2()


def picture(t_s: float, *objects: tuple[str, float, float]) -> Detections:
    """Detections of (name, yaw in radians, score)."""
    found = tuple(Detection(name, score, yaw, 0.0, 0.1, 0.1) for name, yaw, score in objects)
    return Detections(round(t_s * S), 0, "test", found)


def scan(points: list[tuple[float, float]], pose: Pose2 = HERE) -> Standpoint:
    """A standpoint whose scan met these points of the odometry frame."""
    table = np.array(points, np.float64).reshape(-1, 2) - (pose.x, pose.y)
    c, s = cos(-pose.yaw), sin(-pose.yaw)
    table = np.column_stack((c * table[:, 0] - s * table[:, 1], s * table[:, 0] + c * table[:, 1]))
    empty = np.zeros(0, np.float32)
    around = Surroundings(0, table, np.arange(len(table)), np.zeros(0), empty, empty)
    return Standpoint(pose, around, pose)


def watch(*pictures: Detections, standpoint: Standpoint | None = None) -> tuple[Remembered, ...]:
    objects: tuple[Remembered, ...] = ()
    for each in pictures:
        objects = step_objects(SETTINGS, objects, each, standpoint or Standpoint(Pose2()))
        objects = current(SETTINGS, objects, each.stamp_ns)
    return objects


def test_one_strong_sighting_or_a_few_weak_ones_make_an_object_believed() -> None:
    assert [item.believed for item in watch(picture(0, ("tv", 0, 0.55)))] == [True]
    weak = [picture(t / 4, ("tv", 0, 0.2)) for t in range(4)]
    assert [watch(*weak[:n])[0].believed for n in (1, 2, 3, 4)] == [False, False, True, True]


def test_weak_sightings_far_apart_in_time_never_add_up() -> None:
    assert not watch(*(picture(3.0 * t, ("tv", 0, 0.3)) for t in range(20)))[0].believed


def test_a_class_often_seen_where_there_is_none_can_be_asked_for_more() -> None:
    strict = TrackSettings(confirm_class={"television": 1.2})
    objects: tuple[Remembered, ...] = ()
    believed = []
    for t in range(3):
        found = picture(t / 4, ("tv", 0, 0.6))
        objects = current(strict, step_objects(strict, objects, found, Standpoint(Pose2())), found.stamp_ns)
        believed.append(objects[0].believed)
    assert believed == [False, False, True]


def test_what_is_believed_stays_so_below_the_evidence_that_began_it() -> None:
    settings = TrackSettings(memory_s=60.0)
    objects = step_objects(settings, (), picture(0, ("tv", 0, 0.6)), Standpoint(Pose2()))
    objects = current(settings, objects, 0)
    after = [current(settings, objects, round(t * S))[0].believed for t in (0.5, 1.0, 1.7)]
    assert after == [True, True, True]
    assert not current(settings, objects, round(1.8 * S))[0].believed


def test_evidence_is_bounded_so_that_hours_are_forgotten_like_seconds() -> None:
    objects = watch(*(picture(t / 10, ("tv", 0, 0.9)) for t in range(500)))
    assert objects[0].evidence == pytest.approx(2.0)
    assert objects[0].sightings == 500
    assert not any(item.believed for item in current(SETTINGS, objects, round(52 * S)))


def test_synonyms_are_one_class_and_two_boxes_on_one_thing_one_object() -> None:
    (item,) = watch(picture(0, ("tv", 0, 0.4), ("monitor", 0.1, 0.9)), picture(0.25, ("television", 0.05, 0.5)))
    assert (item.name, item.sightings) == ("television", 2)
    assert len(watch(picture(0, ("tv", 0, 0.9), ("tv", 1.0, 0.9), ("cup", 0, 0.9)))) == 3


def test_two_places_tell_where_an_object_stands() -> None:
    target = (3.0, 1.0)
    objects: tuple[Remembered, ...] = ()
    for step in range(30):
        pose = Pose2(0.0, -step * 0.08, 0.3)
        yaw = wrap(atan2(target[1] - pose.y, target[0] - pose.x) - pose.yaw)
        found = picture(step / 4, ("tv", yaw, 0.9))
        objects = step_objects(SETTINGS, objects, found, Standpoint(pose))
    (item,) = objects
    position = item.position()
    assert position is not None
    assert hypot(position[0] - target[0], position[1] - target[1]) < 0.05


def test_from_one_place_the_lidar_tells_how_far_it_is() -> None:
    (item,) = watch(*(picture(t / 4, ("tv", 0.5, 0.9)) for t in range(3)))
    assert item.position() is None
    wall = [(2.5 * cos(a), 2.5 * sin(a)) for a in np.linspace(0.4, 0.6, 40)]
    (item,) = watch(*(picture(t / 4, ("tv", 0.5, 0.9)) for t in range(3)), standpoint=scan(wall))
    assert item.position() == pytest.approx((2.5 * cos(0.5), 2.5 * sin(0.5)), abs=0.05)
    assert height_m(item, (0.0, 0.0, 1.2)) == pytest.approx(1.2)


def hidden_case(occluder_m: float | None, wait_s: float) -> bool:
    """Whether a tv at 3 m is believed so long after something came to stand in front of it."""
    wall = [(3.0 * cos(a), 3.0 * sin(a)) for a in np.linspace(-0.2, 0.2, 40)]
    objects = watch(*(picture(t / 4, ("tv", 0.0, 0.9)) for t in range(4)), standpoint=scan(wall))
    in_front = [(occluder_m, 0.0)] if occluder_m else []
    for t in np.arange(1.0, 1.0 + wait_s, 0.25):
        objects = step_objects(SETTINGS, objects, picture(float(t)), scan(wall + in_front))
        objects = current(SETTINGS, objects, round(t * S))
    return any(item.believed for item in objects)


def test_an_object_behind_something_is_remembered_and_one_in_plain_view_forgotten() -> None:
    assert hidden_case(1.5, 3.0)
    assert hidden_case(1.5, 15.0)
    assert not hidden_case(1.5, 25.0)
    assert not hidden_case(None, 3.0)
    assert not hidden_case(2.9, 3.0), "what stands beside it hides nothing"


def test_driving_past_moves_the_direction_of_an_object_whose_place_is_known() -> None:
    wall = [(0.1 * n, 2.0) for n in range(-10, 11)]
    (item,) = watch(*(picture(t / 4, ("tv", pi / 2, 0.9)) for t in range(4)), standpoint=scan(wall))
    assert item.yaw_from((0.0, 0.0)) == pytest.approx(pi / 2, abs=1e-6)
    assert item.yaw_from((2.0, 0.0)) == pytest.approx(radians(135), abs=0.05)


@given(st.floats(-pi, pi), st.floats(-1.5, 1.5), st.floats(-pi, pi), st.floats(-1.5, 1.5))
def test_the_quick_angle_is_the_exact_one(a: float, b: float, c: float, d: float) -> None:
    assert apart(a, b, c, d) == pytest.approx(float(angular_distance(a, b, c, d)), abs=1e-7)


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(-pi, pi), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_the_camera_s_place_turns_with_the_robot(x: float, y: float, yaw: float, mx: float, my: float) -> None:
    place = complex(x, y) + complex(mx, my) * complex(cos(yaw), sin(yaw))
    assert camera_at(Pose2(x, y, yaw), (mx, my, 1.0)) == pytest.approx((place.real, place.imag))


def test_place_is_the_weighted_least_squares_fit() -> None:
    rng = np.random.default_rng(0)
    target, cameras = np.array((2.0, 3.0)), rng.uniform(-1, 1, (40, 2))
    place = Place()
    for camera in cameras:
        yaw = atan2(*(target - camera)[::-1]) + float(rng.normal(0, 0.02))
        place = place.seen((float(camera[0]), float(camera[1])), yaw)
    position = place.position()
    assert position is not None
    assert np.hypot(*(np.array(position) - target)) < 3 * place.sigma_m() < 1.0


def test_sightings_along_one_line_tell_nothing_about_the_distance() -> None:
    place = Place()
    for x in range(50):
        place = place.seen((-float(x) / 10, 0.0), 0.0)
    assert place.position() is None


@given(
    st.lists(
        st.tuples(st.sampled_from(("tv", "cup")), st.floats(-pi, pi), st.floats(0, 1), st.floats(-1.5, 1.5)),
        max_size=40,
    ),
    st.integers(0, 50),
)
def test_anything_goes_in_and_what_comes_out_is_finite_and_bounded(
    rows: list[tuple[str, float, float, float]], seconds: int
) -> None:
    objects: tuple[Remembered, ...] = ()
    for n in range(3):
        found = tuple(Detection(name, score, yaw, pitch, 0.1, 0.1) for name, yaw, score, pitch in rows)
        standpoint = scan([(1.0, 0.5 * n), (0.0, 0.0)], Pose2(0.1 * n, 0.0, 0.2))
        objects = step_objects(SETTINGS, objects, Detections(n * S, n, "test", found), standpoint)
        objects = current(SETTINGS, objects, (n + seconds) * S)
    assert len(objects) <= 256
    for item in objects:
        assert np.isfinite((item.world_yaw, item.evidence, *(item.position() or (0.0, 0.0)))).all()
