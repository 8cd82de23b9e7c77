"""Finding out what base answers in V3 before anything may move (fact sheet section 11).

Only for a base that is configured as one of V3: these very packets are said to ruin an older one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.fault_log import FaultLog, decode_fault_log
from drivers.rmp110.codec.faults import GROUPS_V3
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import OperationalState, Stored
from drivers.rmp110.codec.v3.commands import General, continuous_data, general, machine_config
from drivers.rmp110.codec.v3.packets import (
    FAULT_LOG,
    MACHINES,
    RMP110,
    STATUS,
    byte_order,
    machine,
    stored_words,
    unpack_words,
)
from drivers.rmp110.codec.v3.whitelist import INPUT_BITS
from drivers.rmp110.codec.v3.words import LAYOUT, MACHINE_ID_AT, PARAMETERS, STATE_AT
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.judgement import Unwritten, check_plausible, judge
from drivers.rmp110.device.language import SILENT_V3, V3Language
from drivers.rmp110.device.link import Link
from drivers.rmp110.device.state import Identity, LinkState
from drivers.rmp110.errors import RmpSilent, RmpUnsupported

SETTLE_S = 0.05
"""After the stream was stopped: five packets' time for the last one to come."""
ANSWER_S, ATTEMPTS = 0.2, 5
"""A stream starts within a few ticks; together a second, as long as a mode change may take."""
LOG_S, LOG_ATTEMPTS = 0.5, 3
"""1248 bytes take 0.11 s at 115200 baud."""
READ_BACK_S, WRITE_ROUNDS = 3.0, 2
"""The vendor's driver waits three seconds for parameters to be read back."""

NOT_UNDERSTOOD = (
    "the base's packets fit their checksum and cannot be understood: word 12 reads 0x{:08X} in one byte order and "
    "0x{:08X} in the other, and neither is the machine id of an RMP; another firmware has another layout"
)
OTHER_MACHINE = "the base says that it is an {}; this driver drives an RMP 110 only"


async def identify(link: Link, config: Rmp110Config, enter: Callable[[LinkState], None]) -> Identity:
    """Who answers, with what parameters; writes what may be written. Raises RmpSilent, RmpUnsupported."""
    link.expects_replies = False
    enter(LinkState.PROBING)
    link.try_send(continuous_data(on=False))
    await link.pause(SETTLE_S)
    log_data = await _read_fault_log(link) if config.read_fault_log else None
    status = await _read_status(link)
    enter(LinkState.IDENTIFYING)
    order = byte_order(status)
    if order is None:
        raise RmpUnsupported(NOT_UNDERSTOOD.format(*(unpack_words(status, each)[MACHINE_ID_AT] for each in "<>")))
    words = unpack_words(status, order)
    if machine(words) != RMP110:
        raise RmpUnsupported(OTHER_MACHINE.format(MACHINES[machine(words)]))
    stored = _stored(status, order)
    check_plausible(stored)
    enter(LinkState.CONFIGURING)
    unwritten = Unwritten.FORBIDDEN
    if config.write_parameters:
        # They change how a base brakes: never while it may roll.
        unwritten = Unwritten.POSTPONED
        if OperationalState.of(words[STATE_AT]) is OperationalState.STANDBY:
            unwritten = Unwritten.REFUSED
            stored = await _write_differing(link, order, stored, config)
    fault_log = _decode_log(log_data, order)
    firmware = f"packed build ids 0x{words[MACHINE_ID_AT - 1]:08X}"
    if fault_log:
        firmware += f" (fault log: {fault_log.sp_build}, {fault_log.uip_build})"
    return judge(
        Dialect.V3,
        stored,
        LAYOUT,
        config,
        partial(V3Language, order),
        input_bits=INPUT_BITS,
        unwritten=unwritten,
        firmware=firmware,
        fault_log=fault_log,
        fault_groups=GROUPS_V3,
    )


async def _read_status(link: Link) -> bytes:
    """A status packet's words, once the stream is on."""
    for _ in range(ATTEMPTS):
        status = await _next(link, STATUS, continuous_data(on=True), ANSWER_S)
        if status is not None:
            return status
    raise RmpSilent(SILENT_V3)


async def _read_fault_log(link: Link) -> bytes | None:
    for _ in range(LOG_ATTEMPTS):
        data = await _next(link, FAULT_LOG, general(General.FAULT_LOG), LOG_S)
        if data is not None:
            return data
    return None


def _decode_log(data: bytes | None, order: str) -> FaultLog | None:
    return decode_fault_log(unpack_words(data, order)) if data is not None else None


async def _write_differing(link: Link, order: str, stored: Stored, config: Rmp110Config) -> Stored:
    """All parameters go in one command; what the base made of it is read back bit for bit."""
    bitmap = INPUT_BITS.cleaned(int(stored["input_bitmap"]))
    wanted = {**config.expected, "input_bitmap": bitmap}
    for _ in range(WRITE_ROUNDS):
        differing = stored.differing(wanted)
        if not differing:
            break
        link.try_send(machine_config(stored.with_values({name: want for name, (_, want) in differing.items()})))
        deadline_ns = link.clock() + round(READ_BACK_S * 1e9)
        while stored.differing(wanted) and link.clock() < deadline_ns:
            status = await _next(link, STATUS, None, ANSWER_S)
            if status is None:
                link.try_send(continuous_data(on=True))
            else:
                stored = _stored(status, order)
    return stored


def _stored(status: bytes, order: str) -> Stored:
    return Stored(stored_words(unpack_words(status, order)), PARAMETERS)


async def _next(link: Link, kind: int, request: Frame | None, timeout_s: float) -> bytes | None:
    """The data of the next frame of this kind, after a request where one is needed."""
    found: list[bytes] = []

    def feed(_stamp_ns: int, frame: Frame) -> None:
        if frame.can_id == kind:
            found.append(frame.data)
            link.wake()

    link.consumer = feed
    if request is not None:
        link.try_send(request)
    await link.wait(lambda: bool(found), timeout_s)
    return found[0] if found else None
