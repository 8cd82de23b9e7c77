"""The colour detector of the simulated world, on pictures drawn by the tests."""

from __future__ import annotations

import colorsys
from math import pi

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors.base import DETECTORS, PixelDetection, make_detector
from ghal360_robot.perception.detectors.painted import PaintedDetector
from ghal360_robot.perception.panorama import around_robot
from ghal360_robot.perception.sphere import PictureSize, PixelBox
from ghal360_robot.simulation.paint import PAINT

SIZE = PictureSize(1920, 960)


def paint(hue_deg: float, saturation: float = 0.9, value: float = 0.8) -> tuple[int, ...]:
    return tuple(round(255 * part) for part in colorsys.hsv_to_rgb(hue_deg / 360, saturation, value))


def room() -> np.ndarray:
    """A dull room: grey gradient with weak colours, as the world outside the paint is."""
    rng = np.random.default_rng(5)
    grey = np.linspace(60, 200, SIZE.height)[:, None, None]
    return np.clip(grey + rng.normal(0, 8, (SIZE.height, SIZE.width, 3)), 0, 255).astype(np.uint8)


def put(picture: np.ndarray, name: str, left: int, top: int, width: int, height: int) -> None:
    """Fill a box with a class's paint, round the seam if need be."""
    columns = np.arange(left, left + width) % picture.shape[1]
    picture[top : top + height, columns] = paint(PAINT[name])


def one(picture: np.ndarray) -> PixelDetection:
    (found,) = PaintedDetector().detect(picture)
    return found


@pytest.mark.parametrize("name", PAINT)
def test_every_painted_class_is_found_by_name_and_place(name: str) -> None:
    picture = room()
    put(picture, name, 700, 500, 60, 80)
    found = one(picture)
    assert found.name == name
    assert found.score > 0.9
    box = found.box
    assert (box.left, box.top, box.width, box.height) == pytest.approx((700, 500, 60, 80), abs=4)


def test_a_dull_room_holds_nothing() -> None:
    assert PaintedDetector().detect(room()) == []


@pytest.mark.parametrize("saturation", [0.0, 0.2, 0.35])
def test_pale_colours_of_the_right_hue_are_not_paint(saturation: float) -> None:
    picture = room()
    picture[400:500, 400:500] = paint(PAINT["backpack"], saturation)
    assert PaintedDetector().detect(picture) == []


@pytest.mark.parametrize("hue_deg", [0, 36, 80, 160, 250, 300])
def test_saturated_colours_between_the_bands_are_not_paint(hue_deg: float) -> None:
    picture = room()
    picture[400:500, 400:500] = paint(hue_deg, 1.0)
    known = [name for name, hue in PAINT.items() if abs((hue - hue_deg + 180) % 360 - 180) <= 12]
    assert [found.name for found in PaintedDetector().detect(picture)] == known


@pytest.mark.parametrize("left", [1870, 1890, 1900, 1919])
def test_an_object_on_the_seam_is_one_object(left: int) -> None:
    picture = room()
    put(picture, "suitcase", left, 480, 60, 90)
    found = one(picture)
    assert found.box.left == pytest.approx(left, abs=4)
    assert found.box.width == pytest.approx(60, abs=6)
    objects = around_robot([found], SIZE, 0.0, stamp_ns=1, picture=2, detector="painted").objects
    assert abs(objects[0].yaw) == pytest.approx(pi - (left + 30 - 1920) / 1920 * 2 * pi, abs=0.02) or (
        objects[0].yaw == pytest.approx(-pi + (1920 - left - 30) / 1920 * 2 * pi, abs=0.02)
    )


def test_objects_at_both_edges_that_do_not_touch_stay_two() -> None:
    picture = room()
    put(picture, "vase", 10, 300, 40, 60)
    put(picture, "vase", 1860, 600, 40, 60)
    assert sorted(round(found.box.left, -1) for found in PaintedDetector().detect(picture)) == [10, 1860]


def test_touching_objects_of_two_classes_stay_two() -> None:
    picture = room()
    put(picture, "laptop", 300, 500, 50, 50)
    put(picture, "bottle", 350, 500, 30, 60)
    assert {found.name for found in PaintedDetector().detect(picture)} == {"laptop", "bottle"}


