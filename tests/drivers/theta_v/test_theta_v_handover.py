"""Between the collecting thread and the readers: what is dropped, what never is; and the recovery ladder."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec.access_units import AccessUnit
from drivers.theta_v.device.ladder import ORDER, Drought, Ladder, Step
from drivers.theta_v.device.mailbox import Mailbox
from drivers.theta_v.device.stats import Meter
from drivers.theta_v.errors import ThetaGone

S = 1_000_000_000


def picture(index: int, *, key: bool = False, taint: str = "", decodable: bool = True) -> AccessUnit:
    return AccessUnit(b"", b"", index, index, index, key, 2, 2, taint=taint, decodable=decodable)


async def drain(mailbox: Mailbox) -> list[int]:
    mailbox.close()
    found = []
    while (unit := await mailbox.get()) is not None:
        found.append(unit.sequence)
    return found


async def test_a_reader_joins_at_a_key_picture() -> None:
    mailbox = Mailbox(asyncio.get_running_loop(), 8)
    for unit in (picture(1), picture(2, key=True, taint="x"), picture(3, key=True), picture(4)):
        mailbox.put(unit)
    assert await drain(mailbox) == [3, 4]
    assert mailbox.dropped == 0


async def test_when_full_everything_before_the_newest_key_picture_goes() -> None:
    mailbox = Mailbox(asyncio.get_running_loop(), 4)
    for unit in (picture(1, key=True), picture(2), picture(3, key=True), picture(4), picture(5)):
        mailbox.put(unit)
    assert await drain(mailbox) == [3, 4, 5]
    assert mailbox.dropped == 2


async def test_when_full_of_one_group_all_goes_until_the_next_key_picture() -> None:
    mailbox = Mailbox(asyncio.get_running_loop(), 3)
    for unit in (picture(1, key=True), *map(picture, range(2, 7)), picture(7, key=True), picture(8)):
        mailbox.put(unit)
    assert await drain(mailbox) == [7, 8]
    assert mailbox.dropped == 6


@pytest.mark.parametrize(("pass_tainted", "expected"), [(True, [1, 2]), (False, [1])])
async def test_tainted_pictures_are_passed_or_not_as_configured(pass_tainted: bool, expected: list[int]) -> None:
    mailbox = Mailbox(asyncio.get_running_loop(), 3, pass_tainted=pass_tainted)
    mailbox.put(picture(1, key=True))
    mailbox.put(picture(2, taint="lost"))
    assert await drain(mailbox) == expected


async def test_the_reader_gets_what_waits_and_then_the_error() -> None:
    mailbox = Mailbox(asyncio.get_running_loop(), 3)
    mailbox.put(picture(1, key=True))
    mailbox.close(ThetaGone("unplugged"))
    assert await mailbox.get() is not None
    with pytest.raises(ThetaGone):
        await mailbox.get()


@given(st.lists(st.tuples(st.booleans(), st.booleans()), max_size=60), st.integers(1, 5))
@settings(deadline=None)
def test_no_picture_is_handed_out_whose_reference_was_dropped(steps: list[tuple[bool, bool]], limit: int) -> None:
    async def run() -> list[AccessUnit]:
        mailbox = Mailbox(asyncio.get_running_loop(), limit)
        found: list[AccessUnit] = []
        for index, (key, read) in enumerate(steps):
            mailbox.put(picture(index, key=key))
            if read and mailbox._units:
                unit = await mailbox.get()
                assert unit is not None
                found.append(unit)
            assert len(mailbox._units) <= limit
        mailbox.close()
        while (unit := await mailbox.get()) is not None:
            found.append(unit)
        return found

    last: int | None = None
    for unit in asyncio.run(run()):
        assert unit.keyframe or last == unit.sequence - 1
        last = unit.sequence


def test_rates_are_those_of_the_last_two_seconds_and_slow_down_when_nothing_comes() -> None:
    meter = Meter()
    unit = replace(picture(1), raw=bytes(1000))
    for at in range(90):
        meter.count(replace(unit, stamp_ns=at * S // 30))
    now = 90 * S // 30
    rate_hz, bit_rate = meter.rates(now)
    assert rate_hz == pytest.approx(30, rel=0.02)
    assert bit_rate == pytest.approx(30 * 8000, rel=0.02)
    assert 0 < meter.rates(now + S)[0] < 25
    assert meter.rates(now + 3 * S) == (0.0, 0.0)


def test_the_ladder_goes_from_restart_to_reopen_and_forgets_when_pictures_come() -> None:
    ladder = Ladder(0, stall_s=1, first_picture_s=3)
    assert ladder.due(2 * S, None) is None
    taken = []
    now = 3 * S
    for _ in range(6):
        taken.append(ladder.due(now, None))
        ladder.started(now)
        assert ladder.due(now + S // 2, None) is None
        now += S
    assert taken == [Step.RESTART, Step.RESTART, Step.RENEGOTIATE, Step.RESET, Step.TOGGLE, Step.REOPEN]
    assert ladder.due(now + S, now + S // 2) is None
    assert ladder.due(now + 7 * S, now + 6 * S) is Step.RESTART


def test_a_stream_that_stalls_again_and_again_after_a_few_pictures_climbs_the_ladder_too() -> None:
    ladder = Ladder(0, stall_s=1, first_picture_s=3)
    taken, now = [], 0
    for _ in range(6):
        picture = now + S // 2
        assert ladder.due(picture, picture) is None
        now = picture + S
        taken.append(ladder.due(now, picture))
        ladder.started(now)
    assert taken == list(ORDER)


def test_a_key_picture_is_fetched_when_somebody_waits_for_one_and_not_all_the_time() -> None:
    drought = Drought(5)
    assert not drought.due(100 * S, None)
    asked = [at for at in range(100, 400) if drought.due(at * S, 100 * S)]
    assert asked == [105, 115, 135, 175, 235, 295, 355]
    assert not drought.due(400 * S, None)
    assert drought.due(405 * S, 400 * S)
