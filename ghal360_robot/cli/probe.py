"""`ghal360 probe`: talk to one device without moving anything."""

from __future__ import annotations

import asyncio
import json
import math
import os
import time
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape

from drivers.rmp110.codec.parameters import BY_NAME
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.rmp110 import Rmp110
from drivers.rmp110.device.state import LinkState
from drivers.rmp110.transport.can_bus import CanTransport
from drivers.theta_v.device.camera import ThetaV, TransportFactory
from drivers.theta_v.device.config import ThetaConfig
from drivers.theta_v.errors import ThetaError
from drivers.theta_v.transport.libusb import LibUsbTransport
from drivers.theta_v.transport.usbip import UsbIpTransport
from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.probe import probe as probe_lidar
from drivers.tim571.transport.tcp import TcpTransport
from ghal360_robot.cli.address import split_address
from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.hardware.camera import MODES
from ghal360_robot.hardware.lidar import DIALECTS

app = typer.Typer(help="Talk to one device: identity, state, a few seconds of data. Never moves anything.")

Seconds = Annotated[float, typer.Option(help="How long to listen", min=0.5, max=86400)]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")]

READY_S = 5.0
"""A base that is on answers within a tenth of a second; identification takes less than two."""


@app.command()
def tim571(
    host: Annotated[str, typer.Option(help="The lidar's address")] = "192.168.0.1",
    port: Annotated[int, typer.Option(help="SOPAS port", min=1, max=65535)] = 2112,
    dialect: Annotated[str, typer.Option(help="a, b or auto")] = "auto",
    seconds: Seconds = 3.0,
    as_json: Json = False,
) -> None:
    """Identity, state, rate and a look around through the lidar.

    Example: ghal360 probe tim571 --host 192.168.0.1
    """
    if dialect not in DIALECTS:
        raise UsageError(f"--dialect is one of {', '.join(DIALECTS)}, not '{dialect}'")
    found = asyncio.run(probe_lidar(lambda: TcpTransport(host, port), TimConfig(dialect=DIALECTS[dialect]), seconds))
    stats, scan, identity = found.stats, found.scan, found.stats.identity
    seen = np.isfinite(scan.ranges)
    nearest = int(np.nanargmin(scan.ranges)) if seen.any() else None
    output = identity.output if identity else None
    _show(
        {
            "type": identity.type if identity else "",
            "version": identity.version if identity else "",
            "firmware": identity.firmware if identity else "",
            "serial": identity.serial if identity else "",
            "name": identity.name if identity else "",
            "dialect": str(identity.dialect.value) if identity else "",
            "state": identity.state.name.lower() if identity else "",
            "operating_hours": identity.operating_hours if identity else None,
            "power_ons": identity.power_ons if identity else None,
            "output": str(output) if output else None,
            "rssi": scan.rssi is not None,
            "beams": len(scan.ranges),
            "beams_with_range": int(seen.sum()),
            "nearest_m": None if nearest is None else round(float(scan.ranges[nearest]), 3),
            "nearest_yaw_deg": None if nearest is None else round(math.degrees(float(scan.yaw[nearest])), 1),
            "device_ok": scan.device_ok,
            "received": stats.received,
            "lost": stats.lost,
            "damaged": stats.damaged,
            "rate_hz": round(stats.rate_hz, 3),
        },
        as_json,
    )


@app.command()
def rmp110(
    interface: Annotated[str, typer.Option(help="python-can interface")] = "socketcan",
    channel: Annotated[str, typer.Option(help="Channel of that interface")] = "can0",
    address: Annotated[str | None, typer.Option(help="HOST:PORT of a socketcand server")] = None,
    seconds: Seconds = 3.0,
    as_json: Json = False,
) -> None:
    """Dialect, firmware's limits, battery and faults in words. Sends polls and read-back requests only.

    Example: ghal360 probe rmp110 --channel can0
    """
    options: dict[str, Any] = {}
    if interface == "socketcand" and address is None:
        raise UsageError("--interface socketcand needs --address HOST:PORT of its server")
    if address is not None:
        interface = "socketcand"
        options["host"], options["port"] = split_address(address)
    asyncio.run(_probe_base(interface, channel, options, seconds, as_json))


