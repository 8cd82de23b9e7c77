"""From nothing to a stream of scans: find the dialect, identify, configure if asked to, subscribe.

Nothing here needs a login unless the output shall be changed (fact sheet section 3: while somebody is logged in
the laser is off, until `Run`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from drivers.tim571.codec import commands
from drivers.tim571.codec.access import password_hash
from drivers.tim571.codec.commands import OutputContent
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.session import Listeners, Session
from drivers.tim571.device.stats import DeviceState, Identity
from drivers.tim571.errors import TimAnswerError, TimError, TimRefusedError, TimTimeoutError, TimUnreachableError
from drivers.tim571.transport import Transport

_HOURS_PER_COUNT = 0.1  # ODoprh


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
    spoken = " and ".join(str(dialect) for dialect in dialects)
    raise TimTimeoutError(
        f"{device} took the connection but {said} in {spoken}: after power-on it needs up to 30 s; if it stays so,"
        " power-cycle it, and check that the address belongs to the lidar."
    )


async def identify(session: Session, config: TimConfig) -> Identity:
    """What the device says about itself; what it refuses to say is left out."""

    async def told(name: str) -> tuple[Any, ...]:
        try:
            return await session.ask(commands.read(session.dialect, name), config.answer_timeout_s)
        except (TimRefusedError, TimAnswerError):
            return ()

    kind = await told("DeviceIdent") or await told("0") or ("", "")
    firmware, serial, name = await told("FirmwareVersion"), await told("SerialNumber"), await told("LocationName")
    state, hours, power_ons = await told("SCdevicestate"), await told("ODoprh"), await told("ODpwrc")
    output = await told("LMDscandatacfg")
    return Identity(
        dialect=session.dialect,
        type=kind[0].strip(),
        version=kind[1].strip(),
        firmware=firmware[0] if firmware else "",
        serial=serial[0] if serial else "",
        name=name[0] if name else "",
        state=DeviceState(state[0]) if state else DeviceState.UNKNOWN,
        operating_hours=hours[0] * _HOURS_PER_COUNT if hours else None,
        power_ons=power_ons[0] if power_ons else None,
        output=OutputContent.from_values(output) if output else None,
    )


async def configure(session: Session, config: TimConfig, output: OutputContent) -> None:
    """Log in, write the output content, and let the device run again, whatever happened in between."""
    dialect, patience_s = session.dialect, config.answer_timeout_s
    login = commands.invoke(dialect, "SetAccessMode", int(config.level), password_hash(config.password))
    (admitted,) = await session.ask(login, patience_s)
    if not admitted:
        raise TimRefusedError(
            f"{session.device} refused the login as {config.level.name.lower()}: the password differs or its owner"
            " has disabled that user level; leave the output as it is, or enable the level with SOPAS."
        )
    try:
        await session.ask(commands.write(dialect, "LMDscandatacfg", *output.to_values()), patience_s)
        await session.ask(commands.invoke(dialect, "LMCstartmeas"), patience_s)
    finally:
        await session.ask(commands.invoke(dialect, "Run"), patience_s)


async def subscribe(session: Session, config: TimConfig) -> None:
    """Have every finished scan sent."""
    (on,) = await session.ask(commands.subscribe(session.dialect, "LMDscandata"), config.answer_timeout_s)
    if on != 1:
        raise TimRefusedError(f"{session.device} did not switch its scan output on.")


async def unsubscribe(session: Session, config: TimConfig) -> bool:
    """Stop the scans before leaving; False if the device no longer listens, which is no harm."""
    request = commands.subscribe(session.dialect, "LMDscandata", on=False)
    try:
        await session.request(request, config.dialect_timeout_s)
    except TimError:
        return False
    return True
