"""The mapped rule turns back when the observed margin is down to its reserve."""

import numpy as np

from homeward.agents import make_policy
from homeward.agents.rules.reserves import RESERVES
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import ancillary_power, d_max
from tests.agents.rules.shown import mode, observed


def test_dmax_mapped_turns_back_when_the_margin_is_down_to_the_reserve() -> None:
    env = HomewardVectorEnv(mission="Survey")
    policy, s, robot = (
        make_policy("dmax_mapped", env),
        env.batch.known.shared[0],
        env.batch.known.robot,
    )
    idle_w, sensing_w = ancillary_power(robot, np.array([0.0, robot.max_sensing_hz]))
    ahead_s = 2.0 * s["decision_s"]
    ahead = (
        2.0 * ahead_s / d_max(robot, 1.0) + ahead_s * (sensing_w - idle_w) / robot.usable_energy_j
    )
    threshold = ahead + RESERVES["dmax_mapped"]["Survey"]
    assert mode(policy, observed(margin=threshold + 1e-3)) == GO
    assert mode(policy, observed(margin=threshold - 1e-3)) == RETURN
