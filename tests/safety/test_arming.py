from __future__ import annotations

from dataclasses import replace

import pytest

from ghal360_robot.messages import ArmState, BaseMode, HeadPose, Inputs, OperatorInput, Stops
from ghal360_robot.safety.arming import Arming, step, why_not_ready
from ghal360_robot.safety.staleness import Staleness
from tests.safety.conftest import TICK_NS, inputs

HEALTHY = Staleness()
SILENT = Staleness(hold=("operator stale",), silent=frozenset({"operator"}))


def tick(n: int, *, arm: int = 0, disarm: int = 0, estop: int = 0, holder: str = "", **changes: object) -> Inputs:
    stamp = n * TICK_NS
    message = OperatorInput(stamp, HeadPose(), True, None, arm, disarm, estop, holder=holder)
    return inputs(n, **{"operator": message, **changes})


def after(*ticks: Inputs, arming: Arming | None = None, stale: Staleness = HEALTHY) -> Arming:
    arming = arming or Arming()
    for one in ticks:
        arming = step(arming, one, stale, ())
    return arming


def armed() -> Arming:
    arming = after(tick(0), tick(1, arm=1), tick(2, arm=1))
    assert arming.state is ArmState.ARMED
    return arming


def test_a_press_arms_once() -> None:
    arming = after(tick(0), tick(1, arm=1))
    assert arming.state is ArmState.ARMED
    assert arming.reason == ""
    assert arming.since_ns == TICK_NS
    gone = after(tick(2, arm=1, disarm=1), tick(3, arm=1, disarm=1), arming=arming)
    assert gone.state is ArmState.DISARMED
    assert gone.reason == "disarmed by the operator"
    assert after(tick(4, arm=2, disarm=1), arming=gone).state is ArmState.ARMED


def test_losses_disarm_by_name_and_keep_from_arming() -> None:
    lost = step(armed(), tick(3, arm=1), HEALTHY, ("too hot", "too late"))
    assert (lost.state, lost.reason) == (ArmState.DISARMED, "too hot, too late")
    refused = step(lost, tick(4, arm=2), HEALTHY, ("too hot",))
    assert (refused.state, refused.reason) == (ArmState.DISARMED, "cannot arm: too hot")
    assert step(refused, tick(5, arm=2), HEALTHY, ()).state is ArmState.DISARMED
    assert step(refused, tick(5, arm=3), HEALTHY, ()).state is ArmState.ARMED
    both = step(armed(), tick(3, arm=1), Staleness(lost=("lidar lost",)), ("too hot",))
    assert both.reason == "lidar lost, too hot"


def test_all_that_stands_in_the_way_is_said() -> None:
    base = replace(tick(0).base, mode=BaseMode.STARTING, faults=("fault",))  # type: ignore[type-var]
    stale = Staleness(hold=("video stale",), lost=("lidar lost",))
    assert why_not_ready(base, stale, ("hot",)) == ("lidar lost", "video stale", "hot", "fault", "base is starting")
    assert why_not_ready(None, HEALTHY, ()) == ()
    for mode in (BaseMode.STANDBY, BaseMode.DRIVE):
        assert why_not_ready(replace(base, mode=mode, faults=()), HEALTHY, ()) == ()


def test_a_lost_operator_changes_nothing_but_the_state() -> None:
    without = replace(tick(3), operator=None)
    assert after(without, arming=armed()).state is ArmState.ARMED
    assert step(armed(), without, Staleness(lost=("operator lost",)), ()).reason == "operator lost"


