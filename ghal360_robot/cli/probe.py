"""`ghal360 probe`: talk to one device without moving anything."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from contextlib import AsyncExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from drivers.theta_v.device.camera import ThetaV, TransportFactory
from drivers.theta_v.device.config import ThetaConfig
from drivers.theta_v.device.readings import Readings
from drivers.theta_v.device.survey import survey
from drivers.theta_v.errors import ThetaError
from drivers.theta_v.transport.libusb import LibUsbTransport
from drivers.theta_v.transport.usbip import UsbIpTransport
from ghal360_robot.cli import probe_lidar as lidar
from ghal360_robot.cli.address import split_address
from ghal360_robot.cli.probe_base import Way, in_words, probe_base
from ghal360_robot.errors import UsageError
from ghal360_robot.hardware.camera import MODES

app = typer.Typer(help="Talk to one device: identity, state, a few seconds of data. Never moves anything.")

Seconds = Annotated[float, typer.Option(help="How long to listen", min=0.5, max=86400)]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")]


@app.command()
def tim571(
    host: Annotated[str, typer.Option(help="The lidar's address")] = "192.168.0.1",
    port: Annotated[int, typer.Option(help="SOPAS port", min=1, max=65535)] = 2112,
    usb: Annotated[bool, typer.Option("--usb", help="Over USB instead of Ethernet")] = False,
    serial: Annotated[str | None, typer.Option(help="Over USB, the one with this serial number")] = None,
    dialect: Annotated[str, typer.Option(help="a, b or auto")] = "auto",
    rssi: Annotated[str, typer.Option(help="Signal strength: leave, off, 8 or 16 bits; a change logs in")] = "leave",
    switch: Annotated[str, typer.Option(help="Have it speak a or b until power-off; logs in")] = "leave",
    seconds: Seconds = 3.0,
    as_json: Json = False,
) -> None:
    """Identity, state, health, clock, rate and a look around through the lidar. As it stands, changes nothing in it.

    Examples:

    ghal360 probe tim571 --host 192.168.0.1

    ghal360 probe tim571 --usb --rssi 8
    """
    way = lidar.Way(host, port, usb, serial, dialect, rssi, switch)
    _show(asyncio.run(lidar.probe_lidar(way, seconds)), as_json)


@app.command()
def rmp110(
    protocol: Annotated[str, typer.Option(help="can; v3-udp, v3-usb only for a base known to speak V3")] = "can",
    interface: Annotated[str, typer.Option(help="python-can interface, with can")] = "socketcan",
    channel: Annotated[str, typer.Option(help="Channel of that interface")] = "can0",
    address: Annotated[str | None, typer.Option(help="HOST:PORT of a socketcand server")] = None,
    dialect: Annotated[str, typer.Option(help="auto, b1, b2 or b3, with can")] = "auto",
    host: Annotated[str | None, typer.Option(help="The base's IPv4 address, with v3-udp")] = None,
    port: Annotated[int, typer.Option(help="Its UDP port", min=1, max=65535)] = 8080,
    device: Annotated[str, typer.Option(help="The base's serial device, with v3-usb")] = "/dev/ttyACM0",
    fault_log: Annotated[bool, typer.Option("--fault-log", help="Read the base's own log of faults too")] = False,
    seconds: Seconds = 3.0,
    as_json: Json = False,
) -> None:
    """Dialect, firmware, stored limits, batteries and faults in words, and why the base would not move.

    Sends polls and read-back requests only. Packets of V3 are said to ruin an older base: name that protocol
    only where the base is known to have it.

    Examples:

    ghal360 probe rmp110 --channel can0 --fault-log

    ghal360 probe rmp110 --protocol v3-udp --host 10.66.171.5
    """
    way = Way(protocol, interface, channel, address, dialect, host, port, device)
    found = asyncio.run(probe_base(way, seconds, fault_log=fault_log))
    _show(found if as_json else in_words(found), as_json)


@app.command("theta-v")
def theta_v(
    usbip: Annotated[str | None, typer.Option(help="HOST:PORT of a USB/IP server; without, this machine's USB")] = None,
    serial: Annotated[str | None, typer.Option(help="Eight digits on the camera; without, the only one")] = None,
    mode: Annotated[str, typer.Option(help="2k or 4k")] = "2k",
    seconds: Seconds = 3.0,
    save: Annotated[Path | None, typer.Option(help="Folder for all that can be read from the camera")] = None,
    let_sleep: Annotated[bool, typer.Option("--let-sleep", help="Sleep timers as delivered, no PTP meanwhile")] = False,
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
    config = ThetaConfig(mode=MODES[mode], serial=serial)
    if let_sleep:
        config = replace(config, keep_awake=False, health_s=0.0)
    try:
        with contextlib.ExitStack() as stack:
            readings = stack.enter_context(Readings(save)) if save is not None else None
            values = asyncio.run(_probe_camera(factory, config, seconds, readings))
    except OSError as error:
        if isinstance(error, ThetaError):
            raise
        raise UsageError(f"cannot write {save}: {error.strerror}") from error
    _show(values, as_json)


async def _probe_camera(
    factory: TransportFactory, config: ThetaConfig, seconds: float, readings: Readings | None
) -> dict[str, Any]:
    found = await survey(factory, config.serial, keep_awake=config.keep_awake) if readings is not None else None
    hooks: dict[str, Any] = {}
    if readings is not None and found is not None:
        readings.conclude(found, {"error": "no stream, or it ended early"})  # what was read so far is worth having
        hooks = {
            "on_access_unit": readings.access_unit,
            "on_packets": readings.packets,
            "on_health": readings.health,
        }
    async with AsyncExitStack() as stack:
        camera = await stack.enter_async_context(ThetaV(factory, config, once=True, **hooks))
        pictures = keyframes = size = 0
        until = time.monotonic() + seconds
        units = camera.access_units()
        stack.push_async_callback(units.aclose)  # type: ignore[attr-defined]
        async for unit in units:
            pictures += 1
            size += len(unit.raw)
            keyframes += unit.keyframe
            if time.monotonic() >= until:
                break
        stats = camera.stats
    values = {
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
        "dropped": stats.dropped,
        "restarts": stats.restarts,
        "battery_percent": stats.battery_percent,
        "charging": stats.charging,
        "faults": list(stats.faults),
        "rate_hz": round(stats.rate_hz, 2),
        "bit_rate": round(stats.bit_rate),
    }
    if readings is not None and found is not None:
        readings.conclude(found, values)
    return values


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
        elif isinstance(value, list):
            console.print(f"[bold]{key:24}[/] {'' if value else 'none'}")
            for entry in value:
                console.print(f"  {escape(str(entry))}")
        else:
            console.print(f"[bold]{key:24}[/] {escape(str(value))}")
