"""Beside the stream: keeps a live camera awake over PTP and asks how it is, at times and whenever it says so."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable

from drivers.theta_v.codec.descriptors import StillFunction
from drivers.theta_v.codec.health import Health
from drivers.theta_v.codec.ptp import Property
from drivers.theta_v.device.bringup import set_timers
from drivers.theta_v.device.ptp_session import PtpSession
from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaTimeout
from drivers.theta_v.transport.base import UsbTransport

RETRY_S = 30.0  # another program may hold the PTP interface for a while; the stream does not need it
LULL_S = 1.0  # between two questions, however much the camera has to say

WATCHED = (Property.BATTERY_LEVEL, Property.BATTERY_STATUS, Property.ERROR_INFO)

log = logging.getLogger(__name__)


async def watch(
    transport: UsbTransport,
    still: StillFunction,
    period_s: float,
    report: Callable[[Health], None],
    *,
    keep_awake: bool = True,
) -> None:
    """Until cancelled. Never raises ThetaError: the pictures matter more than the battery.

    Even a camera that seems to be gone is asked again: one USB error on the PTP pipe looks like that, and the
    end of the stream is told by the stream.
    """
    complaint = ""
    while True:
        session = PtpSession(transport, still)
        try:
            await session.open()
            await set_timers(session, keep_awake=keep_awake)
            while True:
                report(await health(session))
                complaint = ""
                await _until_news(session, period_s)
        except ThetaError as error:
            if complaint != str(error):
                level = logging.DEBUG if isinstance(error, ThetaGone) else logging.WARNING
                log.log(level, "the camera's battery and temperature are not watched: %s", error)
            complaint = str(error)
        await asyncio.sleep(RETRY_S)


async def health(session: PtpSession) -> Health:
    """Raises ThetaError."""
    return Health(*[int(await session.get(code)) for code in WATCHED])


async def _until_news(session: PtpSession, period_s: float) -> None:
    """Until the camera says that something watched has changed, or the period is over. Raises ThetaError."""
    until = time.monotonic() + period_s
    await asyncio.sleep(min(LULL_S, period_s))
    while (left_s := until - time.monotonic()) > 0:
        try:
            event = await session.event(left_s)
        except ThetaTimeout:
            return
        if event is None or not event.body or int.from_bytes(event.body[:4], "little") in WATCHED:
            return
