"""A day of driving in simulated time, with random faults: does anything drift, leak, or fail to come back?

    python -m benchmarks.soak --hours 24

The real driver drives the simulated base over a bus on which frames get lost and damaged, which falls silent,
fills up and goes down, and whose base is blocked, killed and switched off. Odometry is compared, packet by
packet, with a plain integration of what the wheels really did. Prints a line per simulated hour (or per tenth of
a shorter run), then one JSON object; exits with 1 where anything was not as it must be.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import json
import logging
import math
import os
import random
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from drivers.rmp110.codec.feedback import COMPACT, COMPACT_BITMAPS
from drivers.rmp110.codec.frames import as_float32
from drivers.rmp110.codec.parameters import RMP110_STORED, Stored
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.odometry import ulp32
from drivers.rmp110.device.rmp110 import STANDBY, TRACTOR, Rmp110
from drivers.rmp110.device.state import LinkState, State
from drivers.rmp110.errors import RmpError, RmpRefused
from drivers.rmp110.simulator.faults import FaultPlan
from drivers.rmp110.simulator.model import BOOT_S, RmpModel
from tests.virtual_time.chain import TickedWatchdog
from tests.virtual_time.checker import WireChecker
from tests.virtual_time.clock import Clock, virtual_loop
from tests.virtual_time.wire import FRAME_NS, OnWire, VirtualBus

TRACK_M = RMP110_STORED["track_width"]
FEEDBACK = {f"feedback_bitmap_{n}": word for n, word in enumerate(COMPACT_BITMAPS, start=1)}
DRIVE_S = 0.05
"""Twenty commands a second: what the base needs to keep its targets, and half of what the robot sends."""
QUIET_S = (3.0, 20.0)
"""Between the end of one fault, once it drives again, and the next."""
COMES_BACK_S = 25.0
"""Boot 9 s, longest back-off 5 s, identification 2 s, a leg of 4 s without motion, and room."""
WARNS_S = 0.5
"""A blocked base is told within so long of being driven."""
MAX_GROWTH_MB_PER_H = 5.0
WARM_UP = 0.1
"""Share of the run after which memory must not grow any more."""
MAX_VIOLATIONS = 20
"""Then it is clear that something is wrong, and the run ends."""
MAX_TASKS = 8
"""Driver, drive and trouble, and what waits within them."""
MAX_TIMERS = 1000
"""Timers waiting in the event loop; a leak of one per packet is a thousand within a minute."""
FAR_M = 8000.0
"""Wheel positions begin anywhere up to here after a power-on: float32 has steps of half a millimetre there."""


class TrueBase(RmpModel):
    """A base that also knows its pose: the wheels' arcs of every 10 ms."""

    x = y = yaw = distance_m = 0.0

    def _tick(self) -> None:
        right_m, left_m = self.drive.right_m, self.drive.left_m
        super()._tick()
        self.x, self.y, self.yaw = _arc(
            self.x, self.y, self.yaw, self.drive.right_m - right_m, self.drive.left_m - left_m
        )
        self.distance_m += abs(self.drive.right_m - right_m + self.drive.left_m - left_m) / 2


def _arc(x: float, y: float, yaw: float, right_m: float, left_m: float) -> tuple[float, float, float]:
    """Where wheels that roll so far lead to; by the radius, unlike the driver."""
    distance, turn = (right_m + left_m) / 2, (right_m - left_m) / TRACK_M
    if abs(turn) < 1e-9:
        return x + distance * math.cos(yaw), y + distance * math.sin(yaw), yaw + turn
    radius = distance / turn
    return (
        x + radius * (math.sin(yaw + turn) - math.sin(yaw)),
        y - radius * (math.cos(yaw + turn) - math.cos(yaw)),
        yaw + turn,
    )


