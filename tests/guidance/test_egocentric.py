from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.egocentric import (
    N_CODES,
    decode,
    egocentric,
    encode,
    mirror,
    nearest_targets,
    rotate_left,
    rotate_right,
    sticky_wedge,
    wedge_centre,
    wedge_distance,
    wedge_of,
    wedge_offset,
)

codes = st.integers(0, N_CODES - 1)
wedges = st.lists(st.integers(0, 3), min_size=8, max_size=8)


@pytest.mark.parametrize("k", range(-24, 25))
def test_a_border_belongs_to_the_wedge_on_its_right(k: int) -> None:
    border_deg = 22.5 + 45 * k
    for border in (math.radians(border_deg), border_deg * math.pi / 180, (2 * k + 1) * math.pi / 8):
        assert wedge_of(border) == (k + 1) % 8
        assert wedge_of(border - 1e-6) == k % 8
        assert wedge_of(border + 1e-6) == (k + 1) % 8


def test_wedges_are_numbered_clockwise_from_straight_ahead() -> None:
    assert [wedge_of(math.radians(b)) for b in (0, 45, 90, 135, 180, 225, 270, 315)] == list(range(8))
    assert wedge_of(math.radians(-45)) == 7
    assert (wedge_of(math.radians(22.5)), wedge_of(math.radians(-22.5))) == (1, 0)
    assert (wedge_of(math.radians(22.49)), wedge_of(math.radians(-22.51))) == (0, 7)


@pytest.mark.parametrize("bearing", [math.nan, math.inf, -math.inf])
def test_a_bearing_that_is_not_finite_is_refused(bearing: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        wedge_of(bearing)


@given(st.floats(-1e4, 1e4))
def test_a_bearing_is_at_most_half_a_wedge_from_the_centre_of_its_wedge(bearing: float) -> None:
    assert abs(wrap(bearing - wedge_centre(wedge_of(bearing)))) <= math.pi / 8 + 1e-8


@given(st.floats(-1e6, 1e6))
def test_wrapping_keeps_the_direction_and_stays_below_pi(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-8)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-8)


def test_offsets_take_the_shorter_side_and_go_right_when_exactly_behind() -> None:
    assert [wedge_offset(0, k) for k in range(8)] == [0, 1, 2, 3, 4, -3, -2, -1]
    assert [wedge_distance(6, k) for k in range(8)] == [2, 3, 4, 3, 2, 1, 0, 1]


@pytest.mark.parametrize("wedge", range(8))
def test_a_wedge_is_left_only_beyond_the_margin(wedge: int) -> None:
    centre, margin = wedge_centre(wedge), math.radians(3)
    for side, neighbour in ((1, (wedge + 1) % 8), (-1, (wedge - 1) % 8)):
        assert sticky_wedge(centre + side * math.radians(25.4), wedge, margin) == wedge
        assert sticky_wedge(centre + side * math.radians(25.6), wedge, margin) == neighbour
        assert sticky_wedge(centre + side * math.radians(25.4), None, margin) == neighbour
    assert sticky_wedge(centre + math.pi, wedge, margin) == (wedge + 4) % 8


@given(codes)
def test_decoding_and_encoding_are_inverse(code: int) -> None:
    assert encode(decode(code)) == code


@given(wedges)
def test_the_code_is_a_number_to_base_four(values: list[int]) -> None:
    assert encode(values) == sum(value * 4**i for i, value in enumerate(values))


@pytest.mark.parametrize("values", [[0] * 7, [0] * 9, [0] * 7 + [4], [-1] + [0] * 7])
def test_values_that_are_no_wedge_state_are_refused(values: list[int]) -> None:
    with pytest.raises(ValueError, match="wedge state"):
        encode(values)


@pytest.mark.parametrize("code", [-1, N_CODES])
def test_a_code_out_of_range_is_refused(code: int) -> None:
    with pytest.raises(ValueError, match="wedge code"):
        decode(code)


@given(wedges, st.integers(0, 7))
def test_turning_right_shows_the_next_wedge_clockwise(values: list[int], head: int) -> None:
    code = encode(egocentric(values, head))
    assert decode(code)[0] == values[head]
    assert rotate_right(code) == encode(egocentric(values, (head + 1) % 8))
    assert rotate_left(code) == encode(egocentric(values, (head - 1) % 8))


@given(codes)
def test_turns_undo_each_other_and_eight_make_a_circle(code: int) -> None:
    assert rotate_left(rotate_right(code)) == code
    turned = code
    for _ in range(8):
        turned = rotate_right(turned)
    assert turned == code


@given(codes)
def test_a_mirror_exchanges_left_and_right(code: int) -> None:
    values = decode(code)
    assert decode(mirror(code)) == tuple(values[-i % 8] for i in range(8))
    assert mirror(mirror(code)) == code
    assert mirror(rotate_right(code)) == rotate_left(mirror(code))


def test_codes_turn_in_arrays_as_they_turn_alone() -> None:
    every = np.arange(N_CODES)
    some = every[::97].tolist()
    for turn in (rotate_left, rotate_right, mirror):
        assert turn(every)[::97].tolist() == [turn(code) for code in some]


def test_the_nearest_targets_are_counted_on_both_sides() -> None:
    assert nearest_targets(encode([1, 1, 0, 1, 0, 0, 1, 0])) is None
    assert nearest_targets(encode([3, 0, 2, 0, 0, 0, 0, 0])) == (0, 0)
    assert nearest_targets(encode([0, 0, 0, 3, 0, 0, 0, 0])) == (3, 5)
    assert nearest_targets(encode([0, 0, 2, 0, 0, 0, 0, 2])) == (2, 1)
