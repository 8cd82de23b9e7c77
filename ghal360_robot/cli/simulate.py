"""`ghal360 simulate`: one simulated device on a socket or bus, for other people's clients."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.errors import RmpError
from drivers.rmp110.simulator.faults import FORM, FaultPlan, parse_plan
from drivers.rmp110.simulator.machine import BOOT_S
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.packet_wires import PtyWire, UdpWire
from drivers.rmp110.simulator.serve import serve as serve_base
from drivers.rmp110.simulator.serve import serve_v3
from drivers.rmp110.simulator.v3_model import V3Model
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.simulator.faults import FORM as LIDAR_FORM
from drivers.tim571.simulator.faults import parse_plan as parse_lidar_plan
from drivers.tim571.simulator.server import Tim571Simulator
from ghal360_robot.cli.address import split_address
from ghal360_robot.cli.scenario import checked_scenario
from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.simulation.picture_source import FolderPictureSource, PictureSource, RenderedPictureSource
from ghal360_robot.simulation.view import lidar_view
from ghal360_robot.simulation.world import build_world

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

app = typer.Typer(help="One simulated device on a socket or bus, for other clients. Ctrl-C or SIGTERM ends it.")

World = Annotated[str, typer.Option(help="What the device sees: office or home")]
Seed = Annotated[int, typer.Option(help="Seed of world, noise and faults", min=0)]


@app.command()
def tim571(
    *,
    host: Annotated[str, typer.Option(help="Address to listen on")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0 takes a free one", min=0, max=65535)] = 2112,
    dialect: Annotated[str, typer.Option(help="a or b; EIHstCola switches it, as in the device")] = "a",
    replay: Annotated[Path | None, typer.Option(help="Send the scans of this .rec file instead")] = None,
    boot: Annotated[float, typer.Option(help="Seconds of silence after power-on; a device takes up to 30", min=0)] = 0,
    rate: Annotated[float, typer.Option(help="Revolutions per second", min=0.1, max=1000)] = 15.0,
    drift: Annotated[float, typer.Option(help="ppm by which its clock is fast", min=-1000, max=1000)] = 4.7,
    user_levels: Annotated[bool, typer.Option(help="Whether anybody may log in")] = True,
    time_block: Annotated[bool, typer.Option("--time-block", help="Send it where configured")] = False,
    faults: Annotated[str, typer.Option(help=f"What goes wrong: {LIDAR_FORM}")] = "",
    log: Annotated[bool, typer.Option("--log", help="A line for whoever connects, asks and is told what")] = False,
    world: World = "office",
    seed: Seed = 0,
) -> None:
    """A TiM571 at the start position of a simulated world.

    Examples:

    ghal360 simulate tim571 --port 2112 --dialect b --log

    ghal360 simulate tim571 --faults corrupt=0.01,jitter_s=0.0001,power=30+5
    """
    if dialect not in {"a", "b"}:
        raise UsageError(f"--dialect is a or b, not '{dialect}'")
    checked_scenario(world=world, seed=seed, target="backpack", lidar_replay=replay)
    start = build_world(world, seed).start
    source = lidar_view(build_world(world, seed), lambda: start)
    settings = DeviceSettings(
        startup_s=boot, scan_rate_hz=rate, drift_ppm=drift, user_levels_enabled=user_levels, time_block=time_block
    )
    try:
        lidar = Tim571Simulator(
            source,
            host=host,
            port=port,
            dialect=dialect,
            settings=settings,
            faults=parse_lidar_plan(faults),
            seed=seed,
            replay=replay,
            on_news=Console(highlight=False, soft_wrap=True, markup=False).print if log else None,
        )
    except (ValueError, OSError) as error:
        raise UsageError(str(error)) from error

    @contextlib.asynccontextmanager
    async def running() -> AsyncIterator[str]:
        async with lidar:
            yield f"TiM571 at {host}:{lidar.port}, dialect {lidar.behaviour.dialect}"

    _serve(running())


@app.command()
def rmp110(
    dialect: Annotated[str, typer.Option(help="b1, b2 or b3 on CAN, v3 on UDP or a serial device")] = "b2",
    interface: Annotated[str, typer.Option(help="python-can interface; socketcand: be the server")] = "socketcand",
    channel: Annotated[str, typer.Option(help="Channel of that interface")] = "can0",
    address: Annotated[str, typer.Option(help="HOST:PORT to listen on, with socketcand")] = "127.0.0.1:29536",
    udp: Annotated[str | None, typer.Option(help="HOST:PORT to listen on, with v3; real bases use 8080")] = None,
    pty: Annotated[Path | None, typer.Option(help="Serial device to make at this path, with v3")] = None,
    boot: Annotated[float, typer.Option(help="Seconds from power-on to standby", min=0, max=60)] = BOOT_S,
    faults: Annotated[str, typer.Option(help=f"What goes wrong: {FORM}")] = "",
) -> None:
    """An RMP-110 with wheels off the ground.

    Examples:

    ghal360 simulate rmp110 --interface socketcan --channel vcan0

    ghal360 simulate rmp110 --dialect v3 --udp 127.0.0.1:8080 --faults drop=0.01,seed=3,unplug=20+5
    """
    try:
        plan, spoken = parse_plan(faults), Dialect(dialect.upper())
    except ValueError as error:
        known = dialect.upper() in {one.value for one in Dialect}
        raise UsageError(str(error) if known else f"--dialect is b1, b2, b3 or v3, not '{dialect}'") from error
    if spoken is Dialect.V3:
        _serve(_v3_base(udp, pty, boot, plan))
        return
    if udp or pty:
        raise UsageError(f"--udp and --pty are for --dialect v3; {dialect} is on CAN: --interface and --channel")
    host, port = split_address(address, any_port=True)
    options: dict[str, Any] = {"host": host, "port": port} if interface == "socketcand" else {}

    @contextlib.asynccontextmanager
    async def running() -> AsyncIterator[str]:
        model = RmpModel(time.monotonic_ns(), boot_s=boot, dialect=spoken)
        async with serve_base(interface, channel, model=model, plan=plan, **options) as base:
            where = f"{host}:{base.port}" if interface == "socketcand" else interface
            yield f"RMP-110, dialect {spoken.value}, at {where}, channel {channel}"

    _serve(running())


@contextlib.asynccontextmanager
async def _v3_base(udp: str | None, pty: Path | None, boot: float, plan: FaultPlan) -> AsyncIterator[str]:
    if (udp is None) is (pty is None):
        raise UsageError("--dialect v3 needs one of --udp HOST:PORT and --pty PATH")
    wire: UdpWire | PtyWire = PtyWire(pty) if pty else UdpWire(*split_address(udp or "", any_port=True))
    async with serve_v3(wire, model=V3Model(time.monotonic_ns(), boot_s=boot), plan=plan) as base:
        where = wire.path if isinstance(wire, PtyWire) else f"{wire.host}:{base.port}/udp"
        yield f"RMP-110, dialect V3, at {where}"


@app.command("theta-v")
def theta_v(
    usbip: Annotated[str, typer.Option(help="HOST:PORT to listen on; 3240 is what USB/IP clients expect")],
    images: Annotated[Path | None, typer.Option(help="Folder of equirectangular pictures to stream")] = None,
    rate: Annotated[float, typer.Option(help="Pictures per second", min=1, max=30)] = 12.0,
    world: World = "office",
    seed: Seed = 0,
) -> None:
    """A THETA V behind a USB/IP server, at the start position of a simulated world.

    Example: ghal360 simulate theta-v --usbip 127.0.0.1:3240
    """
    host, port = split_address(usbip, any_port=True)
    checked_scenario(world=world, seed=seed, target="backpack", camera_images=images)
    pictures: PictureSource
    if images is not None:
        pictures = FolderPictureSource(images, rate)
    else:
        pictures = RenderedPictureSource(world, seed, "backpack", rate)

    @contextlib.asynccontextmanager
    async def running() -> AsyncIterator[str]:
        camera = SimulatedThetaV()
        pictures.on_access_unit(lambda _stamp_ns, unit: camera.offer(unit))
        with UsbIpServer(camera, host, port) as server, pictures:
            pictures.set_pose(build_world(world, seed).start)
            yield f"THETA V behind USB/IP at {host}:{server.port}"

    _serve(running())


def _serve(running: contextlib.AbstractAsyncContextManager[str]) -> None:
    try:
        asyncio.run(_until_signal(running))
    except RmpError:
        raise  # a sentence of its own
    except (OSError, UnicodeError) as error:
        raise GhalError(f"cannot listen there: {getattr(error, 'strerror', None) or error}") from error


async def _until_signal(running: contextlib.AbstractAsyncContextManager[str]) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    async with running as sentence:
        Console(highlight=False, soft_wrap=True).print(sentence)
        await stop.wait()
