"""YOLOv3's layers in torch, filled from a darknet `.weights` file.

File (darknet, `parser.c`): version as three int32, pictures seen as int64 (int32 before 0.2), then for each
convolution its biases, where normalised its scales, means and variances, and its kernel, all float32.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as f

from ghal360_robot.perception.detectors.errors import WeightsError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.darknet_cfg import Config, Section

EPSILON = 1e-5
"""Darknet divides by the square root of the variance plus 1e-6 or 1e-5, by version; the difference is not visible."""
MAX_CHANNELS = 8192
"""YOLOv3's widest layer has 1,024; a broken cfg must not ask for all memory."""


@dataclass(frozen=True, slots=True)
class Head:
    """One yolo layer: its anchors (width, height) in pixels of the input, and how many classes."""

    anchors: tuple[tuple[int, int], ...]
    n_classes: int


class DarknetModule(nn.Module):
    """Pictures (n, 3, h, w) RGB 0..255 to one map (n, anchors x (5 + classes), rows, columns) for each yolo layer."""

    def __init__(self, config: Config, weights: bytes) -> None:
        """Raises WeightsError where the weights are not those of this cfg."""
        super().__init__()
        self.heads: list[Head] = []
        self.layers = nn.ModuleList()
        self._routes: list[tuple[int, ...]] = []
        source = _Weights(weights)
        channels: list[int] = []
        for index, section in enumerate(config.layers):
            before = channels[-1] if channels else 3
            route, layer, width = self._layer(section, index, before, channels, source)
            self.layers.append(layer)
            self._routes.append(route)
            channels.append(width)
        source.end()
        self._kept = {source for route in self._routes for source in route}

    def forward(self, pictures: Tensor) -> tuple[Tensor, ...]:
        x = pictures / 255
        kept: dict[int, Tensor] = {}
        outputs = []
        for index, (layer, route) in enumerate(zip(self.layers, self._routes, strict=True)):
            if isinstance(layer, _Yolo):
                outputs.append(x)
            elif isinstance(layer, _Add):
                x = x + kept[route[0]]
            elif isinstance(layer, _Join):
                parts = [kept[source] for source in route]
                x = parts[0] if len(parts) == 1 else torch.cat(parts, 1)
            else:
                x = layer(x)
            if index in self._kept:
                kept[index] = x
        return tuple(outputs)

    def _layer(
        self, section: Section, index: int, before: int, channels: list[int], source: _Weights
    ) -> tuple[tuple[int, ...], nn.Module, int]:
        """What it takes up beside the layer before, the layer, and its number of channels."""
        match section.kind:
            case "convolutional":
                width = section.integer("filters", 1)
                return (), _convolution(section, before, width, source), width
            case "maxpool":
                size = section.integer("size", 2)
                return (), _MaxPool(size, section.integer("stride", size)), before
            case "upsample":
                return (), nn.Upsample(scale_factor=section.integer("stride", 2)), before
            case "route":
                taken = tuple(_earlier(layer, index) for layer in section.integers("layers"))
                return taken, _Join(), sum(channels[layer] for layer in taken)
            case "shortcut":
                taken = (_earlier(section.integer("from"), index),)
                if channels[taken[0]] != before:
                    raise WeightsError(f"The cfg's shortcut at layer {index} adds layers of different widths.")
                return taken, _Add(), before
            case _:
                self.heads.append(_head(section, before))
                return (), _Yolo(), before


class _Yolo(nn.Module):
    """Marks an output."""


class _Add(nn.Module):
    """Marks a shortcut."""


class _Join(nn.Module):
    """Marks a route."""


