"""Where and how a torch network computes: device, number format, threads, batches."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
import torch

from ghal360_robot.perception.detectors.errors import DetectorError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.base import DetectorOptions

Device = Literal["auto", "cpu", "cuda"]
Precision = Literal["auto", "float32", "bfloat16", "float16"]

DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}


@dataclass(frozen=True, slots=True)
class Compute:
    """What a network may use. `threads` counts for the CPU only; 0 leaves torch's own choice."""

    device: Device = "auto"
    precision: Precision = "auto"
    threads: int = 1

    @classmethod
    def of(cls, options: DetectorOptions) -> Self:
        return cls(options.device, options.precision, options.threads)

    def chosen_device(self) -> torch.device:
        """CUDA where there is some, unless told otherwise. Raises DetectorError where there is none but has to be."""
        if self.device == "cuda" and not torch.cuda.is_available():
            raise DetectorError("There is no CUDA device (or torch was installed without CUDA): use device = cpu.")
        return torch.device("cuda" if self.device != "cpu" and torch.cuda.is_available() else "cpu")

    def chosen_dtype(self) -> torch.dtype:
        """Half precision on CUDA, single precision on a CPU, unless told otherwise."""
        if self.precision != "auto":
            return DTYPES[self.precision]
        return torch.float16 if self.chosen_device().type == "cuda" else torch.float32


class Engine:
    """A torch module ready to run, without gradients, channels last: that is how its convolutions are fast."""

    def __init__(self, module: torch.nn.Module, compute: Compute) -> None:
        """Raises DetectorError where the device cannot hold it."""
        self.device, self.dtype, self.threads = compute.chosen_device(), compute.chosen_dtype(), compute.threads
        module = module.eval().requires_grad_(requires_grad=False)
        try:
            self._module = module.to(self.device, self.dtype, memory_format=torch.channels_last)  # type: ignore[call-overload]
        except (RuntimeError, MemoryError) as error:
            raise DetectorError(f"The network does not fit on the {self.device.type} device ({error}).") from error
        # A CPU is faster with one tile after the other, whose features stay in its caches; a GPU with all at once.
        self.batch = 64 if self.device.type == "cuda" else 1

    def __call__(self, pictures: NDArray[np.uint8]) -> Iterator[tuple[torch.Tensor, ...]]:
        """The module's outputs for each batch of pictures (n, h, w, 3) uint8, in order; pictures are 0..255 RGB."""
        for begin in range(0, len(pictures), self.batch):
            with self._settled():
                # A view: (n, h, w, 3) in memory is channels last already.
                batch = torch.from_numpy(pictures[begin : begin + self.batch]).permute(0, 3, 1, 2)
                outputs = self._module(batch.to(self.device, non_blocking=True).to(self.dtype))
            yield outputs if isinstance(outputs, tuple) else (outputs,)

    @contextmanager
    def _settled(self) -> Iterator[None]:
        # torch keeps the number of threads for each calling thread: set here, it holds where the work is done.
        if self.threads and torch.get_num_threads() != self.threads:
            torch.set_num_threads(self.threads)
        with torch.inference_mode():
            yield


def rows_last(maps: torch.Tensor) -> NDArray[np.float32]:
    """Maps (n, channels, h, w) as numpy (n, h, w, channels) float32, without a copy where they lie so already."""
    return maps.permute(0, 2, 3, 1).contiguous().float().cpu().numpy()
