from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.telepresence.lease_desk import ASK_LASTS_NS, ASK_NS, LEASE_NS, Desk, gone, renew, settle, wish

NOW = 10_000_000_000


def holding(conn: str = "a", now_ns: int = NOW) -> Desk:
    desk, why = wish(Desk(), conn, "ask", now_ns)
    assert (desk.holder, why) == (conn, "")
    return desk


def test_what_nobody_holds_is_given_to_who_asks() -> None:
    holding()


def test_who_asks_the_driver_waits_for_an_answer() -> None:
    desk, why = wish(holding(), "b", "ask", NOW)
    assert (desk.holder, desk.asking, why) == ("a", "b", "")
    assert wish(desk, "c", "ask", NOW)[1] == "somebody else is asking already"
    assert wish(desk, "a", "hand_over", NOW)[0].holder == "b"
    kept, _ = wish(desk, "a", "keep", NOW)
    assert (kept.holder, kept.asking) == ("a", "")


def test_only_the_driver_answers() -> None:
    desk, _ = wish(holding(), "b", "ask", NOW)
    for conn in ("b", "c"):
        for answer in ("hand_over", "keep"):
            after, why = wish(desk, conn, answer, NOW)
            assert (after.holder, after.asking) == ("a", "b")
            assert why


def test_taking_over_needs_a_question_and_five_seconds() -> None:
    desk = renew(holding(), "a", NOW + ASK_NS)
    assert wish(desk, "b", "take", NOW + ASK_NS)[1].startswith("ask first")
    desk, _ = wish(holding(), "b", "ask", NOW)
    desk = renew(desk, "a", NOW + ASK_NS)
    assert wish(desk, "b", "take", NOW + ASK_NS - 1)[1].startswith("ask first")
    assert wish(desk, "c", "take", NOW + ASK_NS)[1].startswith("ask first")
    assert wish(desk, "b", "take", NOW + ASK_NS) == (Desk("b", NOW + ASK_NS), "")


def test_a_silent_holder_loses_it_to_who_asks() -> None:
    desk, _ = wish(holding(), "b", "ask", NOW)
    assert settle(desk, NOW + LEASE_NS).holder == "a"
    assert settle(desk, NOW + LEASE_NS + 1).holder == "b"
    assert settle(holding(), NOW + LEASE_NS + 1).holder == ""


def test_a_question_does_not_stand_for_ever() -> None:
    desk, _ = wish(holding(), "b", "ask", NOW)
    later = NOW + ASK_LASTS_NS + 1
    desk = settle(renew(desk, "a", later), later)
    assert (desk.holder, desk.asking) == ("a", "")


def test_who_closes_the_page_holds_nothing() -> None:
    asked, _ = wish(holding(), "b", "ask", NOW)
    assert gone(asked, "a", NOW).holder == "b"
    assert gone(asked, "b", NOW).asking == ""
    assert gone(holding(), "a", NOW) == Desk(renewed_ns=NOW)


def test_who_gives_back_or_asks_no_more() -> None:
    asked, _ = wish(holding(), "b", "ask", NOW)
    assert wish(asked, "b", "release", NOW)[0].asking == ""
    assert wish(asked, "a", "release", NOW)[0].holder == "b"


WISHES = st.sampled_from(["ask", "take", "release", "hand_over", "keep"])
STEPS = st.tuples(st.sampled_from("abc"), WISHES | st.sampled_from(["renew", "gone"]), st.integers(0, 4 * 10**9))


@given(st.lists(STEPS, max_size=40))
def test_a_living_driver_loses_it_only_by_own_hand_or_unanswered_question(steps: list[tuple[str, str, int]]) -> None:
    desk, now = Desk(), NOW
    for conn, what, pause in steps:
        now += pause
        before = settle(desk, now)
        if what == "renew":
            after = renew(before, conn, now)
        elif what == "gone":
            after = gone(before, conn, now)
        else:
            after, _ = wish(before, conn, what, now)
        if before.holder and after.holder != before.holder:
            own = conn == before.holder and what in {"release", "hand_over", "gone"}
            assert own or (what == "take" and before.may_take(conn, now))
        desk = after
