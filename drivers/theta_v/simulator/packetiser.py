"""Access units to isochronous packets, byte for byte as the 3.18 gadget kernel does (fact sheet 3.1)."""

from __future__ import annotations

from drivers.theta_v.codec.payload import EOF, EOH

PACKET_BYTES = 3072
HEADER_BYTES = 2


def packetise(
    unit: bytes,
    fid: int,
    *,
    packet_bytes: int = PACKET_BYTES,
    header: bytes = b"",
    end_in_data: bool = True,
) -> list[bytes]:
    """Cut one unit into payloads with frame bit `fid`.

    `header` lengthens the two header bytes (time stamps and vendor data of newer gadgets); its length is
    announced, its flag bits are not set. Without `end_in_data` the end of frame
    comes in an empty payload of its own.
    """
    size = HEADER_BYTES + len(header)
    room = packet_bytes - size
    flags = EOH | fid
    head = bytes([size, flags]) + header
    last = bytes([size, flags | EOF]) + header
    packets = [head + unit[at : at + room] for at in range(0, len(unit), room)]
    if end_in_data and packets:
        packets[-1] = last + packets[-1][size:]
    else:
        packets.append(last)
    return packets
