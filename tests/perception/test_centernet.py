"""CenterNet: the torch module against the graph it was rebuilt from, its decoding against the graph's own."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ghal360_robot.perception.detectors import store
from ghal360_robot.perception.detectors.centernet import CenterNet, decode
from ghal360_robot.perception.detectors.centernet_module import CenterNetModule, twice_the_size
from ghal360_robot.perception.detectors.coco import CLASSES
from ghal360_robot.perception.detectors.compute import Compute
from ghal360_robot.perception.detectors.errors import WeightsError
from ghal360_robot.perception.detectors.tfjs import read_weights
from tests.perception.literal_graph import execute, resized

SIDE = 192


@pytest.fixture(scope="module")
def files() -> tuple[bytes, bytes]:
    entry = store.entry("centernet")
    if entry is None:
        pytest.skip("its weights are not on this machine: run `ghal360 detectors add centernet`")
    return entry.read("json"), entry.read("bin")


@pytest.fixture(scope="module")
def network(files: tuple[bytes, bytes]) -> CenterNet:
    return CenterNet(*files, Compute("cpu", "float32", 1), SIDE)


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    """Shapes and noise: enough to excite every channel, though nothing in it is an object."""
    noise = np.random.default_rng(1)
    canvas = np.repeat(np.repeat(noise.integers(0, 255, (12, 12, 3), np.uint8), SIDE // 12, 0), SIDE // 12, 1)
    canvas[40:150, 60:120] = (200, 60, 30)
    canvas[90:110, 20:170] = (20, 20, 25)
    return canvas


def test_the_module_gives_what_a_literal_execution_of_the_graph_gives(
    files: tuple[bytes, bytes], network: CenterNet, picture: np.ndarray
) -> None:
    truth = execute(*files, picture[None])
    ((logits, reaches),) = network.run(picture[None])
    assert np.abs(1 / (1 + np.exp(-logits)) - truth["keypoints"][0]).max() < 2e-3
    assert np.abs(reaches - truth["wh"][0]).max() / np.abs(truth["wh"]).max() < 2e-3
    assert truth["keypoints"].max() > 0.02, "a picture that excites nothing proves nothing"


def test_decoding_gives_the_graph_s_own_detections(
    files: tuple[bytes, bytes], network: CenterNet, picture: np.ndarray
) -> None:
    rows = execute(*files, picture[None])["detections"][0]
    ((logits, reaches),) = network.run(picture[None])
    found = decode(logits, reaches, float(rows[20, 4]))
    for box, score, kind in zip(*found, strict=True):
        # Suppression takes some of the graph's rows away, and adds none.
        errors = np.abs(rows[:, :4] - box).max(axis=1) + 1e3 * (rows[:, 5] != kind)
        nearest = int(errors.argmin())
        assert errors[nearest] < 0.5
        assert score == pytest.approx(rows[nearest, 4], abs=2e-3)
    assert len(found.score) > 0


def test_bfloat16_finds_about_the_same(files: tuple[bytes, bytes], network: CenterNet, picture: np.ndarray) -> None:
    half = CenterNet(*files, Compute("cpu", "bfloat16", 1), SIDE)
    ((fine, _),) = network.run(picture[None])
    ((coarse, _),) = half.run(picture[None])
    assert np.abs(1 / (1 + np.exp(-fine)) - 1 / (1 + np.exp(-coarse))).max() < 0.05


def test_a_batch_gives_what_single_pictures_give(network: CenterNet, picture: np.ndarray) -> None:
    pictures = [picture, picture[:100], picture[:, ::-1].copy()]
    together = network.detect(pictures, 0.02)
    for one, each in zip(together, pictures, strict=True):
        (alone,) = network.detect([each], 0.02)
        assert np.allclose(one.xyxy, alone.xyxy, atol=1e-3)
        assert np.array_equal(one.kind, alone.kind)


def test_boxes_lie_in_the_picture_whatever_its_shape(network: CenterNet, picture: np.ndarray) -> None:
    (found,) = network.detect([picture[:40, :190]], 0.001)
    assert len(found.score) > 0
    assert (found.xyxy >= 0).all()
    assert (found.xyxy[:, [0, 2]] <= 190).all()
    assert (found.xyxy[:, [1, 3]] <= 40).all()


def test_doubling_is_tensorflow_1_s_bilinear_resize() -> None:
    x = np.random.default_rng(0).normal(size=(2, 5, 7, 3))
    mine = twice_the_size(torch.from_numpy(x).permute(0, 3, 1, 2)).permute(0, 2, 3, 1).numpy()
    assert np.allclose(mine, resized(x, np.array((10, 14))), atol=1e-12)


def test_decoding_finds_peaks_only_and_never_more_than_a_hundred() -> None:
    logits = np.full((32, 32, 80), -9.0, np.float32)
    reaches = np.full((32, 32, 4), 6.0, np.float32)
    logits[10, 10, 3], logits[10, 11, 3], logits[0, 31, 5] = 2.0, 1.0, 3.0
    found = decode(logits, reaches, 0.3)
    assert found.kind.tolist() == [5, 3]
    assert found.xyxy.tolist() == [[118, -6, 130, 6], [34, 34, 46, 46]]
    crowd = decode(np.random.default_rng(0).normal(3, 1, (32, 32, 80)).astype(np.float32), reaches, 0.1)
    assert len(crowd.score) <= 100
    assert (np.diff(crowd.score) <= 0).all()


def test_weights_of_something_else_are_told_so(files: tuple[bytes, bytes]) -> None:
    weights = read_weights(*files)
    name = "CenternetHead/centernet_cls_output/biases"
    with pytest.raises(WeightsError, match="is missing or of another kind"):
        CenterNetModule({key: value for key, value in weights.items() if key != name})
    with pytest.raises(WeightsError, match="has 79 values, not 80"):
        CenterNetModule({**weights, name: weights[name][:79]})


def test_the_classes_are_coco_s_eighty() -> None:
    assert len(set(CLASSES)) == 80
    assert (CLASSES[24], CLASSES[39], CLASSES[62], CLASSES[63]) == ("backpack", "bottle", "tv", "laptop")
