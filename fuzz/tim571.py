"""Hostile bytes for everything in the lidar driver that takes some from a wire, guided by coverage.

    make fuzz
    python fuzz/tim571.py --seconds 60

Checked for every input, in both dialects: nothing raises but the codec's own TimMalformedError; no matter how the
bytes are cut, the same events come out; memory stays bounded; the next good frame is delivered; whatever decodes
can be made a scan of, stamped and encoded again; the simulated device answers whatever it is sent. Where atheris has
no wheel, the same checks run on random mutations of the same seeds, without guidance.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

atheris: Any = None
if __name__ == "__main__":  # a test that borrows the checks needs no instrumented driver
    with suppress(ImportError):
        atheris = import_module("atheris")

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

with atheris.instrument_imports(include=["drivers.tim571"]) if atheris else nullcontext():
    from drivers.tim571.codec import answers, commands, scandata
    from drivers.tim571.codec.deframer import MAX_PAYLOAD, Damage, Deframer, Frame
    from drivers.tim571.codec.dialect import Dialect, frame
    from drivers.tim571.codec.telegram import Receiver, Telegram, parse
    from drivers.tim571.device.intake import Intake
    from drivers.tim571.errors import TimMalformedError
    from drivers.tim571.simulator.behaviour import Behaviour, Client, DeviceSettings
    from drivers.tim571.simulator.words import in_words

LONGEST_INPUT = 6000  # a scan with RSSI in CoLa-A has as much
BEAMS = 20
GOOD = {dialect: commands.read(dialect, "FirmwareVersion").to_wire() for dialect in Dialect}


def check(data: bytes) -> None:
    """One input: the first byte chooses the dialect, the second how to cut, the rest is the stream."""
    if len(data) < 2:
        return
    dialect = Dialect.B if data[0] & 1 else Dialect.A
    stream = data[2:]
    whole = events_of(dialect, [stream])
    cut = events_of(dialect, list(pieces(stream, data[1])))
    if whole != cut:
        raise AssertionError(f"cut differently, the stream is {cut} instead of {whole}")
    behind = events_of(dialect, [stream, GOOD[dialect]])
    if not (isinstance(behind[-1], Frame) and behind[-1].data == GOOD[dialect]):
        raise AssertionError(f"the good frame is lost behind {behind[-1]}")
    check_telegrams(dialect, stream)
    check_payload(dialect, stream)


def pieces(stream: bytes, seed: int) -> Iterator[bytes]:
    """The stream in segments of any size, single bytes if the seed is zero."""
    chance, at = Random(seed), 0  # noqa: S311
    while at < len(stream):
        size = chance.randint(1, 400) if seed else 1
        yield stream[at : at + size]
        at += size


def events_of(dialect: Dialect, chunks: list[bytes]) -> list[Frame | Damage]:
    deframer, events = Deframer(dialect), []
    for chunk in chunks:
        events += deframer.feed(chunk)
        if deframer.buffered > MAX_PAYLOAD + 9:
            raise AssertionError(f"{deframer.buffered} bytes are held back")
    return events + deframer.close()


def check_telegrams(dialect: Dialect, stream: bytes) -> None:
    intake, receiver = Intake(), Receiver(dialect)
    for number, event in enumerate(receiver.feed(stream) + receiver.close()):
        if isinstance(event, Telegram):
            check_telegram(event, intake, number)


def check_payload(dialect: Dialect, payload: bytes) -> None:
    """The same bytes as a payload that is framed well: most of the codec lies behind the checksum."""
    if dialect is Dialect.A:
        payload = payload.replace(b"\x02", b"").replace(b"\x03", b"")
    try:
        telegram = parse(dialect, frame(dialect, payload[:MAX_PAYLOAD]))
    except TimMalformedError:
        return
    check_telegram(telegram, Intake(), 0)


def check_telegram(telegram: Telegram, intake: Intake, number: int) -> None:
    with suppress(TimMalformedError):
        answers.understand(telegram)
    with suppress(TimMalformedError):
        scandata.encode(scandata.decode(telegram), telegram.dialect, "sSN").to_wire()
    device, client = Behaviour(DeviceSettings(), telegram.dialect), Client(telegram.dialect)
    answer = device.answer(telegram, client, [client], 1.0)
    in_words(telegram, parse(telegram.dialect, answer.to_wire()))
    scan = intake.take(replace(telegram, stamp_ns=number * 66_667_000))
    if scan is not None:
        far = scan.ranges[~np.isnan(scan.ranges)]
        if (scan.codes[np.isfinite(scan.ranges)] < 16).any() or (far <= 0).any() or np.isinf(far).any():
            raise AssertionError("a code has become a point")


def seeds() -> Iterator[bytes]:
    """Every command, its answer, and small scans with every block, in both dialects."""
    row = scandata.Channel("DIST1", 1.0, 0.0, -450000, 3333, np.arange(BEAMS, dtype=np.uint16))
    slim = scandata.Channel("RSSI1", 1.0, 0.0, -450000, 3333, np.arange(BEAMS, dtype=np.uint8))
    plain: dict[str, Any] = {
        "version": 1, "device": 1, "serial": 17461662, "status": (0, 0), "telegram_counter": 1, "scan_counter": 3,
        "scan_tick_us": 1, "transmit_tick_us": 7001, "inputs": (0, 0), "outputs": (1, 0), "layer": 0,
        "scan_frequency_chz": 1500, "measuring_frequency_100hz": 162, "channels16": (row,),
    }  # fmt: skip
    full: dict[str, Any] = {
        "encoders": (scandata.Encoder(1, 2),), "channels8": (slim,), "name": "not defined", "comment": "x",
        "position": scandata.Position(0, 0, 0, 0, 0, 0, 1), "clock": scandata.Clock(1970, 1, 1, 0, 0, 0, 0),
        "event": scandata.Event("FDIN", 1, 2, 3),
    }  # fmt: skip
    for dialect in Dialect:
        behaviour, client = Behaviour(DeviceSettings(), dialect), Client(dialect)
        requests = [commands.read(dialect, name) for name in commands.VARIABLES]
        requests += [commands.subscribe(dialect, name) for name in commands.EVENTS]
        requests += [
            commands.invoke(dialect, name, *range(1, 1 + len(method.request)))
            for name, method in commands.METHODS.items()
        ]
        for request in requests:
            answer = behaviour.answer(request, client, [client], 1.0)
            for telegram in (request, answer):
                wire = telegram.to_wire()
                yield bytes([dialect is Dialect.B, 1]) + wire
                yield bytes([dialect is Dialect.B, 1]) + (wire[8:-1] if dialect is Dialect.B else wire[1:-1])
        for fields in (plain, plain | full):
            wire = scandata.encode(scandata.ScanData(**fields), dialect).to_wire()
            yield bytes([dialect is Dialect.B, 2]) + wire * 2
            yield bytes([dialect is Dialect.B, 2]) + (wire[8:-1] if dialect is Dialect.B else wire[1:-1])


def mutations(seconds: float, seed: int) -> int:
    """Checks for that long without guidance; returns how many inputs."""
    chance, corpus, count = Random(seed), list(seeds()), 0  # noqa: S311
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        data = bytearray(chance.choice(corpus))
        for _ in range(chance.randint(1, 6)):
            at = chance.randrange(len(data) + 1)
            match chance.randrange(4):
                case 0:
                    data[at : at + 1] = bytes([chance.choice((0, 2, 3, 32, 48, 70, 255, chance.randrange(256)))])
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
    with tempfile.TemporaryDirectory(prefix="fuzz-tim571-") as corpus:
        for number, seed in enumerate(seeds()):
            Path(corpus, f"seed{number:03}").write_bytes(seed)
        limits = [f"-max_total_time={options.seconds}", f"-max_len={LONGEST_INPUT}", f"-seed={options.seed}"]
        bounds = [
            f"-artifact_prefix={Path(__file__).parent}/",
            "-timeout=10",
            "-rss_limit_mb=1024",
            "-print_final_stats=1",
            "-verbosity=1",
        ]
        atheris.Setup([sys.argv[0], *limits, *bounds, corpus], check)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
