"""onnx: detectors in ONNX files through onnxruntime (extra [onnx]), told apart by their inputs and outputs.

yolox: one output (1, cells, 5 + classes); BGR 0..255 at the upper left of a grey square (YOLOX, demo/ONNXRuntime).
deim: DEIM, D-FINE and RT-DETR as they export: `images` and `orig_target_sizes` to `labels`, `boxes`, `scores`; RGB
0..1, stretched to the square.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.perception.detectors.boxes import Boxes, suppress
from ghal360_robot.perception.detectors.coco import CLASSES
from ghal360_robot.perception.detectors.errors import DetectorError, WeightsError
from ghal360_robot.perception.detectors.letterbox import Placing, letterbox, stretch
from ghal360_robot.perception.detectors.names_file import class_names
from ghal360_robot.perception.detectors.network import SquareNetwork

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.base import DetectorOptions
    from ghal360_robot.perception.detectors.network import Outputs
    from ghal360_robot.perception.detectors.store import Entry, Proposed

    Picture = NDArray[np.uint8]

STRIDES = (8, 16, 32)
"""YOLOX's three grids."""
LIMIT = 100
SAME = 0.65
"""YOLOX's own suppression threshold in evaluation."""
MAX_SIDE = 4096
"""No detector's input is larger; a file that says so would take all memory."""
MAX_EXPONENT = 20.0
"""exp(20) cells are more than any picture has; without the bound a broken file's boxes are infinite."""
SCORES = {"yolox": 0.29, "deim": 0.41}
"""Scores with the best F1 on COCO photographs (fact sheet on the detector, section 3)."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """What a file's inputs and outputs say about it."""

    decoder: str
    side: int
    n_classes: int | None


class OnnxNetwork(SquareNetwork):
    """One ONNX file."""

    def __init__(self, name: str, model: bytes, classes: tuple[str, ...], *, threads: int = 1, cuda: bool) -> None:
        """Raises DetectorError without onnxruntime, WeightsError where the file is no detector known here."""
        self.name = name
        self.class_names = classes
        self._session = _session(model, threads, cuda=cuda)
        self.layout = _layout(self._session)
        if self.layout.n_classes not in (None, len(classes)):
            raise WeightsError(
                f"The detector '{name}' tells {self.layout.n_classes} classes apart, but {len(classes)} names "
                "were given for them: add it again with the right list of names (--classes FILE)."
            )
        self.side = self.layout.side
        self.default_score = SCORES[self.layout.decoder]
        self._yolox = self.layout.decoder == "yolox"
        self.background = 114 if self._yolox else 0
        self._grid, self._stride = _cells(self.side)

    def place(self, picture: Picture, square: Picture) -> Placing:
        if self._yolox:
            return letterbox(picture, square, centred=False, quick=True)
        return stretch(picture, square, quick=True)

    def run(self, batch: Picture) -> Iterator[Outputs]:
        for square in batch:
            yield self._run_one(square)

    def decode(self, outputs: Outputs, min_score: float) -> Boxes:
        return self._decode_yolox(outputs[0], min_score) if self._yolox else self._decode_deim(outputs, min_score)

    def _run_one(self, square: Picture) -> Outputs:
        if self._yolox:
            picture = _channels_first(square[:, :, ::-1], 1.0)
            return (self._session.run(None, {self._session.get_inputs()[0].name: picture})[0][0],)
        size = np.array([[self.side, self.side]], np.int64)
        feed = {"images": _channels_first(square, 1 / 255), "orig_target_sizes": size}
        labels, boxes, scores = self._session.run(["labels", "boxes", "scores"], feed)
        return labels[0], boxes[0], scores[0]

    def _decode_yolox(self, rows: NDArray[np.float32], min_score: float) -> Boxes:
        # No score is above its objectness, and most rows are nothing.
        maybe = np.flatnonzero(rows[:, 4] > min_score)
        best = rows[maybe, 5:].argmax(axis=1)
        score = rows[maybe, 4] * rows[maybe, 5 + best]
        good = score > min_score
        at, best, score = maybe[good], best[good], score[good]
        rows, stride = rows[at], self._stride[at, None]
        centre = (rows[:, :2] + self._grid[at]) * stride
        half = np.exp(np.minimum(rows[:, 2:4], MAX_EXPONENT)) * stride / 2
        xyxy = np.hstack((centre - half, centre + half)).astype(np.float32)
        return suppress(Boxes(xyxy, score, best), SAME, LIMIT)

    def _decode_deim(self, outputs: Outputs, min_score: float) -> Boxes:
        labels, boxes, scores = outputs
        good = np.flatnonzero((scores > min_score) & (labels >= 0) & (labels < len(self.class_names)))
        good = good[np.argsort(-scores[good], kind="stable")[:LIMIT]]
        return Boxes(boxes[good].astype(np.float32), scores[good], labels[good].astype(np.intp))


