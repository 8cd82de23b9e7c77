"""Policies as bytes and files: nothing but what was written comes back."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.assembly import make_brain
from ghal360_robot.atomic import write_atomically
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.guidance.follow_rates import FollowRates
from ghal360_robot.guidance.online import OnlineLearner
from ghal360_robot.guidance.saved import PolicyFormatError, SavedPolicy, from_bytes, to_bytes
from ghal360_robot.policy_file import known_before, load_policy, save_policy

if TYPE_CHECKING:
    from pathlib import Path

POLICY = SavedPolicy(
    np.random.default_rng(0).normal(size=(2048, 3)),
    {"learner": "paper", "seed": 3},
    FollowRates((12.0, 2.0), (9.0, 1.0)),
    17,
)
DATA = to_bytes(POLICY)


def test_a_policy_comes_back_bit_for_bit() -> None:
    back = from_bytes(DATA)
    assert np.array_equal(back.q, POLICY.q)
    assert (back.provenance, back.rates, back.epochs) == (POLICY.provenance, POLICY.rates, POLICY.epochs)
    assert to_bytes(back) == DATA


def test_the_robot_goes_on_where_it_stopped() -> None:
    state = OnlineLearner().begin(from_bytes(DATA).learnt)
    assert np.array_equal(state.learnt.q, POLICY.q)
    assert state.learnt.epochs == 17
    assert not state.learnt.q.flags.writeable


@given(st.binary(max_size=300))
def test_any_bytes_are_a_policy_or_refused(data: bytes) -> None:
    with pytest.raises(PolicyFormatError):
        from_bytes(data)


@given(st.integers(0, len(DATA) - 2), st.integers(1, 255))
def test_any_damage_is_noticed(place: int, by: int) -> None:
    damaged = bytearray(DATA)
    damaged[place] = damaged[place] ^ by
    try:
        back = from_bytes(bytes(damaged))
    except PolicyFormatError:
        return
    # What JSON ignores, such as white space of another kind, is no damage.
    assert to_bytes(back) == DATA


@pytest.mark.parametrize(
    "change",
    [
        {"version": 2},
        {"q": "AAAA"},
        {"q": 5},
        {"follow": {"left": [0, 1]}},
        {"follow": {"left": [1]}},
        {"follow": 3},
        {"epochs": -1},
        {"epochs": "many"},
        {"provenance": []},
        {"format": "something"},
    ],
)
def test_contents_that_make_no_sense_are_refused_even_with_a_good_checksum(change: dict[str, object]) -> None:
    from ghal360_robot.guidance.saved import _checksum

    body = json.loads(DATA) | change
    del body["sha256"]
    with pytest.raises(PolicyFormatError):
        from_bytes(json.dumps(body | {"sha256": _checksum(body)}).encode())


def test_values_that_are_no_numbers_are_neither_saved_nor_read() -> None:
    with pytest.raises(ValueError, match="finite"):
        to_bytes(SavedPolicy(np.full((2048, 3), np.nan)))
    with pytest.raises(ValueError, match="values"):
        to_bytes(SavedPolicy(np.zeros((3, 2048))))


def test_a_huge_file_is_refused_before_it_is_parsed() -> None:
    with pytest.raises(PolicyFormatError, match="bytes"):
        from_bytes(b" " * 2_000_000)


def test_files_are_whole_or_not_there(tmp_path: Path) -> None:
    path = tmp_path / "operators" / "anna.json"
    save_policy(path, POLICY)
    assert np.array_equal(load_policy(path).q, POLICY.q)
    assert [each.name for each in path.parent.iterdir()] == ["anna.json"]


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError, match="taken"):
        write_atomically(tmp_path / "taken", b"data")
    assert [each.name for each in tmp_path.iterdir()] == ["taken"]
    with pytest.raises(GhalError, match="cannot write"):
        save_policy(tmp_path / "taken", POLICY)


def test_a_file_that_is_no_policy_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot read"):
        load_policy(tmp_path / "nothing.json")
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(UsageError, match=r"other\.json"):
        load_policy(tmp_path / "other.json")


def test_the_robot_begins_with_what_is_known_of_its_operator(tmp_path: Path) -> None:
    path = tmp_path / "anna.json"
    assert known_before("") is None
    assert known_before(str(path)) is None
    save_policy(path, POLICY)
    known = known_before(str(path))
    assert known is not None
    config = with_overrides(RobotConfig(), {"guidance": {"policy": "learned", "learn": "values", "memory": str(path)}})
    brain = make_brain(config, known)
    assert brain.policy.name == "learned"
    assert brain.known is not None
    assert brain.known.rates == POLICY.rates
    with pytest.raises(UsageError, match=r"guidance\.memory"):
        make_brain(config)
