"""One look at a lidar: who it is and whether its scans come, or a sentence why not."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.lidar import WATCH_S, OnTelegram, TiM571
from drivers.tim571.device.scan import Scan
from drivers.tim571.device.stats import TimStats
from drivers.tim571.errors import TimError
from drivers.tim571.transport import Transport

PROBE_S = 3.0  # 45 scans: enough for a rate


@dataclass(frozen=True, slots=True)
class ProbeReport:
    """What a look at the lidar showed."""

    stats: TimStats
    scan: Scan
    variables: dict[str, Any]
    """What was `asked` besides the identity, by name; None where the device didn't say."""


async def probe(
    transport: Transport | Callable[[], Transport],
    config: TimConfig | None = None,
    seconds: float = PROBE_S,
    on_telegram: OnTelegram | None = None,
    asked: tuple[str, ...] = (),
) -> ProbeReport:
    """Connect once, listen for `seconds` from the first scan on, read the variables `asked`, disconnect.

    Raises a TimError whose text is for the person at the robot: unreachable, refused, silent, no scans.
    """
    lidar = TiM571(transport, config, on_telegram)
    link = asyncio.create_task(lidar.keep_link(), name="probe TiM571")
    try:
        while lidar.latest is None and not link.done():
            await asyncio.wait({link}, timeout=WATCH_S)
        await asyncio.wait({link}, timeout=seconds)
        if link.done():
            link.result()
        stats, scan = lidar.stats, lidar.latest
        variables = {name: await _told(lidar, name) for name in asked}
    finally:
        link.cancel()
        await asyncio.wait({link})
    assert scan is not None  # noqa: S101 - the link runs and the first scan was waited for
    return ProbeReport(stats, scan, variables)


async def _told(lidar: TiM571, name: str) -> Any:
    try:
        return await lidar.read(name)
    except TimError:
        return None
