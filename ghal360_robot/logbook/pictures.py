"""The recorded video, decoded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import av

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ghal360_robot.logbook.reader import RunReader


def pictures(
    reader: RunReader, from_ns: int | None = None, to_ns: int | None = None
) -> Iterator[tuple[int, av.VideoFrame]]:
    """Every picture that decodes between two stamps, with the stamp of its access unit.

    Decoding begins at the last key picture that is not later than `from_ns`.
    """
    decoder = av.VideoCodecContext.create("h264", "r")
    stamps: dict[int, int] = {}
    started = False
    for number, unit in enumerate(reader.access_units(from_ns, to_ns)):
        started = started or unit.keyframe
        if not started:
            continue
        packet = av.Packet(unit.data)
        packet.pts = number
        stamps[number] = unit.stamp_ns
        yield from _decoded(decoder, packet, stamps, from_ns)
    yield from _decoded(decoder, None, stamps, from_ns)


def _decoded(
    decoder: av.VideoCodecContext, packet: av.Packet[Any] | None, stamps: dict[int, int], from_ns: int | None
) -> Iterator[tuple[int, av.VideoFrame]]:
    try:
        frames = decoder.decode(packet)
    except av.error.FFmpegError:
        return  # damaged on the wire and recorded as received: the film goes on with the next one
    for frame in frames:
        stamp_ns = stamps.pop(-1 if frame.pts is None else frame.pts, None)
        if stamp_ns is not None and (from_ns is None or stamp_ns >= from_ns):
            yield stamp_ns, frame
