"""One robot process: its parts put together, run, and taken apart in the right order.

Order of taking apart: operator and loop first, then the base (zero, standby), lidar, camera, then the
threads, and the recording last, so that everything which happened on the way is in it.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import sys
import time
from contextlib import AsyncExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from ghal360_robot import __version__
from ghal360_robot.assembly import (
    camera_mount,
    camera_view,
    detector_options,
    lidar_mount,
    live_settings,
    make_brain,
    make_safety,
    recorder_settings,
)
from ghal360_robot.board import Board, make_board
from ghal360_robot.brain import BrainState
from ghal360_robot.errors import GhalError
from ghal360_robot.guidance.saved import SavedPolicy
from ghal360_robot.hardware.base import BaseOutput
from ghal360_robot.hardware.camera import CameraInput
from ghal360_robot.hardware.lidar import LidarInput
from ghal360_robot.journal import Journal, RunReport, device_report
from ghal360_robot.logbook.handler import RECORDED, LogbookHandler
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.logbook.recovery import start_recovery
from ghal360_robot.logbook.statics import Mount
from ghal360_robot.loop import ControlLoop
from ghal360_robot.perception.decode import Picture, PictureDecoder
from ghal360_robot.perception.detection_worker import DetectionWorker
from ghal360_robot.perception.detectors.remote import RemoteDetector, apart
from ghal360_robot.policy_file import KNOWN, known_before, save_policy
from ghal360_robot.safety.chain import SafetyState
from ghal360_robot.systemd import Notifier

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.theta_v.codec.access_units import AccessUnit
    from ghal360_robot.config import RobotConfig
    from ghal360_robot.messages import Applied, Bookmark, Decision, Detections, Inputs, LinkStats, OperatorInput

logger = logging.getLogger(__name__)

LINK_PERIOD_S = 1.0
"""How often the state of the links goes into the recording and to systemd."""

READY_POLL_S = 0.05
LAST_INPUTS_S = 0.5
"""Closed devices end their streams within a turn of the event loop."""

SWITCH_INTERVAL_S = 0.001
"""Python's default of 5 ms lets a busy thread hold the control loop's up for a quarter of its period."""


class Operator(Protocol):
    """Whoever drives: leaves messages on the board until cancelled."""

    rate_hz: float

    async def run(self, robot: Robot) -> None: ...


class Robot:
    """A robot of this configuration. `await run(stop)` from start to finish; the rest is for looking at it."""

    def __init__(
        self,
        config: RobotConfig,
        operator: Operator | None,
        record_to: Path,
        audience: Callable[[AccessUnit], None] | None = None,
    ) -> None:
        """`audience` is given every access unit on the camera's thread, and has to return at once."""
        self.config = config
        self.operator = operator
        self.record_to = record_to
        self.audience = audience
        self.board: Board = make_board(config, operator.rate_hz if operator else 20.0)
        self.detector = apart(config.perception.detector, detector_options(config))
        self.recorder: Recorder
        self.loop: ControlLoop
        self.journal: Journal
        self.inputs: tuple[CameraInput, LidarInput, BaseOutput]
        self.started = asyncio.Event()
        self.found = asyncio.Event()
        self._worker: DetectionWorker
        self._feeding: list[asyncio.Task[None]] = []

    async def run(self, stop: asyncio.Event) -> RunReport:
        """Until `stop` is set. Raises GhalError when a device does not come up, or the recording cannot be made."""
        start_ns = time.monotonic_ns()
        self.recorder = self._open_recorder()
        recorded = LogbookHandler(self.recorder)
        logging.getLogger().addHandler(recorded)
        try:
            async with AsyncExitStack() as stack:
                stack.push_async_callback(self._last_inputs)
                await self._assemble(stack)
                await self._ready(stop)
                self.journal = Journal(time.monotonic_ns())
                self.started.set()
                try:
                    await self._drive(stop)
                finally:
                    self._remember()
                links = self.links()
        finally:
            logging.getLogger().removeHandler(recorded)
            closed = await asyncio.to_thread(self.recorder.close)
        if not closed:
            logger.error("the recording could not be closed properly: %s", self.recorder.stats.failed or "too slow")
        return self._report((time.monotonic_ns() - start_ns) / 1e9, links)

    def take_operator(self, message: OperatorInput) -> None:
        """A message of an operator: onto the board where it counts, and into the recording as what it is."""
        why_not = self.board.put_operator(message)
        if why_not:
            self.recorder.operator_refused(message.stamp_ns, message.holder, why_not)
        else:
            self.recorder.operator(message)

    def bookmark(self, mark: Bookmark) -> None:
        """Somebody wants to find this moment again."""
        self.recorder.bookmark(mark)
        logger.info("bookmark by %s: %s", mark.holder, mark.note or "(no note)", extra=RECORDED)

    def links(self) -> dict[str, LinkStats]:
        return {device.name: device.stats() for device in self.inputs}

    def not_ready(self) -> tuple[str, ...]:
        """What would keep an arm press from arming right now."""
        newest = self.loop.newest
        return ("starting",) if newest is None else self.loop.safety.not_ready(self.loop.safety_state, newest[0])

    async def _assemble(self, stack: AsyncExitStack) -> None:
        config, board = self.config, self.board
        known = known_before(config.guidance.memory)
        if known is not None:
            save_policy(self.recorder.folder / KNOWN, known)
        brain = make_brain(config, known)  # a fifth of a second of planning: before anything has a deadline
        worker = DetectionWorker(
            self.detector,
            self._detected,
            rate_hz=config.perception.rate_hz,
            view=camera_view(config),
        )
        decoder = PictureDecoder(self._decoded)
        if isinstance(self.detector, RemoteDetector):
            stack.callback(self.detector.close)
        stack.enter_context(worker)
        stack.enter_context(decoder)
        self._worker = worker
        base = BaseOutput(config.rmp110, config.safety, board, self.recorder)
        lidar = LidarInput(config.tim571, board, self.recorder)
        camera = CameraInput(config.theta, self.recorder, decoder, self.audience)
        self.inputs = (camera, lidar, base)
        for device in self.inputs:  # left in reverse order: the base comes to a stop first
            await device.enter(stack)
            self._feeding.append(asyncio.create_task(device.run(), name=device.name))
        self.loop = ControlLoop(
            board=board,
            brain=brain,
            safety=make_safety(config),
            actuator=base,
            log=self.recorder,
            notifier=Notifier.from_environment(),
            rate_hz=config.control.rate_hz,
            brain_state=BrainState(),
            safety_state=SafetyState(),
            on_tick=self._on_tick,
        )

    def _remember(self) -> None:
        """What was learned from the operator goes back into its file; a run that cannot write it says so and ends."""
        online, memory = self.loop.brain_state.online, self.config.guidance.memory
        if online is None or not memory:
            return
        learnt = online.learnt
        provenance = {
            "learned_in": self.recorder.run_id,
            "learning": self.config.guidance.learn,
            "version": __version__,
        }
        saved = SavedPolicy(learnt.q, provenance, learnt.rates, learnt.epochs)
        try:
            save_policy(Path(memory).expanduser(), saved)
        except GhalError as error:
            logger.error("what was learned from the operator is lost: %s", error)  # noqa: TRY400 - it is no surprise

    async def _ready(self, stop: asyncio.Event) -> None:
        """Wait until all three devices stream; a device that does not come up ends the run with its sentence."""
        limit_s = self.config.robot.startup_s
        deadline_ns = time.monotonic_ns() + round(limit_s * 1e9)
        while not stop.is_set():
            missing = {name: link for name, link in self.links().items() if link.link != "streaming"}
            if not missing:
                return
            if time.monotonic_ns() > deadline_ns:
                name, link = next(iter(missing.items()))
                more = f" ({', '.join(list(missing)[1:])} missing as well)" if len(missing) > 1 else ""
                raise GhalError(f"{name} is not there after {limit_s:g} s: {link.detail or link.link}{more}")
            await asyncio.sleep(READY_POLL_S)

    async def _drive(self, stop: asyncio.Event) -> None:
        """The loop, and beside it the tasks that feed it; the first that fails ends the run."""
        gc.collect()
        gc.freeze()  # what exists now lives as long as the robot: the collector need not look at it again
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        notifier = self.loop.notifier
        notifier.ready()
        own = [asyncio.create_task(self._report_links(), name="links")]
        if self.operator is not None:
            own.append(asyncio.create_task(self.operator.run(self), name="operator"))
        ticking = asyncio.create_task(self.loop.run(stop), name="control loop")
        try:
            done, _ = await asyncio.wait({ticking, *own, *self._feeding}, return_when=asyncio.FIRST_COMPLETED)
            failed = next((task for task in done if not task.cancelled() and task.exception()), None)
            if failed is not None:
                logger.error("%s failed: %r", failed.get_name(), failed.exception())
                failed.result()
            if ticking not in done:
                raise GhalError(f"{next(iter(done)).get_name()} ended by itself: this should not happen")
        finally:
            notifier.stopping()
            for task in (ticking, *own):
                task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.wait({ticking, *own})
            notifier.close()

    async def _last_inputs(self) -> None:
        """Closed devices end their streams by themselves; what they still had is taken in and recorded."""
        if self._feeding:
            _, late = await asyncio.wait(self._feeding, timeout=LAST_INPUTS_S)
            for task in late:
                task.cancel()

    async def _report_links(self) -> None:
        while True:
            links = self.links()
            for name, link in links.items():
                self.recorder.link(name, link)
            words = [f"{name} {link.link}" for name, link in links.items()]
            self.loop.notifier.status("; ".join((*self.recorder.stats.not_recorded, ", ".join(words))))
            await asyncio.sleep(LINK_PERIOD_S)

    def _on_tick(self, inputs: Inputs, decision: Decision, applied: Applied) -> None:
        self.journal.observe(inputs, decision, applied)
        if self.journal.found_ns is not None:
            self.found.set()

    def _decoded(self, picture: Picture) -> None:
        """On the decoder's thread."""
        if not picture.tainted:
            self.board.put_picture(picture.stamp_ns)
        if self.detector.class_names:
            self._worker.offer(picture)

    def _detected(self, detections: Detections) -> None:
        self.board.put_detections(detections)
        self.recorder.detections(detections)

    def _open_recorder(self) -> Recorder:
        lidar, camera, view = lidar_mount(self.config), camera_mount(self.config), camera_view(self.config)
        start_recovery(self.record_to)
        return Recorder(
            self.record_to,
            properties={
                "robot": self.config.robot.name,
                "version": __version__,
                "target": self.config.perception.target,
                "detector": self.config.perception.detector,
                "policy": self.config.guidance.policy,
            },
            config_json=self.config.model_dump_json(indent=1),
            calibration_json=self.config.mounting.model_dump_json(),
            settings=recorder_settings(self.config),
            live=live_settings(self.config),
            mounts={
                "lidar": Mount(lidar.x, lidar.y, lidar.z, lidar.yaw),
                "theta": Mount(camera.x, camera.y, camera.z, camera.yaw, view.pitch, view.roll),
            },
        )

    def _report(self, seconds: float, links: dict[str, LinkStats]) -> RunReport:
        journal, loop, detection = self.journal, self.loop, self._worker.stats()
        folder = self.recorder.folder
        stats = self.recorder.stats
        return RunReport(
            found=journal.found_ns is not None,
            seconds_to_found=journal.seconds_to_found,
            seconds=round(seconds, 2),
            distance_m=round(journal.distance_m, 2),
            ticks=loop.ticks,
            ticks_skipped=loop.lateness.skipped,
            tick_lateness_ms=loop.lateness.summary(),
            cues=dict(journal.cues),
            stops=journal.stops,
            theta=device_report(links["theta"]),
            rmp110=device_report(links["rmp110"]),
            tim571=device_report(links["tim571"]),
            detections={
                "detector": self.detector.name,
                "pictures": detection.detected,
                "failed": detection.failed,
                "last_ms": round(detection.last_duration_s * 1e3, 1),
            },
            logbook={
                "dropped_video": stats.dropped_video,
                "dropped_rest": stats.dropped_rest,
                "failed_rows": stats.failed_rows,
                "failed": stats.failed,
            },
            recording=str(folder),
            recording_bytes=sum(part.stat().st_size for part in folder.glob("*.rrd")),
        )
