"""The benchmark of the estimator: its figures are what they say, and more energy changes no belief
and no way home."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from benchmarks.agents import identification
from benchmarks.agents.identification import Args, Mixture, covered, drive, main, top_up, way_home
from homeward.agents.belief import Belief
from homeward.agents.evaluation import episode_seeds
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv

MIXTURE = Mixture(
    np.array([[0.2, 0.5, 0.3]]), np.array([[-1.0, 0.4, 3.0]]), np.array([[0.5, 1.0, 0.1]])
)


@pytest.mark.parametrize("value", [-4.0, 0.3, 2.9, 7.0])
def test_the_score_is_the_integral_of_the_squared_distance_of_distributions(value: float) -> None:
    def squared(x: float) -> float:
        return float(MIXTURE.cdf(np.array([x]))[0] - (x >= value)) ** 2

    expected = quad(squared, -10.0, value, limit=200)[0] + quad(squared, value, 12.0, limit=200)[0]
    assert MIXTURE.crps(np.array([value]))[0] == pytest.approx(expected, abs=1e-6)


def test_the_score_of_one_component_is_that_of_a_normal_distribution() -> None:
    one = Mixture(np.ones((1, 1)), np.array([[1.0]]), np.array([[2.0]]))
    z = 0.7  # Gneiting and Raftery, J. Am. Stat. Assoc. 102, 2007, Eq. 21
    expected = 2.0 * (z * (2.0 * norm.cdf(z) - 1.0) + 2.0 * norm.pdf(z) - 1.0 / np.sqrt(np.pi))
    assert one.crps(np.array([1.0 + 2.0 * z]))[0] == pytest.approx(expected)


def test_a_calibrated_forecast_covers_what_it_says_and_a_sure_one_does_not() -> None:
    rng, count = np.random.default_rng(0), 20_000
    component = rng.choice(3, count, p=MIXTURE.weight[0])
    values = rng.normal(MIXTURE.mean[0][component], MIXTURE.sd[0][component])
    forecast = Mixture(*(np.repeat(part, count, axis=0) for part in MIXTURE))
    assert covered(forecast, values).mean() == pytest.approx(identification.COVERED, abs=0.01)
    assert covered(forecast._replace(sd=0.5 * forecast.sd), values).mean() < 0.85


def test_the_mixture_has_the_moments_that_the_belief_answers_with() -> None:
    env = HomewardVectorEnv(8, mission="OutAndBack", autoreset_mode="Disabled")
    observations, _ = env.reset(seed=0)
    belief = Belief(env.batch.known, 0.02)
    for decision in range(12):
        belief.learn(observations, np.full(8, decision == 0))
        observations, *_ = env.step(np.tile([4, 0, 1], (8, 1)))
    belief.learn(observations, np.zeros(8, np.bool_))
    before = belief.estimator.state.copy()
    plans = belief.plans(observations)
    total = belief.margin(plans, 1e-3).total
    mixture = way_home(belief, plans)
    np.testing.assert_array_equal(belief.estimator.state, before)
    second = np.einsum("nk,nk->n", mixture.weight, mixture.sd**2 + mixture.mean**2)
    np.testing.assert_allclose(mixture.weight.sum(axis=1), 1.0)
    np.testing.assert_allclose(mixture.expected, total["cost_share"], rtol=1e-9)
    np.testing.assert_allclose(
        np.sqrt(second - mixture.expected**2), total["cost_share_sd"], rtol=1e-6
    )


@pytest.mark.parametrize("difficulty", ["uncertain", "harsh"])
def test_more_energy_changes_neither_what_is_read_nor_what_the_way_home_takes(
    difficulty: str,
) -> None:
    observed, used_j = [], []
    for tops_up in (False, True):
        env = HomewardVectorEnv(
            16, mission="OutAndBack", difficulty=difficulty, autoreset_mode="Disabled"
        )
        observations, _ = env.reset(seed=3)
        for _ in range(20):
            observations, *_ = env.step(np.tile([4, 0, 1], (16, 1)))
        seen = observations.copy()
        if tops_up:
            top_up(env.batch)
        np.testing.assert_array_equal(observations, seen)
        m = env.batch.records
        before_j, names = m["ledger_j"].sum(axis=1), ("soc", "metered", "metered_j", "read_w")
        observed.append(np.stack([m[name] for name in names]))
        ended = np.empty((2, 16), np.bool_)
        while not m["over"].all():
            env.batch.step(np.tile([4, 0, 2], (16, 1)), observations, np.empty(16), *ended)
        assert m["home"].all()
        used_j.append(m["ledger_j"].sum(axis=1) - before_j)
    np.testing.assert_array_equal(observed[0], observed[1])
    np.testing.assert_allclose(used_j[0], used_j[1], rtol=1e-9)


def test_missions_that_would_strand_come_home_and_what_they_take_is_forecast() -> None:
    # for some more than half of the battery
    found = drive(Options("OutAndBack"), episode_seeds(1, 64), 60)
    assert found.home_share.size == 64
    assert (found.home_share > 0.5).any()
    assert found.forecasts["belief"].expected == pytest.approx(found.home_share, abs=0.2)
    assert np.median(np.abs(found.forecasts["belief"].expected - found.home_share)) < 0.02
    assert found.below.mean() < 0.1


def test_the_tables_say_what_was_driven(capsys: pytest.CaptureFixture[str]) -> None:
    main(
        Args(
            difficulties=("uncertain",),
            instruments="exact",
            weather="still",
            decisions=(5,),
            missions=20,
            seed=3,
        )
    )
    printed = capsys.readouterr().out
    for expected in (
        "20 missions, episode_seeds(3, 20)",
        "instruments exact, weather still",
        "ratio",
        "us per update",
    ):
        assert expected in printed
