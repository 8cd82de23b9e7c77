"""Darknet networks: layers against a plain execution written from darknet's own definition, files that do not match."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.perception.detectors.compute import Compute
from ghal360_robot.perception.detectors.darknet import Darknet, decode
from ghal360_robot.perception.detectors.darknet_cfg import parse_cfg
from ghal360_robot.perception.detectors.darknet_module import Head
from ghal360_robot.perception.detectors.errors import WeightsError

SIDE = 32
CFG = """
[net]
width=32
height=32
channels=3
[convolutional]   # 0
batch_normalize=1
filters=4
size=3
stride=2
pad=1
activation=leaky
[convolutional]   # 1
batch_normalize=1
filters=4
size=1
stride=1
pad=1
activation=leaky
[shortcut]        # 2
from=-2
activation=linear
[maxpool]         # 3
size=2
stride=2
[maxpool]         # 4
size=2
stride=1
[upsample]        # 5
stride=2
[route]           # 6
layers=-1, 2
[convolutional]   # 7
size=1
stride=1
pad=1
filters=14
activation=linear
[yolo]            # 8
mask = 1,2
anchors = 4,5, 8,6, 20,24
classes=2
num=3
"""
NAMES = ("cat", "dog")


class Numbers:
    """The numbers of a weights file, drawn at random and kept for the plain execution."""

    def __init__(self) -> None:
        self.noise = np.random.default_rng(3)
        self.written: list[np.ndarray] = []

    def take(self, *shape: int, positive: bool = False) -> np.ndarray:
        values = self.noise.normal(0, 0.5, shape).astype(np.float32)
        values = np.abs(values) + 0.2 if positive else values
        self.written.append(values)
        return values

    def convolution(self, before: int, width: int, size: int, *, normalised: bool) -> dict[str, np.ndarray]:
        layer = {"bias": self.take(width)}
        if normalised:
            layer |= {"scale": self.take(width), "mean": self.take(width), "var": self.take(width, positive=True)}
        return layer | {"kernel": self.take(width, before, size, size)}

    def file(self, header: bytes = struct.pack("<iiiq", 0, 2, 0, 1000)) -> bytes:
        return header + b"".join(values.tobytes() for values in self.written)


def plain(x: np.ndarray, layer: dict[str, np.ndarray], stride: int, *, leaky: bool) -> np.ndarray:
    """One convolution of darknet on (channels, h, w), as its definition says, in loops."""
    kernel = layer["kernel"].astype(float)
    size = kernel.shape[2]
    padded = np.pad(x, ((0, 0), (size // 2, size // 2), (size // 2, size // 2)))
    rows, columns = -(-x.shape[1] // stride), -(-x.shape[2] // stride)
    y = np.zeros((kernel.shape[0], rows, columns))
    for row in range(rows):
        for column in range(columns):
            part = padded[:, row * stride : row * stride + size, column * stride : column * stride + size]
            y[:, row, column] = (kernel * part).sum(axis=(1, 2, 3))
    if "scale" in layer:
        mean, deviation = layer["mean"][:, None, None], np.sqrt(layer["var"] + 1e-5)[:, None, None]
        y = layer["scale"][:, None, None] * (y - mean) / deviation
    y += layer["bias"][:, None, None]
    return np.where(y > 0, y, 0.1 * y) if leaky else y


@pytest.fixture(scope="module")
def made() -> tuple[bytes, list[dict[str, np.ndarray]]]:
    numbers = Numbers()
    layers = [
        numbers.convolution(3, 4, 3, normalised=True),
        numbers.convolution(4, 4, 1, normalised=True),
        numbers.convolution(8, 14, 1, normalised=False),
    ]
    return numbers.file(), layers


def test_layers_do_what_darknet_s_do(made: tuple[bytes, list[dict[str, np.ndarray]]]) -> None:
    weights, (first, second, last) = made
    picture = np.random.default_rng(0).integers(0, 255, (1, SIDE, SIDE, 3), np.uint8)
    ((output,),) = Darknet("toy", CFG, weights, NAMES, Compute("cpu", "float32", 1)).run(picture)
    a = plain(picture[0].transpose(2, 0, 1) / 255, first, 2, leaky=True)
    b = plain(a, second, 1, leaky=True) + a
    halved = b.reshape(4, 8, 2, 8, 2).max(axis=(2, 4))
    around = np.pad(halved, ((0, 0), (0, 1), (0, 1)), constant_values=-np.inf)
    pooled = np.maximum.reduce([around[:, i : i + 8, j : j + 8] for i in (0, 1) for j in (0, 1)])
    joined = np.concatenate((pooled.repeat(2, axis=1).repeat(2, axis=2), b))
    expected = plain(joined, last, 1, leaky=False)
    assert np.abs(output.transpose(2, 0, 1) - expected).max() < 1e-4


def test_boxes_are_where_darknet_puts_them() -> None:
    head = Head(((8, 6), (20, 24)), 2)
    values = np.full((16, 16, 14), -9.0, np.float32)
    values[3, 5, 7:14] = (0.0, 1.0, np.log(2), 0.0, 9.0, -9.0, 2.0)  # the second anchor, class 1
    found = decode(values, head, SIDE, 0.3)
    x, y = (5 + 0.5) * 2, (3 + 1 / (1 + np.exp(-1))) * 2
    assert found.kind.tolist() == [1]
    assert found.score[0] == pytest.approx(1 / (1 + np.exp(-2)), abs=1e-3)
    assert found.xyxy[0] == pytest.approx((x - 20, y - 12, x + 20, y + 12), abs=1e-4)


def test_pictures_give_boxes_inside_them(made: tuple[bytes, list[dict[str, np.ndarray]]]) -> None:
    network = Darknet("toy", CFG, made[0], NAMES, Compute("cpu", "float32", 1))
    (found,) = network.detect([np.zeros((10, 40, 3), np.uint8)], 0.05)
    assert len(found.score) > 0
    assert (found.xyxy >= 0).all()
    assert (found.xyxy <= (40, 10, 40, 10)).all()


def test_old_and_new_headers_are_told_apart(made: tuple[bytes, list[dict[str, np.ndarray]]]) -> None:
    body = made[0][20:]
    for header in (struct.pack("<iiii", 0, 1, 0, 7), struct.pack("<iiiq", 0, 2, 5, 7)):
        Darknet("toy", CFG, header + body, NAMES, Compute("cpu", "float32", 1))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda data: data[:-4], "the cfg needs more: they do not belong together"),
        (lambda data: data + bytes(8), "holds 2 numbers more"),
        (lambda data: data[:-1], "no darknet file, or cut off"),
        (lambda data: data[:7], "empty or cut off"),
    ],
)
def test_weights_of_another_network_are_refused(
    made: tuple[bytes, list[dict[str, np.ndarray]]], change: object, why: str
) -> None:
    with pytest.raises(WeightsError, match=why):
        Darknet("toy", CFG, change(made[0]), NAMES, Compute("cpu", "float32", 1))  # type: ignore[operator]


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("[net]", "[nets]", r"does not begin with \[net\]"),
        ("width=32", "width=33", "not a square multiple of 32"),
        ("width=32", "width=many", "no numbers"),
        ("[upsample]        # 5", "[reorg]", r"a layer \[reorg\]"),
        ("filters=14", "filters=13", "needs 14 filters before it, and has 13"),
        ("filters=4\nsize=3", "filters=999999\nsize=3", "999999 filters"),
        ("from=-2", "from=-9", "which does not come before it"),
        ("mask = 1,2", "mask = 1,7", "the mask"),
        ("activation=leaky", "activation=mish", "'mish'"),
        ("stride=2\n[maxpool]", "stride=-2\n[maxpool]", "stride -2"),
        ("classes=2\n", "", "needs"),
        ("[yolo]            # 8", "yolo", "no 'key = value'"),
    ],
)
def test_a_broken_cfg_is_refused_with_what_is_wrong(
    made: tuple[bytes, list[dict[str, np.ndarray]]], old: str, new: str, why: str
) -> None:
    assert old in CFG
    with pytest.raises(WeightsError, match=why):
        Darknet("toy", CFG.replace(old, new, 1), made[0], NAMES, Compute("cpu", "float32", 1))


def test_the_wrong_number_of_names_is_told(made: tuple[bytes, list[dict[str, np.ndarray]]]) -> None:
    with pytest.raises(WeightsError, match="tells 2 classes apart, but there are 3 names"):
        Darknet("toy", CFG, made[0], ("a", "b", "c"), Compute("cpu", "float32", 1))


def test_tiny_s_fine_head_gets_the_anchors_it_was_trained_with() -> None:
    yolo = "[yolo]\nanchors=1,1,2,2,3,3,4,4,5,5,6,6\nclasses=2\nmask={}\n"
    text = "[net]\nwidth=32\nheight=32\n" + yolo.format("3,4,5") + yolo.format("0,1,2")
    masks = [layer.integers("mask") for layer in parse_cfg(text).layers]
    assert masks == [(3, 4, 5), (1, 2, 3)]
    other = text.replace("mask=0,1,2", "mask=0,1")
    assert [layer.integers("mask") for layer in parse_cfg(other).layers] == [(3, 4, 5), (0, 1)]


@given(st.text(max_size=80) | st.lists(st.sampled_from(CFG.splitlines()), max_size=30).map("\n".join))
def test_no_cfg_whatever_breaks_the_reader(text: str) -> None:
    try:
        assert parse_cfg(text).layers
    except WeightsError as error:
        assert str(error)  # noqa: PT017 - either outcome is right, a third is not
