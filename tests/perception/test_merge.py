"""One box for an object, however many tiles saw it; and whole panoramas through a network that sees exactly."""

from __future__ import annotations

from math import pi, radians, tau

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.perception.detectors.boxes import Boxes
from ghal360_robot.perception.detectors.errors import PictureError
from ghal360_robot.perception.detectors.panoramic import PanoramaDetector
from ghal360_robot.perception.merge import TileBox, intersection, merged, overlap
from ghal360_robot.perception.sphere import PictureSize, SphereBox, sphere_box
from ghal360_robot.perception.tiles import PLANS

SHARED = radians(30)
boxes = st.builds(SphereBox, st.floats(-pi, pi), st.floats(-1, 1), st.floats(0.05, tau), st.floats(0.05, 1.0))


def box(yaw: float, width: float = 10.0, pitch: float = 0.0, height: float = 10.0) -> SphereBox:
    return SphereBox(*(radians(value) for value in (yaw, pitch, width, height)))


@given(boxes, boxes)
def test_intersection_is_that_of_painted_cells(a: SphereBox, b: SphereBox) -> None:
    yaw = np.linspace(-pi, pi, 4000, endpoint=False)
    common = (
        (abs(np.angle(np.exp(1j * (yaw - a.yaw)))) <= a.width / 2)
        & (abs(np.angle(np.exp(1j * (yaw - b.yaw)))) <= b.width / 2)
    ).mean() * tau
    low, high = max(a.pitch - a.height / 2, b.pitch - b.height / 2), min(a.pitch + a.height / 2, b.pitch + b.height / 2)
    assert intersection(a, b) == pytest.approx(common * max(0.0, high - low), abs=0.006)
    assert 0 <= overlap(a, b) <= 1 + 1e-9
    assert overlap(a, b) == pytest.approx(overlap(b, a))


def test_two_tiles_on_one_object_give_one_box_over_the_seam_too() -> None:
    found = [TileBox("cup", 0.5, box(179), cut=False), TileBox("cup", 0.7, box(-180), cut=False)]
    assert merged(found, SHARED) == [found[1]]


def test_a_whole_box_wins_over_a_better_one_that_is_cut() -> None:
    whole, part = TileBox("bed", 0.5, box(0, 50), cut=False), TileBox("bed", 0.9, box(-10, 35), cut=True)
    assert merged([part, whole], SHARED) == [whole]


def test_a_cut_piece_that_lies_in_a_kept_box_is_a_part_of_it_and_a_narrow_one_is_nothing() -> None:
    whole = TileBox("bed", 0.5, box(0, 80), cut=False)
    assert merged([whole, TileBox("bed", 0.9, box(15, 40), cut=True)], SHARED) == [whole]
    assert merged([TileBox("bed", 0.9, box(15, 20), cut=True)], SHARED) == []


def test_different_classes_and_different_places_are_different_objects() -> None:
    found = [TileBox("cup", 0.5, box(0), cut=False), TileBox("bowl", 0.4, box(0), cut=False)]
    found.append(TileBox("cup", 0.3, box(12), cut=False))
    assert merged(found, SHARED) == found


class ExactNetwork:
    """Sees every patch of pure red as a tv and of pure green as a cup, as far as the tile shows it."""

    name = "exact"
    class_names = ("tv", "cup")
    side = 512
    default_score = 0.5

    def __init__(self) -> None:
        self.batches: list[int] = []

    def detect(self, pictures: list[np.ndarray], min_score: float) -> list[Boxes]:
        self.batches.append(len(pictures))
        return [self._one(picture) for picture in pictures]

    def _one(self, picture: np.ndarray) -> Boxes:
        rows = []
        for kind in range(2):
            mask = (picture[:, :, kind] > 200) & (picture.sum(axis=2) < 300)
            y, x = np.nonzero(mask)
            if x.size:
                rows.append((x.min(), y.min(), x.max() + 1, y.max() + 1, kind))
        table = np.array(rows, np.float32).reshape(-1, 5)
        score = np.full(len(table), 0.8, np.float32)
        return Boxes(table[:, :4], score, table[:, 4].astype(np.intp))


def painted(shift: int) -> np.ndarray:
    picture = np.full((480, 960, 3), 90, np.uint8)
    picture[200:240, 300:340] = (255, 0, 0)
    picture[260:290, 700:725] = (0, 255, 0)
    return np.roll(picture, shift, axis=1)


@pytest.mark.parametrize("plan", ["default", "floor", "fine", "full"])
@pytest.mark.parametrize("turn", range(0, 960, 120))
def test_objects_are_found_once_wherever_the_panorama_is_turned(plan: str, turn: int) -> None:
    if plan == "full" and turn in (240, 600, 720):
        pytest.skip("the bare panorama cuts what lies on its seam: that is why it is no plan to use")
    detector = PanoramaDetector(ExactNetwork(), PLANS[plan])
    size = PictureSize(960, 480)
    found = {item.name: sphere_box(item.box, size) for item in detector.detect(painted(turn))}
    assert len(detector.detect(painted(turn))) == 2
    expected = {
        "television": SphereBox(pi - (320 + turn) * tau / 960, pi / 2 - 220 * pi / 480, 40 * tau / 960, 40 * pi / 480),
        "cup": SphereBox(pi - (712.5 + turn) * tau / 960, pi / 2 - 275 * pi / 480, 25 * tau / 960, 30 * pi / 480),
    }
    for name, truth in expected.items():
        assert overlap(found[name], truth) > (0.75 if plan == "floor" else 0.999), name


def test_names_are_those_of_the_robot_and_thresholds_go_by_any_of_them() -> None:
    detector = PanoramaDetector(ExactNetwork(), thresholds={"monitor": 0.9})
    assert detector.class_names == ("television", "cup")
    assert [item.name for item in detector.detect(painted(0))] == ["cup"]


def test_tiles_go_to_the_network_in_one_batch_and_one_at_a_time_with_round_robin() -> None:
    together, turns = ExactNetwork(), ExactNetwork()
    PanoramaDetector(together).detect(painted(0))
    robin = PanoramaDetector(turns, PLANS["round-robin"])
    seen = {item.name for _ in range(4) for item in robin.detect(painted(0))}
    assert together.batches == [4]
    assert turns.batches == [1, 1, 1, 1]
    assert seen == {"television", "cup"}


@pytest.mark.parametrize(
    "picture", [np.zeros((0, 10, 3), np.uint8), np.zeros((10, 10), np.uint8), np.zeros((4, 20000, 3), np.uint8)]
)
def test_absurd_pictures_are_refused_with_a_sentence(picture: np.ndarray) -> None:
    with pytest.raises(PictureError, match=r"picture"):
        PanoramaDetector(ExactNetwork()).detect(picture)
