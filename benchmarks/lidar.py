"""Telegrams per second that the lidar's codec gets through on one core, and how that compares to a floor.

    python benchmarks/lidar.py

The codec does all that the driver does before it publishes a scan: framing, checksum, parsing, plausibility. The
floor is measured in the same run, interleaved, so that their ratio can be compared between machines and
moments: for CoLa-B `np.frombuffer` of the payload, for CoLa-A `bytes.split` and `int(token, 16)` of every token.
The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import repeat
from operator import itemgetter

import numpy as np
from lidar_damage import OUTPUTS, telegrams

from drivers.tim571.codec import scandata
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.plausibility import Plausibility
from drivers.tim571.codec.telegram import Receiver, Telegram

ROUNDS = 12
TELEGRAMS = 200
WANTED = {Dialect.A: 5_000, Dialect.B: 20_000}


@dataclass(frozen=True)
class Rate:
    """The best round of each, in telegrams per second: others share the machine."""

    codec: float
    floor: float

    @property
    def ratio(self) -> float:
        return self.codec / self.floor


def decode(dialect: Dialect, frames: list[bytes]) -> int:
    """As the driver does it, telegram by telegram."""
    receiver, plausibility = Receiver(dialect), Plausibility()
    believed = 0
    for frame in frames:
        for event in receiver.feed(frame):
            believed += isinstance(event, Telegram) and not plausibility.doubts(scandata.decode(event))
    return believed


def floor_a(frames: list[bytes]) -> int:
    """Without a look at what the tokens are: names are sorted out by their place, which costs the floor nothing."""
    tokens = frames[0][1:-1].split()
    numbers = [place for place, token in enumerate(tokens) if not token.translate(None, b"0123456789ABCDEF")]
    pick = itemgetter(*numbers)
    for frame in frames:
        list(map(int, pick(frame[1:-1].split()), repeat(16)))
    return len(frames)


def floor_b(frames: list[bytes]) -> int:
    for frame in frames:
        np.frombuffer(frame[8:-1], ">u2", (len(frame) - 9) // 2)
    return len(frames)


def measure(dialect: Dialect, frames: list[bytes], rounds: int = ROUNDS) -> Rate:
    """Codec and floor in turn, in seconds of this process; raises ValueError if a telegram is not delivered."""
    floor = floor_a if dialect is Dialect.A else floor_b

    def rate(work: Callable[[], int]) -> float:
        began = time.process_time()
        if work() != len(frames):
            raise ValueError("a telegram was not delivered")
        return len(frames) / (time.process_time() - began)

    pairs = [(rate(lambda: decode(dialect, frames)), rate(lambda: floor(frames))) for _ in range(rounds)]
    return Rate(max(codec for codec, _ in pairs), max(floor for _, floor in pairs))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    rounds = parser.parse_args().rounds
    found: dict[str, dict[str, float | bool]] = {}
    for dialect in Dialect:
        for words, output in OUTPUTS.items():
            frames = list(telegrams(dialect, output, TELEGRAMS))
            rate = measure(dialect, frames, rounds)
            enough = rate.codec >= WANTED[dialect] and (dialect is Dialect.B or rate.ratio > 1)
            found[f"{dialect} {words}"] = asdict(rate) | {"ratio": rate.ratio, "enough": enough}
            print(
                f"{dialect!s:7} {words:17} {len(frames[0]):5} bytes  {rate.codec:9,.0f} telegrams/s, floor "
                f"{rate.floor:11,.0f}, ratio {rate.ratio:.4f}"
            )
    print(json.dumps(found))


if __name__ == "__main__":
    main()
