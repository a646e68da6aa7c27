"""Random actions are even and repeatable."""

import numpy as np
import pytest

from homeward.agents import make_policy
from homeward.envs.features import NAMES
from homeward.envs.vector import HomewardVectorEnv


def test_random_draws_evenly_and_repeatably() -> None:
    env = HomewardVectorEnv(3000)
    observations, begun = np.zeros((3000, len(NAMES)), np.float32), np.ones(3000, np.bool_)
    first, again, other = (
        make_policy("random", env, seed=seed).act(observations, begun) for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    for column, levels in enumerate((5, 5, 3)):
        assert np.bincount(first[:, column]) == pytest.approx(
            np.full(levels, 3000 / levels), rel=0.12
        )
    box = HomewardVectorEnv(3000, action_type="continuous")
    for column in make_policy("random", box, seed=5).act(observations, begun).T:
        assert np.histogram(column, 10, (-1.0, 1.0))[0] == pytest.approx(np.full(10, 300), rel=0.2)
