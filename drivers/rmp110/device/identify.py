"""Finding out what base answers before anything may move (fact sheet section 13).

Nothing sent here can move a base of dialect B2 or B3: polls, command 30, and writes of parameters.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

from drivers.rmp110.codec.assembler import Packet, ReplyCollector
from drivers.rmp110.codec.commands import POLL, configure, force_config_feedback
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS, CONFIG_REPLY_FRAMES, Dialect, Layout
from drivers.rmp110.codec.frames import Frame, as_float32
from drivers.rmp110.codec.motion import MotionScale
from drivers.rmp110.codec.parameters import (
    BY_NAME,
    PARAMETERS,
    RMP110_TRACK_MINIMUM_M,
    Number,
    OperationalState,
    Stored,
)
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.link import Link
from drivers.rmp110.device.state import NEEDED, Identity
from drivers.rmp110.errors import RmpSilent, RmpUnsupported

LISTEN_S = 0.3
"""Three periods of the slowest sensible command stream (10 Hz): is somebody else driving?"""
PROBE_PERIOD_S, PROBES = 0.1, 5
"""Five polls at 10 Hz; a base that is on answers the first."""
REPLY_TIMEOUT_S = 0.15
"""Reply within 10 ms, longest packet 6.5 ms, then 20 ms of quiet; the rest is for a busy computer."""
READ_ATTEMPTS = 5
WRITE_SPACING_S = 0.05
"""The vendor's own sample leaves 50 ms between configuration writes."""
WRITE_ROUNDS = 3

MUST_MATCH = ("max_accel", "max_decel", "max_yaw_accel", "tire_diameter", "gear_ratio")
"""Stored parameters that change how far and how fast the base really goes for the same command."""

SILENT = (
    "the base does not answer: switch it on (after a kill switch it needs its power button), "
    "check the CAN cable and the bit rate of 1 Mbit/s; an old RMP with 0x400 ids cannot be used"
)


@dataclass(frozen=True, slots=True)
class Reply:
    """What followed a request: whether anything did, and the packet where it came whole."""

    heard: bool
    packet: Packet | None = None


async def listen(link: Link) -> None:
    """Hear whether somebody else commands the base before sending anything. Raises RmpForeignCommands."""
    await link.pause(LISTEN_S)


async def probe(link: Link) -> bool:
    """Whether polls are answered. A base whose feedback bitmaps are all zero does not, and is still there."""
    for _ in range(PROBES):
        collector = _collect(link)
        if not link.try_send(POLL):
            await link.pause(PROBE_PERIOD_S)
        elif await link.wait(lambda c=collector: c.started, PROBE_PERIOD_S):  # type: ignore[misc]
            await _until_quiet(link, collector)
            return True
    return False


async def read_stored(link: Link) -> tuple[Dialect, Stored]:
    """Dialect by reply length and the stored parameters, read until two replies in a row are the same.

    Raises RmpSilent, RmpUnsupported.
    """
    try:
        words = await _read_words(link)
    except BaseException:
        # Whatever happened: never leave the base answering with parameters instead of its state.
        link.farewell(force_config_feedback(on=False))
        raise
    await _ask(link, force_config_feedback(on=False))
    return _interpret(words)


async def _read_words(link: Link) -> tuple[int, ...]:
    """The configuration reply, once two in a row are the same."""
    before = await _ask(link, force_config_feedback(on=True))
    words: tuple[int, ...] | None = None
    for _ in range(READ_ATTEMPTS):
        reply = await _ask(link, POLL)
        if not (reply.heard or before.heard):
            raise RmpSilent(SILENT)
        before = reply
        if reply.packet:
            if reply.packet.words == words:
                return words
            words = reply.packet.words
    raise RmpUnsupported("the base's configuration replies differ from each other: frames get lost on the bus")


