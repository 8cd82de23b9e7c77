from __future__ import annotations

import pytest

from ghal360_robot.telepresence.access import Role
from ghal360_robot.telepresence.gate import MAX_AGE_US
from ghal360_robot.telepresence.hub import NO_PICTURE, PICTURE_LOCK, PRESS_AGAIN, FloodError
from tests.telepresence.conftest import MS, Desk


def test_a_driver_who_sees_a_picture_and_presses_drives(desk: Desk) -> None:
    page = desk.open()
    page.drive()
    assert desk.driving
    assert not desk.locked
    assert desk.said("lease")[-1]["holder"] == page.connection.holder
    assert desk.said("lock")[-1]["name"] == PICTURE_LOCK


def test_the_wish_has_the_robots_stamp_units_and_the_measured_latency(desk: Desk) -> None:
    page = desk.open()
    page.lease("ask")
    page.see(120.0)
    page.operate(stick={"v": 0.5, "w": -1.0}, sent_us=desk.now_ns // 1000 - 100_000)
    wish = desk.said("operator")[-1]
    assert wish["stamp_ns"] == desk.now_ns
    assert wish["stick"] == {"v": 0.25, "w": -0.8}
    assert wish["latency_s"] == 0.12
    assert wish["holder"] == page.connection.holder


def test_without_the_right_to_drive_nothing_counts(desk: Desk) -> None:
    page = desk.open()
    page.see()
    page.operate(deadman=True)
    assert desk.said("operator") == []
    assert page.heard("refused")[-1]["why"] == "not the driver's"
    assert desk.said("received")[-1]["verdict"] == "not the driver's"


def test_a_viewer_cannot_even_ask(desk: Desk) -> None:
    page = desk.open(Role.VIEWER)
    page.lease("ask")
    assert desk.hub.driver is None
    assert "not drive" in page.heard("refused")[-1]["why"]


def test_a_second_driver_is_refused_until_it_is_handed_over(desk: Desk) -> None:
    first, second = desk.open(), desk.open()
    first.drive()
    second.lease("ask")
    second.see()
    second.operate(deadman=True)
    assert {wish["holder"] for wish in desk.said("operator")} == {first.connection.holder}
    assert first.heard("right")[-1]["asking"] == second.connection.name
    first.lease("hand_over")
    assert not desk.driving
    second.operate(deadman=True)
    assert not desk.driving, "a hand that was on before has to let go first"
    second.operate()
    second.operate(deadman=True)
    assert desk.driving
    assert desk.said("operator")[-1]["holder"] == second.connection.holder


def test_closing_the_page_lets_go_at_once_and_frees_the_controls(desk: Desk) -> None:
    page = desk.open()
    page.drive()
    desk.hub.leave(page.connection)
    assert not desk.driving
    assert desk.said("lease")[-1] is None


def test_a_driver_who_falls_silent_loses_the_controls(desk: Desk) -> None:
    page = desk.open()
    page.drive()
    desk.wait(2.9)
    assert desk.hub.driver is page.connection
    desk.wait(0.3)
    assert desk.hub.driver is None
    assert desk.said("lease")[-1] is None


def test_an_old_picture_locks_until_the_hand_has_let_go(desk: Desk) -> None:
    page = desk.open()
    page.drive()
    desk.wait(0.75)
    page.operate(deadman=True)
    assert desk.locked
    assert not desk.driving
    assert "old" in page.heard("quality")[-1]["lock"]
    page.see()
    page.operate(deadman=True)
    assert not desk.locked
    assert not desk.driving
    desk.wait(0.2)
    assert page.heard("quality")[-1]["lock"] == PRESS_AGAIN
    page.operate()
    page.operate(deadman=True)
    assert desk.driving


def test_nobody_drives_before_the_first_picture(desk: Desk) -> None:
    page = desk.open()
    page.lease("ask")
    page.operate()
    page.operate(deadman=True)
    assert desk.locked
    assert not desk.driving
    desk.wait(0.2)
    assert page.heard("quality")[-1]["lock"] == NO_PICTURE


@pytest.mark.parametrize("role", list(Role))
@pytest.mark.parametrize("level", ["disarm", "estop"])
def test_anybody_may_stop_and_each_press_counts_once(desk: Desk, role: Role, level: str) -> None:
    desk.open().drive()
    page = desk.open(role)
    for press in (1, 1, 2):
        page.send(kind="stop", level=level, press=press)
    assert desk.said("stop") == [level, level]


@pytest.mark.parametrize("role", list(Role))
def test_anybody_may_set_a_bookmark_but_not_one_after_the_other(desk: Desk, role: Role) -> None:
    page = desk.open(role)
    for note in ("the door\n is \x1b[2Jlocked", "", "x" * 200, "y"):
        page.send(kind="bookmark", note=note)
    marks = desk.said("bookmark")
    assert [mark["note"] for mark in marks] == ["the door is [2Jlocked", "", "x" * 200]
    assert marks[0] == {"stamp_ns": desk.now_ns, "holder": page.connection.holder, "note": marks[0]["note"]}
    assert "wait" in page.heard("refused")[-1]["why"]
    desk.wait(5.1)
    page.send(kind="bookmark")
    assert len(desk.said("bookmark")) == 4


def test_replayed_old_and_future_wishes_move_nothing_and_are_recorded(desk: Desk) -> None:
    page = desk.open()
    page.drive()
    page.operate()
    count = len(desk.said("operator"))
    page.operate(seq=1, deadman=True)
    page.operate(sent_us=desk.now_ns // 1000 - MAX_AGE_US - 1, deadman=True)
    page.operate(sent_us=desk.now_ns // 1000 + 10_000_000, deadman=True)
    page.operate(conn="somebody else's", deadman=True)
    assert len(desk.said("operator")) == count
    assert [r["verdict"] != "taken" for r in desk.said("received")[-4:]] == [True] * 4
    assert len(page.heard("refused")) >= 4
    page.operate()
    assert len(desk.said("operator")) == count + 1


def test_a_flood_closes_the_connection_but_a_stop_in_it_counts(desk: Desk) -> None:
    page = desk.open()
    for _ in range(120):
        page.send(kind="ping", t0=0.0)
    with pytest.raises(FloodError):
        page.send(kind="ping", t0=0.0)
    with pytest.raises(FloodError):
        page.send(kind="stop", level="estop", press=1)
    assert desk.said("stop") == ["estop"]


def test_a_page_that_sends_nonsense_is_told_and_then_closed(desk: Desk) -> None:
    page = desk.open()
    for _ in range(4):
        desk.hub.take(page.connection, "{}")
    assert "malformed" in page.heard("refused")[-1]["why"]
    with pytest.raises(FloodError):
        desk.hub.take(page.connection, "{}")


def test_a_page_that_opens_late_is_told_the_newest(desk: Desk) -> None:
    desk.hub.broadcast("scan", '{"kind": "scan", "n": 1}')
    desk.hub.broadcast("scan", '{"kind": "scan", "n": 2}')
    assert [message["n"] for message in desk.open().heard("scan")] == [2]


def test_a_ping_is_answered_with_the_robots_clock(desk: Desk) -> None:
    page = desk.open()
    page.send(kind="ping", t0=3.5)
    (pong,) = page.heard("pong")
    assert pong == {"kind": "pong", "t0": 3.5, "received_us": desk.now_ns // 1000, "sent_us": desk.now_ns // 1000}


def test_probes_that_are_echoed_measure_the_round_trip(desk: Desk) -> None:
    page = desk.open()
    desk.wait(0.2)
    nonce = page.heard("probe")[-1]["nonce"]
    desk.now_ns += 40 * MS
    page.send(kind="echo", nonce=nonce)
    page.operate()
    assert page.connection.delays.round_trip_ns(desk.now_ns) is not None


def test_what_is_refused_again_and_again_is_logged_a_few_times(desk: Desk, caplog: pytest.LogCaptureFixture) -> None:
    page = desk.open()
    for _ in range(60):
        desk.now_ns += 20 * MS
        page.operate(deadman=True)
    assert 1 <= sum("refused" in record.message for record in caplog.records) <= 8
