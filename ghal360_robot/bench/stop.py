"""How fast the robot stops, for every reason there is to: measured where it counts, at the base's end of the bus.

A real process with the whole robot drives a simulated base over real wires on loopback; then the cause
strikes. What the process survives has to put zero onto the wire within 300 ms; what it does not survive
is left to the base, which stops by itself 0.5 s after the last motion frame.
"""

from __future__ import annotations

import asyncio
import os
import platform
import signal
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.rmp110.codec.parameters import RMP110_STORED
from ghal360_robot.bench.stand import Stand
from ghal360_robot.bench.subject import BLOCK_S, SPEED_MPS, Order
from ghal360_robot.bench.subject_process import SubjectError, SubjectProcess
from ghal360_robot.bench.trace import Stop

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Sequence

TO_ZERO_MS = 300.0
"""The budget: from the cause to zero on the wire."""
BASE_TIMEOUT_MS = 500.0
"""The base's own, counted from its last motion frame."""
BASE_LATENCY_MS = 40.0
"""Frame to effect in the base."""
PERIOD_MS = 20.0
"""The last motion frame may be this old when the cause strikes, or this young."""
ROLL_OUT_MS = 100.0
"""The target approaches standstill like a low-pass, and speed is looked at every 10 ms."""

START_S = 30.0
"""Python, the three devices' identification and two metres of acceleration take four seconds on an idle machine."""
STEADY_NS = 300_000_000
STEADY_MPS = 0.95 * SPEED_MPS
PHASES_S = 0.1
"""Causes strike anywhere in the robot's periods: two of the operator's, five of the control loop's."""
WATCH_S = 2.0
"""Longer than any stop here takes."""
AFTER_BLOCK_S = 1.0
"""A robot whose event loop runs again must not drive on by itself."""
END_S = 10.0
"""After SIGTERM the base comes to a stop and the recording is closed."""
MAX_REMARKS = 3


@dataclass(frozen=True, slots=True)
class Cause:
    """One reason to stop: how it strikes, and what it leaves to do the stopping."""

    name: str
    words: str
    strike: Callable[[Stand, SubjectProcess], Awaitable[int]]
    """Lets it happen and gives the instant."""
    zero_comes: bool = True
    """Whether somebody is left who can send a zero, and a wire that takes it."""
    watch_s: float = WATCH_S
    ends: bool = False
    """Whether the process is meant to end by itself."""

    def limits_ms(self, speed_mps: float) -> tuple[float, float]:
        """To zero on the wire, and to standstill from this speed."""
        braking_ms = BASE_LATENCY_MS + 1e3 * speed_mps / RMP110_STORED["max_decel"] + ROLL_OUT_MS
        left_rolling_ms = TO_ZERO_MS if self.zero_comes else BASE_TIMEOUT_MS + PERIOD_MS
        return TO_ZERO_MS, left_rolling_ms + braking_ms


@dataclass(frozen=True, slots=True)
class Sample:
    """One measured stop."""

    stop: Stop
    to_zero_ms: float | None
    """To the zero after which nothing asked for motion; where none can come, to the last frame that did."""
    limits_ms: tuple[float, float]
    remarks: tuple[str, ...]
    """What the robot said about it."""
    exit_status: int | None = None

    def passed(self, allowance_ms: float = 0.0) -> bool:
        """Whether both limits were kept; `allowance_ms` is for machines that are busy with something else."""
        return all(
            value is not None and value <= limit + allowance_ms
            for value, limit in zip((self.to_zero_ms, self.stop.standstill_ms), self.limits_ms, strict=True)
        )

    def to_json(self) -> dict[str, Any]:
        stop = self.stop
        return {
            "to_zero_ms": _round(self.to_zero_ms),
            "to_standstill_ms": _round(stop.standstill_ms),
            "last_motion_ms": _round(stop.last_motion_ms),
            "speed_mps": round(stop.speed_mps, 3),
            "said": list(self.remarks),
            "exit_status": self.exit_status,
        }


@dataclass(frozen=True, slots=True)
class Result:
    """All samples of one cause."""

    cause: Cause
    samples: tuple[Sample, ...]
    trouble: str = ""
    """Why there are not as many as were asked for; empty when all is well."""

    @property
    def passed(self) -> bool:
        return bool(self.samples) and not self.trouble and all(sample.passed() for sample in self.samples)

    @property
    def to_zero_ms(self) -> list[float | None]:
        return [sample.to_zero_ms for sample in self.samples]

    @property
    def to_standstill_ms(self) -> list[float | None]:
        return [sample.stop.standstill_ms for sample in self.samples]

    @property
    def limits_ms(self) -> tuple[float, float]:
        """To zero, and to standstill from the highest speed among the samples."""
        speeds = [sample.stop.speed_mps for sample in self.samples]
        return self.cause.limits_ms(max(speeds, default=SPEED_MPS))

    def to_json(self) -> dict[str, Any]:
        """Medians under the plain names; None where one sample has no value, because it never happened."""
        return {
            "cause": self.cause.name,
            "passed": self.passed,
            "trouble": self.trouble,
            "to_zero_ms": _round(median(self.to_zero_ms)),
            "to_zero_worst_ms": _round(worst(self.to_zero_ms)),
            "to_zero_limit_ms": self.limits_ms[0],
            "to_standstill_ms": _round(median(self.to_standstill_ms)),
            "to_standstill_worst_ms": _round(worst(self.to_standstill_ms)),
            "to_standstill_limit_ms": _round(self.limits_ms[1]),
            "samples": [sample.to_json() for sample in self.samples],
        }