@dataclass(slots=True)
class Reference:
    """Unrounded wheel positions of the packets that arrived, integrated plainly, since the base was switched on."""

    right_m: float
    left_m: float
    anchor: tuple[float, float, float]
    """The driver's pose where this one is zero."""
    true: tuple[float, float, float]
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    squares_m2: float = 0.0
    """Of the steps: rounding errors walk at random."""

    def advance(self, right_m: float, left_m: float) -> None:
        right, left = right_m - self.right_m, left_m - self.left_m
        self.x, self.y, self.yaw = _arc(self.x, self.y, self.yaw, right, left)
        self.squares_m2 += (right + left) ** 2 / 4
        self.right_m, self.left_m = right_m, left_m

    def errors(self, state: State) -> tuple[float, float]:
        """Distance and angle between the driver's pose and this one, both since the anchor."""
        x, y, yaw = _relative((state.x, state.y, state.yaw), self.anchor)
        return math.hypot(x - self.x, y - self.y), abs(yaw - self.yaw)

    def allowed(self) -> tuple[float, float]:
        """What rounding both wheels' positions to float32 explains, metres and radians.

        In yaw it does not add up: it is that of the newest positions. In position each step goes off by its
        yaw's rounding; ten times the root of the sum of their squares is never reached by chance.
        """
        coarse_m = max(ulp32(self.right_m), ulp32(self.left_m))
        yaw = 1.01 * coarse_m / TRACK_M + 1e-7
        return 4 * coarse_m + 4 * yaw * math.sqrt(self.squares_m2) + 1e-6, yaw

    def sampling_m(self, base: tuple[float, float, float]) -> float:
        """How far the plain integration of packets is from the true path: bends between packets."""
        x, y, _ = _relative(base, self.true)
        return math.hypot(x - self.x, y - self.y)


def _relative(pose: tuple[float, float, float], origin: tuple[float, float, float]) -> tuple[float, float, float]:
    dx, dy = pose[0] - origin[0], pose[1] - origin[1]
    c, s = math.cos(origin[2]), math.sin(origin[2])
    return c * dx + s * dy, c * dy - s * dx, pose[2] - origin[2]


@dataclass(slots=True)
class Tally:
    """What happened so far."""

    faults: dict[str, int] = field(default_factory=dict)
    back_s: list[float] = field(default_factory=list)
    """Seconds from each fault's end to driving again."""
    packets: int = 0
    restarts: int = 0
    worst_m: float = 0.0
    worst_rad: float = 0.0
    worst_share: float = 0.0
    """The largest error over what rounding explains."""
    worst_sampling_m: float = 0.0
    warned: int = 0
    violations: list[str] = field(default_factory=list)

    def complain(self, clock: Clock, what: str) -> None:
        if len(self.violations) < MAX_VIOLATIONS:
            self.violations.append(f"{clock.seconds():.2f} s: {what}")


