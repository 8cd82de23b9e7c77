from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import HeadPose, Lease, OperatorInput
from ghal360_robot.safety.lease import denied

NOW = 5_000_000_000


def by(holder: str) -> OperatorInput:
    return OperatorInput(NOW, HeadPose(), holder=holder)


@pytest.mark.parametrize(
    ("lease", "holder", "why"),
    [
        (None, "", ""),
        (None, "a", "nobody holds the lease"),
        (Lease("a", NOW), "a", ""),
        (Lease("a", NOW), "b", "another operator holds the lease"),
        (Lease("a", NOW), "", "another operator holds the lease"),
        (Lease("a", NOW - 3_000_000_000), "a", ""),
        (Lease("a", NOW - 3_000_000_001), "a", "the lease has expired"),
        (Lease("a", NOW + 20_000_000), "a", ""),
        (Lease("a", NOW + 20_000_001), "a", "the lease has expired"),
    ],
)
def test_only_the_holder_of_a_live_lease_may_drive(lease: Lease | None, holder: str, why: str) -> None:
    assert denied(lease, by(holder), NOW) == why


def test_without_an_operator_there_is_nobody_to_deny() -> None:
    assert denied(Lease("a", 0), None, NOW) == ""


@given(st.text(max_size=3), st.text(max_size=3), st.integers(-(2**62), 2**62), st.floats(0.5, 10))
def test_nobody_drives_by_a_lease_that_is_old_or_not_theirs(
    holder: str, name: str, stamp_ns: int, lease_s: float
) -> None:
    if denied(Lease(holder, stamp_ns), by(name), NOW, lease_s) == "":
        assert holder == name
        assert NOW - lease_s * 1e9 <= stamp_ns <= NOW + 20_000_000
