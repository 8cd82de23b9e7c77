"""How much damage of the lidar's telegrams goes unnoticed, with the checksum alone and with the plausibility checks.

    python benchmarks/lidar_damage.py
    python benchmarks/lidar_damage.py --minutes 1 --bursts 2000 --json

Streams come from the simulated optics in simulated time. `flips` changes each byte of a stream with a chance of
1 in 20,000. `bursts` changes 2 to 20 neighbouring bytes of every second telegram; in CoLa-B a second round chooses
the bytes so that the checksum is right, each behind one good telegram, which measures what the plausibility checks
alone find. "missed" are damaged telegrams delivered as if they were good; "singly" counts those of them in which
just one byte was changed.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from random import Random

from drivers.tim571.codec import scandata
from drivers.tim571.codec.commands import OutputContent, OutputRange
from drivers.tim571.codec.deframer import Damage
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.plausibility import Plausibility
from drivers.tim571.codec.telegram import Receiver, Telegram
from drivers.tim571.errors import TimMalformedError
from drivers.tim571.simulator.scanner import Revolution, Scanner, empty_room
from drivers.tim571.simulator.timing import DeviceTime, Motor, transmit_delay_s

RATE_HZ = 15.0
BYTES_PER_FLIP = 20_000
BURST_BYTES = (2, 20)


@dataclass
class Outcome:
    """What became of one stream."""

    telegrams: int = 0
    damaged: int = 0
    delivered_good: int = 0
    lost_good: int = 0
    missed: int = 0
    """Damaged, and delivered."""
    missed_singly: int = 0
    """Those of them in which one byte was changed."""
    past_the_frame: int = 0
    """Damaged, and a good frame: what would be missed without plausibility checks and a strict parser."""
    counted: int = 0
    """Damage that the driver would count: bad stretches and implausible telegrams."""
    implausible: Counter[str] = field(default_factory=Counter)

    @property
    def miss_rate(self) -> float:
        return self.missed / max(1, self.damaged)


def telegrams(dialect: Dialect, output: OutputContent, count: int, seed: int = 0) -> Iterator[bytes]:
    """Framed telegrams of a device in an empty room."""
    scanner, motor, chance = Scanner(empty_room, seed), Motor(RATE_HZ, seed), Random(seed)
    clock, end_s = DeviceTime(0.0, drift_ppm=4.7), 1.0
    for number in range(count):
        end_s += motor.period_s()
        turn = Revolution(round(end_s * 1e9), clock.tick_us(end_s), (number + 2) % 65536, number % 65536)
        scan = scanner.scan(turn, 17461662, RATE_HZ, output, OutputRange(), "not defined", (0, 0))
        sent = clock.tick_us(end_s + transmit_delay_s(chance))
        yield scandata.encode(replace(scan, transmit_tick_us=sent), dialect).to_wire()


def flipped(frame: bytes, chance: Random) -> bytes:
    """Each byte changed with the chance of the campaign."""
    spoilt = bytearray(frame)
    at = int(chance.expovariate(1 / BYTES_PER_FLIP))
    while at < len(spoilt):
        spoilt[at] ^= chance.randrange(1, 256)
        at += 1 + int(chance.expovariate(1 / BYTES_PER_FLIP))
    return bytes(spoilt)


def burst(frame: bytes, chance: Random, keep_checksum: bool = False) -> bytes:
    """Some neighbouring bytes changed; `keep_checksum` inside the payload, with the same XOR as before."""
    size = chance.randint(*BURST_BYTES)
    first = 8 if keep_checksum else 0
    at = chance.randrange(first, len(frame) - size - first // 8)
    while True:
        changes = [chance.randrange(1, 256) for _ in range(size)]
        if keep_checksum:
            changes[-1] = 0
            for change in changes[:-1]:
                changes[-1] ^= change
        if changes[-1]:
            break
    spoilt = bytearray(frame)
    for offset, change in enumerate(changes):
        spoilt[at + offset] ^= change
    return bytes(spoilt)


class Reader:
    """The driver's way from bytes to scans that it believes."""

    def __init__(self, dialect: Dialect, outcome: Outcome) -> None:
        self.outcome = outcome
        self.receiver, self.plausibility = Receiver(dialect), Plausibility()

    def read(self, meant: bytes, sent: bytes) -> None:
        """Take the next telegram of the stream, and count what comes of it."""
        outcome = self.outcome
        outcome.telegrams += 1
        outcome.damaged += meant != sent
        outcome.lost_good += meant == sent
        for event in self.receiver.feed(sent):
            if isinstance(event, Damage):
                outcome.counted += 1
                continue
            good = event.frame == meant
            outcome.past_the_frame += not good
            if doubts := self._doubts(event):
                outcome.counted += 1
                outcome.implausible.update(doubts)
            elif good:
                outcome.delivered_good += 1
                outcome.lost_good -= 1
            else:
                outcome.missed += 1
                outcome.missed_singly += sum(a != b for a, b in zip(event.frame, meant, strict=False)) == 1

    def finish(self) -> None:
        """The stream has ended: count the damage that was not told yet."""
        self.outcome.counted += len(self.receiver.close())

    def _doubts(self, telegram: Telegram) -> set[str]:
        if not scandata.is_scan(telegram):
            return {"no scan"}
        try:
            scan = scandata.decode(telegram)
        except TimMalformedError:
            return {"malformed"}
        return set(self.plausibility.doubts(scan))