class Soak:
    """One run."""

    def __init__(self, clock: Clock, seed: int, hours: float, boot_s: float) -> None:
        self.clock = clock
        self.tally = Tally()
        self.checker = WireChecker(None, accel=math.inf, w_accel=math.inf, reverse_max=0.5, w_max=1.0)
        self._random = random.Random(seed)
        self._end_ns = clock.now_ns + round(hours * 3600e9)
        self.base_model = TrueBase(clock.now_ns, Stored.of({**RMP110_STORED, **FEEDBACK}), boot_s=boot_s)
        self.bus = VirtualBus(clock, self.base_model, self._on_wire)
        self.bus.snapshot = self._snapshot
        self.base = Rmp110(
            self.bus.transport,
            Rmp110Config(poll_hz=20.0),
            clock=clock.read,
            watchdog=lambda zero, read: TickedWatchdog(zero, read, clock),
        )
        self._reference: Reference | None = None
        self._jumps = 0
        self._odd_until_s = -math.inf
        self._stuck_since_s = [clock.seconds()] * 2
        self._told = False
        self._driving = asyncio.Event()

    async def run(self) -> None:
        """Drive to the end."""
        async with self.base as base:
            driving = asyncio.create_task(self._drive(), name="drive")
            trouble = asyncio.create_task(self._trouble(), name="trouble")
            await asyncio.wait({driving, trouble}, return_when=asyncio.FIRST_COMPLETED)
            for task in (driving, trouble):
                task.cancel()
            await asyncio.wait({driving, trouble})
            for task in (driving, trouble):
                if not task.cancelled() and task.exception():
                    self.tally.complain(self.clock, f"{task.get_name()} failed: {task.exception()!r}")
        if base.link is not LinkState.CLOSED or self.bus.connections:
            self.tally.complain(self.clock, "the driver left something open")
        self.tally.violations += self.checker.violations

    @property
    def _over(self) -> bool:
        return self.clock.now_ns >= self._end_ns or len(self.tally.violations) >= MAX_VIOLATIONS

    async def _drive(self) -> None:
        """At random speeds, with pauses and changes of mode, and on again after everything that goes wrong."""
        draw = self._random
        while not self._over:
            try:
                await self.base.ready(4 * COMES_BACK_S)
                await self._to_tractor()
                for _ in range(draw.randrange(1, 40)):
                    await self._leg(draw.uniform(-0.5, 0.5), draw.uniform(-1.0, 1.0), draw.uniform(0.3, 4.0))
                await self.base.request_mode(STANDBY)
            except RmpError:
                self._driving.clear()
                await asyncio.sleep(0.2)

    async def _to_tractor(self) -> None:
        """As soon as the base has booted."""
        while True:
            try:
                return await self.base.request_mode(TRACTOR)
            except RmpRefused:
                if self.base.link is not LinkState.STREAMING:
                    raise
                state = self.base.latest
                if state and state.latched and not state.trouble_now:
                    await self.base.request_mode(STANDBY)  # a trouble that is over has to be acknowledged
                await asyncio.sleep(0.2)

    async def _leg(self, v: float, w: float, seconds: float) -> None:
        end_s = self.clock.seconds() + seconds
        if self._random.random() < 0.2:
            v, w = self._random.choice([(0.0, 0.0), (0.0, w), (v, 0.0)])
        while self.clock.seconds() < end_s:
            self.base.send_motion(v, w)
            await asyncio.sleep(DRIVE_S)
            state = self.base.latest
            if state and max(abs(state.v), abs(state.w)) > 0.05:
                self._driving.set()

    async def _trouble(self) -> None:
        """One fault after another; each has to be over before the next."""
        kinds = self._kinds()
        while not self._over:
            await asyncio.sleep(self._random.uniform(*QUIET_S))
            await self._moving_again()
            kind = next(kinds)
            self.tally.faults[kind] = self.tally.faults.get(kind, 0) + 1
            await getattr(self, f"_{kind}")(self._random.uniform(0.1, 4.0))
            began_s = self.clock.seconds()
            if await self._moving_again():
                self.tally.back_s.append(self.clock.seconds() - began_s)
            self._look_for_leaks()

    async def _moving_again(self) -> bool:
        self._driving.clear()
        try:
            async with asyncio.timeout(COMES_BACK_S):
                await self._driving.wait()
        except TimeoutError:
            self.tally.complain(self.clock, f"does not drive again: {self.base.stats}, {self.base.refusal()!r}")
            return False
        return True

    def _kinds(self) -> Iterator[str]:
        """Every kind before any comes again, in a random order."""
        every = ["losses", "damage", "jitter", "silence", "deafness", "full_bus", "bus_down", "power", "kill", "block"]
        while True:
            self._random.shuffle(every)
            yield from every

    async def _losses(self, seconds: float) -> None:
        self.bus.plan_faults(FaultPlan(self._random.randrange(10**6), drop=0.01))
        await asyncio.sleep(5 * seconds)
        self.bus.plan_faults(FaultPlan())

    async def _damage(self, seconds: float) -> None:
        self.bus.plan_faults(FaultPlan(self._random.randrange(10**6), drop=0.005, corrupt=0.01))
        await asyncio.sleep(5 * seconds)
        self.bus.plan_faults(FaultPlan())

    async def _jitter(self, seconds: float) -> None:
        self.bus.jitter_s = 0.06
        await asyncio.sleep(5 * seconds)
        self.bus.jitter_s = 0.0

    async def _silence(self, seconds: float) -> None:
        self.bus.silent = True
        await asyncio.sleep(seconds)
        self.bus.silent = False

    async def _deafness(self, seconds: float) -> None:
        self.bus.deaf = True
        await asyncio.sleep(seconds)
        self.bus.deaf = False

    async def _full_bus(self, seconds: float) -> None:
        self.bus.full = True
        await asyncio.sleep(seconds)
        self.bus.full = False

    async def _bus_down(self, seconds: float) -> None:
        self.bus.go_down()
        await asyncio.sleep(seconds)
        self.bus.go_up()

    async def _power(self, seconds: float) -> None:
        self.bus.power_off()
        await self._restarted(seconds)

    async def _kill(self, seconds: float) -> None:
        self.bus.kill_switch()
        await self._restarted(2 * seconds)

    async def _restarted(self, seconds: float) -> None:
        await asyncio.sleep(seconds)
        self.tally.restarts += 1
        self._jumps += 1
        self._reference = None
        far = self._random.uniform(-FAR_M, FAR_M)
        self.base_model._integrators_m = (far, far + self._random.uniform(-50.0, 50.0))
        self.bus.power_on()

    async def _block(self, seconds: float) -> None:
        """Against an obstacle, and free again; what the driver has to say about it is judged packet by packet."""
        self._odd_until_s, self._told = math.inf, False
        self.base_model.block()
        await asyncio.sleep(1.5 + seconds)
        self.base_model.unblock()
        self._odd_until_s = self.clock.seconds() + 2.0

    def _snapshot(self) -> Callable[[], None]:
        """The truth when the base makes a reply, compared when the driver has it."""
        base = self.base_model
        right_m, left_m, true = base.drive.right_m, base.drive.left_m, (base.x, base.y, base.yaw)
        v_mps, turning_mps = base.drive.v_target, base.drive.yaw_target * TRACK_M / 2
        targets_mps = abs(v_mps + turning_mps), abs(v_mps - turning_mps)

        def delivered() -> None:
            state = self.base.latest
            if state and state.stamp_ns == self.clock.now_ns - FRAME_NS * (COMPACT.frame_count - 1):
                self._compare(state, right_m, left_m, true)
                self._judge_warnings(state, targets_mps)

        return delivered

    def _compare(self, state: State, right_m: float, left_m: float, true: tuple[float, float, float]) -> None:
        tally, reference = self.tally, self._reference
        tally.packets += 1
        jumps = self.base._journal.odometry.jumps
        if jumps != self._jumps:
            tally.complain(self.clock, f"odometry jumped {jumps} times, the base was switched on {self._jumps} times")
            self._jumps = jumps
            reference = None
        if reference is None:
            anchor = (state.x, state.y, state.yaw)
            self._reference = Reference(as_float32(right_m), as_float32(left_m), anchor, true)
            return
        reference.advance(right_m, left_m)
        (off_m, off_rad), (may_m, may_rad) = reference.errors(state), reference.allowed()
        tally.worst_m, tally.worst_rad = max(tally.worst_m, off_m), max(tally.worst_rad, off_rad)
        share = max(off_m / may_m, off_rad / may_rad)
        tally.worst_share = max(tally.worst_share, share)
        tally.worst_sampling_m = max(tally.worst_sampling_m, reference.sampling_m(true))
        if share > 1.0:
            tally.complain(self.clock, f"odometry is off by {off_m:.6f} m, {off_rad:.8f} rad")
            self._reference = None

    def _judge_warnings(self, state: State, targets_mps: tuple[float, float]) -> None:
        """A blocked base is told in time, and nothing is told of a healthy one. Each wheel is watched by itself."""
        now_s, blocked = self.clock.seconds(), self.base_model.drive.blocked
        for wheel, target_mps in enumerate(targets_mps):
            if not blocked or target_mps < 0.1:
                self._stuck_since_s[wheel] = now_s
        if blocked and state.warnings and not self._told:
            self._told = True
            self.tally.warned += 1
        stuck_s = now_s - min(self._stuck_since_s)
        if blocked and stuck_s > WARNS_S + 2 * DRIVE_S and not state.warnings:
            self.tally.complain(self.clock, f"blocked for {stuck_s:.2f} s and nothing is told")
        if state.warnings and now_s > self._odd_until_s:
            self.tally.complain(self.clock, f"nothing is odd, but told is: {'; '.join(state.warnings)}")

    def _look_for_leaks(self) -> None:
        tasks, timers = len(asyncio.all_tasks()), len(self.bus.loop._scheduled)  # type: ignore[attr-defined]
        if tasks > MAX_TASKS or timers > MAX_TIMERS or self.bus.connections > 1:
            what = f"{tasks} tasks, {timers} timers, {self.bus.connections} transports"
            self.tally.complain(self.clock, f"something leaks: {what}")

    def _on_wire(self, frame: OnWire) -> None:
        if frame.to_base:
            self.checker.feed(frame)


