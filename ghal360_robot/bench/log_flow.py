"""What a whole robot gives its logbook, tick by tick: a simulated search with the bytes its devices would send.

Rates are those of the design's budget: 2K video at 30 pictures a second, scans at 15, feedback and motion frames at
50, an operator at 17. The search is simulated ahead and played again and again, with stamps of the present.
"""

from __future__ import annotations

import math
import random
import struct
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.simulation.lockstep import TICK_NS, Lockstep
from ghal360_robot.simulation.world import build_world

if TYPE_CHECKING:
    from ghal360_robot.logbook.recorder import Recorder
    from ghal360_robot.messages import Applied, Decision, Inputs, LidarScan

CONFIG = with_overrides(RobotConfig(), {"perception": {"target": "backpack"}})
TAPE_S = 8
TICKS_PER_S = round(1e9 / TICK_NS)
FRAMES_PER_PACKET = 11
"""One feedback packet of the base."""
GROUP = 30
"""Pictures from one key picture to the next."""
KEY_FACTOR = 5.0
"""How much larger a key picture is."""
CAN_WIRE_BYTES = 12
"""Identifier and data: what a frame brings."""


@dataclass(frozen=True, slots=True)
class Rates:
    """What the camera sends."""

    picture_hz: float = 30.0
    mbit_s: float = 12.0


class Flow:
    """Gives a recorder everything of one tick at a time, and counts what it gave."""

    def __init__(self, rates: Rates = Rates(), seed: int = 0) -> None:
        self.rates = rates
        self.sent: Counter[str] = Counter()
        self.raw_bytes = 0
        """Of what the devices sent: access units, telegrams, CAN frames."""
        self._random = random.Random(seed)  # noqa: S311 - the same bytes every time
        self._tape: list[tuple[Inputs, Decision, Applied]] = []
        robot = Lockstep(build_world("office", seed, "backpack"), CONFIG, seed, self._keep)
        for _ in range(TAPE_S * TICKS_PER_S):
            robot.step()
        mean = rates.mbit_s * 1e6 / 8 / rates.picture_hz
        self._picture = mean * GROUP / (GROUP - 1 + KEY_FACTOR)
        # Random bytes, like H.264, do not let themselves be compressed.
        self._noise = self._random.randbytes(round(3 * KEY_FACTOR * mean))

    def give(self, recorder: Recorder | None, tick: int, now_ns: int) -> list[bytes]:
        """Everything of one tick, stamped `now_ns`; returns the raw bytes the devices sent."""
        inputs, decision, applied = self._tape[tick % len(self._tape)]
        raw = [self._unit(recorder, now_ns)] if self._due(tick, self.rates.picture_hz) else []
        base, scan, operator = inputs.base, inputs.scan, inputs.operator
        if scan is not None:
            # The simulated search has ranges of any length; a device has whole millimetres.
            ranges = (np.rint(scan.ranges.astype(np.float64) * 1000) / 1000).astype(np.float32)
            scan = replace(scan, stamp_ns=now_ns, ranges=ranges, scan_counter=tick, telegram_counter=tick)
            if self._due(tick, 15.0):
                raw.append(self._telegram(recorder, scan, now_ns))
        raw += self._frames(recorder, inputs, applied, tick, now_ns)
        if base is not None:
            base = replace(base, stamp_ns=now_ns)
        if operator is not None:
            operator = replace(operator, stamp_ns=now_ns)
        if recorder is not None:
            if base is not None:
                recorder.base_state(base)
                self.sent["base/state"] += 1
            if operator is not None and self._due(tick, 17.0):
                recorder.operator(operator)
                self.sent["operator/command"] += 1
            around = inputs.surroundings and replace(inputs.surroundings, stamp_ns=now_ns)
            seen = replace(inputs, stamp_ns=now_ns, tick=tick, base=base, scan=scan, operator=operator)
            seen = replace(seen, surroundings=around)
            recorder.tick(seen, decision, applied, lateness_ms=0.5 + tick % 7 / 10, work_ms=1.0 + tick % 5 / 10)
            self.sent["loop/inputs"] += 1
        self.raw_bytes += sum(map(len, raw))
        return raw

    def _unit(self, recorder: Recorder | None, now_ns: int) -> bytes:
        sequence = self.sent["theta/video"]
        self.sent["theta/video"] += 1
        key = sequence % GROUP == 0
        size = round(self._picture * (KEY_FACTOR if key else 1.0) * self._random.uniform(0.7, 1.3))
        begin = self._random.randrange(len(self._noise) - size - 16)
        data = struct.pack(">IQ", 1, sequence) + self._noise[begin : begin + size]
        if recorder is not None:
            recorder.access_unit(now_ns, data, sequence, key, tainted=False)
        return data

    def _telegram(self, recorder: Recorder | None, scan: LidarScan, now_ns: int) -> bytes:
        """Binary, without signal strength: a header and whole millimetres, as the device sends them."""
        millimetres = [0 if math.isnan(r) else min(round(r * 1000), 65_535) for r in scan.ranges.tolist()]
        data = b"\x02\x02\x02\x02sSN LMDscandata " + struct.pack(">QQ", self.sent["lidar/raw"], now_ns) + bytes(120)
        data += struct.pack(f">{len(millimetres)}H", *millimetres)
        if recorder is not None:
            recorder.lidar_telegram(now_ns, data)
            recorder.lidar_scan(scan)
            self.sent["lidar/scan"] += 1
        self.sent["lidar/raw"] += 1
        return data

    def _frames(
        self, recorder: Recorder | None, inputs: Inputs, applied: Applied, tick: int, now_ns: int
    ) -> list[bytes]:
        """Feedback of the base and the motion frame; all but the counters as it is while driving."""
        base = inputs.base
        numbers = (0.0,) * 4 if base is None else (base.pose.x, base.pose.y, base.pose.yaw, base.twist.v)
        made = []
        for k in range(FRAMES_PER_PACKET):
            data = struct.pack("<If", tick if k == 0 else k, numbers[k % 4])
            made.append(("rx", 0x502 + k, data))
        made.append(("tx", 0x501, struct.pack("<ff", applied.twist.v, applied.twist.w)))
        for direction, can_id, data in made:
            self.sent[f"can/{direction}"] += 1
            if recorder is not None:
                recorder.can_frame(now_ns, "rx" if direction == "rx" else "tx", can_id, data)
        return [struct.pack("<I", can_id) + data for _, can_id, data in made]

    def _due(self, tick: int, rate_hz: float) -> bool:
        """Whether something of this rate comes in this tick."""
        return math.floor((tick + 1) * rate_hz / TICKS_PER_S) > math.floor(tick * rate_hz / TICKS_PER_S)

    def _keep(self, inputs: Inputs, decision: Decision, applied: Applied) -> None:
        self._tape.append((inputs, decision, applied))