def run(dialect: Dialect, pairs: Iterable[tuple[bytes, bytes]]) -> Outcome:
    """Feed the second of each pair, the first being what was meant, as one stream through the driver's codec."""
    outcome = Outcome()
    reader = Reader(dialect, outcome)
    for meant, sent in pairs:
        reader.read(meant, sent)
    reader.finish()
    return outcome


def flips(dialect: Dialect, output: OutputContent, count: int, seed: int = 0) -> Outcome:
    """Single bytes all over a stream of so many telegrams."""
    chance = Random(seed)
    return run(dialect, ((frame, flipped(frame, chance)) for frame in telegrams(dialect, output, count, seed)))


def bursts(dialect: Dialect, output: OutputContent, count: int, seed: int = 0) -> Outcome:
    """So many bursts, in every second telegram of a stream."""
    chance = Random(seed)
    frames = enumerate(telegrams(dialect, output, 2 * count + 1, seed))
    return run(dialect, ((f, burst(f, chance) if number % 2 else f) for number, f in frames))


def lucky_bursts(output: OutputContent, count: int, seed: int = 0) -> Outcome:
    """So many bursts that the checksum of CoLa-B does not notice."""
    chance, outcome = Random(seed), Outcome()
    for before, frame in pairwise(telegrams(Dialect.B, output, count + 1, seed)):
        reader = Reader(Dialect.B, outcome)
        reader.read(before, before)
        reader.read(frame, burst(frame, chance, keep_checksum=True))
    return outcome


OUTPUTS = {"distances": OutputContent(), "with 8-bit RSSI": OutputContent(rssi=True),
           "with 16-bit RSSI": OutputContent(rssi=True, rssi_bits=16)}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0, help="length of the simulated stream with flips")
    parser.add_argument("--bursts", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    began_s = time.monotonic()
    found: dict[str, dict[str, object]] = {}
    count = round(60 * RATE_HZ * options.minutes)
    for dialect in Dialect:
        for words, output in OUTPUTS.items():
            rounds = {f"one byte in {BYTES_PER_FLIP:,}": flips(dialect, output, count, options.seed)}
            rounds["bursts"] = bursts(dialect, output, options.bursts, options.seed)
            if dialect is Dialect.B:
                rounds["bursts with a right checksum"] = lucky_bursts(output, options.bursts, options.seed)
            for what, outcome in rounds.items():
                found[f"{dialect} {words}: {what}"] = asdict(outcome) | {"miss_rate": outcome.miss_rate}
                print(
                    f"{dialect!s:7} {words:17} {what:29} {outcome.telegrams} telegrams, {outcome.damaged} damaged: "
                    f"{outcome.counted} counted, {outcome.past_the_frame} well framed, {outcome.missed} missed = "
                    f"{100 * outcome.miss_rate:.3f} % (singly {outcome.missed_singly}), good ones lost "
                    f"{outcome.lost_good}, {dict(outcome.implausible)}"
                )
    if options.json:
        print(json.dumps({"seconds": round(time.monotonic() - began_s, 1), "outcomes": found}))


if __name__ == "__main__":
    main()
