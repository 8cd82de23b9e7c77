"""Writes small ONNX files by hand: a graph whose outputs are constants, in protocol-buffer wire format."""

from __future__ import annotations

import numpy as np

FLOAT, INT64 = 1, 7


def varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def field(number: int, value: int | bytes | str) -> bytes:
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def tensor(name: str, values: np.ndarray) -> bytes:
    kind = FLOAT if values.dtype == np.float32 else INT64
    dims = b"".join(field(1, length) for length in values.shape)
    return dims + field(2, kind) + field(8, name) + field(9, values.tobytes())


def value_info(name: str, kind: int, shape: tuple[int, ...]) -> bytes:
    dims = b"".join(field(1, field(1, length)) for length in shape)
    return field(1, name) + field(2, field(1, field(1, kind) + field(2, dims)))


def onnx_file(inputs: dict[str, tuple[int, tuple[int, ...]]], outputs: dict[str, np.ndarray]) -> bytes:
    """A model with these inputs (element type, shape), which it ignores, and these outputs."""
    nodes = b"".join(field(1, field(1, f"const_{name}") + field(2, name) + field(4, "Identity")) for name in outputs)
    constants = b"".join(field(5, tensor(f"const_{name}", values)) for name, values in outputs.items())
    ins = b"".join(field(11, value_info(name, kind, shape)) for name, (kind, shape) in inputs.items())
    outs = b"".join(
        field(12, value_info(name, FLOAT if values.dtype == np.float32 else INT64, values.shape))
        for name, values in outputs.items()
    )
    graph = nodes + field(2, "made") + constants + ins + outs
    return field(1, 8) + field(7, graph) + field(8, field(1, "") + field(2, 17))
