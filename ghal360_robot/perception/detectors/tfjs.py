"""Weights of a TensorFlow.js graph model: `model.json` names and shapes them, `*.bin` holds them end to end.

Format: TensorFlow.js converter, `weightsManifest` (dtype, shape, optional quantization to float16 or integers).
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.perception.detectors.errors import WeightsError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Array = NDArray[Any]

DTYPES = {"float32": "<f4", "int32": "<i4", "bool": "|b1", "float16": "<f2", "uint8": "|u1", "uint16": "<u2"}
MAX_WEIGHTS = 1 << 29
"""Two GiB of float32; a model that declares more is not one for a robot."""


def read_weights(model_json: bytes, weights_bin: bytes) -> dict[str, Array]:
    """Every weight by name, float16 and integer quantization undone. Raises WeightsError."""
    try:
        manifest = json.loads(model_json)["weightsManifest"]
        entries = [entry for group in manifest for entry in group["weights"]]
        return dict(_weights(entries, weights_bin))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        if isinstance(error, WeightsError):
            raise
        raise WeightsError(f"The model's description is no TensorFlow.js graph model ({error!r}).") from error


def _weights(entries: list[dict[str, Any]], data: bytes) -> Iterator[tuple[str, Array]]:
    at = 0
    for entry in entries:
        name, shape = str(entry["name"]), tuple(int(length) for length in entry["shape"])
        count = math.prod(shape)
        if any(length < 0 for length in shape) or count > MAX_WEIGHTS:
            raise WeightsError(f"The model's weight '{name}' has the impossible shape {shape}.")
        quantization = entry.get("quantization")
        stored = np.dtype(DTYPES[quantization["dtype"] if quantization else entry["dtype"]])
        end = at + count * stored.itemsize
        if end > len(data):
            raise WeightsError(f"The weights end within '{name}': {len(data)} bytes, at least {end} are needed.")
        values = np.frombuffer(data, stored, count, at).reshape(shape)
        at = end
        if quantization and "scale" in quantization:
            values = values.astype(np.float32) * np.float32(quantization["scale"]) + np.float32(quantization["min"])
        yield name, values.astype(DTYPES[entry["dtype"]])
    if at != len(data):
        raise WeightsError(f"The weights hold {len(data)} bytes, their description only {at}: not of one model.")
