"""The video's transfers: kept queued on one endpoint, handed on packet by packet, reaped at the end."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from dataclasses import dataclass

import numpy as np

from drivers.theta_v.codec.descriptors import ISOCHRONOUS, Endpoint
from drivers.theta_v.codec.payload import RAN_DRY, Packet
from drivers.theta_v.errors import ThetaGone, ThetaMalformed, ThetaRefused
from drivers.theta_v.transport import usb1_api
from drivers.theta_v.transport.base import GoneSink, PacketSink
from drivers.theta_v.transport.microframes import Listening, Pauses
from drivers.theta_v.transport.usb1_api import Handle, Transfer

REAP_S = 2.0  # cancelled transfers come back within a microframe or two
MAX_ERRORS = 32  # transfers in a row that failed as a whole: the endpoint is dead
MAX_PAYLOAD_BYTES = 4 << 20  # one bulk payload; the kernel lends 16 MiB to all USB programs together
MAX_BULK_QUEUE_BYTES = 4 << 20

USBFS_LIMIT = (
    "the kernel lends no more memory for USB transfers: the video wants {mib:.1f} MiB, and all programs together"
    " get 16 MiB unless told otherwise; as root: echo 64 > /sys/module/usbcore/parameters/usbfs_memory_mb"
)

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Queue:
    """How much video the kernel collects while this process is held up."""

    transfers: int = 64
    packets: int = 32
    """Per isochronous transfer: 4 ms, which batching may add to the latency of a picture.

    64 of them last 256 ms and take 6 MiB of the 16 MiB usbfs has (84 times 64 would just fit). In a slow
    virtual machine a queue of 8 ms damaged most pictures and one of 128 ms none.
    """

    def __post_init__(self) -> None:
        if self.transfers < 1 or not 1 <= self.packets <= 128:
            raise ValueError("a queue has at least one transfer of 1 to 128 packets: the kernel takes no more")


class VideoTransfers:
    """One stream from `start` to `stop`. `on_dead` is told, from the event thread, when it ends by itself."""

    def __init__(
        self, handle: Handle, endpoint: Endpoint, payload_bytes: int, queue: Queue, sink: PacketSink, on_dead: GoneSink
    ) -> None:
        self._sink, self._on_dead = sink, on_dead
        self._isochronous = endpoint.kind == ISOCHRONOUS
        if self._isochronous:
            count, packets = queue.transfers, queue.packets
            self._listening, self._pauses = Listening(count, packets), Pauses()
            self._transfer_bytes = packets * endpoint.max_packet_bytes
        else:
            # One transfer takes one payload: it ends with a short packet or when it is full.
            whole = max(endpoint.max_packet_bytes, 1)
            self._transfer_bytes = -(-max(payload_bytes, whole) // whole) * whole
            if self._transfer_bytes > MAX_PAYLOAD_BYTES:
                raise ThetaMalformed(f"the camera announces video payloads of {payload_bytes} bytes")
            count, packets = max(2, min(queue.transfers, MAX_BULK_QUEUE_BYTES // self._transfer_bytes)), 0
        self._transfers = [handle.getTransfer(packets) for _ in range(count)]
        for transfer in self._transfers:
            fill = transfer.setIsochronous if self._isochronous else transfer.setBulk
            fill(endpoint.address, self._transfer_bytes, self._ended)
        self._packet_bytes, self._packets_each = endpoint.max_packet_bytes, packets
        self._tables = {id(t): usb1_api.iso_table(t) for t in self._transfers} if self._isochronous else {}
        self._after_gap: set[int] = set()
        """Transfers that were submitted too late: what came before they began is lost."""
        self._perhaps_after_gap: set[int] = set()
        self._ended_this_round = 0
        self._lock = threading.Lock()
        self._stopping = False
        self._busy = 0
        """Transfers in the air, and those whose callback is running."""
        self._all_down = threading.Event()
        self._errors = 0

    def start(self) -> None:
        """Submit everything. Raises ThetaGone, or ThetaRefused with the remedy when memory is short."""
        for transfer in self._transfers:
            try:
                self._submit(transfer)
            except usb1_api.UsbNoDevice:
                self.stop()
                raise ThetaGone(usb1_api.LEFT_THE_BUS) from None
            except usb1_api.UsbError as error:
                self.stop()
                total = len(self._transfers) * self._transfer_bytes
                log.warning("submitting video transfers: %s", error)
                raise ThetaRefused(USBFS_LIMIT.format(mib=total / 2**20)) from error

    def stop(self) -> None:
        """Cancel and reap; blocks. After this the sink is not called any more."""
        with self._lock:
            self._stopping = True
            if not self._busy:
                self._all_down.set()
        for transfer in self._transfers:
            with contextlib.suppress(usb1_api.UsbError):  # it has come down already, or goes with the device
                transfer.cancel()
        if not self._all_down.wait(REAP_S):
            log.warning("the kernel keeps %d video transfers", self._busy)
            return
        self._tables.clear()
        for transfer in self._transfers:
            transfer.close()  # with their callbacks they form a circle, and hold megabytes until it is collected

    def round_ended(self) -> None:
        """In the event thread, whenever libusb has handed over all that had ended.

        Time alone tells of a gap only where a bus keeps time, and an emulated one does not. But while even one
        transfer of the queue had not ended yet, somebody listened.
        """
        if self._perhaps_after_gap:
            if self._ended_this_round >= len(self._transfers):
                self._after_gap |= self._perhaps_after_gap
                self._listening.warn()
            self._perhaps_after_gap.clear()
        self._ended_this_round = 0

    def _submit(self, transfer: Transfer) -> bool:
        """False once the stream is to end: nothing may be in the air that `stop` did not cancel."""
        with self._lock:
            if self._stopping:
                return False
            transfer.submit()
            self._busy += 1
            return True

    def _ended(self, transfer: Transfer) -> None:
        """In the event thread: copy, submit again, then hand on."""
        reason = ""
        try:
            # What comes after a cancel has begun is half a transfer at best.
            reason = "" if self._stopping else self._take(transfer, time.monotonic_ns())
        except usb1_api.UsbError as error:
            reason = str(usb1_api.translated(error, "video"))
        except Exception as error:  # libusb's callbacks would swallow it
            log.exception("a mistake of this driver ended the video")
            reason = f"the driver failed: {error!r}"
        finally:
            with self._lock:
                self._busy -= 1
                if self._stopping and not self._busy:
                    self._all_down.set()
        if reason:
            self._on_dead(reason)

    def _take(self, transfer: Transfer, stamp_ns: int) -> str:
        status = transfer.getStatus()
        if status == usb1_api.NO_DEVICE:
            return usb1_api.LEFT_THE_BUS
        if status == usb1_api.CANCELLED:
            return "the kernel ended the video stream; unplug and replug the camera"
        self._errors = self._errors + 1 if status != usb1_api.COMPLETED else 0
        if self._errors > MAX_ERRORS:
            return "the camera's video endpoint is dead; unplug and replug the camera"
        packets = self._packets(transfer, status)
        if id(transfer) in self._after_gap:
            self._after_gap.discard(id(transfer))
            packets.insert(0, (RAN_DRY, b""))
        if self._isochronous:
            self._ended_this_round += 1
            if self._listening.gap(stamp_ns):
                self._perhaps_after_gap.add(id(transfer))
        self._submit(transfer)
        if packets:
            self._sink(stamp_ns, packets)
        return ""

    def _packets(self, transfer: Transfer, status: int) -> list[Packet]:
        """Copies of what a transfer carried."""
        if not self._isochronous:
            payload = bytes(transfer.getBuffer()[: transfer.getActualLength()])
            return [(status, payload)] if payload or status else []
        table = self._tables[id(transfer)]
        carried: list[Packet]
        if table is None:
            every = list(transfer.iterISO())
            slots = [slot for slot, (failed, data) in enumerate(every) if failed or data]
            carried = [every[slot] for slot in slots]
        else:
            buffer, step = transfer.getBuffer(), self._packet_bytes
            found = np.flatnonzero(table[:, 1] | table[:, 2])
            slots = found.tolist()
            carried = [
                (failed, bytes(buffer[slot * step : slot * step + length]))
                for slot, (length, failed) in zip(slots, table[found, 1:].tolist(), strict=True)
            ]
        return self._pauses.marked(slots, carried, self._packets_each)
