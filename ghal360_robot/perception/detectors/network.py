"""What every network offers, and the part that they share: pictures into squares, boxes out of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ghal360_robot.perception.detectors.boxes import Boxes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.letterbox import Placing

    Picture = NDArray[np.uint8]
    Outputs = tuple[NDArray[Any], ...]


class Network(Protocol):
    """A detector for ordinary pictures; used by one thread at a time."""

    @property
    def name(self) -> str: ...

    @property
    def class_names(self) -> tuple[str, ...]: ...

    @property
    def side(self) -> int:
        """Pixels of its square input: tiles larger than this are scaled down."""
        ...

    @property
    def default_score(self) -> float:
        """The score at which it does best (F1 on COCO photographs)."""
        ...

    def detect(self, pictures: Sequence[Picture], min_score: float) -> list[Boxes]:
        """Objects in each RGB picture (height, width, 3) uint8, all pictures in one batch. Raises PictureError."""
        ...


class SquareNetwork(ABC):
    """A network with a square input: place each picture, run, read the boxes, and take them back to the picture."""

    name: str
    class_names: tuple[str, ...]
    side: int
    default_score: float
    background = 0
    """Grey level beside a picture that is not square."""

    def detect(self, pictures: Sequence[Picture], min_score: float) -> list[Boxes]:
        batch, placings = self.prepare(pictures)
        found = (self.decode(outputs, min_score) for outputs in self.run(batch))
        return [Boxes(place.back(box.xyxy), box.score, box.kind) for place, box in zip(placings, found, strict=True)]

    def prepare(self, pictures: Sequence[Picture]) -> tuple[Picture, list[Placing]]:
        """The pictures as squares (n, side, side, 3) uint8, and where each one lies in its square."""
        batch = np.full((len(pictures), self.side, self.side, 3), self.background, np.uint8)
        return batch, [self.place(picture, square) for picture, square in zip(pictures, batch, strict=True)]

    @abstractmethod
    def place(self, picture: Picture, square: Picture) -> Placing:
        """Draw one picture into its square, as it was done in training."""

    @abstractmethod
    def run(self, batch: Picture) -> Iterator[Outputs]:
        """The bare network's outputs for each square, in order."""

    @abstractmethod
    def decode(self, outputs: Outputs, min_score: float) -> Boxes:
        """Boxes in pixels of the square."""