def load(entry: Entry | Proposed, options: DetectorOptions) -> OnnxNetwork:
    """The network with the file that was added. Raises DetectorError, WeightsError."""
    classes = class_names(entry.read("names")) if entry.has("names") else CLASSES
    if options.device == "cuda" and "CUDAExecutionProvider" not in _runtime().get_available_providers():
        raise DetectorError("This onnxruntime has no CUDA: install onnxruntime-gpu, or use device = cpu.")
    return OnnxNetwork(entry.name, entry.read("model"), classes, threads=options.threads, cuda=options.device != "cpu")


def _runtime() -> Any:
    try:
        import onnxruntime  # noqa: PLC0415 - an extra
    except ImportError:
        raise DetectorError("ONNX detectors need onnxruntime: pip install 'ghal360-robot[onnx]'.") from None
    return onnxruntime


def _session(model: bytes, threads: int, *, cuda: bool) -> Any:
    runtime = _runtime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    # Waiting threads that spin take the cores away from decoder and control loop.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    wanted = ("CUDAExecutionProvider", "CPUExecutionProvider") if cuda else ("CPUExecutionProvider",)
    providers = [name for name in wanted if name in runtime.get_available_providers()]
    try:
        return runtime.InferenceSession(model, options, providers=providers)
    except Exception as error:
        # onnxruntime's errors have no common root but Exception.
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise WeightsError(f"onnxruntime cannot load this file ({first}): it is damaged or no ONNX model.") from error


def _layout(session: Any) -> _Layout:
    inputs = {item.name: item.shape for item in session.get_inputs()}
    outputs = {item.name: item.shape for item in session.get_outputs()}
    shape = session.get_inputs()[0].shape
    if "images" in inputs and "orig_target_sizes" in inputs and {"labels", "boxes", "scores"} <= outputs.keys():
        return _Layout("deim", _side(inputs["images"]), None)
    (first, *others) = outputs.values()
    if len(inputs) == 1 and not others and len(first) == 3 and isinstance(first[2], int) and first[2] > 5:
        layout = _Layout("yolox", _side(shape), first[2] - 5)
        if first[1] == sum((layout.side // stride) ** 2 for stride in STRIDES):
            return layout
    raise WeightsError(
        "This ONNX file is no detector known here: neither YOLOX (one output of rows) nor of the DEIM, D-FINE, "
        f"RT-DETR kind (labels, boxes, scores); it has {dict(inputs)} and {dict(outputs)}."
    )


def _side(shape: list[Any]) -> int:
    if len(shape) != 4 or shape[1] != 3 or shape[2] != shape[3] or not isinstance(shape[2], int):
        raise WeightsError(f"This ONNX file's input {shape} is not one square picture of known size.")
    if not 32 <= shape[2] <= MAX_SIDE or shape[2] % STRIDES[-1]:
        raise WeightsError(f"This ONNX file's input of {shape[2]} pixels is no multiple of 32 up to {MAX_SIDE}.")
    return int(shape[2])


def _cells(side: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Column and row (n, 2), and stride (n,), of every row of a YOLOX output."""
    grids, strides = [], []
    for stride in STRIDES:
        across = np.arange(side // stride)
        x, y = np.meshgrid(across, across)
        grids.append(np.stack((x.ravel(), y.ravel()), 1))
        strides.append(np.full(x.size, stride))
    return np.concatenate(grids).astype(np.float32), np.concatenate(strides).astype(np.float32)


def _channels_first(square: Picture, scale: float) -> NDArray[np.float32]:
    return np.multiply(square.transpose(2, 0, 1)[None], np.float32(scale), dtype=np.float32, order="C")
