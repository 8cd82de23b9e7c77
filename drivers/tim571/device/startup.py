"""From nothing to a stream of scans: find the dialect, identify, configure if asked to, subscribe.

Nothing here needs a login unless the output shall be changed (fact sheet section 3: while somebody is logged in
the laser is off, until `Run`).
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from typing import Any

from drivers.tim571.codec import commands
from drivers.tim571.codec.access import password_hash
from drivers.tim571.codec.answers import DeviceIdent, DeviceState
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.telegram import Telegram
from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.session import Listeners, Session
from drivers.tim571.device.stats import Identity
from drivers.tim571.errors import TimAnswerError, TimError, TimRefusedError, TimTimeoutError, TimUnreachableError
from drivers.tim571.transport import Transport

MOST_SILENCES = 3  # questions in a row that a live device may not know how to refuse


async def connect(
    make_transport: Callable[[], Transport], dialects: tuple[Dialect, ...], config: TimConfig, listeners: Listeners
) -> Session:
    """Open a connection in the first of `dialects` that the device answers in; any answer will do.

    Raises what the transport raises, and TimTimeoutError if it is silent in all of them.
    """
    device, said = "", "stays silent"
    for dialect in dialects:
        session = Session(make_transport(), dialect, listeners)
        device = session.device
        await session.open()
        try:
            await session.request(commands.read(dialect, "SCdevicestate"), config.dialect_timeout_s)
        except TimTimeoutError:
            said = "stays silent"
        except TimUnreachableError:
            said = "closes the connection"  # some devices do so in the wrong dialect
        except BaseException:
            await session.close()
            raise
        else:
            return session
        await session.close()
    spoken = " and ".join(sorted(str(dialect) for dialect in dialects))
    raise TimTimeoutError(
        f"{device} took the connection but {said} in {spoken}: after power-on it needs up to 30 s; if it stays so,"
        " power-cycle it, and check that the address belongs to the lidar."
    )


async def identify(session: Session, config: TimConfig) -> Identity:
    """What the device says about itself; what it refuses to say or passes over is left out.

    Raises TimTimeoutError if it falls silent.
    """
    silent = 0

    async def told(name: str) -> Any:
        nonlocal silent
        try:
            answer = await session.answer(commands.read(session.dialect, name), config.answer_timeout_s)
        except (TimRefusedError, TimAnswerError):
            answer = None
        except TimTimeoutError:
            silent += 1
            if silent >= MOST_SILENCES:
                raise
            return None
        silent = 0
        return answer

    kind = await told("DeviceIdent") or await told("0") or DeviceIdent("", "")
    return Identity(
        dialect=session.dialect,
        type=kind.type.strip(),
        version=kind.version.strip(),
        firmware=await told("FirmwareVersion") or "",
        serial=await told("SerialNumber") or "",
        name=await told("LocationName") or "",
        state=await told("SCdevicestate") or DeviceState.UNKNOWN,
        operating_hours=_hours(await told("ODoprh")),
        power_ons=await told("ODpwrc"),
        output=await told("LMDscandatacfg"),
        output_range=await told("LMPoutputRange"),
    )


def _hours(operated: timedelta | None) -> float | None:
    return None if operated is None else operated / timedelta(hours=1)


def changes(config: TimConfig, found: Identity) -> tuple[Telegram, ...]:
    """The writes that make the device what the configuration asks for; none if it is so already."""
    dialect, writes = found.dialect, []
    if config.output_range is not None and config.output_range != found.output_range:
        writes.append(commands.write(dialect, "LMPoutputRange", *config.output_range.to_values()))
    if config.output is not None and config.output != found.output:
        writes.append(commands.write(dialect, "LMDscandatacfg", *config.output.to_values()))
    if config.switch_to not in (None, dialect):
        writes.append(commands.write(dialect, "EIHstCola", int(dialect is Dialect.A)))
    return tuple(writes)


async def configure(session: Session, config: TimConfig, writes: tuple[Telegram, ...]) -> None:
    """Log in, write, and let the device run again, whatever happened in between.

    After a change of dialect it listens in the other one only; a reconnect logs out. Raises TimRefusedError with a
    sentence that says what to do if the device does not let us.
    """
    patience_s = config.answer_timeout_s
    await _login(session, config)
    listening = True
    try:
        for write in writes:
            await session.ask(write, patience_s)
            listening = not switches_dialect(write)
        if listening:
            await session.ask(commands.invoke(session.dialect, "LMCstartmeas"), patience_s)
    finally:
        if listening:
            await session.ask(commands.invoke(session.dialect, "Run"), patience_s)


def switches_dialect(write: Telegram) -> bool:
    """Always the last of the `changes`."""
    return write.name == "EIHstCola"


async def _login(session: Session, config: TimConfig) -> None:
    hashed = password_hash(config.password)
    login = commands.invoke(session.dialect, "SetAccessMode", int(config.level), hashed)
    if not await session.answer(login, config.answer_timeout_s):
        raise TimRefusedError(
            f"{session.device} refused the login as {config.level.name.lower()}: the password differs or its owner"
            " has disabled that user level; leave the output as it is, or enable the level with SOPAS."
        )


async def wake(session: Session, config: TimConfig) -> str:
    """Ask a device that sends nothing to measure; no login, for that would switch off somebody else's laser.

    Returns what it said to that, as a clause.
    """
    try:
        started = await session.answer(commands.invoke(session.dialect, "LMCstartmeas"), config.answer_timeout_s)
    except (TimRefusedError, TimAnswerError, TimTimeoutError) as error:
        return str(error)
    return "it was told to start measuring" if started else "it did not start measuring when told to"


async def subscribe(session: Session, config: TimConfig) -> None:
    """Have every finished scan sent."""
    if not await session.answer(commands.subscribe(session.dialect, "LMDscandata"), config.answer_timeout_s):
        raise TimRefusedError(f"{session.device} did not switch its scan output on.")


async def unsubscribe(session: Session, config: TimConfig) -> bool:
    """Stop the scans before leaving; False if the device no longer listens, which is no harm."""
    request = commands.subscribe(session.dialect, "LMDscandata", on=False)
    try:
        await session.request(request, config.dialect_timeout_s)
    except TimError:
        return False
    return True