def median(values: Sequence[float | None]) -> float | None:
    """None where one of them is."""
    there = [value for value in values if value is not None]
    return statistics.median(there) if there and len(there) == len(values) else None


def worst(values: Sequence[float | None]) -> float | None:
    """None where one of them is: never is later than anything."""
    there = [value for value in values if value is not None]
    return max(there) if there and len(there) == len(values) else None


def _round(value: float | None) -> float | None:
    return None if value is None else round(value, 1)


def _ordered(order: Order) -> Callable[[Stand, SubjectProcess], Awaitable[int]]:
    async def strike(_stand: Stand, subject: SubjectProcess) -> int:
        return await subject.order(order)

    return strike


def _at_the_stand(what: Callable[[Stand], None]) -> Callable[[Stand, SubjectProcess], Awaitable[int]]:
    async def strike(stand: Stand, _subject: SubjectProcess) -> int:
        what(stand)
        return time.monotonic_ns()

    return strike


def _signalled(number: signal.Signals) -> Callable[[Stand, SubjectProcess], Awaitable[int]]:
    async def strike(_stand: Stand, subject: SubjectProcess) -> int:
        return subject.send_signal(number)

    return strike


CAUSES: tuple[Cause, ...] = (
    Cause("operator-silent", "operator silent", _ordered(Order.FALL_SILENT)),
    Cause("e-stop", "emergency stop pressed", _ordered(Order.PRESS_ESTOP)),
    Cause("lidar-silent", "lidar silent", _at_the_stand(Stand.silence_lidar)),
    Cause("feedback-lost", "base's feedback lost", _at_the_stand(lambda stand: stand.base.lose_feedback())),
    Cause("bus-down", "bus down", _at_the_stand(lambda stand: stand.base.lose_bus()), zero_comes=False),
    Cause(
        "loop-blocked",
        f"event loop blocked for {BLOCK_S:g} s",
        _ordered(Order.BLOCK_LOOP),
        watch_s=BLOCK_S + AFTER_BLOCK_S,
    ),
    Cause("sigterm", "SIGTERM", _signalled(signal.SIGTERM), ends=True),
    Cause("sigkill", "SIGKILL", _signalled(signal.SIGKILL), zero_comes=False, ends=True),
)


async def measure_all(cause: Cause, repeat: int, progress: Callable[[int], None]) -> Result:
    """So many stops for one cause, each at another phase of the robot's periods; `progress` hears of each begun."""
    samples: list[Sample] = []
    try:
        for number in range(repeat):
            progress(number)
            samples.append(await measure(cause, seed=number))
    except SubjectError as error:
        return Result(cause, tuple(samples), str(error))
    return Result(cause, tuple(samples))


async def measure(cause: Cause, seed: int = 0) -> Sample:
    """Start a robot, let it drive, let the cause strike, watch. Raises SubjectError where it does not drive."""
    phase_s = float(np.random.default_rng([seed, CAUSES.index(cause)]).uniform(0.0, PHASES_S))
    with tempfile.TemporaryDirectory(prefix="ghal360-bench-") as folder:
        async with Stand() as stand, SubjectProcess(stand.endpoints, Path(folder)) as subject:
            await _driving(stand, subject)
            await asyncio.sleep(phase_s)
            cause_ns = await cause.strike(stand, subject)
            await asyncio.sleep(max(0.0, cause.watch_s - (time.monotonic_ns() - cause_ns) / 1e9))
            stop = stand.base.trace.stop_after(cause_ns)
            said = tuple(said.text for said in subject.said if said.stamp_ns >= cause_ns)
            status = await subject.exit_status(END_S) if cause.ends else None
    return Sample(
        stop=stop,
        to_zero_ms=stop.zero_ms if cause.zero_comes else stop.last_motion_ms,
        limits_ms=cause.limits_ms(stop.speed_mps),
        remarks=tuple(dict.fromkeys(said))[:MAX_REMARKS],
        exit_status=status,
    )


async def _driving(stand: Stand, subject: SubjectProcess) -> None:
    """Wait until the robot drives steadily."""
    deadline = time.monotonic() + START_S
    while not stand.base.trace.steady(STEADY_MPS, STEADY_NS):
        if not subject.alive or time.monotonic() > deadline:
            raise SubjectError(f"the robot to be measured does not drive: {subject.last_words()}")
        await asyncio.sleep(0.01)


def machine() -> dict[str, Any]:
    """What the numbers were measured on, and how busy it was."""
    return {
        "cores": os.cpu_count(),
        "architecture": platform.machine(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "load_1_min": round(os.getloadavg()[0], 2),
    }
