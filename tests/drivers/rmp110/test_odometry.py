"""Wheel positions to pose: exact on arcs, deaf to jumps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.device.odometry import SPEEDS_TELL_S, Noise, Odometry, ulp32

TRACK = 0.481224


@given(st.floats(-2, 2), st.floats(-0.5, 0.5), st.integers(1, 40))
def test_a_circle_ends_where_geometry_says_however_it_is_cut(turn: float, distance: float, pieces: int) -> None:
    odometry = Odometry().advance(3.0, 4.0, 0.0, TRACK)
    for k in range(1, pieces + 1):
        part = k / pieces
        right, left = (distance + turn * TRACK / 2) * part, (distance - turn * TRACK / 2) * part
        odometry = odometry.advance(3.0 + right, 4.0 + left, part, TRACK)
    if abs(turn) > 1e-3:
        radius = distance / turn
        x, y = radius * math.sin(turn), radius * (1 - math.cos(turn))
    else:
        x, y = distance, distance * turn / 2
    assert (odometry.x, odometry.y, odometry.yaw) == pytest.approx((x, y, turn), abs=1e-6)
    assert odometry.jumps == 0


def test_the_first_reading_is_the_origin() -> None:
    odometry = Odometry().advance(12.0, 13.0, 100.0, TRACK)
    assert (odometry.x, odometry.y, odometry.yaw) == (0, 0, 0)


@pytest.mark.parametrize(("right", "left", "time_s"), [(0.0, 0.0, 10.02), (12.0, 13.0, 0.5), (50.0, 13.0, 10.02)])
def test_reset_integrators_and_a_restart_are_not_motion(right: float, left: float, time_s: float) -> None:
    odometry = Odometry().advance(12.0, 13.0, 10.0, TRACK).advance(12.1, 13.1, 10.1, TRACK)
    after = odometry.advance(right, left, time_s, TRACK)
    assert (after.x, after.y, after.yaw, after.jumps) == (odometry.x, odometry.y, odometry.yaw, 1)
    on = after.advance(right + 0.1, left + 0.1, time_s + 0.1, TRACK)
    assert on.x == pytest.approx(odometry.x + 0.1)


def test_a_small_reset_is_noticed_by_the_speeds_and_bridged_by_them() -> None:
    odometry = Odometry().advance(0.30, 0.30, 10.0, TRACK, speeds_mps=(0.4, 0.4))
    after = odometry.advance(0.0, 0.0, 10.02, TRACK, speeds_mps=(0.4, 0.4))
    assert after.jumps == 1
    assert (after.x, after.yaw) == pytest.approx((0.008, 0.0))
    without = odometry.advance(0.0, 0.0, 10.02, TRACK)
    assert without.x == pytest.approx(-0.3), "positions alone do not tell it from motion"


@given(st.floats(-8, 8), st.floats(-8, 8), st.floats(0.01, SPEEDS_TELL_S), st.floats(-10, 10), st.floats(0, 0.04))
def test_motion_at_any_limit_is_no_jump(right: float, left: float, dt: float, accel: float, skew: float) -> None:
    """Whatever the wheels do within the firmware's limits, with positions sampled a little later than the time."""
    after = (right + accel * dt, left + accel * dt)
    moved = [(one + two) / 2 * dt + two * skew for one, two in zip((right, left), after, strict=True)]
    odometry = Odometry().advance(5.0, 5.0, 100.0, TRACK, speeds_mps=(right, left))
    odometry = odometry.advance(5.0 + moved[0], 5.0 + moved[1], 100.0 + dt, TRACK, speeds_mps=after)
    assert odometry.jumps == 0


def test_a_restart_is_noticed_even_where_the_base_s_time_has_overtaken_the_old_one() -> None:
    odometry = Odometry().advance(13.0, 12.9, 10.0, TRACK, stamp_ns=0)
    after = odometry.advance(12.75, 12.5, 14.0, TRACK, stamp_ns=20_000_000_000)
    assert (after.x, after.y, after.yaw, after.jumps) == (0.0, 0.0, 0.0, 1)
    assert after.covariance()[0] >= 1.0, "somebody may have pushed it"


def test_a_link_that_was_away_loses_no_motion() -> None:
    odometry = Odometry().advance(13.0, 13.0, 10.0, TRACK, stamp_ns=0, speeds_mps=(0.5, 0.5))
    after = odometry.advance(14.0, 14.0, 14.0, TRACK, stamp_ns=4_030_000_000, speeds_mps=(0.0, 0.0))
    assert (after.x, after.jumps) == (1.0, 0)


QUIET = Noise(random_m=0.0, diameter=0.0, unequal=0.0, track=0.0)


