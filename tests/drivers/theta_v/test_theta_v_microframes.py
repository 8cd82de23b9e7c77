"""Where nothing came and when nobody listened: what no packet status tells."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec import usbip
from drivers.theta_v.codec.payload import RAN_DRY, Packet
from drivers.theta_v.transport.microframes import NOTHING, Listening, Pauses
from drivers.theta_v.transport.usbip_urbs import Urbs, Video

MS = 1_000_000
TRANSFERS, PACKETS, TRANSFER_NS = 64, 32, 4 * MS
QUEUE_NS = TRANSFERS * TRANSFER_NS


@given(st.lists(st.lists(st.booleans(), min_size=4, max_size=4), max_size=12))
@settings(deadline=None)
def test_each_run_of_empty_microframes_is_marked_once_wherever_transfers_are_cut(transfers: list[list[bool]]) -> None:
    pauses = Pauses()
    found: list[Packet] = []
    for transfer in transfers:
        slots = [slot for slot, full in enumerate(transfer) if full]
        found += pauses.marked(slots, [(0, b"x")] * len(slots), 4)
    expected: list[Packet] = []
    for full in [slot for transfer in transfers for slot in transfer]:
        if full or not expected or expected[-1] != NOTHING:
            expected.append((0, b"x") if full else NOTHING)
    while expected and expected[-1] == NOTHING:
        expected.pop()
    assert found == expected


def test_transfers_that_come_in_time_or_late_together_leave_no_gap() -> None:
    listening, now_ns = Listening(TRANSFERS, PACKETS), 0
    for _ in range(1000):
        now_ns += TRANSFER_NS
        assert listening.gap(now_ns) == 0
    now_ns += QUEUE_NS - TRANSFER_NS
    assert [listening.gap(now_ns) for _ in range(TRANSFERS - 1)] == [0] * (TRANSFERS - 1)


def test_a_clock_that_drifts_is_no_gap() -> None:
    listening, now_ns = Listening(TRANSFERS, PACKETS), 0
    for _ in range(100_000):
        now_ns += TRANSFER_NS + TRANSFER_NS // 1000
        assert listening.gap(now_ns) == 0


def test_a_pause_longer_than_the_queue_is_a_gap_of_the_rest() -> None:
    listening = Listening(TRANSFERS, PACKETS)
    listening.gap(0)
    assert listening.gap(QUEUE_NS + 40 * MS) == 40 * MS
    assert listening.gap(QUEUE_NS + 40 * MS) == 0


def test_pauses_that_starve_the_queue_together_are_a_gap_though_none_is_longer_than_it() -> None:
    listening = Listening(TRANSFERS, PACKETS)
    gaps = [listening.gap(at * 200 * MS) for at in range(5)]
    assert gaps[:2] == [0, 0]
    assert all(gap > 100 * MS for gap in gaps[2:])


def test_the_loss_shows_before_the_first_request_made_too_late_and_not_before_those_in_flight() -> None:
    batches: list[list[Packet]] = []
    urbs = Urbs(1, "server")
    urbs.start_video(Video(0x84, 8, 4, lambda _, packets: batches.append(list(packets))), 2)
    table = usbip.iso_request(4, 8)

    def answer(sequence: int, now_ns: int) -> None:
        rows = usbip.iso_table(table).copy()
        rows[:, 2] = 8
        data = usbip.Return(sequence, 0, 32, 4).encode() + bytes(32) + rows.astype(">u4").tobytes()
        assert urbs.answers(memoryview(data), now_ns)[0] == len(data)

    answer(1, 0)
    answer(2, 50 * MS)
    answer(3, 50 * MS)
    answer(4, 50 * MS)
    assert [batch[0][0] for batch in batches] == [0, 0, 0, RAN_DRY]
