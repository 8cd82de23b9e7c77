"""From any THETA on the bus to one that streams: identify it, wake it, switch it to live mode, negotiate."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import dataclass

from drivers.theta_v.codec.descriptors import (
    Pipe,
    StillFunction,
    VideoFunction,
    find_still,
    find_video,
    parse_configuration,
)
from drivers.theta_v.codec.probe import Probe, negotiate
from drivers.theta_v.codec.ptp import CaptureMode, Property
from drivers.theta_v.device.config import Mode
from drivers.theta_v.device.ptp_session import PtpSession
from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaMalformed, ThetaRefused, ThetaStall, ThetaTimeout
from drivers.theta_v.transport.base import UsbTransport

WAKE_S, WAKE_PAUSE_S = 5.0, 0.1  # from sleep to awake; a V takes about two seconds
ATTENTION_S = 6.0  # for a live camera to wake up and obey; one whose PTP is out of order streams all the same

STAY_AWAKE = {Property.SLEEP_DELAY_S: 0, Property.AUTO_POWER_OFF_S: 0, Property.AUDIO_VOLUME: 0}
"""Never sleep, never switch off, do not beep: a camera on a robot is switched by its power."""

AS_DELIVERED = {Property.SLEEP_DELAY_S: 180, Property.AUTO_POWER_OFF_S: 64800}
"""Both timers as a V has them from the factory (fact sheet 4.3)."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Functions:
    """What the camera shows in its present mode."""

    video: VideoFunction | None
    still: StillFunction | None


@dataclass(frozen=True, slots=True)
class Agreement:
    """What was negotiated: the committed block and the pipe it comes through."""

    probe: Probe
    pipe: Pipe


def functions(transport: UsbTransport) -> Functions:
    """Read the descriptors of an open transport. Raises ThetaMalformed."""
    configuration = parse_configuration(transport.configuration)
    found = Functions(find_video(configuration), find_still(configuration))
    if found.video is None and found.still is None:
        raise ThetaMalformed(
            f"{transport.identity.product} has neither a video nor a PTP interface; set it to live streaming"
            " with its mode button"
        )
    return found


async def rouse(transport: UsbTransport, still: StillFunction, *, keep_awake: bool | None) -> str:
    """Of a camera in live mode, which may sleep there: wake it, and return its firmware version.

    Its timers are set too, unless `keep_awake` is None: the watch does that beside the stream, which a camera
    that is busy for a while need not hold up. The version is "" where PTP is not to be had: another program may
    hold it, and pictures are worth trying for without.
    """
    session = PtpSession(transport, still)
    version = ""
    try:
        async with asyncio.timeout(ATTENTION_S):
            await session.open()
            version = (await session.device_info()).version
            await wake(session)
            if keep_awake is not None:
                await set_timers(session, keep_awake=keep_awake)
    except (ThetaError, TimeoutError) as error:  # if it is gone, the next request says so too
        log.info("the camera does not listen to PTP: %s", error or "it is busy")
    return version


async def wake(session: PtpSession) -> None:
    """Wake a camera that sleeps. Raises ThetaError."""
    await session.set(Property.SLEEP_MODE, 0)
    deadline = time.monotonic() + WAKE_S
    while await session.get(Property.SLEEP_MODE) != 0:
        if time.monotonic() > deadline:
            raise ThetaTimeout("the camera does not wake up; press its power button")
        await asyncio.sleep(WAKE_PAUSE_S)


async def set_timers(session: PtpSession, *, keep_awake: bool) -> None:
    """Forbid sleep and automatic power-off, or put them back to what a new camera does.

    What this camera refuses is only noted; raises ThetaError else.
    """
    for code, value in (STAY_AWAKE if keep_awake else AS_DELIVERED).items():
        try:
            await session.set(code, value)
        except ThetaRefused as error:
            log.info("%s", error)


async def switch_to_live(transport: UsbTransport, still: StillFunction, *, keep_awake: bool = True) -> None:
    """Wake a camera in MTP mode and send it to live mode; it leaves the bus then. Raises ThetaError."""
    session = PtpSession(transport, still)
    await session.open()
    await wake(session)
    await set_timers(session, keep_awake=keep_awake)
    await _send_to(session, CaptureMode.LIVE)


async def leave_live(transport: UsbTransport) -> None:
    """Send a live camera to still mode; it leaves the bus then, its encoder ended. Raises ThetaError."""
    still = functions(transport).still
    if still is None:
        raise ThetaRefused("the camera has no PTP interface to change its mode by; replug it")
    session = PtpSession(transport, still)
    await session.open()
    await wake(session)
    await _send_to(session, CaptureMode.STILL)


async def _send_to(session: PtpSession, mode: CaptureMode) -> None:
    """Whether it obeyed shows in how it comes back: it may leave before it answers. Raises PtpRefused."""
    try:
        await session.set(Property.CAPTURE_MODE, mode)
        await session.close()
    except (ThetaGone, ThetaTimeout, ThetaStall) as error:
        log.debug("the camera left before the end of the session: %s", error)


async def agree(transport: UsbTransport, video: VideoFunction, mode: Mode) -> Agreement:
    """Claim the video interface and negotiate `mode` by the descriptors. Raises ThetaError."""
    found = next(((f, frame) for f in video.formats if (frame := f.frame(mode.width, mode.height)) is not None), None)
    if found is None:
        offered = ", ".join(f"{f.width}x{f.height}" for fmt in video.formats for f in fmt.frames)
        raise ThetaRefused(f"the camera does not offer {mode.width}x{mode.height}, only {offered}; choose another mode")
    video_format, frame = found
    await transport.claim(video.interface)
    # A driver that died may have left it streaming, and it refuses to negotiate then.
    await transport.set_interface(video.interface, 0)
    steps = negotiate(video.interface, video_format.index, frame.index, frame.default_interval_100ns)
    answer: bytes | None = None
    request = next(steps)
    while True:
        try:
            argument = request.length or request.data
            answer = await transport.control(
                request.request_type, request.request, request.value, request.index, argument
            )
        except ThetaStall:
            answer = None
        try:
            request = steps.send(answer)
        except StopIteration as done:
            probe: Probe = done.value
            break
    return Agreement(probe, video.pipe(probe.max_payload_bytes))
