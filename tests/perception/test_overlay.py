from __future__ import annotations

import math

import numpy as np
import pytest

from ghal360_robot.messages import Cue, Detection
from ghal360_robot.perception.overlay import CUE_COLOUR, TARGET_COLOUR, WEDGE_COLOURS, Annotation, draw

GREY = np.full((480, 960, 3), 90, np.uint8)


def has(picture: np.ndarray, colour: tuple[int, int, int], columns: slice) -> bool:
    return bool((picture[:, columns] == colour).all(axis=-1).any())


def test_drawing_leaves_the_picture_as_it_is() -> None:
    before = GREY.copy()
    draw(before, Annotation(wedges=(0,) * 8, cue=Cue.LEFT))
    assert (before == GREY).all()


def test_a_target_on_the_left_is_boxed_in_the_left_half() -> None:
    found = Detection("bottle", 0.9, math.pi / 2, 0.0, 0.2, 0.2)
    drawn = draw(GREY, Annotation(objects=(found,), target="bottle"))
    assert has(drawn, TARGET_COLOUR, slice(200, 280))
    assert not has(drawn, TARGET_COLOUR, slice(480, 960))


def test_a_box_over_the_seam_shows_at_both_edges() -> None:
    found = Detection("bottle", 0.9, math.pi, 0.0, 0.2, 0.2)
    drawn = draw(GREY, Annotation(objects=(found,), target="bottle"))
    assert has(drawn, TARGET_COLOUR, slice(0, 20))
    assert has(drawn, TARGET_COLOUR, slice(940, 960))


def test_the_ring_shows_the_target_wedge_to_the_right_of_the_gaze() -> None:
    drawn = draw(GREY, Annotation(wedges=(0, 0, 2, 0, 0, 0, 0, 0), gaze_yaw=0.0))
    lower_edge = drawn[472, :, :]
    coloured = np.flatnonzero((lower_edge == WEDGE_COLOURS[2]).all(axis=-1))
    assert 700 < coloured.mean() < 740  # W2 is 90 degrees to the right: three quarters of the width


@pytest.mark.parametrize(("cue", "columns"), [(Cue.LEFT, slice(440, 480)), (Cue.RIGHT, slice(480, 520))])
def test_the_arrow_points_where_the_cue_says(cue: Cue, columns: slice) -> None:
    def width(rows: np.ndarray) -> int:
        return int((rows == CUE_COLOUR).all(axis=-1).sum())

    drawn = draw(GREY, Annotation(cue=cue))
    head = width(drawn[:, columns])
    tail = width(drawn[:, slice(440, 480) if columns.start == 480 else slice(480, 520)])
    assert head > tail  # the head of an arrow is broader than its tail


def test_without_a_cue_nothing_of_its_colour_is_drawn() -> None:
    assert not has(draw(GREY, Annotation()), CUE_COLOUR, slice(0, 960))
