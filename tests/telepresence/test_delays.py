from __future__ import annotations

from ghal360_robot.telepresence.delays import MAX_PROBES, Delays

MS = 1_000_000


def test_the_round_trip_is_the_median_of_the_echoes() -> None:
    delays = Delays()
    for nonce, ms in enumerate((10, 12, 300, 11, 9)):
        delays.probe(nonce, 0)
        assert delays.echo(nonce, ms * MS)
    assert delays.round_trip_ns(0) == 11 * MS


def test_an_echo_that_nobody_asked_for_counts_nothing() -> None:
    delays = Delays()
    delays.probe(5, 0)
    assert not delays.echo(4, MS)
    assert delays.echo(5, 2 * MS)
    assert not delays.echo(5, 3 * MS)
    assert delays.round_trip_ns(3 * MS) == 2 * MS


def test_a_page_that_does_not_echo_gets_later_and_later() -> None:
    delays = Delays()
    delays.probe(1, 0)
    assert delays.round_trip_ns(700 * MS) == 700 * MS
    delays.echo(1, 10 * MS)
    delays.probe(2, 20 * MS)
    assert delays.round_trip_ns(25 * MS) == 10 * MS
    assert delays.round_trip_ns(920 * MS) == 900 * MS


def test_unanswered_probes_are_bounded() -> None:
    delays = Delays()
    for nonce in range(1000):
        delays.probe(nonce, nonce)
    assert len(delays._probes) == MAX_PROBES


def test_a_shown_picture_says_how_late_the_loop_is() -> None:
    delays = Delays()
    for sequence in (1, 2, 3):
        delays.picture(sequence, sequence * 33 * MS)
    assert delays.picture_age_ns(0) is None
    assert delays.shown(2, 166 * MS)
    assert delays.loop_ns == 100 * MS
    assert delays.picture_age_ns(200 * MS) == 134 * MS
    assert delays.latency_s(0) == 0.1


def test_a_picture_that_was_never_sent_or_was_shown_before_counts_nothing() -> None:
    delays = Delays()
    delays.picture(1, 0)
    delays.picture(2, 33 * MS)
    assert not delays.shown(7, 40 * MS)
    delays.picture(8, 66 * MS)
    assert delays.shown(8, 70 * MS)
    assert not delays.shown(8, 80 * MS)
    assert not delays.shown(1, 80 * MS)
    assert delays.picture_age_ns(80 * MS) == 14 * MS
