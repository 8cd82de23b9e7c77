"""The USB transport as the device layer sees it, and what all transports share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from drivers.theta_v.codec.descriptors import Endpoint
from drivers.theta_v.codec.payload import Packet
from drivers.theta_v.errors import ThetaMalformed, ThetaStall

RICOH = 0x05CA
PRODUCT_PREFIX = "RICOH THETA"

MICROFRAME_NS = 125_000  # USB 2.0 high speed: 8000 a second

CONTROL_S = 5.0  # SET_INTERFACE is answered only once the camera's encoder runs (fact sheet 3.3)
BULK_S = 3.0  # PTP: the slowest answer seen in public traces is below a second

GET_DESCRIPTOR, SET_CONFIGURATION, SET_INTERFACE, CLEAR_FEATURE = 0x06, 0x09, 0x0B, 0x01
DEVICE_DESCRIPTOR, CONFIGURATION_DESCRIPTOR, STRING_DESCRIPTOR = 0x0100, 0x0200, 0x0300
ENGLISH = 0x0409

PacketSink = Callable[[int, list[Packet]], None]
"""Called with the arrival time and the packets of one batch; they are valid only during the call.

A packet is one UVC payload: what one microframe carried, or one bulk transfer. A run of empty microframes is
one empty packet. A queue that ran dry shows as a packet of status `RAN_DRY`.
"""
GoneSink = Callable[[str], None]
"""Called once, with the reason, when the device is gone."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Who is at the other end, by its descriptors."""

    vendor_id: int
    product_id: int
    manufacturer: str
    product: str
    serial: str

    @property
    def is_theta(self) -> bool:
        """By vendor and product name; product ids differ by model and mode (fact sheet 1.1)."""
        return self.vendor_id == RICOH and self.product.startswith(PRODUCT_PREFIX)


class UsbTransport(Protocol):
    """One THETA on some kind of USB. Everything but `start_video`'s sink runs on the event loop.

    Any method may raise ThetaGone (unplugged), ThetaTimeout, ThetaStall (the endpoint stalled) or
    ThetaMalformed (nonsense from the other end).
    """

    @property
    def name(self) -> str:
        """Where it looks for the camera, in words."""

    @property
    def identity(self) -> Identity: ...

    @property
    def device_descriptor(self) -> bytes: ...

    @property
    def configuration(self) -> bytes:
        """The whole active configuration, wTotalLength bytes."""

    async def open(self, serial: str | None, on_gone: GoneSink) -> None:
        """Find a THETA (the one with this serial number, if given) and take it.

        `on_gone` may be called from any thread. Raises ThetaNotFound, ThetaWrongDevice or ThetaRefused.
        """

    async def close(self) -> None:
        """Let go of everything; safe at any time, also twice."""

    async def control(
        self,
        request_type: int,
        request: int,
        value: int,
        index: int,
        data_or_length: bytes | int = b"",
        timeout_s: float = CONTROL_S,
    ) -> bytes:
        """One control transfer: bytes go out, a number is the length wanted in. Returns what came in."""

    async def bulk_out(self, endpoint: int, data: bytes, timeout_s: float = BULK_S) -> None:
        """Send one transfer; empty data is a zero-length packet."""

    async def bulk_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        """Receive up to `length` bytes; ends early at a short packet."""

    async def interrupt_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes: ...

    async def set_interface(self, interface: int, alternate: int) -> None: ...

    async def claim(self, interface: int) -> None:
        """Raises ThetaRefused when another program holds the interface."""

    async def release(self, interface: int) -> None: ...

    async def clear_halt(self, endpoint: int) -> None:
        """Make a stalled bulk endpoint work again."""

    async def reset(self) -> None:
        """Reset the camera's port. Claims survive, alternate settings return to 0; raises ThetaGone if it left."""

    async def start_video(self, endpoint: Endpoint, payload_bytes: int, on_packets: PacketSink) -> None:
        """Keep transfers queued on `endpoint`, isochronous or bulk; `payload_bytes` is the largest payload agreed.

        The sink is called from the transport's own thread.
        """

    async def stop_video(self) -> None:
        """Cancel and reap all transfers; after this the sink is not called any more."""


async def read_device_descriptor(transport: UsbTransport) -> bytes:
    """Read and check the device descriptor. Raises ThetaMalformed."""
    raw = await transport.control(0x80, GET_DESCRIPTOR, DEVICE_DESCRIPTOR, 0, 18)
    if len(raw) < 18 or raw[1] != 1:
        raise ThetaMalformed("the USB device does not describe itself; unplug and replug it")
    return raw[:18]


async def read_configuration(transport: UsbTransport) -> bytes:
    """Read the first configuration whole. Raises ThetaMalformed."""
    head = await transport.control(0x80, GET_DESCRIPTOR, CONFIGURATION_DESCRIPTOR, 0, 9)
    if len(head) < 9:
        raise ThetaMalformed("the USB device has no configuration; unplug and replug it")
    total = int.from_bytes(head[2:4], "little")
    raw = await transport.control(0x80, GET_DESCRIPTOR, CONFIGURATION_DESCRIPTOR, 0, total)
    if len(raw) != total:
        raise ThetaMalformed(f"the USB configuration ends after {len(raw)} of {total} bytes")
    return raw


async def read_identity(transport: UsbTransport, device_descriptor: bytes) -> Identity:
    """Read the three strings. A string the device will not give is empty."""
    vendor, product = (int.from_bytes(device_descriptor[i : i + 2], "little") for i in (8, 10))
    texts: list[str] = []
    for index in device_descriptor[14:17]:
        try:
            raw = await transport.control(0x80, GET_DESCRIPTOR, STRING_DESCRIPTOR | index, ENGLISH, 255)
        except ThetaStall:
            raw = b""
        well_formed = index and len(raw) >= 2 and raw[1] == 3
        texts.append(raw[2 : raw[0]].decode("utf-16-le", "replace") if well_formed else "")
    return Identity(vendor, product, *texts)
