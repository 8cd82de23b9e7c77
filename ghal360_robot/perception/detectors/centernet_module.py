"""CenterNet on MobileNetV3-large x 0.75, rebuilt in torch from the weights of its TensorFlow.js graph.

Fact sheet on the detector, section 1.1: batch normalisation is folded into the convolutions, TensorFlow's SAME
padding at stride 2 pads right and bottom more, and the up-sampling is TensorFlow 1's (no half-pixel centres).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as f

from ghal360_robot.perception.detectors.errors import WeightsError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Weights = Mapping[str, NDArray[Any]]

N_CLASSES = 80
CELL_PX = 4
"""Input pixels per cell of the two output maps."""
REACH_PX = 16.0
"""The network gives box reaches in units of so many pixels."""
TOWER = "tower_0/"
"""Some of the graph's names begin with this and some do not; without it they are unique."""
BACKBONE = "MobilenetV3/"
HEAD = "CenternetHead/"


@dataclass(frozen=True, slots=True)
class _Block:
    """One inverted residual of the backbone: what the weights' shapes do not tell."""

    stride: int
    swish: bool
    squeeze: bool
    residual: bool


BLOCKS = (
    _Block(1, swish=False, squeeze=False, residual=True),
    _Block(2, swish=False, squeeze=False, residual=False),
    _Block(1, swish=False, squeeze=False, residual=True),
    _Block(2, swish=False, squeeze=True, residual=False),
    _Block(1, swish=False, squeeze=True, residual=True),
    _Block(1, swish=False, squeeze=True, residual=True),
    _Block(2, swish=True, squeeze=False, residual=False),
    _Block(1, swish=True, squeeze=False, residual=True),
    _Block(1, swish=True, squeeze=False, residual=True),
    _Block(1, swish=True, squeeze=False, residual=True),
    _Block(1, swish=True, squeeze=True, residual=False),
    _Block(1, swish=True, squeeze=True, residual=True),
    _Block(2, swish=True, squeeze=True, residual=False),
    _Block(1, swish=True, squeeze=True, residual=True),
    _Block(1, swish=True, squeeze=True, residual=True),
)
FINE, MIDDLE, COARSE = 3, 5, 11
"""Blocks whose features the head takes up: those of the first two before they are made smaller, the third's output."""


class CenterNetModule(nn.Module):
    """Pictures (n, 3, h, w) RGB 0..255 to class logits (n, 80, h/4, w/4) and reaches (n, 4, h/4, w/4).

    Sides are multiples of 32. Reaches are pixels from a cell's corner (4 x, 4 y) to left, top, right and bottom.
    """

    def __init__(self, weights: Weights) -> None:
        """Raises WeightsError where a weight is missing or of another shape."""
        super().__init__()
        weights = {name.removeprefix(TOWER): values for name, values in weights.items()}
        self.stem = _folded(weights, BACKBONE + "Conv/Conv2D", stride=2)
        self.blocks = nn.ModuleList(_Residual(weights, number, block) for number, block in enumerate(BLOCKS))
        self.top = _folded(weights, "extern1/Conv2D")
        self.laterals = nn.ModuleList(_Lateral(weights, f"{HEAD}c{level}_reverse/") for level in (4, 3, 2))
        self.ups = nn.ModuleList(_Up(weights, f"{HEAD}c{level}_upsample/") for level in (5, 4, 3))
        self.attention = _Attention(
            _folded(weights, HEAD + "conv1x1_se_a/Conv2D"), _conv(weights, HEAD + "conv1x1_se_b/weights", None)
        )
        self.classes = _Separable.output(weights, HEAD + "centernet_cls_output/")
        self.reaches = _Separable.output(weights, HEAD + "centernet_wh_output/")

    def forward(self, pictures: Tensor) -> tuple[Tensor, Tensor]:
        x = f.hardswish(self.stem(pictures), inplace=True)
        taken: dict[int, Tensor] = {}
        for number, block in enumerate(self.blocks):
            x, wide = block(x)
            taken[number] = x if number == COARSE else wide
        x = f.hardswish(self.top(x), inplace=True)
        for lateral, up, level in zip(self.laterals, self.ups, (COARSE, MIDDLE, FINE), strict=True):
            x = f.relu_(torch.cat((lateral(taken[level]), up(x)), dim=1))
        x = self.attention(x)
        return self.classes(x), self.reaches(x) * REACH_PX


class _Residual(nn.Module):
    """Expand, filter each channel, weigh the channels, project back; gives its output and its expanded features."""

    def __init__(self, weights: Weights, number: int, block: _Block) -> None:
        super().__init__()
        prefix = f"{BACKBONE}expanded_conv{f'_{number}' if number else ''}/"
        self.expand = _folded(weights, prefix + "expand/Conv2D") if number else None
        self.depthwise = _folded(weights, prefix + "depthwise/depthwise", stride=block.stride, depthwise=True)
        self.squeeze: nn.Module | None = None
        if block.squeeze:
            inside = prefix + "squeeze_excite/"
            self.squeeze = _Squeeze(_biased(weights, inside + "Conv/"), _biased(weights, inside + "Conv_1/"))
        self.project = _folded(weights, prefix + "project/Conv2D")
        self.activation = nn.Hardswish(inplace=True) if block.swish else nn.ReLU(inplace=True)
        self.residual = block.residual

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        wide = x if self.expand is None else self.activation(self.expand(x))
        y = self.activation(self.depthwise(wide))
        if self.squeeze is not None:
            y = self.squeeze(y)
        y = self.project(y)
        return (y + x if self.residual else y), wide


