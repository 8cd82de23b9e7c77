"""ONNX detectors: told apart by their inputs and outputs, read as their exporters define them."""

from __future__ import annotations

import builtins
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from ghal360_robot.perception.detectors import store
from ghal360_robot.perception.detectors.adding import add
from ghal360_robot.perception.detectors.base import make_detector
from ghal360_robot.perception.detectors.errors import DetectorError, WeightsError
from ghal360_robot.perception.detectors.onnx import OnnxNetwork
from tests.perception.onnx_file import FLOAT, INT64, onnx_file

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("onnxruntime")
NAMES = ("cat", "dog")
PICTURE = np.zeros((32, 64, 3), np.uint8)


def yolox(rows: int = 84, classes: int = 2) -> tuple[bytes, np.ndarray]:
    """64 pixels square: 8 x 8, 4 x 4 and 2 x 2 cells."""
    output = np.zeros((1, rows, 5 + classes), np.float32)
    output[0, 8 * 2 + 3, :7] = (0.5, 0.25, np.log(2), 0.0, 0.9, 0.1, 0.8)  # column 3, row 2 of stride 8: a dog
    output[0, 64 + 4 * 1 + 2, :7] = (0.0, 0.0, 0.0, 0.0, 0.9, 0.5, 0.1)  # column 2, row 1 of stride 16: a cat
    return onnx_file({"images": (FLOAT, (1, 3, 64, 64))}, {"output": output}), output


def deim() -> bytes:
    return onnx_file(
        {"images": (FLOAT, (1, 3, 64, 64)), "orig_target_sizes": (INT64, (1, 2))},
        {
            "labels": np.array([[1, 0, 5]], np.int64),
            "boxes": np.array([[[8, 16, 40, 48], [0, 0, 64, 64], [0, 0, 1, 1]]], np.float32),
            "scores": np.array([[0.7, 0.2, 0.9]], np.float32),
        },
    )


def network(model: bytes, names: tuple[str, ...] = NAMES) -> OnnxNetwork:
    return OnnxNetwork("toy", model, names, cuda=False)


def test_yolox_rows_are_cells_of_three_grids() -> None:
    model, _ = yolox()
    (found,) = network(model).detect([PICTURE], 0.3)
    assert [NAMES[kind] for kind in found.kind] == ["dog", "cat"]
    assert found.score == pytest.approx((0.72, 0.45))
    # The picture fills the upper half of the square without being scaled.
    assert found.xyxy[0] == pytest.approx((28 - 8, 18 - 4, 28 + 8, 18 + 4), abs=1e-4)
    assert found.xyxy[1] == pytest.approx((32 - 8, 16 - 8, 32 + 8, 16 + 8), abs=1e-4)


def test_deim_boxes_are_of_the_stretched_picture_and_unknown_labels_are_left_out() -> None:
    (found,) = network(deim()).detect([PICTURE], 0.3)
    assert found.kind.tolist() == [1]
    assert found.xyxy[0] == pytest.approx((8, 8, 40, 24))


def test_what_a_network_is_given_is_what_its_training_gave_it(monkeypatch: pytest.MonkeyPatch) -> None:
    fed: list[dict[str, np.ndarray]] = []
    picture = np.full((32, 64, 3), (255, 51, 0), np.uint8)
    for model in (yolox()[0], deim()):
        made = network(model)
        session = made._session

        class Spy:
            def run(self, names: Any, feed: dict[str, np.ndarray], session: Any = session) -> Any:
                fed.append(feed)
                return session.run(names, feed)

            def get_inputs(self, session: Any = session) -> Any:
                return session.get_inputs()

        made._session = Spy()
        made.detect([picture], 0.3)
    assert fed[0]["images"][0, :, 10, 10].tolist() == [0, 51, 255], "YOLOX takes BGR, 0..255"
    assert fed[0]["images"][0, :, 50, 10].tolist() == [114, 114, 114], "and grey below the picture"
    assert fed[1]["images"][0, :, 50, 10].tolist() == pytest.approx([1.0, 0.2, 0.0]), "DEIM takes RGB, 0..1"
    assert fed[1]["orig_target_sizes"].tolist() == [[64, 64]]


@pytest.mark.parametrize(
    ("model", "why"),
    [
        (b"", "damaged or no ONNX model"),
        (b"not an onnx file at all", "damaged or no ONNX model"),
        (yolox(rows=83)[0], "no detector known here"),
        (yolox(classes=3)[0], "tells 3 classes apart, but 2 names"),
        (onnx_file({"x": (FLOAT, (1, 3, 64, 32))}, {"y": np.zeros((1, 84, 7), np.float32)}), "not one square picture"),
        (onnx_file({"x": (FLOAT, (1, 3, 48, 48))}, {"y": np.zeros((1, 84, 7), np.float32)}), "no multiple of 32"),
        (onnx_file({"x": (FLOAT, (1, 3, 64, 64))}, {"y": np.zeros((1, 9), np.float32)}), "no detector known here"),
    ],
)
def test_other_files_are_refused_with_what_they_are(model: bytes, why: str) -> None:
    with pytest.raises(WeightsError, match=why):
        network(model)


def test_without_onnxruntime_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name == "onnxruntime":
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(DetectorError, match=r"ghal360-robot\[onnx\]"):
        network(yolox()[0])


def test_an_added_file_becomes_a_detector_of_panoramas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(store.CACHE_VARIABLE, str(tmp_path / "cache"))
    (tmp_path / "toy.onnx").write_bytes(yolox()[0])
    (tmp_path / "toy.names").write_text("tvmonitor\nsofa\n")
    with pytest.raises(WeightsError, match="2 classes apart, but 80 names"):
        add("toy", [tmp_path / "toy.onnx"])
    assert store.entries() == {}
    add("toy", [tmp_path / "toy.onnx"], tmp_path / "toy.names")
    detector = make_detector("toy")
    assert detector.class_names == ("television", "couch")
    found = detector.detect(np.zeros((128, 256, 3), np.uint8))
    assert {item.name for item in found} == {"television", "couch"}
    (tmp_path / "toy.names").write_text("\n")
    with pytest.raises(WeightsError, match="names is empty"):
        add("toy", [tmp_path / "toy.onnx"], tmp_path / "toy.names")
