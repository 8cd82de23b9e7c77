"""What page and server say to each other: JSON texts, one message each, checked by the same models on both sides.

`page/src/protocol.gen.ts` is made of these models by `telepresence.typescript`. Angles are radians in the base frame
(REP-103: yaw counter-clockwise, zero ahead), lengths metres. Instants are microseconds of the robot's monotonic
clock: a browser's numbers are exact to 2^53, which as nanoseconds would be over after 104 days.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

VERSION = 1

MAX_TEXT_BYTES = 2048
"""A page's longest message has 400 bytes."""

MAX_WORDS = 300
MAX_NOTE = 200
MAX_BOXES = 32
MAX_APPROACHING = 12
MAX_REASONS = 12
MAX_BEAMS = 720

Number = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-4 * math.pi, le=4 * math.pi, allow_inf_nan=False)]
Opening = Annotated[float, Field(gt=0.0, lt=math.tau, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, lt=1_000_000_000)]
Micros = Annotated[int, Field(ge=0, le=2**53 - 1)]
Millis = Annotated[float, Field(ge=0.0, le=1e12, allow_inf_nan=False)]
Words = Annotated[str, Field(max_length=MAX_WORDS)]
Name = Annotated[str, Field(max_length=64)]
Unit = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]


class Message(BaseModel):
    """Unknown fields, wrong types and numbers out of bounds are errors, not guesses."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Stick(Message):
    """A wish of the hand, as shares of what the robot may do at most: `v` forward, `w` counter-clockwise."""

    v: Unit
    w: Unit


class Operate(Message):
    """The driver's sign of life, at 20 Hz or more: where they look and what they hold. The newest counts.

    Presses are running counts of this connection. `sent_us` is the page's idea of the robot's clock.
    """

    kind: Literal["operate"]
    conn: Name
    seq: Count
    sent_us: Micros
    yaw: Angle
    pitch: Angle
    fov_h: Opening
    fov_v: Opening
    mode: Literal["screen", "touch", "xr"]
    deadman: bool
    stick: Stick | None
    arm: Count
    disarm: Count
    found: Count


class Stop(Message):
    """Anybody may stop. `press` is a running count of this connection, so that a repeat is no second press."""

    kind: Literal["stop"]
    level: Literal["disarm", "estop"]
    press: Count


class LeaseWish(Message):
    """Ask to drive, or answer who asks: give it to them, keep it, let go of it, or take it although it is held."""

    kind: Literal["lease"]
    wish: Literal["ask", "take", "release", "hand_over", "keep"]


class Bookmark(Message):
    """Anybody may mark this moment in the recording, with a few words on it."""

    kind: Literal["bookmark"]
    note: Annotated[str, Field(max_length=MAX_NOTE)] = ""


class Shown(Message):
    """The newest picture that is on the screen, and how it is going."""

    kind: Literal["shown"]
    seq: Count
    dropped: Count
    """Pictures that the page did not decode, or not show, since it was opened."""


class Echo(Message):
    """Answer to a probe, at once."""

    kind: Literal["echo"]
    nonce: Count


class Ping(Message):
    """The page's own question for the robot's clock; `t0` is any number of the page's."""

    kind: Literal["ping"]
    t0: Millis


FromPage = Annotated[Operate | Stop | LeaseWish | Bookmark | Shown | Echo | Ping, Field(discriminator="kind")]


class Speed(Message):
    """m/s and rad/s."""

    v: Number
    w: Number


class Place(Message):
    """Odometry frame."""

    x: Number
    y: Number
    yaw: Angle


class Box(Message):
    """Something detected: direction of its middle and angular size."""

    name: Name
    score: Number
    yaw: Angle
    pitch: Angle
    width: Opening
    height: Opening
    target: bool


class Device(Message):
    """One device's link in a word, why in words, and the age of what it sent last."""

    link: Name
    detail: Words
    age_s: Number | None
    ok: bool


class Hello(Message):
    """The first message of every connection."""

    kind: Literal["hello"]
    version: int
    conn: Name
    name: Name
    """What others see of this operator."""
    role: Literal["viewer", "driver"]
    robot: Name
    target: Name
    v_max: Number
    w_max: Number
    camera_yaw: Angle
    """Where the picture's centre column looks."""
    picture_hold_s: Number
    blind: tuple[Angle, Angle]
    """The sector that the lidar cannot see, counter-clockwise from the first to the second."""
    streams: tuple[Literal["camera", "small", "stills"], ...]
    arrow: Literal["wedges", "continuous"] = "wedges"
    """Whether the arrow to `State.target` is shown from the start, beside the cues."""


