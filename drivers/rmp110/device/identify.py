"""Finding out what base answers on CAN before anything may move (fact sheet section 13).

Nothing sent here can move a base of the 0x500 family: polls, requests for its parameters and its fault log,
and writes of parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from drivers.rmp110.codec.commands import POLL
from drivers.rmp110.codec.dialect import Action, Dialect
from drivers.rmp110.codec.fault_log import PACKET_WORDS, PACKETS, FaultLog, decode_fault_log
from drivers.rmp110.codec.frames import FEEDBACK_ID, Frame
from drivers.rmp110.codec.parameters import OperationalState, Stored
from drivers.rmp110.codec.vocabulary import B1, B2, B3, VOCABULARIES, Vocabulary
from drivers.rmp110.codec.whitelist import guard
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.inquiry import Reply, ask
from drivers.rmp110.device.judgement import Unwritten, check_plausible, judge
from drivers.rmp110.device.language import SILENT, CanLanguage
from drivers.rmp110.device.link import Link
from drivers.rmp110.device.state import Identity, LinkState
from drivers.rmp110.errors import RmpSilent, RmpUnsupported

LISTEN_S = 0.3
"""Three periods of the slowest sensible command stream (10 Hz): is somebody else driving?"""
LATE_REPLIES = 2
"""Whoever was on the bus before may still be answered; a stream brings thirty packets meanwhile (fact sheet 3.5)."""
PROBE_PERIOD_S, PROBES = 0.1, 5
"""Five polls at 10 Hz; a base that is on answers the first."""
READ_ATTEMPTS = 5
WRITE_SPACING_S = 0.05
"""The vendor's own sample leaves 50 ms between configuration writes."""
WRITE_ROUNDS = 3
LOG_ATTEMPTS = 3
"""The log comes in six replies; where one is lost only the first can be asked for again."""

CANDIDATES: Mapping[str, tuple[Vocabulary, ...]] = {"auto": (B2, B3), "b1": (B1,), "b2": (B2,), "b3": (B3,)}
"""By configured dialect. B2 and B3 are asked for their parameters by the same number."""

LOOKS_LIKE_B1 = (
    "the base looks like one of dialect B1 (replies of {} frames): the question that tells the others may latch "
    "a fault in it; set the dialect to b1, or to b2 where you know better"
)

NOT_B1 = (
    "the base is not one of dialect B1 (replies of {} frames, B1 has {} at most): what B1 is asked for its parameters "
    "with would change the feedback set of this one; set the dialect to auto"
)
STREAMS = (
    "the base sends by itself, so that replies cannot be told from its stream: stop the program that asked it to, "
    "then switch the base off and on"
)


async def identify(link: Link, config: Rmp110Config, enter: Callable[[LinkState], None]) -> Identity:
    """Who answers, with what parameters; writes what may be written.

    Raises RmpSilent, RmpUnsupported, RmpLinkError (RmpForeignCommands where somebody else drives).
    """
    books = CANDIDATES[config.dialect]
    link.allow(guard(books[0].dialect))
    enter(LinkState.PROBING)
    await _listen(link)
    reply = await probe(link)
    frames, longest_b1 = len(reply.words) // 2, B1.layout(B1.factory_bitmaps).frame_count
    if config.dialect == "auto" and frames == longest_b1:
        raise RmpUnsupported(LOOKS_LIKE_B1.format(frames))
    if config.dialect == "b1" and frames > longest_b1:
        raise RmpUnsupported(NOT_B1.format(frames, longest_b1))
    enter(LinkState.IDENTIFYING)
    book, stored = await read_stored(link, books)
    link.allow(guard(book.dialect))
    values = await read_values(link, book, stored)
    fault_log = await read_fault_log(link, book) if config.read_fault_log else None
    firmware = _firmware(values, fault_log)
    enter(LinkState.CONFIGURING)
    if config.write_feedback_set:
        bitmaps = {f"feedback_bitmap_{n}": word for n, word in enumerate(book.compact_bitmaps, start=1)}
        stored = await write_differing(link, book, stored, bitmaps)
    unwritten = Unwritten.FORBIDDEN
    if config.write_parameters:
        stored, unwritten = await write_parameters(link, book, stored, config)
    return conclude(book.dialect, stored, config, firmware=firmware, fault_log=fault_log, unwritten=unwritten)


def conclude(
    dialect: Dialect,
    stored: Stored,
    config: Rmp110Config,
    *,
    firmware: str = "",
    fault_log: FaultLog | None = None,
    unwritten: Unwritten = Unwritten.FORBIDDEN,
) -> Identity:
    """What the driver may do with a base of this dialect and with these parameters. Raises RmpUnsupported."""
    book = VOCABULARIES[dialect]
    layout = book.layout(stored.bitmaps)
    speak = partial(CanLanguage, book, layout)
    return judge(
        dialect,
        stored,
        layout,
        config,
        speak,
        input_bits=book.input_bits,
        unwritten=unwritten,
        firmware=firmware,
        fault_log=fault_log,
    )


async def _listen(link: Link) -> None:
    """Hear whether somebody else drives, or the base talks unasked. Raises RmpForeignCommands, RmpUnsupported."""
    begun = 0

    def count(_stamp_ns: int, frame: Frame) -> None:
        nonlocal begun
        begun += frame.can_id == FEEDBACK_ID

    link.consumer = count
    await link.pause(LISTEN_S)
    if begun > LATE_REPLIES:
        raise RmpUnsupported(STREAMS)


async def probe(link: Link) -> Reply:
    """The answer to a poll. A base whose feedback bitmaps are all zero gives none, and is still there."""
    reply = Reply(heard=False)
    for _ in range(PROBES):
        reply = await ask(link, POLL, PROBE_PERIOD_S)
        if reply.packet:
            break
    return reply


