"""Single USB transfers as awaitables: control, bulk and interrupt, each cancelled when its time is up."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable

from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaMalformed, ThetaStall, ThetaTimeout
from drivers.theta_v.transport import usb1_api
from drivers.theta_v.transport.usb1_api import Handle, Transfer

log = logging.getLogger(__name__)


async def exchange(
    handle: Handle,
    prepare: Callable[[Transfer, Callable[[Transfer], None]], None],
    what: str,
    timeout_s: float,
) -> bytes:
    """Submit one transfer that `prepare` fills in, and await its end; returns the bytes that came in.

    Raises ThetaError. A transfer given up is cancelled; libusb gives it back to nobody a moment later.
    """
    loop = asyncio.get_running_loop()
    future: asyncio.Future[bytes] = loop.create_future()

    def settle(outcome: bytes | ThetaError) -> None:
        if future.done():
            return
        if isinstance(outcome, bytes):
            future.set_result(outcome)
        else:
            future.set_exception(outcome)

    def ended(transfer: Transfer) -> None:
        outcome = _outcome(transfer, what)
        transfer.doom()  # libusb frees it behind this callback
        try:
            loop.call_soon_threadsafe(settle, outcome)
        except RuntimeError:
            log.debug("an answer of the camera came after the event loop had ended")

    transfer = handle.getTransfer()
    prepare(transfer, ended)
    try:
        transfer.submit()
    except usb1_api.UsbError as error:
        transfer.close()
        raise usb1_api.translated(error, what) from error
    try:
        async with asyncio.timeout(timeout_s):
            return await future
    except TimeoutError:
        raise ThetaTimeout(f"the camera did not answer {what} within {timeout_s:g} s") from None
    finally:
        if not future.done() or future.cancelled():
            # It may end of itself at this very moment, or with the device: both are as good as cancelled.
            with contextlib.suppress(usb1_api.UsbNotFound, usb1_api.UsbNoDevice):
                transfer.cancel()


def _outcome(transfer: Transfer, what: str) -> bytes | ThetaError:
    match transfer.getStatus():
        case usb1_api.COMPLETED:
            return bytes(transfer.getBuffer()[: transfer.getActualLength()])
        case usb1_api.STALLED:
            return ThetaStall(f"the camera refuses {what}")
        case usb1_api.NO_DEVICE:
            return ThetaGone(usb1_api.LEFT_THE_BUS)
        case usb1_api.CANCELLED:
            return ThetaGone(f"the camera was closed during {what}")
        case usb1_api.OVERFLOWED:
            return ThetaMalformed(f"the camera answers more than was asked for to {what}")
        case status:
            return ThetaGone(f"USB error {status} during {what}; unplug and replug the camera")
