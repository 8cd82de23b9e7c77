"""What the robot's process and the simulated hardware's process say to each other besides the device wires.

One JSON object a line over a socket pair. The robot's brain never sees any of it: the truth feeds the
virtual operator's eyes and the summary, the cuts come from a fault plan.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from ghal360_robot.errors import UsageError
from ghal360_robot.messages import HeadPose, OperatorInput, Pose2
from ghal360_robot.simulation.plant import Body

if TYPE_CHECKING:
    import asyncio

DEVICES = ("theta", "tim571", "rmp110")


@dataclass(frozen=True, slots=True)
class Cut:
    """One device is unplugged `at_s` seconds after the start, for `for_s` seconds."""

    device: str
    at_s: float
    for_s: float

    @classmethod
    def parse(cls, text: str) -> Cut:
        """`tim571@10+5`: the lidar is gone from second 10 to 15. Raises UsageError."""
        device, _, times = text.partition("@")
        at, _, span = times.partition("+")
        try:
            cut = cls(device, float(at), float(span))
        except ValueError as error:
            raise UsageError(f"'{text}' is no cut: write DEVICE@START+SECONDS, for example tim571@10+5") from error
        if device not in DEVICES or not (0 <= cut.at_s < 1e6 and 0 < cut.for_s < 1e6):
            raise UsageError(f"'{text}' is no cut: the device is one of {', '.join(DEVICES)}, times are seconds")
        return cut


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything the simulated hardware needs to know at its start."""

    world: str = "office"
    seed: int = 0
    target: str = "backpack"
    camera_hz: float = 12.0
    camera_images: str | None = None
    painted: bool = True
    """Things wear the paint of their class, for the `painted` detector, instead of looking natural."""
    lidar_replay: str | None = None
    lidar_dialect: str = "b"
    operator: bool = False
    """Whether a virtual operator sits in front of the picture."""
    cuts: tuple[Cut, ...] = field(default_factory=tuple)
    camera_tape: str | None = None
    """File that gets the SHA-256 of every access unit the camera takes, a line each: what a recording must hold."""

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Scenario:
        return cls(**{**data, "cuts": tuple(Cut(**cut) for cut in data["cuts"])})


@dataclass(frozen=True, slots=True)
class Endpoints:
    """Where the three simulated devices listen: loopback ports of USB/IP, SOPAS and socketcand."""

    theta: int
    tim571: int
    rmp110: int


@dataclass(frozen=True, slots=True)
class Truth:
    """The body's true state at an instant of the shared monotonic clock, and how the camera is doing."""

    stamp_ns: int
    body: Body
    camera: dict[str, float] = field(default_factory=dict)
    target_in_view: bool | None = None
    """Whether the target was really in view when the virtual operator pressed "found"; None before."""

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Truth:
        body = data["body"]
        return cls(**{**data, "body": Body(**{**body, "pose": Pose2(**body["pose"])})})


def operator_from_json(data: dict[str, Any]) -> OperatorInput:
    """A message of the virtual operator, who drives by looking and has no stick."""
    return OperatorInput(**{**data, "head": HeadPose(**data["head"]), "stick": None})


def send(writer: asyncio.StreamWriter, kind: str, value: Any) -> None:
    """Write one line: `{kind: value}`; dataclasses become objects."""
    body = asdict(value) if hasattr(value, "__dataclass_fields__") else value
    writer.write(json.dumps({kind: body}).encode() + b"\n")


async def receive(reader: asyncio.StreamReader) -> tuple[str, Any] | None:
    """The next line as (kind, value), or None when the other side is gone."""
    try:
        line = await reader.readline()
    except ConnectionError:
        return None
    if not line.endswith(b"\n"):
        return None
    ((kind, value),) = json.loads(line).items()
    return kind, value