async def read_stored(link: Link, books: Sequence[Vocabulary]) -> tuple[Vocabulary, Stored]:
    """Which of these dialects it is, by reply length, and the parameters, once two replies are the same.

    Raises RmpSilent, RmpUnsupported.
    """
    off = books[0].act(Action.FORCE_CONFIG_FEEDBACK, 0)
    try:
        words = await _read_words(link, books)
    except BaseException:
        # Whatever happened: never leave the base answering with parameters instead of its state.
        link.farewell(off)
        raise
    await _back_to_feedback(link, off, words)
    return _interpret(words, books)


async def _back_to_feedback(link: Link, off: Frame, parameters: tuple[int, ...]) -> None:
    """Until replies are no parameters any more: B3's are as long as its feedback, and would pass for it.

    A base whose feedback bitmaps are all zero falls silent then.
    """
    for _ in range(READ_ATTEMPTS):
        heard = (await ask(link, off)).heard
        reply = await ask(link, POLL)
        if reply.words != parameters if reply.packet else not (heard or reply.heard):
            return
    raise RmpUnsupported("the base goes on replying with its parameters instead of its state: switch it off and on")


async def _read_words(link: Link, books: Sequence[Vocabulary]) -> tuple[int, ...]:
    """The configuration reply, once two in a row are the same, or of a length that it cannot have."""
    lengths = [2 * book.config_reply_frames for book in books]
    before = await ask(link, books[0].act(Action.FORCE_CONFIG_FEEDBACK, 1))
    words: tuple[int, ...] | None = None
    for _ in range(READ_ATTEMPTS):
        reply = await ask(link, POLL)
        if not (reply.heard or before.heard):
            raise RmpSilent(SILENT)
        before = reply
        if reply.packet:
            if words and (reply.words == words or len(reply.words) == len(words) not in lengths):
                return words
            words = reply.words
    raise RmpUnsupported("the base's configuration replies differ from each other: frames get lost on the bus")


def _interpret(words: tuple[int, ...], books: Sequence[Vocabulary]) -> tuple[Vocabulary, Stored]:
    frames = len(words) // 2
    book = next((book for book in books if book.config_reply_frames == frames), None)
    if book is None:
        wanted = " or ".join(f"dialect {book.dialect.value} ({book.config_reply_frames})" for book in books)
        other = next((b for b in (B1, B2, B3) if b.config_reply_frames == frames), None)
        spoken = f": it speaks dialect {other.dialect.value}, set that" if other else "; it is none that is known"
        raise RmpUnsupported(
            f"the base replies with {frames} configuration frames, expected was {wanted}{spoken}; "
            "if it reports an unknown command now, switch it off and on"
        )
    stored = book.stored(words)
    check_plausible(stored)
    return book, stored


async def read_values(link: Link, book: Vocabulary, stored: Stored) -> dict[str, float]:
    """The base's state by name; empty where it has no feedback set, or none of its replies comes whole."""
    layout = book.layout(stored.bitmaps)
    for _ in range(READ_ATTEMPTS if layout.frame_count else 0):
        reply = await ask(link, POLL)
        if len(reply.words) == 2 * layout.frame_count:
            return layout.decode(reply.words)
    return {}


async def read_fault_log(link: Link, book: Vocabulary) -> FaultLog | None:
    """The base's fault log; None where it does not come whole."""
    for _ in range(LOG_ATTEMPTS):
        words: list[int] = []
        for number in range(PACKETS):
            reply = await ask(link, book.act(Action.FAULT_LOG, int(number == 0)))
            if len(reply.words) != PACKET_WORDS:
                break
            words += reply.words
        else:
            return decode_fault_log(words)
    return None


async def write_parameters(
    link: Link, book: Vocabulary, stored: Stored, config: Rmp110Config
) -> tuple[Stored, Unwritten]:
    """Write the parameters that differ; as they are afterwards, and why some may still differ.

    They change how a base brakes: nothing is written unless the base says that it is in STANDBY.
    """
    values = await read_values(link, book, stored)
    if OperationalState.of(int(values.get("operational_state", -1))) is not OperationalState.STANDBY:
        return stored, Unwritten.POSTPONED
    bitmap = book.input_bits.cleaned(int(stored["input_bitmap"]))
    stored = await write_differing(link, book, stored, {"input_bitmap": bitmap, **config.expected})
    return stored, Unwritten.REFUSED


async def write_differing(link: Link, book: Vocabulary, stored: Stored, wanted: Mapping[str, float]) -> Stored:
    """Write what differs; the parameters as they are afterwards.

    A base keeps its old value where it refuses one: that shows in the read-back and is not an error here.
    """
    for _ in range(WRITE_ROUNDS):
        differing = stored.differing(wanted)
        if not differing:
            break
        for name, (_, value) in differing.items():
            link.try_send(book.store(name, value))
            await link.pause(WRITE_SPACING_S)
        _, stored = await read_stored(link, (book,))
    return stored


def _firmware(values: Mapping[str, float], fault_log: FaultLog | None) -> str:
    if "ccu_sp_sw_build_id" in values and "ccu_uip_sw_build_id" in values:
        return f"SP {values['ccu_sp_sw_build_id']:.0f}, UIP {values['ccu_uip_sw_build_id']:.0f}"
    if "packed_build_ids" in values:
        return f"packed build ids 0x{int(values['packed_build_ids']):08X}"
    return f"SP {fault_log.sp_build}, UIP {fault_log.uip_build}" if fault_log else ""
