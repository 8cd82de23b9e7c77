"""Executes a TensorFlow.js graph model node by node, as written, in float64 numpy: slow, plain, and of no other use."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np


def weights_of(model: bytes, data: bytes) -> dict[str, np.ndarray]:
    """Every constant, read by its own small loop."""
    at, found = 0, {}
    for entry in json.loads(model)["weightsManifest"][0]["weights"]:
        stored = {"float16": "<f2", None: {"float32": "<f4", "int32": "<i4"}[entry["dtype"]]}[
            entry.get("quantization", {}).get("dtype")
        ]
        count = int(np.prod(entry["shape"], dtype=int))
        size = count * np.dtype(stored).itemsize
        found[entry["name"]] = (
            np.frombuffer(data[at : at + size], stored)
            .reshape(entry["shape"])
            .astype(np.float64 if entry["dtype"] == "float32" else np.int64)
        )
        at += size
    assert at == len(data)
    return found


def execute(model: bytes, data: bytes, picture: np.ndarray) -> dict[str, np.ndarray]:
    """Outputs `keypoints`, `wh` and `detections` for a picture (1, h, w, 3); its own size replaces the graph's."""
    values: dict[str, np.ndarray] = dict(weights_of(model, data))
    rows, columns = picture.shape[1] // 4, picture.shape[2] // 4
    # What was folded from the input's size of 512.
    values["tower_0/strided_slice_6"] = np.array(columns)
    for level, factor in ((5, 32), (4, 16), (3, 8)):
        name = "up_sampling2d" if level == 5 else f"up_sampling2d_{5 - level}"
        size = np.array((picture.shape[1], picture.shape[2])) * 2 // factor
        values[f"tower_0/CenternetHead/c{level}_upsample/{name}/mul"] = size
    values["tower_0/BatchGather/concat"] = np.array((rows * columns, 4))
    for node in json.loads(model)["modelTopology"]["node"]:
        if node["op"] == "Placeholder":
            values[node["name"]] = picture.astype(np.float64)
        elif node["op"] != "Const":
            inputs = [values[name] for name in node.get("input", [])]
            result = step(node["op"], inputs, node.get("attr", {}))
            if isinstance(result, tuple):
                values[node["name"]], values[node["name"] + ":1"] = result
            else:
                values[node["name"]] = result
    return {name: values["tower_0/" + name] for name in ("keypoints", "wh", "detections")}


def step(op: str, inputs: list[np.ndarray], attr: dict[str, Any]) -> Any:  # noqa: PLR0911 - one for each operation
    binary = {"Add": np.add, "Sub": np.subtract, "Mul": np.multiply, "Equal": np.equal}
    binary |= {"FloorDiv": np.floor_divide, "FloorMod": np.mod}
    if op in binary:
        return binary[op](*inputs)
    match op:
        case "_FusedConv2D" | "Conv2D" | "FusedDepthwiseConv2dNative" | "DepthwiseConv2dNative":
            return convolved(inputs, attr, depthwise="Depthwise" in op)
        case "Relu" | "Relu6":
            return np.clip(inputs[0], 0, 6 if op == "Relu6" else None)
        case "Sigmoid":
            return 1 / (1 + np.exp(-inputs[0]))
        case "Mean":
            return inputs[0].mean(axis=tuple(inputs[1].tolist()), keepdims=True)
        case "ResizeBilinear":
            return resized(*inputs)
        case "ConcatV2":
            return np.concatenate(inputs[:-1], axis=int(inputs[-1]))
        case "MaxPool":
            around = np.pad(inputs[0], ((0, 0), (1, 1), (1, 1), (0, 0)), constant_values=-np.inf)
            return np.lib.stride_tricks.sliding_window_view(around, (3, 3), (1, 2)).max(axis=(-1, -2))
        case "TopKV2":
            order = np.argsort(-inputs[0], axis=-1, kind="stable")[..., : int(inputs[1])]
            return np.take_along_axis(inputs[0], order, -1), order
        case "GatherV2":
            return np.take(inputs[0], inputs[1], axis=int(inputs[2]))
        case "Reshape":
            return inputs[0].reshape([int(length) for length in inputs[1]])
        case "ExpandDims":
            return np.expand_dims(inputs[0], int(inputs[1]))
        case "StridedSlice":
            begin, end, stride = (each.tolist() for each in inputs[1:])
            masks = {key: int(attr.get(key, {}).get("i", 0)) for key in ("begin_mask", "end_mask", "shrink_axis_mask")}
            assert masks["shrink_axis_mask"] == 0
            return inputs[0][
                tuple(
                    slice(
                        None if masks["begin_mask"] >> axis & 1 else b, None if masks["end_mask"] >> axis & 1 else e, s
                    )
                    for axis, (b, e, s) in enumerate(zip(begin, end, stride, strict=True))
                )
            ]
        case "Cast" | "Identity":
            return inputs[0].astype(np.float64)
    raise AssertionError(f"the graph has an operation {op}")


def convolved(inputs: list[np.ndarray], attr: dict[str, Any], *, depthwise: bool) -> np.ndarray:
    x, kernel, *bias = inputs
    stride = int(attr["strides"]["list"]["i"][1])
    height, width = kernel.shape[:2]
    if base64.b64decode(attr["padding"]["s"]) == b"SAME":
        pads = []
        for length, size in ((x.shape[1], height), (x.shape[2], width)):
            total = max((-(-length // stride) - 1) * stride + size - length, 0)
            pads.append((total // 2, total - total // 2))
        x = np.pad(x, ((0, 0), *pads, (0, 0)))
    rows, columns = (x.shape[1] - height) // stride + 1, (x.shape[2] - width) // stride + 1
    y: Any = 0.0
    for i in range(height):
        for j in range(width):
            part = x[:, i : i + stride * rows : stride, j : j + stride * columns : stride]
            y = y + (part * kernel[i, j, :, 0] if depthwise else part @ kernel[i, j])
    fused = [base64.b64decode(name) for name in attr.get("fused_ops", {}).get("list", {}).get("s", [])]
    y = y + bias[0] if b"BiasAdd" in fused else y
    return np.maximum(y, 0) if b"Relu" in fused else y


def resized(x: np.ndarray, size: np.ndarray) -> np.ndarray:
    """TensorFlow's ResizeBilinear with align_corners and half_pixel_centers both false."""
    for axis, length in ((1, int(size[0])), (2, int(size[1]))):
        source = np.arange(length) * (x.shape[axis] / length)
        low = np.floor(source).astype(int)
        high = np.minimum(low + 1, x.shape[axis] - 1)
        share = (source - low).reshape([-1 if each == axis else 1 for each in range(4)])
        x = np.take(x, low, axis) * (1 - share) + np.take(x, high, axis) * share
    return x
