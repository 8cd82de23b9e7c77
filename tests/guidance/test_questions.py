"""An operator who is asked about what they see, and does not say so, says no."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.guidance.questions import (
    MOST_NOS,
    No,
    Question,
    Questions,
    QuestionSettings,
    said_no,
    step_questions,
)
from ghal360_robot.messages import HeadPose, OperatorInput

SETTINGS = QuestionSettings()
TICK_NS = 20_000_000
AHEAD = Question(0.0, (0.0, 0.0), (3.0, 0.0))


def watching(now_ns: int, *, yaw: float = 0.0, presses: int = 0, age_ns: int = 0) -> OperatorInput:
    return OperatorInput(now_ns - age_ns, HeadPose(yaw), found_presses=presses)


def shown(
    seconds: float,
    question: Question | None = AHEAD,
    state: Questions | None = None,
    *,
    since_s: float = 0.0,
    yaw: float = 0.0,
    presses: int = 0,
    settings: QuestionSettings = SETTINGS,
    operator: bool = True,
) -> tuple[Questions, float | None]:
    """The questions after so long, and the seconds until silence became a no."""
    state, no_s = state or Questions(), None
    for n in range(round(seconds * 50) + 1):
        now_ns = round(since_s * 1e9) + n * TICK_NS
        person = watching(now_ns, yaw=yaw, presses=presses) if operator else None
        state, no = step_questions(settings, state, question, person, 0.0, now_ns)
        if no and no_s is None:
            no_s = n / 50
    return state, no_s


def test_four_seconds_of_silence_are_a_no() -> None:
    state, no_s = shown(4.2)
    assert no_s == pytest.approx(4.0, abs=0.03)
    assert len(state.noes) == 1
    assert said_no(SETTINGS, state.noes, 0.05, (0.2, 0.0), (3.1, 0.1))


@pytest.mark.parametrize(
    ("why", "arguments"),
    [
        ("nobody is there", {"operator": False}),
        ("it is out of their view", {"yaw": math.radians(50)}),
        ("nothing is asked", {"question": None}),
        ("silence is told to be none", {"settings": QuestionSettings(no_after_s=0.0)}),
    ],
)
def test_silence_is_no_answer_where(why: str, arguments: dict[str, object]) -> None:
    state, no_s = shown(20.0, **arguments)  # type: ignore[arg-type]
    assert no_s is None, why
    assert not state.noes


def test_a_head_stream_that_stopped_is_nobody_s_silence() -> None:
    state = Questions()
    for n in range(500):
        state, no = step_questions(SETTINGS, state, AHEAD, watching(0), 0.0, n * TICK_NS)
        assert not no


def test_an_operator_who_says_found_says_yes() -> None:
    state, _ = shown(3.0)
    state, no_s = shown(3.0, AHEAD, state, since_s=3.02, presses=1)
    assert no_s is None
    assert not state.noes


def test_a_question_that_flickers_is_one_and_another_thing_is_another() -> None:
    first, _ = shown(3.0)
    paused, _ = shown(0.5, None, first, since_s=3.02)
    assert shown(2.0, AHEAD, paused, since_s=3.54)[1] == pytest.approx(1.0, abs=0.55)
    forgotten, _ = shown(1.5, None, first, since_s=3.02)
    assert forgotten.asked is None
    aside = replace(AHEAD, yaw=0.5, place=(3.0, 1.6))
    assert shown(2.0, aside, first, since_s=3.02)[1] is None


def test_who_drives_up_to_it_is_still_looking() -> None:
    state, now_ns = Questions(), 0
    for n in range(600):
        now_ns = n * TICK_NS
        question = replace(AHEAD, camera=(0.004 * n, 0.0))
        state, no = step_questions(SETTINGS, state, question, watching(now_ns), 0.0, now_ns)
        assert not no


def test_a_no_holds_nearby_and_for_a_while_only() -> None:
    state, _ = shown(4.2)
    place = (3.0, 0.0)
    assert said_no(SETTINGS, state.noes, 0.0, (1.4, 0.0), place)
    assert not said_no(SETTINGS, state.noes, 0.0, (1.6, 0.0), place)
    assert not said_no(SETTINGS, state.noes, 1.0, (0.0, 0.0), (1.6, 2.5))
    later, _ = shown(0.1, None, state, since_s=4.2 + SETTINGS.again_s + 0.1)
    assert not later.noes


def test_a_thing_whose_place_is_not_known_is_told_by_its_direction() -> None:
    no = No(0.0, (0.0, 0.0), None, 0)
    assert no.holds(SETTINGS, 0.2, (0.0, 0.0), None)
    assert not no.holds(SETTINGS, 0.4, (0.0, 0.0), None)
    # Passed by 1 m, a thing that stands 3 m ahead is seen elsewhere.
    assert No(0.0, (0.0, 0.0), (3.0, 0.0), 0).holds(SETTINGS, math.atan2(-1.0, 3.0), (0.0, 1.0), None)


def test_each_further_no_about_a_thing_holds_twice_as_far() -> None:
    state, _ = shown(4.2)
    again = Question(0.0, (1.6, 0.0), (3.0, 0.0))
    state, _ = shown(4.2, again, state, since_s=5.0)
    (no,) = state.noes
    assert no.times == 2
    assert said_no(SETTINGS, state.noes, math.pi, (4.5, 0.0), (3.0, 0.0))
    assert not said_no(SETTINGS, state.noes, math.pi, (4.7, 0.0), (3.0, 0.0))


yaws = st.floats(-math.pi, math.pi)
spots = st.tuples(st.floats(-5, 5), st.floats(-5, 5))
ticks = st.tuples(st.booleans(), yaws, spots, st.booleans(), yaws, st.integers(0, 3), st.integers(0, 6_000_000_000))


@given(st.lists(ticks, max_size=60))
def test_whatever_happens_few_noes_are_remembered_and_each_was_shown_long_enough(
    moments: list[tuple[bool, float, tuple[float, float], bool, float, int, int]],
) -> None:
    state, now_ns = Questions(), 0
    for asked, yaw, camera, present, head, presses, wait_ns in moments:
        now_ns += wait_ns
        question = Question(yaw, camera) if asked else None
        operator = watching(now_ns, yaw=head, presses=presses) if present else None
        before = state
        state, no = step_questions(SETTINGS, state, question, operator, 0.0, now_ns)
        assert len(state.noes) <= MOST_NOS
        if no:
            assert question is not None
            assert before.asked is not None
            assert state.asked is None