def _interpret(words: tuple[int, ...]) -> tuple[Dialect, Stored]:
    dialect = CONFIG_REPLY_FRAMES.get(len(words) // 2)
    if dialect is not Dialect.B2:
        spoken = f"dialect {dialect.value}" if dialect else f"a dialect with {len(words) // 2} configuration frames"
        raise RmpUnsupported(f"the base speaks {spoken}; this driver moves bases of dialect B2 only")
    stored = Stored(words)
    for parameter in PARAMETERS[: Number.GEAR_RATIO]:
        track = parameter.number == Number.TRACK_WIDTH
        low_enough = track and RMP110_TRACK_MINIMUM_M - 1e-6 <= stored[parameter.name] <= parameter.maximum
        if not (low_enough or parameter.accepts(words[parameter.number - 1])):
            raise RmpUnsupported(
                f"the base's reply does not look like stored parameters ({parameter.name} reads "
                f"{stored[parameter.name]:g}); this is not an RMP of dialect B2"
            )
    return dialect, stored


async def read_mode(link: Link, layout: Layout) -> OperationalState:
    """The mode the base reports; UNKNOWN where its feedback set does not tell."""
    packet = (await _ask(link, POLL)).packet
    if packet is None or len(packet.words) < len(layout.words) or layout.missing(["operational_state"]):
        return OperationalState.UNKNOWN
    return OperationalState.of(int(layout.decode(packet.words)["operational_state"]))


async def write_differing(link: Link, stored: Stored, config: Rmp110Config, *, parameters: bool) -> Stored:
    """Write what differs and is allowed to be written; the parameters as they are afterwards.

    A base keeps its old value where it refuses one: that shows in the read-back and is not an error here.
    """
    wanted = dict(config.expected) if parameters else {}
    if config.write_feedback_set:
        wanted |= {f"feedback_bitmap_{n}": word for n, word in enumerate(COMPACT_BITMAPS, start=1)}
    for _ in range(WRITE_ROUNDS):
        differing = stored.differing(wanted)
        if not differing:
            break
        for name, (_, value) in differing.items():
            link.try_send(configure(BY_NAME[name].number, value))
            await link.pause(WRITE_SPACING_S)
        _, stored = await read_stored(link)
    return stored


def conclude(dialect: Dialect, stored: Stored, config: Rmp110Config) -> Identity:
    """What the driver may do with a base that has these parameters. Raises RmpUnsupported."""
    layout = Layout.of(stored.bitmaps)
    missing = layout.missing(NEEDED)
    if missing:
        raise RmpUnsupported(
            f"the base's feedback set lacks {', '.join(missing[:3])}{' and more' if len(missing) > 3 else ''}: "
            "allow the driver to write it (write_feedback_set)"
        )
    for name in ("max_velocity", "max_yaw_rate"):
        if stored[name] <= 0:
            raise RmpUnsupported(f"the base has stored {name} = 0 and cannot move: allow write_parameters")
    differences = stored.differing(config.expected)
    hard = [name for name in MUST_MATCH if name in differences]
    refusal = None
    if hard:
        name = hard[0]
        have, want = differences[name]
        refusal = (
            f"the base has stored {name} = {have:g} {BY_NAME[name].unit}, the configuration expects {want:g}: "
            "allow the driver to write it (write_parameters) or correct the configuration"
        )
    scale = MotionScale(
        stored["max_velocity"],
        stored["max_yaw_rate"],
        config.max_v_mps,
        config.max_w_rps,
        as_float32(config.track_m) / stored["track_width"],
    )
    return Identity(dialect, stored, layout, scale, differences, refusal)


def _collect(link: Link) -> ReplyCollector:
    collector = ReplyCollector()

    def feed(stamp_ns: int, frame: Frame) -> None:
        collector.feed(stamp_ns, frame)
        link.wake()

    link.consumer = feed
    return collector


async def _ask(link: Link, request: Frame) -> Reply:
    """One request and its reply, of whatever length."""
    collector = _collect(link)
    if not link.try_send(request):
        await link.pause(REPLY_TIMEOUT_S)
        return Reply(heard=False)
    await link.wait(lambda: collector.started, REPLY_TIMEOUT_S)
    await _until_quiet(link, collector)
    return Reply(collector.started, collector.finish())


async def _until_quiet(link: Link, collector: ReplyCollector) -> None:
    deadline = time.monotonic() + REPLY_TIMEOUT_S
    while collector.started and not collector.quiet(time.monotonic_ns()) and time.monotonic() < deadline:
        await link.pause(0.005)