@pytest.mark.parametrize("held_ticks", [1, 200])
def test_an_emergency_stop_latches_until_a_fresh_press(held_ticks: int) -> None:
    stopped = after(tick(3, arm=1, estop=1), arming=armed())
    assert (stopped.state, stopped.reason) == (ArmState.ESTOP, "emergency stop pressed")
    assert stopped.since_ns == 3 * TICK_NS
    stopped = after(*(tick(4 + n, arm=1, estop=1) for n in range(held_ticks)), arming=stopped)
    assert stopped.state is ArmState.ESTOP
    n = 4 + held_ticks
    reset = after(tick(n, arm=2, estop=1), arming=stopped)
    assert (reset.state, reset.reason) == (ArmState.DISARMED, "emergency stop reset; press again to arm")
    again = after(tick(n, arm=2, estop=2), arming=stopped)
    assert again.state is ArmState.ESTOP
    assert after(tick(n, arm=1, estop=1, disarm=1), arming=stopped).state is ArmState.ESTOP


def test_an_emergency_stop_counts_when_disarmed_and_in_a_first_message() -> None:
    assert after(tick(0), tick(1, estop=1)).state is ArmState.ESTOP
    assert after(tick(0, estop=3)).state is ArmState.ESTOP


def test_stops_of_others_count_by_edges_and_anew_when_their_counts_begin_anew() -> None:
    others = after(tick(3, arm=1, stops=Stops(disarm=1)), arming=armed())
    assert (others.state, others.reason) == (ArmState.DISARMED, "disarmed by somebody else")
    again = after(tick(4, arm=2, stops=Stops(disarm=1)), arming=others)
    assert again.state is ArmState.ARMED
    assert after(tick(5, arm=2, stops=Stops(disarm=1, estop=1)), arming=again).state is ArmState.ESTOP
    high = replace(again, stops_seen=Stops(5, 5))
    assert after(tick(5, arm=2, stops=Stops(0, 0)), arming=high).state is ArmState.ARMED
    assert after(tick(5, arm=2, stops=Stops(1, 0)), arming=high).state is ArmState.DISARMED
    assert after(tick(5, arm=2, stops=Stops(0, 1)), arming=high).state is ArmState.ESTOP
    assert after(tick(5, arm=2, stops=Stops(5, 5)), arming=high).state is ArmState.ARMED
    assert after(tick(5, arm=2, stops=Stops(6, 5)), arming=high).state is ArmState.DISARMED


def test_disarming_wins_over_arming_and_is_named() -> None:
    both = after(tick(3, arm=1, disarm=1, stops=Stops(disarm=1)), arming=armed())
    assert both.reason == "disarmed by somebody else"
    assert after(tick(0), tick(1, arm=1, disarm=1)).state is ArmState.DISARMED
    assert after(tick(0), tick(1, arm=1, stops=Stops(disarm=1))).state is ArmState.DISARMED


def test_a_silence_makes_the_next_message_a_new_start_for_arming_but_not_for_stops() -> None:
    before = after(tick(0))
    silent = step(before, tick(1), SILENT, ())
    assert silent.silent
    assert after(tick(2, arm=1), arming=silent).state is ArmState.DISARMED
    assert after(tick(2, arm=1), tick(3, arm=2), arming=silent).state is ArmState.ARMED
    assert after(tick(2, estop=1), arming=silent).state is ArmState.ESTOP
    pressed_while_silent = step(before, tick(1, arm=1), SILENT, ())
    assert pressed_while_silent.state is ArmState.DISARMED
    assert after(tick(2, arm=1), arming=pressed_while_silent).state is ArmState.DISARMED


def test_who_takes_over_during_a_silence_finds_the_robot_disarmed() -> None:
    silent = step(armed(), tick(3, arm=1), SILENT, ())
    successor = after(tick(4, holder="b"), arming=silent)
    assert (successor.state, successor.reason) == (ArmState.DISARMED, "another operator took over")
    reloaded = after(tick(4), arming=silent)
    assert (reloaded.state, reloaded.reason) == (ArmState.DISARMED, "another operator took over")
    assert after(tick(4, arm=1), tick(5, arm=1), arming=reloaded).state is ArmState.DISARMED


