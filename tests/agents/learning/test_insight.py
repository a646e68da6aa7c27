"""The critic's insight: what is hidden, of the right mission, and none of it for the policy."""

from typing import Any

import numpy as np
import pytest
import torch

from homeward.agents.learning.insight import AHEAD_PLACES, Insight
from homeward.agents.learning.ppo import make_model
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import PPOSettings
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv

COUNT = 5


def adapter(insight: bool) -> SB3Adapter:
    env = HomewardVectorEnv(COUNT, mission="Survey", difficulty="harsh", decision_s=300.0, autoreset_mode="SameStep")
    made = SB3Adapter(env, late_is_lost=True, insight=insight)
    made.seed(0)
    return made


def seen(batch: Any, i: int) -> list[float]:
    """What the critic is to see of a mission, place by place."""
    m, p, robot = batch.records[i], batch.robots[i], batch.known.robot
    usable_j, places = float(batch.known.shared["usable_j"][0]), int(batch.known.shared["places"][0])
    route = batch.routes[i]["places"][:places]
    headwind_mps = m["wind_mps"] * np.cos(m["wind_from_rad"] - np.arctan2(route["north"], route["east"]))
    columns = [
        m["energy_j"] / usable_j,
        5.0 * (m["capacity_j"] / usable_j - 0.9),
        5.0 * (p["rolling_resistance"] / robot.rolling_resistance - 1.0),
        5.0 * p["payload_mass_kg"] / robot.mass_kg,
        5.0 * (m["meter_gain"] - 1.0),
    ]
    here = int(m["place"])
    for part in (slice(0, here), *(slice(here, here + ahead) for ahead in AHEAD_PLACES)):
        for along, scale in ((route["sin_grade"], 10.0), (route["interest"], 0.5), (headwind_mps, 0.1)):
            columns.append(scale * float(along[part].mean()) if len(along[part]) else 0.0)
    return columns


def test_the_critic_sees_what_is_hidden_and_the_rest_is_as_without() -> None:
    with_it, without = adapter(True), adapter(False)
    inputs: Any = with_it.reset()
    plain: Any = without.reset()
    rng, ends = np.random.default_rng(0), 0
    for _ in range(60):
        np.testing.assert_array_equal(inputs[:, Insight.columns :], plain)
        for i in range(COUNT):
            assert inputs[i, : Insight.columns] == pytest.approx(seen(with_it.env.batch, i), abs=1e-5)
        actions = np.column_stack((rng.integers(0, 5, (COUNT, 2)), rng.choice(3, COUNT, p=[0.1, 0.8, 0.1])))
        inputs, _, ended, infos = with_it.step(actions)
        plain, _, _, expected = without.step(actions)
        for i in np.flatnonzero(ended).tolist():
            ends += 1
            last = infos[i]["terminal_observation"]
            assert with_it.observation_space.contains(last)
            np.testing.assert_array_equal(last[Insight.columns :], expected[i]["terminal_observation"])
    assert ends > COUNT


@pytest.mark.parametrize("guide", ["planner", "none"])
def test_the_policy_does_not_see_it(guide: str) -> None:
    settings = PPOSettings(n_envs=COUNT, n_steps=8, batch_size=40, epochs=1, hidden=16, guide=guide)
    model = make_model(Options("Survey"), settings, seed=0)
    assert isinstance(model.env, SB3Adapter)
    inputs = torch.as_tensor(model.env.reset())
    other = inputs.clone()
    other[:, : Insight.columns] += 1.0
    with torch.no_grad():
        taken = torch.as_tensor([[0, 1, 2]] * COUNT)
        likelihoods = [model.policy.evaluate_actions(all_inputs, taken)[1] for all_inputs in (inputs, other)]
        torch.testing.assert_close(*likelihoods, rtol=0.0, atol=0.0)
        assert (model.policy.predict_values(inputs) != model.policy.predict_values(other)).all()