@pytest.mark.parametrize(
    ("noise", "scale"),
    [
        (Noise(random_m=0.0, diameter=0.01, unequal=0.0, track=0.0), lambda e: (1 + e, 1 + e, 1.0)),
        (Noise(random_m=0.0, diameter=0.0, unequal=0.01, track=0.0), lambda e: (1 + e / 2, 1 - e / 2, 1.0)),
        (Noise(random_m=0.0, diameter=0.0, unequal=0.0, track=0.01), lambda e: (1.0, 1.0, 1 + e)),
    ],
    ids=["diameter", "unequal", "track"],
)
def test_a_systematic_error_is_what_a_wrong_wheel_really_does(noise: Noise, scale: object) -> None:
    true, wrong = path(), path(*scale(1e-5))  # type: ignore[operator]
    error = np.array([wrong.x - true.x, wrong.y - true.y, wrong.yaw - true.yaw]) / 1e-5
    expected = matrix(np.outer(error, error)[np.triu_indices(3)]) * 0.01**2
    assert matrix(true.covariance(noise)) == pytest.approx(expected, rel=0.01, abs=1e-7)


def test_random_errors_are_what_many_noisy_drives_scatter_by() -> None:
    noise, rng = Noise(random_m=0.02, diameter=0.0, unequal=0.0, track=0.0), np.random.default_rng(5)
    ends = np.array([(o.x, o.y, o.yaw) for o in (path(rng=rng, sigma=0.02) for _ in range(600))])
    claimed = matrix(path(noise=noise).covariance(noise))
    assert np.sqrt(np.diag(claimed)) == pytest.approx(ends.std(axis=0), rel=0.12)
    assert np.linalg.eigvalsh(claimed).min() > 0


def test_there_and_back_undoes_a_wrong_diameter_but_not_chance() -> None:
    there = Odometry().advance(0.0, 0.0, 0.0, TRACK)
    for k in range(1, 101):
        there = there.advance(0.05 * k, 0.05 * k, k / 10, TRACK)
    back = there
    for k in range(1, 101):
        back = back.advance(5.0 - 0.05 * k, 5.0 - 0.05 * k, 10 + k / 10, TRACK)
    diameter = Noise(random_m=0.0, unequal=0.0, track=0.0)
    assert there.covariance(diameter)[0] - there.random[0] == pytest.approx((5 * diameter.diameter) ** 2)
    assert back.covariance(diameter)[0] - back.random[0] == pytest.approx(0.0, abs=1e-12)
    assert back.random[0] == pytest.approx(2 * there.random[0])


def test_standing_still_adds_nothing() -> None:
    odometry = path()
    later = odometry.advance(odometry.right_m or 0, odometry.left_m or 0, odometry.time_s + 600, TRACK)
    assert later.covariance() == odometry.covariance()


@given(st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)), max_size=60))
def test_a_covariance_is_one_after_any_drive(steps: list[tuple[float, float]]) -> None:
    right = left = 0.0
    odometry = Odometry().advance(right, left, 0.0, TRACK)
    for k, (a, b) in enumerate(steps, start=1):
        right, left = right + a, left + b
        odometry = odometry.advance(right, left, k / 10, TRACK)
    assert np.linalg.eigvalsh(matrix(odometry.covariance())).min() >= -1e-9


@pytest.mark.parametrize("metres", [0.0, 1.0, 12.75, 1000.0, 8192.0, 70_000.0, -70_000.0])
def test_the_resolution_of_far_positions_is_float32_s(metres: float) -> None:
    assert ulp32(metres) == (float(np.spacing(np.float32(abs(metres)))) if metres else 0.0)
    assert Odometry().advance(metres, 0.0, 0.0, TRACK).resolution_m == ulp32(metres)


def test_float32_positions_far_out_do_not_drift() -> None:
    """Heading and path come from differences of rounded positions: the rounding does not add up."""
    near, far = path(), path(offset=60_000.0, float32=True)
    assert far.yaw == pytest.approx(near.yaw, abs=2 * ulp32(60_000.0) / TRACK)
    assert (far.x, far.y) == pytest.approx((near.x, near.y), abs=0.02)


def path(
    right_scale: float = 1.0,
    left_scale: float = 1.0,
    track_scale: float = 1.0,
    *,
    rng: np.random.Generator | None = None,
    sigma: float = 0.0,
    offset: float = 0.0,
    float32: bool = False,
    noise: Noise = QUIET,
) -> Odometry:
    """A drive of eight metres with bends both ways, as wheels with these errors report it."""
    right = left = offset
    odometry = Odometry().advance(right, left, 0.0, TRACK)
    for k in range(1, 201):
        bend = 0.01 * math.sin(k / 25)
        for side, step in ((0, 0.04 + bend), (1, 0.04 - bend)):
            scatter = rng.normal(0.0, sigma * math.sqrt(step)) if rng else 0.0
            right += (step * right_scale + scatter) * (side == 0)
            left += (step * left_scale + scatter) * (side == 1)
        shown = (float(np.float32(right)), float(np.float32(left))) if float32 else (right, left)
        odometry = odometry.advance(*shown, k / 10, TRACK * track_scale, noise=noise)
    return odometry


def matrix(covariance: object) -> np.ndarray:
    xx, xy, xt, yy, yt, tt = covariance  # type: ignore[misc]
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