async def _probe_base(interface: str, channel: str, options: dict[str, Any], seconds: float, as_json: bool) -> None:
    # Nothing is written: a probe leaves the base's stored feedback set as it is.
    config = Rmp110Config(write_feedback_set=False)
    async with Rmp110(lambda: CanTransport(interface, channel, **options), config) as base:
        identity = await base.ready(READY_S)
        await asyncio.sleep(seconds)
        stats, state = base.stats, base.latest
        if stats.link is not LinkState.STREAMING:
            raise GhalError(f"the base was there and is gone: {stats.detail}")
        stored = {name: round(float(identity.stored[name]), 6) for name in BY_NAME}
    _show(
        {
            "dialect": identity.dialect.name,
            "stored": stored,
            "differences": {name: list(pair) for name, pair in identity.differences.items()},
            "motion_refused_because": identity.refusal,
            "mode": None if state is None else state.mode.name,
            "battery_percent": None if state is None else round(state.battery_percent, 2),
            "faults": [] if state is None else list(state.faults),
            "dynamic_response": None if state is None else state.dynamic_response,
            "v_mps": None if state is None else round(state.v, 4),
            "w_radps": None if state is None else round(state.w, 4),
            "received": stats.received,
            "lost": stats.lost,
            "damaged": stats.damaged,
            "rate_hz": round(stats.rate_hz, 2),
        },
        as_json,
    )


@app.command("theta-v")
def theta_v(
    usbip: Annotated[str | None, typer.Option(help="HOST:PORT of a USB/IP server; without, this machine's USB")] = None,
    serial: Annotated[str | None, typer.Option(help="Eight digits on the camera; without, the only one")] = None,
    mode: Annotated[str, typer.Option(help="2k or 4k")] = "2k",
    seconds: Seconds = 3.0,
    save: Annotated[Path | None, typer.Option(help="Write the access units as received to this .h264 file")] = None,
    as_json: Json = False,
) -> None:
    """Identity, picture size, rate, bit rate and damage of the live stream.

    A camera in still or video mode is woken and switched to live mode.
    Example: ghal360 probe theta-v --mode 4k
    """
    if mode not in MODES:
        raise UsageError(f"--mode is one of {', '.join(MODES)}, not '{mode}'")
    factory: TransportFactory = LibUsbTransport
    if usbip is not None:
        factory = partial(UsbIpTransport, *split_address(usbip))
    try:
        with open(save or os.devnull, "wb") as file:  # noqa: PTH123 - the null device where nothing is kept
            values = asyncio.run(_probe_camera(factory, ThetaConfig(mode=MODES[mode], serial=serial), seconds, file))
    except OSError as error:
        if isinstance(error, ThetaError):
            raise
        raise UsageError(f"cannot write {save}: {error.strerror}") from error
    _show(values, as_json)


async def _probe_camera(
    factory: TransportFactory, config: ThetaConfig, seconds: float, file: BinaryIO
) -> dict[str, Any]:
    async with AsyncExitStack() as stack:
        camera = await stack.enter_async_context(ThetaV(factory, config, once=True))
        pictures = keyframes = size = 0
        until = time.monotonic() + seconds
        units = camera.access_units()
        stack.push_async_callback(units.aclose)  # type: ignore[attr-defined]
        async for unit in units:
            pictures += 1
            size += len(unit.raw)
            keyframes += unit.keyframe
            file.write(unit.raw)
            if time.monotonic() >= until:
                break
        stats = camera.stats
    return {
        "model": stats.model,
        "serial": stats.serial,
        "firmware": stats.firmware,
        "usb_id": stats.usb_id,
        "width": stats.width,
        "height": stats.height,
        "pictures": pictures,
        "key_pictures": keyframes,
        "mean_bytes": round(size / pictures) if pictures else 0,
        "received": stats.received,
        "lost": stats.lost,
        "damaged": stats.damaged,
        "tainted": stats.tainted,
        "rate_hz": round(stats.rate_hz, 2),
        "bit_rate": round(stats.bit_rate),
    }


def _show(values: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(values))
        return
    console = Console(highlight=False, soft_wrap=True)
    for key, value in values.items():
        if isinstance(value, dict):
            console.print(f"[bold]{key}[/]")
            for name, inner in value.items():
                console.print(f"  {name:24} {escape(str(inner))}")
        else:
            console.print(f"[bold]{key:24}[/] {escape(str(value))}")
