"""Tuned parameters of the baselines: one for every mission, in the agent's own measure, and the one
it is made with."""

from __future__ import annotations

import numpy as np
import pytest

from homeward.agents import make_policy
from homeward.agents.planner import Planner
from homeward.agents.registry import SWEPT
from homeward.agents.rules.reserves import PACES, RESERVES
from homeward.agents.rules.turn_back import BelievingRule, TurnBackRule
from homeward.envs.missions import MISSIONS
from homeward.envs.vector import HomewardVectorEnv
from tests.agents.rules.shown import FIRST, observed

DEVIATIONS = ("dmax_adaptive", "dmax_belief", "planner")


def test_every_agent_is_tuned_for_every_mission() -> None:
    assert {name: sorted(tuned) for name, tuned in RESERVES.items()} == dict.fromkeys(
        RESERVES, sorted(MISSIONS)
    )
    assert sorted(PACES) == sorted(MISSIONS)
    assert set(RESERVES) == SWEPT.keys() - {"soc50"}  # whose reserve is its name


@pytest.mark.parametrize("name", RESERVES)
def test_a_reserve_lies_within_what_was_tried(name: str) -> None:
    assert all(SWEPT[name][0] <= reserve < SWEPT[name][-1] for reserve in RESERVES[name].values())


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("name", RESERVES)
def test_an_agent_keeps_its_tuned_reserve(name: str, mission: str) -> None:
    env = HomewardVectorEnv(mission=mission)
    policy, without = make_policy(name, env), make_policy(name, env, reserve=0.0)
    rule, bare = (one.rule if isinstance(one, Planner) else one for one in (policy, without))
    assert isinstance(rule, TurnBackRule) and isinstance(bare, TurnBackRule)
    reserve = bare.margin_above_reserve(observed(), FIRST) - rule.margin_above_reserve(
        observed(), FIRST
    )
    size = rule.outlook.deviation if isinstance(rule, BelievingRule) else np.ones(1)
    assert isinstance(rule, BelievingRule) == (name in DEVIATIONS)
    assert reserve == pytest.approx(RESERVES[name][mission] * size, abs=1e-12)


@pytest.mark.parametrize("mission", MISSIONS)
def test_a_pace_is_one_that_a_robot_can_keep_and_senses_on_surveys_alone(mission: str) -> None:
    pace = PACES[mission]
    assert 0.0 <= pace.rate <= 1.0 and pace.interest >= 0.0 and 0.0 < pace.full <= 1.0
    assert (pace.rate > 0.0) == (mission == "Survey")
