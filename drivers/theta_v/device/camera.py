"""The camera: `async with ThetaV(...) as camera: async for unit in camera.access_units(): ...`."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Self

from drivers.theta_v.codec.access_units import AccessUnit
from drivers.theta_v.codec.descriptors import BULK, VideoFunction
from drivers.theta_v.codec.health import Health
from drivers.theta_v.device import bringup
from drivers.theta_v.device.collector import AccessUnitHook, Collector
from drivers.theta_v.device.config import ThetaConfig
from drivers.theta_v.device.ladder import Drought, Ladder, Step
from drivers.theta_v.device.mailbox import Mailbox
from drivers.theta_v.device.stats import Link, ThetaStats
from drivers.theta_v.device.watch import watch
from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaNotFound, ThetaTimeout
from drivers.theta_v.transport.base import Identity, PacketSink, UsbTransport

WATCH_S = 0.1  # how often the stream's sign of life is looked at; a tenth of the patience
RETURN_PAUSE_S = 0.2  # between two looks for a camera that changes its mode
LETTING_GO_S = 3.0  # closing a camera that does not answer must not hold up the robot's shutdown

TransportFactory = Callable[[], UsbTransport]

log = logging.getLogger(__name__)


class ThetaV:
    """One THETA, kept streaming until closed: it reconnects for ever and says why in `stats.detail`.

    `on_access_unit` hears of every picture before any is dropped, `on_packets` of every batch of packets.
    They are called in the collecting thread and must return at once; `on_health` is called on the event
    loop, whenever the camera was asked how it is. Built with `once`, entering raises ThetaError when there
    is no stream to be had, and a stream that breaks raises from `access_units` instead of being taken up
    again.
    """

    def __init__(
        self,
        transport_factory: TransportFactory,
        config: ThetaConfig | None = None,
        *,
        on_access_unit: AccessUnitHook | None = None,
        on_packets: PacketSink | None = None,
        on_health: Callable[[Health], None] | None = None,
        once: bool = False,
    ) -> None:
        self.config = config or ThetaConfig()
        self._factory, self._once = transport_factory, once
        self._collector = Collector(on_access_unit, on_packets)
        self._link, self._detail = Link.CLOSED, ""
        self._reconnects = self._restarts = 0
        self._identity: Identity | None = None
        self._firmware = ""
        self._health: Health | None = None
        self._on_health = on_health
        self._watch: asyncio.Task[None] | None = None
        self._transport: UsbTransport | None = None
        self._returning: str | None = None
        self._returning_until = 0.0
        self._gone = asyncio.Event()
        self._reason = ""
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        if self._once:
            try:
                video, agreement = await self._connect()
            except BaseException:
                await self._let_go()
                self._link = Link.CLOSED
                raise
            self._task = asyncio.create_task(self._stream_once(video, agreement))
        else:
            self._task = asyncio.create_task(self._keep_streaming())
        self._task.add_done_callback(self._ended)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Stop the stream, let go of the camera, end all readers."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
        await self._let_go()
        self._link = Link.CLOSED
        self._collector.close()
        task, self._task = self._task, None
        if task is not None and not task.cancelled():
            task.result()  # a mistake of this driver must not go unnoticed

    async def access_units(self) -> AsyncIterator[AccessUnit]:
        """The pictures in order, from the next key picture on; a slow reader skips ahead (see `Mailbox`).

        Several readers may each have their own iteration. It ends when the camera is closed.
        """
        mailbox = Mailbox(asyncio.get_running_loop(), self.config.queue_units, pass_tainted=self.config.pass_tainted)
        self._collector.subscribe(mailbox)
        if self._task is None or self._task.done():
            mailbox.close()
        try:
            while (unit := await mailbox.get()) is not None:
                yield unit
        finally:
            self._collector.unsubscribe(mailbox)

    @property
    def stats(self) -> ThetaStats:
        meter = self._collector.meter
        rate_hz, bit_rate = meter.rates(time.monotonic_ns())
        width, height = self._collector.size
        who = self._identity
        return ThetaStats(
            link=self._link,
            detail=self._detail,
            received=meter.received,
            damaged=meter.damaged,
            tainted=meter.tainted,
            lost=self._collector.lost,
            dropped=self._collector.dropped,
            restarts=self._restarts,
            reconnects=self._reconnects,
            rate_hz=rate_hz,
            bit_rate=bit_rate,
            last_ns=meter.last_ns,
            model=who.product if who else "",
            serial=who.serial if who else "",
            firmware=self._firmware,
            usb_id=f"{who.vendor_id:04x}:{who.product_id:04x}" if who else "",
            width=width,
            height=height,
            battery_percent=self._health.battery_percent if self._health else None,
            charging=self._health.charging if self._health else "",
            faults=self._health.faults if self._health else (),
        )

    def _ended(self, task: asyncio.Task[None]) -> None:
        """The task never ends by itself; if a mistake of ours ends it, the readers must not wait for ever."""
        if not task.cancelled() and task.exception() is not None:
            log.error("the camera driver failed: %r", task.exception())
            self._link, self._detail = Link.CLOSED, f"the driver failed: {task.exception()!r}"
            self._collector.close()

    async def _keep_streaming(self) -> None:
        pause_s = self.config.backoff_min_s
        while True:
            try:
                video, agreement = await self._connect()
                pause_s = self.config.backoff_min_s
                await self._stream(video, agreement)
            except ThetaError as error:
                if self._detail != str(error):
                    log.warning("camera: %s", error)
                self._detail = str(error)
            finally:
                await self._let_go()
            self._link = Link.BACKOFF
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, self.config.backoff_max_s)
            self._reconnects += 1

    async def _stream_once(self, video: VideoFunction, agreement: bringup.Agreement) -> None:
        try:
            await self._stream(video, agreement)
        except ThetaError as error:
            self._detail = str(error)
            self._link = Link.CLOSED
            self._collector.close(error)
        finally:
            await self._let_go()

    async def _connect(self) -> tuple[VideoFunction, bringup.Agreement]:
        """Open, identify and negotiate, by way of live mode if need be. Raises ThetaError."""
        transport = await self._open(self._wanted_serial())
        found = bringup.functions(transport)
        if found.video is None and found.still is not None:
            serial = transport.identity.serial
            await bringup.switch_to_live(transport, found.still, keep_awake=self.config.keep_awake)
            await self._let_go()
            transport = await self._await_return(serial)
            found = bringup.functions(transport)
        if found.video is None:
            raise ThetaGone("the camera did not change to live mode; use its mode button")
        if found.still is not None:
            timers = None if self.config.health_s > 0 else self.config.keep_awake
            self._firmware = await bringup.rouse(transport, found.still, keep_awake=timers)
        self._link = Link.CONFIGURING
        return found.video, await bringup.agree(transport, found.video, self.config.mode)

    def _wanted_serial(self) -> str | None:
        """As configured; after a change of mode the one that is on its way back, for as long as that may take."""
        if self.config.serial is None and time.monotonic() < self._returning_until:
            return self._returning
        return self.config.serial

    async def _open(self, serial: str | None) -> UsbTransport:
        self._link = Link.CONNECTING
        self._gone.clear()
        loop = asyncio.get_running_loop()
        transport = self._factory()

        def gone(reason: str) -> None:
            loop.call_soon_threadsafe(self._lose, transport, reason)

        await transport.open(serial, gone)
        self._transport = transport
        self._link = Link.IDENTIFYING
        self._identity = transport.identity
        return transport

    async def _await_return(self, serial: str) -> UsbTransport:
        """Wait for the camera to come back in live mode. Raises ThetaTimeout.

        Whatever else it says meanwhile passes: until udev has seen it, its new face belongs to root alone.
        """
        deadline = time.monotonic() + self.config.reenumeration_s
        last: ThetaError | None = None
        while time.monotonic() < deadline:
            try:
                transport = await self._open(serial or None)
                if bringup.functions(transport).video is not None:
                    return transport
                await self._let_go()
            except ThetaError as error:
                log.debug("still away: %s", error)
                last = error
                await self._let_go()
            await asyncio.sleep(RETURN_PAUSE_S)
        why = "unplug and replug it" if last is None or isinstance(last, ThetaNotFound) else str(last)
        raise ThetaTimeout(f"the camera did not come back in live mode; {why}")

    async def _stream(self, video: VideoFunction, agreement: bringup.Agreement) -> None:
        """Stream until the camera is lost. Always ends with a ThetaError."""
        config = self.config
        self._collector.thirsty_since_ns = None
        await self._start(video, agreement)
        self._begin_watch()
        ladder = Ladder(time.monotonic_ns(), stall_s=config.stall_s, first_picture_s=config.first_picture_s)
        drought = Drought(config.key_picture_s)
        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(WATCH_S):
                    await self._gone.wait()
            if self._gone.is_set():
                raise ThetaGone(self._reason)
            now_ns = time.monotonic_ns()
            step = ladder.due(now_ns, self._collector.last_end_ns)
            what = f"no picture for {config.stall_s:g} s"
            if step is None and drought.due(now_ns, self._collector.thirsty_since_ns):
                step, what = Step.RESTART, "no whole key picture for too long"
            if step is None:
                if self._detail and now_ns - (self._collector.last_end_ns or 0) < config.stall_s * 1e9:
                    self._detail = ""
                continue
            self._detail = f"{what}: {step.value}"
            log.warning("camera: %s", self._detail)
            if step is Step.REOPEN or (self._once and step is Step.TOGGLE):  # nobody would fetch it back
                raise ThetaTimeout("the camera sends no pictures and restarting it did not help; replug it")
            self._restarts += 1
            agreement = await self._climb(step, video, agreement)
            ladder.started(time.monotonic_ns())

    async def _climb(self, step: Step, video: VideoFunction, agreement: bringup.Agreement) -> bringup.Agreement:
        """Take one step of the ladder; returns what is agreed then. Raises ThetaError."""
        transport = self._open_transport()
        await transport.stop_video()
        if step in (Step.TOGGLE, Step.RESET):
            await self._end_watch()
        if step is Step.TOGGLE:
            self._returning = transport.identity.serial or None
            self._returning_until = time.monotonic() + self.config.reenumeration_s
            await bringup.leave_live(transport)
            raise ThetaGone("the camera was sent to still mode, to be fetched back")
        if step is Step.RESET:
            await transport.reset()
        else:
            await transport.set_interface(video.interface, 0)
        if step is not Step.RESTART or not agreement.pipe.alternate:
            agreement = await bringup.agree(transport, video, self.config.mode)
        await self._start(video, agreement)
        if step is Step.RESET:
            self._begin_watch()
        return agreement

    def _begin_watch(self) -> None:
        transport = self._open_transport()
        still = bringup.functions(transport).still
        if still is not None and self.config.health_s > 0:
            config = self.config
            beside = watch(transport, still, config.health_s, self._is_well, keep_awake=config.keep_awake)
            self._watch = asyncio.create_task(beside)

    async def _end_watch(self) -> None:
        task, self._watch = self._watch, None
        if task is not None:
            task.cancel()
            await asyncio.wait([task])

    def _is_well(self, health: Health) -> None:
        if health.faults and (self._health is None or health.faults != self._health.faults):
            log.warning("the camera says: %s", ", ".join(health.faults))
        self._health = health
        if self._on_health is not None:
            self._on_health(health)

    async def _start(self, video: VideoFunction, agreement: bringup.Agreement) -> None:
        transport, pipe = self._open_transport(), agreement.pipe
        self._collector.restart(agreement.probe.framing)
        if pipe.alternate:  # a bulk pipe in setting 0 streams from the commit on
            await transport.set_interface(video.interface, pipe.alternate)
        await transport.start_video(pipe.endpoint, agreement.probe.max_payload_bytes, self._collector.packets)
        self._link = Link.STREAMING

    def _open_transport(self) -> UsbTransport:
        if self._transport is None:
            raise ThetaGone("the camera is not open")
        return self._transport

    def _lose(self, transport: UsbTransport, reason: str) -> None:
        if transport is self._transport:
            self._reason = reason
            self._gone.set()

    async def _let_go(self) -> None:
        """Close the transport whatever state it is in; what it says meanwhile is of no interest."""
        await self._end_watch()
        transport, self._transport = self._transport, None
        if transport is None:
            return
        try:
            async with asyncio.timeout(LETTING_GO_S):
                if not self._gone.is_set():
                    await self._stop(transport)
        except (ThetaError, TimeoutError) as error:
            log.debug("while letting go of the camera: %s", error)
        finally:
            await transport.close()

    async def _stop(self, transport: UsbTransport) -> None:
        """Some cameras need alternate setting 0 before they will start again (fact sheet 3.3)."""
        await transport.stop_video()
        video = bringup.functions(transport).video
        if video is not None:
            await transport.claim(video.interface)
            await transport.set_interface(video.interface, 0)
            for pipe in video.pipes:
                if pipe.endpoint.kind == BULK:
                    await transport.clear_halt(pipe.endpoint.address)
            await transport.release(video.interface)
