"""One name for each class of object, whatever a detector or a person calls it. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

SYNONYMS: Mapping[str, str] = MappingProxyType(
    {
        "tv": "television",
        "tvmonitor": "television",
        "tv monitor": "television",
        "monitor": "television",
        "screen": "television",
        "telly": "television",
        "notebook": "laptop",
        "computer": "laptop",
        "rucksack": "backpack",
        "knapsack": "backpack",
        "bag": "backpack",
        "flask": "bottle",
        "water bottle": "bottle",
        "pottedplant": "potted plant",
        "plant": "potted plant",
        "houseplant": "potted plant",
        "sofa": "couch",
        "settee": "couch",
        "diningtable": "dining table",
        "table": "dining table",
        "fridge": "refrigerator",
        "cellphone": "cell phone",
        "phone": "cell phone",
        "mobile": "cell phone",
        "mug": "cup",
        "bike": "bicycle",
        "motorbike": "motorcycle",
        "aeroplane": "airplane",
        "people": "person",
        "human": "person",
    }
)
"""What else things are called, in detectors' class lists (COCO, VOC, darknet) and by people."""


def canonical(name: str) -> str:
    """The name by which this class is known throughout the robot; unknown names stay as they are."""
    plain = " ".join(name.replace("_", " ").lower().split())
    return SYNONYMS.get(plain, plain)