def test_an_armed_robot_stays_armed_over_a_short_silence() -> None:
    silent = step(armed(), tick(3, arm=1), SILENT, ())
    assert silent.state is ArmState.ARMED
    assert after(tick(4, arm=1), arming=silent).state is ArmState.ARMED


@pytest.mark.parametrize(
    ("seen", "counts"),
    [({}, {"arm": 0}), ({"disarm_seen": 1}, {"arm": 1, "disarm": 0}), ({"estop_seen": 1}, {"arm": 1, "estop": 0})],
)
def test_counts_that_fall_are_another_operator(seen: dict[str, int], counts: dict[str, int]) -> None:
    replaced = after(tick(3, **counts), arming=replace(armed(), **seen))  # type: ignore[arg-type]
    assert (replaced.state, replaced.reason) == (ArmState.DISARMED, "another operator took over")
    assert replaced.fell_ns == 3 * TICK_NS


def test_stops_in_the_first_message_of_another_count() -> None:
    assert after(tick(3, arm=0, estop=1), arming=armed()).state is ArmState.ESTOP
    assert after(tick(3, arm=5, estop=1, holder="b"), arming=armed()).state is ArmState.ESTOP
    assert after(tick(3, arm=1, estop=1), arming=replace(armed(), estop_seen=5)).state is ArmState.ESTOP
    assert after(tick(3, arm=0, disarm=1), arming=armed()).reason == "disarmed by the operator"


def test_another_holder_is_another_operator_and_may_arm_at_once_with_a_press_of_their_own() -> None:
    other = after(tick(3, arm=1, holder="b"), arming=armed())
    assert (other.state, other.reason) == (ArmState.DISARMED, "another operator took over")
    assert other.holder == "b"
    assert after(tick(4, arm=2, holder="b"), arming=other).state is ArmState.ARMED
    fewer = after(tick(3, arm=0, holder="b"), tick(4, arm=1, holder="b"), arming=armed())
    assert (fewer.state, fewer.fell_ns) == (ArmState.ARMED, None)
    assert after(tick(3, arm=9, holder="b"), arming=after(tick(0))).state is ArmState.DISARMED


def test_after_counts_fell_presses_count_only_when_they_have_settled() -> None:
    fell = after(tick(3, arm=0), arming=armed())
    assert fell.fell_ns == 3 * TICK_NS
    early = after(*(tick(n) for n in range(4, 52)), tick(52, arm=1), arming=fell)
    assert early.state is ArmState.DISARMED
    late = after(*(tick(n) for n in range(4, 53)), tick(53, arm=1), arming=fell)
    assert late.state is ArmState.ARMED


def test_a_base_gets_two_seconds_into_the_drive_mode_and_none_out_of_it() -> None:
    standby = replace(tick(0).base, mode=BaseMode.STANDBY)  # type: ignore[type-var]
    arming = after(tick(0, base=standby), tick(1, arm=1, base=standby))
    assert not arming.drove
    assert after(tick(101, arm=1, base=standby), arming=arming).state is ArmState.ARMED
    late = after(tick(102, arm=1, base=standby), arming=arming)
    assert (late.state, late.reason) == (ArmState.DISARMED, "base left the drive mode (standby)")
    drove = after(tick(2, arm=1), arming=arming)
    assert drove.drove
    assert after(tick(3, arm=1, base=standby), arming=drove).state is ArmState.DISARMED
    again = after(tick(3, arm=1, base=standby), tick(4, arm=2, base=standby), arming=drove)
    assert (again.state, again.drove) == (ArmState.ARMED, False)
    assert after(tick(3, arm=1, base=None), arming=drove).state is ArmState.ARMED


def test_a_fault_of_the_base_disarms() -> None:
    broken = replace(tick(0).base, faults=("hot", "wet"))  # type: ignore[type-var]
    assert after(tick(3, arm=1, base=broken), arming=armed()).reason == "base fault: hot, wet"
    assert after(tick(0), tick(1, arm=1, base=broken)).reason == "cannot arm: hot, wet"
