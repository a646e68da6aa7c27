"""The rule of half a charge turns back there, and earns less than one that measures."""

import pytest

from homeward.agents import make_policy
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv
from tests.agents.rules.shown import mode, observed


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey"])
def test_soc50_turns_back_at_half(mission: str) -> None:
    policy = make_policy("soc50", HomewardVectorEnv(mission=mission))
    assert mode(policy, observed(energy=0.501, distance=0.3)) == GO
    assert mode(policy, observed(energy=0.499, distance=0.3)) == RETURN
