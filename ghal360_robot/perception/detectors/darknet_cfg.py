"""Darknet's `.cfg` files: sections of keys and values, in the order of the layers."""

from __future__ import annotations

from dataclasses import dataclass, field

from ghal360_robot.perception.detectors.errors import WeightsError

LAYERS = frozenset({"convolutional", "maxpool", "upsample", "route", "shortcut", "yolo"})
MAX_LAYERS = 400
"""YOLOv3 has 107, its largest relatives not twice as many."""
MAX_SIDE = 2048
TINY_MASKS = ((3, 4, 5), (0, 1, 2))


@dataclass(frozen=True, slots=True)
class Section:
    """One layer, or the head of the file."""

    kind: str
    values: dict[str, str] = field(default_factory=dict)

    def integer(self, key: str, default: int | None = None) -> int:
        numbers = self.integers(key, None if default is None else (default,))
        if len(numbers) != 1:
            raise WeightsError(f"The cfg's [{self.kind}] has {len(numbers)} values for '{key}', not one.")
        return numbers[0]

    def integers(self, key: str, default: tuple[int, ...] | None = None) -> tuple[int, ...]:
        """Raises WeightsError where the key is missing without a default or no list of numbers."""
        text = self.values.get(key)
        if text is None:
            if default is None:
                raise WeightsError(f"The cfg's [{self.kind}] has no '{key}'.")
            return default
        try:
            return tuple(int(float(part)) for part in text.split(",") if part.strip())
        except (ValueError, OverflowError):
            raise WeightsError(f"The cfg's [{self.kind}] has '{key} = {text}', which are no numbers.") from None


@dataclass(frozen=True, slots=True)
class Config:
    """A network: side of its square input, and its layers in order."""

    side: int
    layers: tuple[Section, ...]


def parse_cfg(text: str) -> Config:
    """Raises WeightsError where this is no description of a YOLO network."""
    sections: list[Section] = []
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.split("#")[0].split(";")[0].strip()
        if line.startswith("[") and line.endswith("]"):
            sections.append(Section(line[1:-1].strip()))
        elif line:
            key, equals, value = line.partition("=")
            if not equals or not sections:
                raise WeightsError(f"Line {number} of the cfg is no 'key = value' in a section: {line[:40]!r}.")
            sections[-1].values[key.strip()] = value.strip()
    if not sections or sections[0].kind not in {"net", "network"}:
        raise WeightsError("The cfg does not begin with [net]: it is no darknet network.")
    head, layers = sections[0], tuple(sections[1:])
    unknown = next((layer.kind for layer in layers if layer.kind not in LAYERS), None)
    if unknown is not None:
        raise WeightsError(f"The cfg has a layer [{unknown}], which is not known here: {', '.join(sorted(LAYERS))}.")
    if not 1 <= len(layers) <= MAX_LAYERS or not any(layer.kind == "yolo" for layer in layers):
        raise WeightsError(f"The cfg has {len(layers)} layers and has to have 1 to {MAX_LAYERS} with a [yolo] in them.")
    side, height, channels = head.integer("width"), head.integer("height"), head.integer("channels", 3)
    if side != height or not 32 <= side <= MAX_SIDE or side % 32 or channels != 3:
        raise WeightsError(f"The cfg's input is {side} x {height} x {channels}, not a square multiple of 32 in colour.")
    return Config(side, with_trained_masks(layers))


def with_trained_masks(layers: tuple[Section, ...]) -> tuple[Section, ...]:
    """The layers with YOLOv3-tiny's fine head given the anchors it was trained with.

    Its published cfg says `mask = 0,1,2` there, but the published weights go with 1,2,3: average precision 0.20
    instead of 0.14 (fact sheet on the detector, section 2).
    """
    yolo = [layer for layer in layers if layer.kind == "yolo"]
    if tuple(layer.integers("mask", ()) for layer in yolo) != TINY_MASKS:
        return layers
    fine = yolo[1]
    return tuple(Section("yolo", {**fine.values, "mask": "1,2,3"}) if layer is fine else layer for layer in layers)
