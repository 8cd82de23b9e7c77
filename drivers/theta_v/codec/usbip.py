"""USB/IP messages, both directions: what `usbip` and the kernel's vhci_hcd speak over TCP.

Layouts: the Linux kernel's Documentation/usb/usbip_protocol.rst, protocol version 1.1.1. Everything is big
endian except the eight setup bytes. Reading is bounded: a length that no THETA needs is an error.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.theta_v.errors import ThetaMalformed

VERSION = 0x0111
OP_REQ_DEVLIST, OP_REP_DEVLIST = 0x8005, 0x0005
OP_REQ_IMPORT, OP_REP_IMPORT = 0x8003, 0x0003
CMD_SUBMIT, CMD_UNLINK, RET_SUBMIT, RET_UNLINK = 1, 2, 3, 4
DIR_OUT, DIR_IN = 0, 1
SPEED_HIGH = 3

ST_OK, ST_NA, ST_BUSY, ST_ERROR, ST_NODEV = 0, 1, 2, 3, 4

EPIPE, EPROTO, ECONNRESET, ENODEV, EXDEV, EOVERFLOW, EINVAL = 32, 71, 104, 19, 18, 75, 22

MAX_TRANSFER_BYTES = 4 << 20  # usbfs takes no larger URB than its 16 MB pool; the camera's are below 100 kB
MAX_PACKETS = 1024  # per isochronous URB: the kernel's own limit (USBIP_MAX_ISO_PACKETS)
MAX_DEVICES = 64
NO_PACKETS = 0xFFFFFFFF  # number_of_packets of a URB that is not isochronous, as some clients write it

OP = struct.Struct(">HHI")
OP_BYTES = 8
BUSID_BYTES = 32
DEVICE = struct.Struct(">256s32sIIIHHHBBBBBB")
SUBMIT = struct.Struct(">IIIIIIiiII8s")
RETURN = struct.Struct(">IIIIIiiIII8x")
UNLINK = struct.Struct(">IIIIII24x")
HEADER_BYTES = 48

IsoDescriptors = NDArray[np.uint32]
"""(n, 4): offset in the transfer buffer, length, actual length, status (two's complement)."""


@dataclass(frozen=True, slots=True)
class Device:
    """One exported device as the server describes it."""

    path: str
    busid: str
    bus: int
    address: int
    speed: int
    vendor_id: int
    product_id: int
    bcd_device: int
    device_class: tuple[int, int, int]
    configuration: int
    configurations: int
    interfaces: int

    @property
    def devid(self) -> int:
        return self.bus << 16 | self.address

    def encode(self) -> bytes:
        return DEVICE.pack(
            self.path.encode(), self.busid.encode(), self.bus, self.address, self.speed, self.vendor_id,
            self.product_id, self.bcd_device, *self.device_class, self.configuration, self.configurations,
            self.interfaces,
        )  # fmt: skip

    @classmethod
    def decode(cls, raw: bytes) -> Device:
        """Raises ThetaMalformed."""
        if len(raw) != DEVICE.size:
            raise ThetaMalformed(f"USB/IP device record of {len(raw)} bytes")
        path, busid, bus, address, speed, vendor, product, bcd, c, s, p, value, count, n = DEVICE.unpack(raw)
        path, busid = (bytes(t).split(b"\0")[0].decode("ascii", "replace") for t in (path, busid))
        return cls(path, busid, bus, address, speed, vendor, product, bcd, (c, s, p), value, count, n)


@dataclass(frozen=True, slots=True)
class Submit:
    """CMD_SUBMIT, without the data that follows it."""

    sequence: int
    devid: int
    inward: bool
    endpoint: int
    """Number without the direction bit."""
    length: int
    packets: int
    """Isochronous packets; 0 for any other transfer."""
    interval: int = 0
    setup: bytes = bytes(8)
    flags: int = 0
    start_frame: int = 0

    def encode(self) -> bytes:
        return SUBMIT.pack(
            CMD_SUBMIT, self.sequence, self.devid, DIR_IN if self.inward else DIR_OUT, self.endpoint,
            self.flags, self.length, self.start_frame, self.packets, self.interval, self.setup,
        )  # fmt: skip

    @classmethod
    def decode(cls, raw: bytes) -> Submit:
        """Raises ThetaMalformed when a length or count is beyond the limits."""
        _, sequence, devid, direction, endpoint, flags, length, start, packets, interval, setup = SUBMIT.unpack(raw)
        packets = 0 if packets == NO_PACKETS else packets
        if not 0 <= length <= MAX_TRANSFER_BYTES or packets > MAX_PACKETS or endpoint > 15 or direction > 1:
            raise ThetaMalformed(f"USB/IP request for {length} bytes in {packets} packets on {endpoint}")
        return cls(sequence, devid, direction == DIR_IN, endpoint, length, packets, interval, setup, flags, start)


@dataclass(frozen=True, slots=True)
class Return:
    """RET_SUBMIT, without the data that follows it."""

    sequence: int
    status: int
    """0 or a negative errno."""
    length: int
    packets: int = 0
    errors: int = 0
    start_frame: int = 0

    def encode(self) -> bytes:
        return RETURN.pack(
            RET_SUBMIT, self.sequence, 0, 0, 0, self.status, self.length, self.start_frame, self.packets,
            self.errors,
        )  # fmt: skip

    @classmethod
    def decode(cls, raw: bytes) -> Return:
        """Raises ThetaMalformed when a length or count is beyond the limits."""
        _, sequence, _, _, _, status, length, start, packets, errors = RETURN.unpack(raw)
        packets = 0 if packets == NO_PACKETS else packets
        if not 0 <= length <= MAX_TRANSFER_BYTES or packets > MAX_PACKETS:
            raise ThetaMalformed(f"USB/IP answer of {length} bytes in {packets} packets")
        return cls(sequence, status, length, packets, errors, start)


def operation(code: int, status: int = ST_OK) -> bytes:
    return OP.pack(VERSION, code, status)


def decode_operation(raw: bytes, expected: int) -> int:
    """Status of an operation's reply. Raises ThetaMalformed when it is not the expected one."""
    version, code, status = OP.unpack(raw)
    if code != expected or version >> 8 != VERSION >> 8:
        raise ThetaMalformed(f"not a USB/IP server: answered {code:#06x}, version {version:#06x}")
    return int(status)


def unlink(sequence: int, devid: int, victim: int) -> bytes:
    return UNLINK.pack(CMD_UNLINK, sequence, devid, 0, 0, victim)


def unlinked(sequence: int, status: int) -> bytes:
    return UNLINK.pack(RET_UNLINK, sequence, 0, 0, 0, status & 0xFFFFFFFF)


def iso_request(packets: int, packet_bytes: int) -> bytes:
    """Descriptors of an IN URB with `packets` equal packets one after the other."""
    table = np.zeros((packets, 4), ">u4")
    table[:, 0] = np.arange(packets) * packet_bytes
    table[:, 1] = packet_bytes
    return table.tobytes()


def iso_table(raw: bytes | bytearray | memoryview) -> IsoDescriptors:
    return np.frombuffer(raw, ">u4").reshape(-1, 4).astype(np.uint32)