@dataclass(frozen=True, slots=True)
class Row:
    """Where the process stands at one moment of the run."""

    hours: float
    packets: int
    faults: int
    rss_mb: float
    objects: int
    wall_s: float


@dataclass(frozen=True, slots=True)
class Result:
    """What a soak found; `violations` is empty where all was well."""

    hours: float
    tally: Tally
    rows: tuple[Row, ...]
    distance_km: float
    reconnects: int
    lost: int
    damaged: int
    growth_mb_per_h: float | None
    wall_s: float

    @property
    def violations(self) -> list[str]:
        return self.tally.violations

    def summary(self) -> dict[str, object]:
        tally = self.tally
        return {
            "hours": self.hours,
            "wall_s": round(self.wall_s, 1),
            "packets": tally.packets,
            "distance_km": round(self.distance_km, 2),
            "faults": sum(tally.faults.values()),
            "kinds": tally.faults,
            "reconnects": self.reconnects,
            "restarts": tally.restarts,
            "lost": self.lost,
            "damaged": self.damaged,
            "back_s_max": round(max(tally.back_s, default=0.0), 2),
            "odometry_worst_mm": round(1e3 * tally.worst_m, 4),
            "odometry_worst_urad": round(1e6 * tally.worst_rad, 2),
            "odometry_worst_share_of_rounding": round(tally.worst_share, 3),
            "bends_between_packets_worst_mm": round(1e3 * tally.worst_sampling_m, 2),
            "blocks_told": tally.warned,
            "growth_mb_per_h": None if self.growth_mb_per_h is None else round(self.growth_mb_per_h, 3),
            "violations": self.violations,
        }