class Pong(Message):
    kind: Literal["pong"]
    t0: Millis
    received_us: Micros
    sent_us: Micros


class Probe(Message):
    """Has to be echoed at once: how the server measures the round trip."""

    kind: Literal["probe"]
    nonce: Count


class State(Message):
    """What the robot sees, decides and does; 20 times a second, and at once when a cue or the arming changes."""

    kind: Literal["state"]
    t_us: Micros
    tick: Count
    arm: Literal["disarmed", "armed", "estop"]
    blockers: tuple[Words, ...] = Field(max_length=MAX_REASONS)
    """What would keep a press from arming; empty when it would arm."""
    cue: Literal["none", "left", "right", "confirm"]
    cue_us: Micros
    """When it was decided."""
    target: Angle | None
    target_m: Number | None
    """How far the next thing in the target's direction is, by the lidar."""
    intention: Angle | None
    """Where the robot believes that the driver wants to go."""
    found: bool
    boxes: tuple[Box, ...] = Field(max_length=MAX_BOXES)
    boxes_us: Micros
    approaching: tuple[Angle, ...] = Field(max_length=MAX_APPROACHING)
    """Where something comes closer."""
    wanted: Speed
    applied: Speed
    source: Name
    reasons: tuple[Words, ...] = Field(max_length=MAX_REASONS)
    """Why not more than applied."""
    clearance_m: Number | None
    pose: Place | None
    speed: Speed | None
    battery_percent: Number | None
    base: Name
    devices: dict[Name, Device]


class Scan(Message):
    """The lidar's view in the base frame: the nearest return of each step, in centimetres, 0 where there is none."""

    kind: Literal["scan"]
    t_us: Micros
    first: Angle
    step: Angle
    cm: tuple[Annotated[int, Field(ge=0, le=10_000)], ...] = Field(max_length=MAX_BEAMS)


class Floor(Message):
    """The floor around as far as it is known, in the odometry frame, and the way driven so far."""

    kind: Literal["floor"]
    png: Annotated[str, Field(max_length=200_000)]
    """Base64; row 0 is the largest y; white is free, black occupied, grey unknown."""
    resolution_m: Number
    x: Number
    y: Number
    """Of the lower left corner."""
    path: tuple[tuple[Number, Number], ...] = Field(max_length=512)


class Right(Message):
    """Who drives, as this connection has to know it."""

    kind: Literal["right"]
    driver: Name | None
    yours: bool
    asking: Name | None
    """Who asks the driver for it."""
    may_take: bool
    """Whether `take` would be granted now."""
    words: Words


class Quality(Message):
    """How this connection is doing, measured at the robot; `lock` says why it may not drive, empty if it may."""

    kind: Literal["quality"]
    round_trip_ms: Number | None
    loop_ms: Number | None
    """From a picture's arrival at the robot until the robot heard that it is shown."""
    picture_ms: Number | None
    """Age of the newest picture that is known to be shown."""
    dropped: Count
    """Pictures not sent to this connection."""
    bit_rate: Annotated[float, Field(ge=0.0, le=1e12, allow_inf_nan=False)]
    lock: Words
    viewers: Count


class Refused(Message):
    """Something this connection sent was not taken."""

    kind: Literal["refused"]
    what: Name
    why: Words


FromServer = Annotated[
    Hello | Pong | Probe | State | Scan | Floor | Right | Quality | Refused, Field(discriminator="kind")
]

_FROM_PAGE: TypeAdapter[Operate | Stop | LeaseWish | Bookmark | Shown | Echo | Ping] = TypeAdapter(FromPage)
FROM_SERVER: TypeAdapter[Hello | Pong | Probe | State | Scan | Floor | Right | Quality | Refused] = TypeAdapter(
    FromServer
)


class MalformedError(ValueError):
    """A message that is none; the text is for the log."""


def parse(text: str) -> Operate | Stop | LeaseWish | Bookmark | Shown | Echo | Ping:
    """A message from a page. Raises MalformedError for anything else."""
    if len(text) > MAX_TEXT_BYTES:
        raise MalformedError(f"message of {len(text)} characters")
    try:
        return _FROM_PAGE.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"])[:80]
        raise MalformedError(f"{where or 'message'}: {first['msg']}"[:MAX_WORDS]) from error
    except RecursionError as error:
        raise MalformedError("message nested too deep") from error
