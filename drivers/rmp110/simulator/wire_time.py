"""How long frames take on the wire: classic CAN with bit stuffing, at 1 Mbit/s."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.rmp110.codec.frames import Frame

BIT_NS = 1000
"""1 Mbit/s (fact sheet 3.1)."""
TAIL_BITS = 13
"""CRC delimiter, acknowledge slot and delimiter, end of frame, and the three bits between frames."""
CRC_POLYNOMIAL, CRC_BITS = 0x4599, 15


def frame_bits(frame: Frame) -> int:
    """Bits of a standard data frame, stuff bits and the gap after it included: 111 to 135 for eight bytes."""
    bits = [*_bits(frame.can_id, 12), 0, 0, 0, *_bits(len(frame.data), 4)]
    for byte in frame.data:
        bits += _bits(byte, 8)
    bits += _bits(_crc(bits), CRC_BITS)
    return len(bits) + _stuffed(bits) + TAIL_BITS


def schedule_ns(frames: Sequence[Frame]) -> tuple[int, ...]:
    """When each frame of a burst is complete, after the burst began on an idle bus."""
    done, offsets = 0, []
    for frame in frames:
        done += frame_bits(frame) * BIT_NS
        offsets.append(done)
    return tuple(offsets)


def _bits(value: int, count: int) -> list[int]:
    """Start of frame is the identifier's leading zero where `count` is 12."""
    return [value >> shift & 1 for shift in range(count - 1, -1, -1)]


def _crc(bits: Sequence[int]) -> int:
    crc = 0
    for bit in bits:
        feedback = bit ^ (crc >> (CRC_BITS - 1))
        crc = crc << 1 & (1 << CRC_BITS) - 1
        if feedback:
            crc ^= CRC_POLYNOMIAL
    return crc


def _stuffed(bits: Sequence[int]) -> int:
    """After five equal bits, stuff bits included, comes one of the other kind."""
    stuffed, last, run = 0, -1, 0
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed += 1
            last, run = 1 - bit, 1
    return stuffed
