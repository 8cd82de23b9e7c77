"""What can be read from a camera before it streams: both its USB faces, the negotiation, every PTP property.

No public dump of a THETA V in live mode exists; this takes one (fact sheet section 8, readings 1, 2, 6, 7).
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from drivers.theta_v.codec.descriptors import StillFunction, VideoFunction
from drivers.theta_v.codec.probe import (
    BLOCK_BYTES,
    FROM_INTERFACE,
    GET_CUR,
    GET_DEF,
    GET_INFO,
    GET_LEN,
    GET_MAX,
    GET_MIN,
    SET_CUR,
    TO_INTERFACE,
    UVC_1_5_BYTES,
    VS_COMMIT,
    VS_PROBE,
    Probe,
)
from drivers.theta_v.codec.ptp import DeviceInfo, Operation
from drivers.theta_v.device import bringup
from drivers.theta_v.device.ptp_session import PtpRefused, PtpSession
from drivers.theta_v.errors import ThetaError, ThetaTimeout
from drivers.theta_v.transport.base import UsbTransport

RETURN_S, RETURN_PAUSE_S = 30.0, 0.05  # generous: how long it really takes is what is to be found out
QUESTIONS = {
    "GET_LEN": GET_LEN, "GET_INFO": GET_INFO, "GET_DEF": GET_DEF, "GET_MIN": GET_MIN, "GET_MAX": GET_MAX,
    "GET_CUR": GET_CUR,
}  # fmt: skip


@dataclass(slots=True)
class Survey:
    """Bytes as hex, so that it can be written as JSON; an answer in words where the camera refused."""

    faces: list[dict[str, Any]] = field(default_factory=list)
    """Identity, device descriptor and configuration, in each mode the camera was seen in."""
    reenumeration_s: float | None = None
    """From the last word of the old face to the first of the new one; None if it was live already."""
    negotiation: dict[str, str] = field(default_factory=dict)
    device_info: str = ""
    properties: dict[str, dict[str, str]] = field(default_factory=dict)
    """Property descriptions by code, for each face's USB id; a camera in still mode is asked before it is touched."""


async def survey(factory: Callable[[], UsbTransport], serial: str | None, *, keep_awake: bool = True) -> Survey:
    """Ask a camera everything, switching it to live mode if need be, and let go of it. Raises ThetaError."""
    found = Survey()
    transport = factory()
    try:
        await transport.open(serial, lambda _: None)
        functions = _face(found, transport)
        if functions.video is None and functions.still is not None:
            serial = transport.identity.serial
            await _properties(found, transport, functions.still)
            await bringup.switch_to_live(transport, functions.still, keep_awake=keep_awake)
            left = time.monotonic()
            await transport.close()
            transport = await _returned(factory, serial, left + RETURN_S)
            found.reenumeration_s = round(time.monotonic() - left, 3)
            functions = _face(found, transport)
        if functions.video is not None:
            await _negotiation(found, transport, functions.video)
        if functions.still is not None:
            await _properties(found, transport, functions.still)
    finally:
        await transport.close()
    return found


def _face(found: Survey, transport: UsbTransport) -> bringup.Functions:
    who = transport.identity
    found.faces.append(
        {
            "usb_id": f"{who.vendor_id:04x}:{who.product_id:04x}",
            "manufacturer": who.manufacturer,
            "product": who.product,
            "serial": who.serial,
            "device_descriptor": transport.device_descriptor.hex(),
            "configuration": transport.configuration.hex(),
        }
    )
    return bringup.functions(transport)


async def _returned(factory: Callable[[], UsbTransport], serial: str, deadline: float) -> UsbTransport:
    """The camera in live mode; until udev has seen it, it may belong to root alone."""
    while time.monotonic() < deadline:
        transport = factory()
        with contextlib.suppress(ThetaError):
            await transport.open(serial or None, lambda _: None)
            if bringup.functions(transport).video is not None:
                return transport
        await transport.close()
        await asyncio.sleep(RETURN_PAUSE_S)
    raise ThetaTimeout("the camera did not come back in live mode; unplug and replug it")


async def _negotiation(found: Survey, transport: UsbTransport, video: VideoFunction) -> None:
    """All questions about PROBE and COMMIT, before and after asking for each size."""
    await transport.claim(video.interface)
    await transport.set_interface(video.interface, 0)

    async def ask(label: str) -> None:
        for control, selector in (("PROBE", VS_PROBE), ("COMMIT", VS_COMMIT)):
            for name, request in QUESTIONS.items():
                key = f"{label}{control} {name}"
                length = {GET_LEN: 2, GET_INFO: 1}.get(request, UVC_1_5_BYTES)
                try:
                    raw = await transport.control(FROM_INTERFACE, request, selector, video.interface, length)
                    found.negotiation[key] = raw.hex()
                except ThetaError as error:
                    found.negotiation[key] = str(error)

    await ask("")
    for video_format in video.formats:
        for frame in video_format.frames:
            wish = Probe(1, video_format.index, frame.index, frame.default_interval_100ns)
            label = f"{frame.width}x{frame.height} "
            for length in BLOCK_BYTES:  # the longest that is taken is the camera's own
                try:
                    await transport.control(TO_INTERFACE, SET_CUR, VS_PROBE, video.interface, wish.encode(length))
                except ThetaError as error:
                    found.negotiation[f"{label}PROBE SET_CUR {length}"] = str(error)
                else:
                    found.negotiation[f"{label}PROBE SET_CUR {length}"] = "taken"
                    break
            await ask(label)
    await transport.release(video.interface)


async def _properties(found: Survey, transport: UsbTransport, still: StillFunction) -> None:
    session = PtpSession(transport, still)
    answers = found.properties.setdefault(found.faces[-1]["usb_id"], {})
    try:
        await session.open()
        info = await session.raw_device_info()
        found.device_info = info.hex()
        for code in DeviceInfo.decode(info).properties:
            try:
                raw = await session.ask(Operation.GET_PROPERTY_DESCRIPTION, f"property {code:#06x}", code)
                answers[f"{code:#06x}"] = raw.hex()
            except PtpRefused as refusal:
                answers[f"{code:#06x}"] = str(refusal)
        await session.close()
    except ThetaError as error:
        answers["error"] = str(error)
