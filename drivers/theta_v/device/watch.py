"""Beside the stream: keeps a live camera awake over PTP and asks now and then how it is."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from drivers.theta_v.codec.descriptors import StillFunction
from drivers.theta_v.codec.health import Health
from drivers.theta_v.codec.ptp import Property
from drivers.theta_v.device.bringup import stay_awake
from drivers.theta_v.device.ptp_session import PtpSession
from drivers.theta_v.errors import ThetaError, ThetaGone
from drivers.theta_v.transport.base import UsbTransport

RETRY_S = 30.0  # another program may hold the PTP interface for a while; the stream does not need it

log = logging.getLogger(__name__)


async def watch(
    transport: UsbTransport, still: StillFunction, period_s: float, report: Callable[[Health], None]
) -> None:
    """For as long as the stream lasts. Never raises ThetaError: the pictures matter more than the battery."""
    complaint = ""
    while True:
        session = PtpSession(transport, still)
        try:
            await session.open()
            await stay_awake(session)
            while True:
                report(await health(session))
                complaint = ""
                await asyncio.sleep(period_s)
        except ThetaGone:
            return  # the stream's end is not told here
        except ThetaError as error:
            if complaint != str(error):
                log.warning("the camera's battery and temperature are not watched: %s", error)
            complaint = str(error)
        await asyncio.sleep(RETRY_S)


async def health(session: PtpSession) -> Health:
    """Raises ThetaError."""
    battery, status, errors = [
        int(await session.get(code)) for code in (Property.BATTERY_LEVEL, Property.BATTERY_STATUS, Property.ERROR_INFO)
    ]
    return Health(battery, status, errors)
