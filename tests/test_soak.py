"""Two minutes of the day that `make soak` drives, and proof that it would notice what it looks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from benchmarks.soak import soak
from drivers.rmp110.device import odometry, slip
from drivers.rmp110.device.link import Link
from drivers.rmp110.device.odometry import Odometry
from drivers.rmp110.errors import RmpInterfaceError

SHORT_H = 2 / 60
BOOT_S = 0.5
Spoil = Callable[[pytest.MonkeyPatch], None]


def test_two_minutes_of_faults_leave_no_drift_no_leak_and_a_base_that_drives() -> None:
    result = soak(SHORT_H, seed=3, boot_s=BOOT_S)
    assert result.violations == []
    assert len(result.tally.faults) >= 6, "too few kinds of faults to prove anything"
    assert len(result.tally.back_s) >= 6
    assert result.reconnects > 0
    assert result.tally.packets > 1500
    assert result.tally.worst_share < 1.0


def drifting(patch: pytest.MonkeyPatch) -> None:
    """A ten-thousandth of every step of one wheel is lost."""
    moved = Odometry._moved

    def worn(self: Odometry, right: float, left: float, *rest: Any) -> Odometry:
        return moved(self, right * (1 - 1e-4), left, *rest)

    patch.setattr(Odometry, "_moved", worn)


def deaf_to_restarts(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(odometry, "MAX_WHEEL_MPS", 1e9)
    advance = Odometry.advance

    def trusting(self: Odometry, *args: Any, **named: Any) -> Odometry:
        return replace(advance(self, *args, **named), jumps=0)

    patch.setattr(Odometry, "advance", trusting)


def silent_about_blocks(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(slip.SlipWatch, "warnings", ())


def crying_wolf(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(slip, "FREE_MPS", -0.2)


def never_again(patch: pytest.MonkeyPatch) -> None:
    """A link that was lost is not found again."""
    opened = Link.open
    times = iter(range(10))

    async def once(self: Link) -> None:
        if next(times, 10) > 0:
            raise RmpInterfaceError("spoiled")
        await opened(self)

    patch.setattr(Link, "open", once)


@pytest.mark.parametrize("spoil", [drifting, deaf_to_restarts, silent_about_blocks, crying_wolf, never_again])
def test_a_spoiled_driver_does_not_pass(spoil: Spoil, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(monkeypatch)
    assert soak(SHORT_H, seed=3, boot_s=BOOT_S).violations
