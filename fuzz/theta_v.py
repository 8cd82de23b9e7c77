"""Hostile bytes for everything in the camera's driver that takes some from a wire, guided by coverage.

    python fuzz/theta_v.py --seconds 600

The first byte chooses what is fuzzed: descriptors, payloads and pictures, NAL units and parameter sets, PTP
containers, USB/IP answers, the simulated camera, or its USB/IP server. Checked for every input: nothing raises
but the driver's own errors, memory stays bounded, and a PTP stream means the same however it is cut. Where atheris
has no wheel, the same checks run on random mutations of the same seeds, without guidance.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path
from random import Random

atheris = None
if __name__ == "__main__":  # a test that borrows the checks needs no instrumented driver
    with suppress(ImportError):
        import atheris

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

with atheris.instrument_imports(include=["drivers.theta_v"]) if atheris else nullcontext():
    from drivers.theta_v.codec import h264, ptp, usbip
    from drivers.theta_v.codec.access_units import MAX_HELD_BYTES, AccessUnitTracker
    from drivers.theta_v.codec.descriptors import find_still, find_video, parse_configuration
    from drivers.theta_v.codec.payload import RAN_DRY, Assembler, Flaw, Packet, Unit
    from drivers.theta_v.codec.probe import Probe
    from drivers.theta_v.codec.sps_rewrite import rewritten
    from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaMalformed, ThetaStall
    from drivers.theta_v.simulator.camera import SimulatedThetaV
    from drivers.theta_v.simulator.descriptors import LIVE_CONFIGURATION, MTP_CONFIGURATION
    from drivers.theta_v.simulator.usbip_session import Session
    from drivers.theta_v.transport.usbip_urbs import Urbs, Video

LONGEST_INPUT = 2000
ANSWER_BYTES = 16 << 20  # the server stops answering at half of that, and one answer is at most 4 MiB
UNIT_BYTES = 500  # the assembler's limit here, small enough to be reached
SPS = bytes.fromhex("674240289a6403c0113f2e02d40404050000030001000003003ce0600000000000")
PICTURE = b"\0\0\0\1" + SPS + b"\0\0\0\1\x68\xce\x3c\x80\0\0\0\1\x65\x88\x84\0\x10\xff"


def check(data: bytes) -> None:
    if len(data) > 1:
        TARGETS[data[0] % len(TARGETS)](data[1:])


def check_descriptors(data: bytes) -> None:
    for raw in (data, LIVE_CONFIGURATION[:2] + (9 + len(data)).to_bytes(2, "little") + LIVE_CONFIGURATION[4:9] + data):
        with suppress(ThetaMalformed):
            configuration = parse_configuration(raw)
            find_still(configuration)
            video = find_video(configuration)
            if video is not None:
                video.pipe(3072)
    with suppress(ThetaMalformed):
        Probe.decode(data)


def check_payloads(data: bytes) -> None:
    """The framing a camera announces, and the rest as packets, each behind its status and its length."""
    packets: list[Packet] = []
    at = 1
    while at + 2 <= len(data):
        status = 0 if data[at] < 224 else RAN_DRY if data[at] == 255 else -18
        packets.append((status, data[at + 2 : at + 2 + data[at + 1]]))
        at += 2 + data[at + 1]
    framing = data[0] if data else 0
    assembler, tracker = Assembler(UNIT_BYTES, opens=h264.opens_stream, framing=framing), AccessUnitTracker()
    for unit in assembler.feed(0, packets):
        if not 0 < len(unit.data) <= UNIT_BYTES:
            raise AssertionError(f"a unit of {len(unit.data)} bytes")
        track(tracker, unit)


def check_pictures(data: bytes) -> None:
    tracker = AccessUnitTracker()
    track(tracker, Unit(PICTURE, Flaw.NONE, 0, 0))
    for piece in (data, b"\0\0\0\1" + data, PICTURE + data):
        track(tracker, Unit(piece, Flaw.NONE, 1, 1))
        with suppress(ThetaMalformed):
            rewritten(piece)
    for parse in (h264.parse_sps, h264.parse_pps, h264.parse_slice_start):
        with suppress(ThetaMalformed):
            parse(data)
    with suppress(ThetaMalformed):
        nals = h264.split(data)
        if any(b"\0\0\1" in data[nal.start : nal.end] for nal in nals):
            raise AssertionError("a start code was missed")


def track(tracker: AccessUnitTracker, unit: Unit) -> None:
    found = tracker.feed(unit)
    if found is None:
        return
    if len(found.raw) > len(unit.data) + MAX_HELD_BYTES or not found.data.endswith(unit.data):
        raise AssertionError("the picture is not what came")
    if not found.tainted and (found.damaged or not found.decodable):
        raise AssertionError("a damaged picture is called clean")


def check_containers(data: bytes) -> None:
    whole, cut = containers([data]), containers([data[i : i + 1] for i in range(len(data))])
    if whole != cut[: len(whole)]:
        raise AssertionError(f"cut differently, the stream is {cut} instead of {whole}")
    for decode in (ptp.DeviceInfo.decode, ptp.PropertyDescription.decode):
        with suppress(ThetaMalformed):
            decode(data)
    for kind in ptp.Kind:
        with suppress(ThetaMalformed):
            ptp.decode_value(kind, data)


def containers(pieces: list[bytes]) -> list[ptp.Container]:
    reader, found = ptp.ContainerReader(1000), []
    with suppress(ThetaMalformed):
        for piece in pieces:
            found += reader.feed(piece)
    for container in found:
        with suppress(ThetaMalformed):
            _ = container.parameters
    return found


def check_usbip(data: bytes) -> None:
    for decode, size in ((usbip.Submit.decode, 48), (usbip.Return.decode, 48), (usbip.Device.decode, 312)):
        with suppress(ThetaMalformed):
            decode(data[:size].ljust(size, b"\0"))
    urbs = Urbs(1, "server")
    urbs.start_video(Video(0x84, 64, 4, lambda *_: None), 2)
    urbs.ask(0, True, b"", 18, bytes(8), "a request", lambda _: None)
    with suppress(ThetaError):
        urbs.answers(memoryview(data), 0)


def check_camera(data: bytes) -> None:
    """The simulated camera must survive what a host may send."""
    port = SimulatedThetaV().connect()
    for at in range(0, len(data), 24):
        piece = data[at : at + 24].ljust(24, b"\0")
        length = int.from_bytes(piece[6:8], "little")
        with suppress(ThetaStall):
            port.control(piece[:8], b"" if piece[0] & 0x80 else piece[8 : 8 + length].ljust(min(length, 64), b"\0"))
        with suppress(ThetaStall):
            port.write(1, piece[8:])
        with suppress(ThetaStall):
            port.read(0x81, 512)


def check_server(data: bytes) -> None:
    """The USB/IP server must survive what a client may send, attached or not, however it is cut."""
    for attached in (False, True):
        session = Session(SimulatedThetaV())
        with suppress(ThetaMalformed, ThetaGone):
            if attached:
                session.receive(usbip.operation(usbip.OP_REQ_IMPORT) + b"1-1".ljust(usbip.BUSID_BYTES, b"\0"))
            for at in range(0, len(data), 40):
                session.receive(data[at : at + 40])
                session.complete(time.monotonic_ns() + 10**9)
        if len(session.outbox) > ANSWER_BYTES:
            raise AssertionError(f"{len(session.outbox)} bytes in answer to {len(data)}")
        session.close()


TARGETS = (
    check_descriptors, check_payloads, check_pictures, check_containers, check_usbip, check_camera, check_server,
)  # fmt: skip


def seeds() -> Iterator[bytes]:
    for raw in (LIVE_CONFIGURATION, MTP_CONFIGURATION, LIVE_CONFIGURATION[9:], Probe().encode(48)):
        yield b"\0" + raw
    for flags in (0x80, 0x82, 0x83, 0xC2):
        packet = bytes([2, flags]) + PICTURE
        yield b"\1\3" + (b"\0" + bytes([len(packet)]) + packet) * 2 + b"\xff\0"
    for raw in (PICTURE, SPS, PICTURE[len(SPS) + 8 :], PICTURE * 2):
        yield b"\2" + raw
    device = SimulatedThetaV().ptp
    for command in (ptp.command(0x1001, 0), ptp.command(0x1002, 0, 1), ptp.command(0x1014, 1, 0x5013)):
        device.receive(command.encode())
        yield b"\3" + command.encode()
        while (answer := device.send(16384)) is not None:
            yield b"\3" + answer
            yield b"\3" + answer[12:]
    yield b"\4" + usbip.Return(1, 0, 64, 4).encode() + bytes(64) + usbip.iso_request(4, 64)
    yield b"\4" + usbip.Return(3, 0, 18).encode() + bytes(18)
    yield b"\4" + usbip.unlinked(4, -104)
    yield (
        b"\5" + bytes.fromhex("0009010000000000").ljust(24, b"\0") + bytes.fromhex("a185000102000200").ljust(24, b"\0")
    )
    setup = bytes.fromhex("0009010000000000")
    yield b"\6" + usbip.Submit(1, 1 << 16 | 2, False, 0, 0, 0, setup=setup).encode() + usbip.unlink(2, 1, 1)
    yield b"\6" + usbip.Submit(1, 1 << 16 | 2, True, 4, 256, 4).encode() + usbip.iso_request(4, 64)
    yield b"\6" + usbip.operation(usbip.OP_REQ_DEVLIST)
    yield b"\5" + bytes(8) + ptp.command(0x1002, 0, 1).encode()


def mutations(seconds: float, seed: int) -> int:
    """Checks for that long without guidance; returns how many inputs."""
    chance, corpus, count = Random(seed), list(seeds()), 0  # noqa: S311
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        data = bytearray(chance.choice(corpus))
        for _ in range(chance.randint(1, 6)):
            at = chance.randrange(1, len(data) + 1)
            match chance.randrange(4):
                case 0:
                    data[at : at + 1] = bytes([chance.choice((0, 1, 3, 255, chance.randrange(256)))])
                case 1:
                    del data[at : at + chance.randint(1, 20)]
                case 2:
                    data[at:at] = chance.choice(corpus)[chance.randrange(20) :][: chance.randint(1, 300)]
                case _:
                    data[at:at] = data[at : at + chance.randint(1, 40)]
        check(bytes(data[:LONGEST_INPUT]))
        count += 1
    return count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--unguided", action="store_true", help="random mutations, as where there is no atheris")
    options = parser.parse_args()
    if atheris is None or options.unguided:
        count = mutations(options.seconds, options.seed)
        sys.stdout.write(f"{count} inputs, no failure (random mutations, not guided)\n")
        return
    with tempfile.TemporaryDirectory(prefix="fuzz-theta-v-") as corpus:
        for number, seed in enumerate(seeds()):
            Path(corpus, f"seed{number:03}").write_bytes(seed)
        limits = [f"-max_total_time={options.seconds}", f"-max_len={LONGEST_INPUT}", f"-seed={options.seed}"]
        bounds = [f"-artifact_prefix={Path(__file__).parent}/", "-timeout=10", "-rss_limit_mb=1024", "-verbosity=1"]
        atheris.Setup([sys.argv[0], *limits, *bounds, corpus], check)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
