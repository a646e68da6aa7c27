"""The paper's rule turns back where Eq. 8 says."""

import numpy as np
import pytest

from homeward.agents import make_policy
from homeward.agents.rules.reserves import RESERVES
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import d_max
from tests.agents.rules.shown import mode, observed


@pytest.mark.parametrize("mean_grade", [-0.04, 0.0, 0.06])
def test_dmax_turns_back_when_equation_8_reaches_no_further_than_home(mean_grade: float) -> None:
    env = HomewardVectorEnv(mission="OutAndBack")
    policy, s = make_policy("dmax", env), env.batch.known.shared[0]
    robot, distance_m = env.batch.known.robot, 0.5 * s["reach_m"]
    out, home = np.arcsin(mean_grade), np.arcsin(-mean_grade)
    ahead_m = 2.0 * s["decision_s"] * s["cruise_mps"]
    needed = (distance_m + ahead_m) / d_max(robot, 1.0, home) + ahead_m / d_max(robot, 1.0, out)
    threshold = needed + RESERVES["dmax"]["OutAndBack"]
    seen = {"distance": 0.5, "grade_mean": 10.0 * mean_grade}
    assert mode(policy, observed(energy=threshold + 1e-3, **seen)) == GO
    assert mode(policy, observed(energy=threshold - 1e-3, **seen)) == RETURN
