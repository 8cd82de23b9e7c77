"""The eight wedges around the robot, and the short memory behind them."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, pi, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.egocentric import BOTH, CLUTTER, TARGET, wedge_of
from ghal360_robot.messages import Detection, Detections, Pose2, Surroundings
from ghal360_robot.perception.bearing_out import AskSettings
from ghal360_robot.perception.sphere import angular_distance
from ghal360_robot.perception.tracking import Remembered, Standpoint, TrackSettings
from ghal360_robot.perception.wedges import Scene, SceneState, reports, scene, step_scene

SETTINGS = TrackSettings()
MS = 1_000_000


def seen(stamp_ms: int, *objects: tuple[str, float, float]) -> Detections:
    """Detections of (name, yaw in degrees, score)."""
    found = tuple(Detection(name, score, radians(yaw), 0.0, 0.1, 0.1) for name, yaw, score in objects)
    return Detections(stamp_ms * MS, 0, "test", found)


def step(state: SceneState, detections: Detections | None, base_yaw: float, now_ns: int) -> SceneState:
    return step_scene(SETTINGS, state, detections, Standpoint(Pose2(yaw=base_yaw)), now_ns)


def look(*objects: tuple[str, float, float], base_yaw: float = 0.0) -> SceneState:
    return step(SceneState(), seen(0, *objects), base_yaw, 0)


def view_of(state: SceneState, target: str, base_yaw: float) -> Scene:
    return scene(SETTINGS, state, target, Pose2(yaw=base_yaw))


def test_wedges_are_clockwise_from_the_odometry_s_x() -> None:
    state = look(("bin", 0, 0.9), ("vase", 90, 0.9), ("vase", -45, 0.9))
    view = view_of(state, "bin", 0.0)
    assert view.allocentric == (TARGET, CLUTTER, 0, 0, 0, 0, CLUTTER, 0)
    assert view.target_yaw == pytest.approx(0.0)


def test_egocentric_wedges_start_at_the_gaze_and_run_to_its_right() -> None:
    state = look(("bin", 90, 0.9), ("vase", 45, 0.9))
    view = view_of(state, "bin", 0.0)
    assert view.egocentric(radians(90)) == (TARGET, CLUTTER, 0, 0, 0, 0, 0, 0)
    assert view.egocentric(0.0) == (0, 0, 0, 0, 0, 0, TARGET, CLUTTER)


def test_a_target_among_clutter_is_both() -> None:
    assert view_of(look(("bin", 3, 0.9), ("vase", -3, 0.9)), "bin", 0.0).allocentric[0] == BOTH


def test_there_is_one_target_wedge_that_of_the_best_box() -> None:
    view = view_of(look(("bin", 0, 0.6), ("bin", 180, 0.95), ("bin", 90, 0.7)), "bin", 0.0)
    assert view.allocentric == (0, 0, 0, 0, TARGET, 0, 0, 0)
    assert view.target_score == 0.95


def test_weak_detections_are_not_there() -> None:
    view = view_of(look(("bin", 0, 0.49), ("vase", 90, 0.2)), "bin", 0.0)
    assert view.allocentric == (0,) * 8
    assert view.target_yaw is None


def test_turning_the_base_moves_the_target_in_the_base_frame_and_not_in_the_world() -> None:
    state = look(("bin", 30, 0.9), base_yaw=radians(60))
    before = view_of(state, "bin", radians(60))
    after = view_of(state, "bin", radians(100))
    assert before.allocentric == after.allocentric
    assert before.target_yaw == pytest.approx(radians(30))
    assert after.target_yaw == pytest.approx(radians(-10))


def test_an_object_seen_while_turning_does_not_smear() -> None:
    state = SceneState()
    for i in range(8):
        base_yaw = radians(12 * i)
        state = step(state, seen(100 * i, ("bin", 20 - 12 * i, 0.9)), base_yaw, 100 * i * MS)
    assert len(state.objects) == 1
    assert view_of(state, "bin", 0.0).target_yaw == pytest.approx(radians(20))


def test_an_object_missed_for_a_moment_is_still_there_and_after_a_second_gone() -> None:
    state = look(("bin", 0, 0.9))
    state = step(state, seen(500), 0.0, 500 * MS)
    assert view_of(state, "bin", 0.0).target_yaw is not None
    state = step(state, None, 0.0, 1000 * MS)
    assert view_of(state, "bin", 0.0).target_yaw is not None
    state = step(state, None, 0.0, 1001 * MS)
    assert view_of(state, "bin", 0.0).target_yaw is None


def test_a_new_sighting_replaces_the_old_one_of_the_same_object() -> None:
    state = look(("bin", 0, 0.9), ("vase", 4, 0.9))
    state = step(state, seen(250, ("bin", 10, 0.6)), 0.0, 250 * MS)
    assert [(item.name, item.score) for item in state.objects] == [("bin", 0.6), ("vase", 0.9)]


def test_the_last_sighting_of_a_target_wins_over_a_better_but_older_one() -> None:
    state = look(("bin", 180, 0.95))
    state = step(state, seen(250, ("bin", 90, 0.6)), 0.0, 250 * MS)
    assert view_of(state, "bin", 0.0).target_yaw == pytest.approx(pi / 2)


def test_the_same_or_older_detections_are_taken_in_only_once() -> None:
    state = look(("bin", 0, 0.9))
    again = step(state, seen(0, ("bin", 0, 0.9)), radians(90), 10 * MS)
    assert [(item.world_yaw, item.sightings) for item in again.objects] == [(0.0, 1)]
    assert again.objects[0].evidence < state.objects[0].evidence


@given(
    st.lists(st.tuples(st.sampled_from(("bin", "vase", "plant")), st.floats(-180, 180), st.floats(0, 1)), max_size=30),
    st.floats(-10, 10),
    st.floats(-10, 10),
)
def test_any_detections_give_eight_values_and_at_most_one_target(
    objects: list[tuple[str, float, float]], base_yaw: float, later_yaw: float
) -> None:
    view = view_of(look(*objects, base_yaw=base_yaw), "bin", later_yaw)
    assert len(view.allocentric) == 8
    assert all(0 <= value <= BOTH for value in view.allocentric)
    targets = [wedge for wedge, value in enumerate(view.allocentric) if value & TARGET]
    assert (
        len(targets)
        == (view.target_yaw is not None)
        == any(name == "bin" and score >= 0.5 for name, _, score in objects)
    )
    if view.target_yaw is not None:
        world = wrap(view.target_yaw + later_yaw)
        # A centre within rounding of a border may fall either way.
        assert any(wedge_of(-(world + nudge)) == targets[0] for nudge in (-1e-6, 0, 1e-6))


@given(st.floats(-180, 180), st.floats(-20, 20))
def test_the_target_s_direction_survives_any_base_yaw(yaw_deg: float, base_yaw: float) -> None:
    view = view_of(look(("bin", yaw_deg, 0.9), base_yaw=base_yaw), "bin", base_yaw)
    assert view.target_yaw is not None
    assert angular_distance(view.target_yaw, 0, radians(yaw_deg), 0) < 1e-6


def test_a_flood_of_detections_is_bounded() -> None:
    flood = [("vase", i % 360 - 180, 0.5 + i / 10_000) for i in range(5000)]
    assert len(look(*flood).objects) <= 256


@pytest.mark.parametrize("border", range(8))
@pytest.mark.parametrize("aside_deg", [-1e-3, 0.0, 1e-3])
@pytest.mark.parametrize("gaze_wedge", range(8))
def test_at_every_border_an_object_is_in_exactly_one_wedge_and_a_border_belongs_to_its_right(
    border: int, aside_deg: float, gaze_wedge: int
) -> None:
    bearing_deg = 45 * border + 22.5 + aside_deg  # clockwise; the border between wedges `border` and `border` + 1
    view = view_of(look(("bin", -bearing_deg, 0.9), ("vase", -bearing_deg, 0.9)), "bin", 0.0)
    expected = (border + (aside_deg >= 0)) % 8
    assert [wedge for wedge, value in enumerate(view.allocentric) if value] == [expected]
    assert view.allocentric[expected] == BOTH
    seen_from_gaze = view.egocentric(radians(-45 * gaze_wedge))
    assert seen_from_gaze[(expected - gaze_wedge) % 8] == BOTH
    assert sum(seen_from_gaze) == BOTH


@pytest.mark.parametrize("border", range(8))
@pytest.mark.parametrize(("aside_deg", "right"), [(-1e-3, 0), (0.0, 1), (1e-3, 1)])
def test_a_gaze_on_a_border_rests_on_the_wedge_to_its_right(border: int, aside_deg: float, right: int) -> None:
    gaze_deg = 45 * border + 22.5 + aside_deg
    view = view_of(look(("bin", -45.0 * (border + right), 0.9)), "bin", 0.0)
    assert view.egocentric(-radians(gaze_deg))[0] == TARGET


@given(st.lists(st.tuples(st.sampled_from(("bin", "vase")), st.floats(-720, 720)), max_size=20), st.floats(-50, 50))
def test_the_state_is_total_and_turns_with_the_gaze(objects: list[tuple[str, float]], gaze: float) -> None:
    view = view_of(look(*((name, yaw, 0.9) for name, yaw in objects)), "bin", 0.0)
    values = view.egocentric(gaze)
    assert sorted(values) == sorted(view.allocentric)
    assert all(value in (0, CLUTTER, TARGET, BOTH) for value in values)


LEFTWARD = Pose2(0.0, 0.0, pi / 2)


def asking(score: float, **sizes: tuple[float, float]) -> TrackSettings:
    return TrackSettings(asking=AskSettings(score=score, sizes=sizes))


def test_a_picture_reports_the_target_and_says_nothing_of_a_hidden_one() -> None:
    state = look(("bin", 0, 0.6), ("bin", 5, 0.5), ("vase", 90, 0.9), base_yaw=pi / 2)
    assert reports(SETTINGS, state, "bin", LEFTWARD) == (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    hidden = Remembered("bin", 0.9, -pi / 2, 0.0, -1, evidence=1.0, believed=True, hidden=True)
    behind = reports(SETTINGS, replace(state, objects=(*state.objects, hidden)), "bin", LEFTWARD)
    assert isnan(behind[2])
    assert behind[6] == 1.0


def test_a_report_too_weak_to_be_asked_about_says_nothing_and_spoils_no_strong_one() -> None:
    def report(*objects: tuple[str, float, float]) -> tuple[float, ...]:
        state = step_scene(asking(0.25), SceneState(), seen(0, *objects), Standpoint(LEFTWARD), 0)
        return reports(asking(0.25), state, "bin", LEFTWARD)

    weak = report(("bin", 0, 0.2))
    assert isnan(weak[6])
    assert sum(value == 0.0 for value in weak) == 7
    assert report(("bin", -9, 0.2), ("bin", 9, 0.3))[6] == 1.0
    assert report(("bin", -9, 0.3), ("bin", 9, 0.2))[6] == 1.0


def test_a_thing_is_measured_by_what_the_lidar_meets_and_waits_where_it_meets_nothing() -> None:
    """A thing of 0.1 rad is 0.15 m wide at 1.5 m, 0.3 m at 3 m."""
    settings, ahead = asking(0.25, bin=(0.25, 0.45)), np.linspace(-0.1, 0.1, 21)
    picture = seen(0, ("bin", 0, 0.3))

    def report(range_m: float, yaw: float = 0.0) -> float:
        points = range_m * np.column_stack((np.cos(ahead + yaw), np.sin(ahead + yaw)))
        nothing = np.empty(0, np.float32)
        scan = Surroundings(0, points, np.arange(len(points)), np.empty(0), nothing, nothing)
        state = step_scene(settings, SceneState(), picture, Standpoint(Pose2(), scan, Pose2()), 0)
        return reports(settings, state, "bin", Pose2())[0]

    assert report(3.0) == 1.0
    assert isnan(report(1.5))
    assert isnan(report(3.0, yaw=pi))
    state = step_scene(settings, SceneState(), picture, Standpoint(Pose2()), 0)
    assert reports(settings, state, "bin", Pose2())[0] == 1.0  # a robot without a lidar


def test_of_two_in_a_picture_the_one_seen_well_is_the_target_and_tells_when() -> None:
    settings = TrackSettings(asking=AskSettings(sizes={"bin": (0.05, 0.2)}))
    found = seen(0, ("bin", 90, 0.8), ("bin", -90, 0.9))
    large = replace(found.objects[1], width=0.5)
    around = np.column_stack((np.zeros(2), np.array([1.0, -1.0])))
    nothing = np.empty(0, np.float32)
    scan = Surroundings(0, around, np.arange(2), np.empty(0), nothing, nothing)
    standpoint = Standpoint(Pose2(), scan, Pose2())
    both = step_scene(
        settings, SceneState(), replace(found, objects=(found.objects[0], replace(large, pitch=-0.8))), standpoint, 0
    )
    view = scene(settings, both, "bin", Pose2())
    assert view.target_yaw == pytest.approx(pi / 2)
    assert view.well_seen_ns == 0
    later = step_scene(settings, both, seen(500, ("bin", 90, 0.3)), standpoint, 500 * MS)
    assert scene(settings, later, "bin", Pose2()).well_seen_ns == 0


def test_what_the_operator_refused_is_clutter_and_not_reported() -> None:
    state = look(("bin", 90, 0.9), ("bin", 0, 0.8))

    def refused(yaw: float, _camera: object, _place: object) -> bool:
        return abs(yaw - pi / 2) < 0.1

    view = scene(SETTINGS, state, "bin", Pose2(), refused)
    assert view.allocentric == (TARGET, 0, 0, 0, 0, 0, CLUTTER, 0)
    assert view.target_yaw == pytest.approx(0.0)
    assert reports(SETTINGS, state, "bin", Pose2(), refused) == (1.0, *(0.0,) * 7)


def test_synonyms_name_one_target() -> None:
    state = look(("tv", 90, 0.9), ("cup", 0, 0.9))
    views = [view_of(state, name, 0.0) for name in ("tv", "television", "monitor", "TV")]
    assert [view.target_yaw for view in views] == [pytest.approx(pi / 2)] * 4
    assert view_of(state, "laptop", 0.0).target_yaw is None