def test_a_thin_strap_does_not_cut_an_object_in_two() -> None:
    picture = room()
    put(picture, "backpack", 900, 500, 80, 100)
    picture[550:553, 900:980] = 30
    assert one(picture).box.height == pytest.approx(100, abs=5)


def test_specks_and_streaks_are_not_objects() -> None:
    picture = room()
    put(picture, "television", 100, 300, 4, 4)
    put(picture, "television", 500, 300, 400, 6)
    assert PaintedDetector().detect(picture) == []


def test_small_and_ragged_patches_score_less_than_large_whole_ones() -> None:
    picture = room()
    put(picture, "cushion", 100, 400, 100, 80)
    put(picture, "cushion", 600, 400, 8, 10)
    put(picture, "cushion", 1000, 400, 90, 4)
    put(picture, "cushion", 1000, 400, 4, 90)
    large, *rest = PaintedDetector().detect(picture)
    assert large.box.left == pytest.approx(100, abs=4)
    assert len(rest) == 2
    assert all(found.score < 0.8 * large.score for found in rest)


def test_a_bottle_at_six_metres_is_still_believed() -> None:
    picture = room()
    put(picture, "bottle", 800, 500, 6, 15)
    assert one(picture).score >= 0.5


def test_a_4k_picture_gives_boxes_in_its_own_pixels() -> None:
    picture = cv2.resize(room(), (3840, 1920))
    put(picture, "laptop", 3000, 1000, 100, 120)
    box = one(picture).box
    assert (box.left, box.top, box.width, box.height) == pytest.approx((3000, 1000, 100, 120), abs=8)


def test_a_picture_full_of_paint_is_one_box() -> None:
    picture = np.full((480, 960, 3), paint(PAINT["vase"]), np.uint8)
    assert one(picture).box == PixelBox(0, 0, 960, 480)


@given(npst.arrays(np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 80), st.just(3))))
@settings(max_examples=200)
def test_any_picture_gives_boxes_inside_it_and_scores_from_0_to_1(picture: np.ndarray) -> None:
    height, width = picture.shape[:2]
    for found in PaintedDetector().detect(picture):
        assert 0 < found.score <= 1
        assert 0 <= found.box.left < width
        assert 0 < found.box.width <= width
        assert 0 <= found.box.top < found.box.top + found.box.height <= height


@pytest.mark.parametrize(
    "picture", [np.zeros((4, 8), np.uint8), np.zeros((4, 8, 3), np.float32), np.zeros((0, 8, 3), np.uint8)]
)
def test_what_is_no_rgb_picture_is_refused(picture: np.ndarray) -> None:
    with pytest.raises(ValueError, match="uint8"):
        PaintedDetector().detect(picture)


@pytest.mark.parametrize("name", DETECTORS)
def test_detectors_are_made_by_name(name: str) -> None:
    detector = make_detector(name)
    assert detector.name == name
    assert isinstance(detector.class_names, tuple)


def test_the_none_detector_finds_nothing_in_a_painted_room() -> None:
    picture = room()
    put(picture, "vase", 10, 300, 40, 60)
    assert make_detector("none").detect(picture) == []


def test_an_unknown_detector_is_refused_with_the_known_names() -> None:
    with pytest.raises(UsageError, match="no detector 'yolo'; choose one of none, painted"):
        make_detector("yolo")


def test_detections_are_turned_by_the_camera_s_mounting() -> None:
    found = PixelDetection("vase", 0.7, PixelBox(940, 470, 40, 20))
    message = around_robot([found], SIZE, pi / 2, stamp_ns=123, picture=7, detector="painted")
    assert (message.stamp_ns, message.picture, message.detector) == (123, 7, "painted")
    (object_,) = message.objects
    assert (object_.name, object_.score) == ("vase", 0.7)
    assert (object_.yaw, object_.pitch) == pytest.approx((pi / 2, 0.0), abs=1e-12)
    assert (object_.width, object_.height) == pytest.approx((40 / 1920 * 2 * pi, 20 / 960 * pi))