class _MaxPool(nn.Module):
    """Darknet's: pads size - 1 pixels in all, the odd one on the right and at the bottom."""

    def __init__(self, size: int, stride: int) -> None:
        super().__init__()
        if not (1 <= size <= 32 and 1 <= stride <= 32):
            raise WeightsError(f"The cfg has a maxpool of size {size} and stride {stride}.")
        self.size, self.stride = size, stride

    def forward(self, x: Tensor) -> Tensor:
        left = (self.size - 1) // 2
        padded = f.pad(x, (left, self.size - 1 - left, left, self.size - 1 - left), value=float("-inf"))
        return f.max_pool2d(padded, self.size, self.stride)


class _Weights:
    """The numbers of a `.weights` file, taken in order."""

    def __init__(self, data: bytes) -> None:
        if len(data) < 16:
            raise WeightsError("The weights file is empty or cut off.")
        major, minor = np.frombuffer(data, "<i4", 2)
        header = 20 if 2 <= major * 10 + minor < 10000 else 16
        body = len(data) - header
        if body < 0 or body % 4 or not 0 <= major < 1000:
            raise WeightsError("The weights file is no darknet file, or cut off.")
        self._values: NDArray[np.float32] = np.frombuffer(data, "<f4", body // 4, header)
        self._at = 0

    def take(self, count: int) -> Tensor:
        end = self._at + count
        if end > len(self._values):
            raise WeightsError(
                f"The weights file holds {len(self._values)} numbers, the cfg needs more: they do not belong together."
            )
        values, self._at = self._values[self._at : end], end
        return torch.from_numpy(values.copy())

    def end(self) -> None:
        left = len(self._values) - self._at
        if left:
            raise WeightsError(
                f"The weights file holds {left} numbers more than the cfg has a use for: they do not belong together."
            )


def _convolution(section: Section, before: int, width: int, source: _Weights) -> nn.Module:
    size, stride = section.integer("size", 1), section.integer("stride", 1)
    if not (1 <= width <= MAX_CHANNELS and 1 <= size <= 15 and 1 <= stride <= 8) or section.integer("groups", 1) != 1:
        raise WeightsError(f"The cfg has a convolution of {width} filters, size {size}, stride {stride}, or groups.")
    padding = size // 2 if section.integer("pad", 0) else section.integer("padding", 0)
    bias = source.take(width)
    scale = torch.ones(width)
    if section.integer("batch_normalize", 0):
        gamma, mean, variance = source.take(width), source.take(width), source.take(width)
        scale = gamma / torch.sqrt(variance + EPSILON)
        bias = bias - mean * scale
    kernel = source.take(width * before * size * size).reshape(width, before, size, size)
    conv = nn.Conv2d(before, width, size, stride, padding)
    with torch.no_grad():
        conv.weight.copy_(kernel * scale[:, None, None, None])
        conv.bias = nn.Parameter(bias)
    activation = section.values.get("activation", "logistic")
    if activation == "linear":
        return conv
    if activation != "leaky":
        raise WeightsError(f"The cfg has the activation '{activation}'; leaky and linear are known here.")
    return nn.Sequential(conv, nn.LeakyReLU(0.1, inplace=True))


def _earlier(layer: int, index: int) -> int:
    """A layer named from the beginning, or, where negative, from here."""
    absolute = index + layer if layer < 0 else layer
    if not 0 <= absolute < index:
        raise WeightsError(f"The cfg's layer {index} takes up layer {absolute}, which does not come before it.")
    return absolute


def _head(section: Section, width: int) -> Head:
    sizes, mask, classes = section.integers("anchors"), section.integers("mask"), section.integer("classes", 20)
    anchors = list(zip(sizes[::2], sizes[1::2], strict=False))
    if not mask or not all(0 <= index < len(anchors) for index in mask):
        raise WeightsError(f"The cfg's [yolo] has the mask {mask} and {len(anchors)} anchors.")
    if width != len(mask) * (5 + classes):
        raise WeightsError(
            f"The cfg's [yolo] with {len(mask)} anchors and {classes} classes needs {len(mask) * (5 + classes)} "
            f"filters before it, and has {width}."
        )
    return Head(tuple(anchors[index] for index in mask), classes)
