from __future__ import annotations

import numpy as np
import pytest

from ghal360_robot.guidance.egocentric import encode, mirror
from ghal360_robot.guidance.mdp import ACTIONS, one_target_codes
from ghal360_robot.guidance.policy import POLICY_NAMES, ValuePolicy, make_policy, plan_policy
from ghal360_robot.guidance.rule import rule_action
from ghal360_robot.messages import Cue


def test_the_default_policy_is_the_plan_and_agrees_with_the_rule() -> None:
    plan, rule = make_policy(), make_policy("rule")
    for code in one_target_codes().tolist():
        assert plan.advise(code, 0.0).cue is rule.advise(code, 0.0).cue is ACTIONS[rule_action(code)]


def test_the_plan_tells_the_value_of_each_cue() -> None:
    q = plan_policy().advise(encode([2, 0, 0, 0, 0, 0, 0, 0]), 0.0).q
    assert q is not None
    assert q[2] == pytest.approx(250)
    assert max(q) == q[2]


def test_every_named_policy_can_be_made_and_bears_its_name() -> None:
    assert set(POLICY_NAMES) >= {"plan", "rule", "fgs", "none"}
    for name in POLICY_NAMES:
        policy = make_policy(name)
        assert policy.name == name
        assert policy.advise(encode([0, 2, 0, 0, 0, 0, 0, 0]), 0.5).cue is (Cue.NONE if name == "none" else Cue.RIGHT)


def test_an_unknown_policy_is_refused_with_the_names_of_the_known() -> None:
    with pytest.raises(ValueError, match=r"'clever'.*plan, rule, fgs"):
        make_policy("clever")


def test_guidance_is_mirror_symmetric_but_for_exact_ties() -> None:
    plan = plan_policy()
    swapped = {Cue.LEFT: Cue.RIGHT, Cue.RIGHT: Cue.LEFT, Cue.CONFIRM: Cue.CONFIRM}
    for code in one_target_codes().tolist():
        if mirror(code) != code:
            assert plan.advise(mirror(code), 0.0).cue is swapped[plan.advise(code, 0.0).cue]


def test_values_of_the_wrong_shape_are_refused() -> None:
    with pytest.raises(ValueError, match="65536"):
        ValuePolicy("learned", np.zeros((2048, 3)))


def test_a_policy_keeps_its_values_when_the_learner_goes_on() -> None:
    q = np.zeros((65_536, 3))
    policy = ValuePolicy("learned", q)
    q += 1.0
    assert policy.advise(2, 0.0).q == (0.0, 0.0, 0.0)