class _Squeeze(nn.Module):
    """Channel weights from the whole picture's mean (hard sigmoid)."""

    def __init__(self, down: nn.Module, up: nn.Module) -> None:
        super().__init__()
        self.down, self.up = down, up

    def forward(self, x: Tensor) -> Tensor:
        return x * f.hardsigmoid(self.up(f.relu_(self.down(x.mean((2, 3), keepdim=True)))))


class _Attention(_Squeeze):
    """The head's channel weights (sigmoid)."""

    def forward(self, x: Tensor) -> Tensor:
        return x * torch.sigmoid(self.up(f.relu_(self.down(x.mean((2, 3), keepdim=True)))))


class _Separable(nn.Module):
    """A filter for each channel, then a mix of the channels."""

    def __init__(self, depthwise: nn.Module, pointwise: nn.Module) -> None:
        super().__init__()
        self.depthwise, self.pointwise = depthwise, pointwise

    @classmethod
    def inside(cls, weights: Weights, prefix: str) -> Self:
        depthwise = _conv(weights, prefix + "depthwise_weights", None, depthwise=True)
        return cls(depthwise, _folded(weights, prefix + "separable_conv2d"))

    @classmethod
    def output(cls, weights: Weights, prefix: str) -> Self:
        depthwise = _conv(weights, prefix + "depthwise_weights", None, depthwise=True)
        return cls(depthwise, _conv(weights, prefix + "pointwise_weights", prefix + "biases"))

    def forward(self, x: Tensor) -> Tensor:
        return self.pointwise(self.depthwise(x))  # type: ignore[no-any-return]


class _Lateral(nn.Module):
    """Features of the backbone on their way into the head."""

    def __init__(self, weights: Weights, prefix: str) -> None:
        super().__init__()
        self.narrow = _folded(weights, prefix + "1x1/Conv2D")
        self.widen = _Separable.inside(weights, prefix + "3x3/")

    def forward(self, x: Tensor) -> Tensor:
        return self.widen(f.relu_(self.narrow(x)))  # type: ignore[no-any-return]


class _Up(nn.Module):
    """Two separable convolutions side by side, added, at twice the size."""

    def __init__(self, weights: Weights, prefix: str) -> None:
        super().__init__()
        self.x = _Separable.inside(weights, prefix + "branch_x_upsample_resize/")
        self.y = _Separable.inside(weights, prefix + "branch_y_upsample_resize/")

    def forward(self, x: Tensor) -> Tensor:
        return twice_the_size(self.x(x) + self.y(x))


def twice_the_size(x: Tensor) -> Tensor:
    """TensorFlow 1's bilinear resize by two: even rows and columns are copies, odd ones means of their neighbours."""
    x = x.permute(0, 2, 3, 1)  # channels last, as they lie in memory: stacking keeps it so
    rows = torch.stack((x, (x + torch.cat((x[:, 1:], x[:, -1:]), 1)) / 2), 2).flatten(1, 2)
    both = torch.stack((rows, (rows + torch.cat((rows[:, :, 1:], rows[:, :, -1:]), 2)) / 2), 3).flatten(2, 3)
    return both.permute(0, 3, 1, 2)


class _Pointwise(nn.Linear):
    """A 1x1 convolution as what it is: one matrix for every pixel, without torch's copying detour for it."""

    def forward(self, x: Tensor) -> Tensor:
        return super().forward(x.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)


class _SameConv(nn.Conv2d):
    """TensorFlow's SAME at stride 2: the odd pixel of padding is on the right and at the bottom."""

    def forward(self, x: Tensor) -> Tensor:
        total = max(self.kernel_size[0] - 2, 0)
        before = total // 2
        return super().forward(f.pad(x, (before, total - before, before, total - before)))


def _folded(weights: Weights, name: str, stride: int = 1, *, depthwise: bool = False) -> nn.Module:
    """A convolution with its batch normalisation folded in."""
    return _conv(weights, name + "_weights", name + "_bn_offset", stride, depthwise=depthwise)


def _biased(weights: Weights, prefix: str) -> nn.Module:
    return _conv(weights, prefix + "weights", prefix + "biases")


def _conv(
    weights: Weights, kernel_name: str, bias_name: str | None, stride: int = 1, *, depthwise: bool = False
) -> nn.Module:
    # TensorFlow keeps kernels as height, width, in, out, and those of depthwise filters as height, width, out, 1.
    kernel = _get(weights, kernel_name, 4).permute((2, 3, 0, 1) if depthwise else (3, 2, 0, 1))
    n_out, n_in, size, _ = kernel.shape
    bias = None if bias_name is None else _get(weights, bias_name, 1)
    if bias is not None and bias.shape[0] != n_out:
        raise WeightsError(f"These weights are not CenterNet's: '{bias_name}' has {bias.shape[0]} values, not {n_out}.")
    groups = n_out if depthwise else 1
    conv: nn.Conv2d | nn.Linear
    if size == 1:
        conv, kernel = _Pointwise(n_in, n_out, bias=bias is not None), kernel[:, :, 0, 0]
    elif stride == 1:
        conv = nn.Conv2d(n_in * groups, n_out, size, padding=size // 2, groups=groups, bias=bias is not None)
    else:
        conv = _SameConv(n_in * groups, n_out, size, stride, groups=groups, bias=bias is not None)
    with torch.no_grad():
        conv.weight.copy_(kernel)
        if bias is not None and conv.bias is not None:
            conv.bias.copy_(bias)
    return conv


def _get(weights: Weights, name: str, rank: int) -> Tensor:
    values = weights.get(name)
    if values is None or values.ndim != rank or values.dtype != np.float32:
        raise WeightsError(f"These weights are not CenterNet's: '{name}' is missing or of another kind.")
    return torch.from_numpy(values)