def soak(hours: float, seed: int, *, boot_s: float = BOOT_S, say: Callable[[Row], None] | None = None) -> Result:
    """Drive for so many simulated hours."""
    began_s = time.perf_counter()
    clock = Clock()
    rows: list[Row] = []
    with virtual_loop(clock) as loop:
        run = loop.run_until_complete(_made(clock, seed, hours, boot_s))
        start_ns = clock.now_ns

        async def watch() -> None:
            while True:
                gc.collect()
                done_h = (clock.now_ns - start_ns) / 3600e9
                faults = sum(run.tally.faults.values())
                row = Row(
                    done_h, run.tally.packets, faults, _rss_mb(), len(gc.get_objects()), time.perf_counter() - began_s
                )
                rows.append(row)
                if say:
                    say(row)
                await asyncio.sleep(3600 * min(1.0, hours / 10))

        watching = loop.create_task(watch(), name="watch")
        loop.run_until_complete(run.run())
        watching.cancel()
    if threading.active_count() > THREADS:
        run.tally.complain(clock, f"{threading.active_count()} threads are left")
    stats, tally = run.base.stats, run.tally
    if not tally.warned and tally.faults.get("block"):
        tally.complain(clock, "the base was blocked and never told so")
    growth = _growth(rows)
    if growth is not None and hours >= 1 and growth > MAX_GROWTH_MB_PER_H:
        tally.complain(clock, f"memory grows by {growth:.1f} MB in an hour")
    return Result(
        hours=hours,
        tally=tally,
        rows=tuple(rows),
        distance_km=run.base_model.distance_m / 1e3,
        reconnects=stats.reconnects,
        lost=stats.lost,
        damaged=stats.damaged,
        growth_mb_per_h=growth,
        wall_s=time.perf_counter() - began_s,
    )


async def _made(clock: Clock, seed: int, hours: float, boot_s: float) -> Soak:
    return Soak(clock, seed, hours, boot_s)


THREADS = threading.active_count()


def _rss_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _growth(rows: list[Row]) -> float | None:
    """MB an hour between warm-up and end."""
    warm = [row for row in rows if row.hours >= WARM_UP * rows[-1].hours]
    span_h = warm[-1].hours - warm[0].hours if warm else 0.0
    return (warm[-1].rss_mb - warm[0].rss_mb) / span_h if span_h > 0 else None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    logging.getLogger("drivers").setLevel(logging.ERROR)
    print(f"{'hours':>6} {'packets':>9} {'faults':>7} {'RSS MB':>7} {'objects':>8} {'wall s':>7}")

    def say(row: Row) -> None:
        print(
            f"{row.hours:6.2f} {row.packets:9d} {row.faults:7d} {row.rss_mb:7.1f} {row.objects:8d} {row.wall_s:7.1f}",
            flush=True,
        )

    result = soak(arguments.hours, arguments.seed, say=say)
    for violation in result.violations:
        print(f"VIOLATION {violation}")
    print(json.dumps(result.summary()))
    return 1 if result.violations else 0


if __name__ == "__main__":
    sys.exit(main())
