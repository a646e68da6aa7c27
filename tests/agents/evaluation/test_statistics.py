"""Statistics agree with the published definitions, and intervals cover what they claim."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from homeward.agents.evaluation.statistics import (
    Bootstrap,
    interval,
    iqm,
    performance_profile,
    probability_of_improvement,
    wilson,
)


def some(seeds: int, episodes: int, seed: int = 0, shift: float = 0.0) -> NDArray[np.float64]:
    """Scores with ties, hard and easy episodes, and good and bad seeds."""
    rng = np.random.default_rng(seed)
    hard = np.random.default_rng(99).normal(10.0, 3.0, episodes)
    return np.round(
        hard + rng.normal(shift, 1.0, (seeds, 1)) + rng.normal(0.0, 2.0, (seeds, episodes))
    )


def test_definitions_are_those_of_rliable() -> None:
    """Its formulas: a trimmed mean over all, Mann and Whitney's U averaged over tasks, the share of
    scores above."""
    a, b = some(5, 16), some(3, 16, 1, 1.0)
    assert iqm(a) == pytest.approx(stats.trim_mean(a, proportiontocut=0.25, axis=None))
    u = [
        stats.mannwhitneyu(a[:, task], b[:, task], alternative="greater").statistic
        for task in range(16)
    ]
    assert probability_of_improvement(a, b) == pytest.approx(np.mean(u) / (5 * 3))
    thresholds = np.linspace(0.0, 20.0, 21)
    expected = [np.mean(a > one) for one in thresholds]
    np.testing.assert_allclose(performance_profile(a, thresholds), expected)


def test_iqm_is_the_mean_of_the_middle_half() -> None:
    scores = np.random.default_rng(0).permutation(np.arange(100.0) ** 2)
    assert iqm(scores.reshape(4, 25)) == pytest.approx(np.mean(np.arange(25.0, 75.0) ** 2))


def test_improvement_counts_each_pair_of_seeds_on_each_episode() -> None:
    a, b = some(4, 7), some(3, 7, 1)
    pairs = [(x > y) + 0.5 * (x == y) for i in range(7) for x in a[:, i] for y in b[:, i]]
    assert probability_of_improvement(a, b) == pytest.approx(np.mean(pairs))
    assert probability_of_improvement(a, b) + probability_of_improvement(b, a) == pytest.approx(1.0)
    assert probability_of_improvement(a, a) == pytest.approx(0.5)


def test_a_profile_falls_from_all_to_none() -> None:
    scores = some(3, 50)
    profile = performance_profile(scores, [-100.0, 10.0, 100.0])
    assert profile.tolist() == pytest.approx([1.0, (scores > 10.0).mean(), 0.0])


def test_rates_near_zero_keep_an_upper_bound() -> None:
    z2 = 1.959963984540054**2
    # Wilson's interval without an event
    assert wilson(0, 4000) == pytest.approx([0.0, z2 / (4000.0 + z2)])
    assert wilson(0, 3838)[1] < 0.001 < wilson(0, 3837)[1]


def test_one_seed_has_the_interval_of_its_episodes() -> None:
    scores = np.random.default_rng(1).normal(5.0, 2.0, (1, 900))
    low, high = interval(Bootstrap({"a": scores}, np.random.default_rng(0)).means()["a"])
    half = 1.96 * scores.std() / 30.0  # the normal approximation
    assert [low, high] == pytest.approx([scores.mean() - half, scores.mean() + half], rel=0.01)


def test_seeds_that_differ_widen_the_interval_however_many_episodes() -> None:
    offsets = np.array([[-1.0], [0.0], [1.0], [2.0]])
    rng = np.random.default_rng(2)
    wide = Bootstrap(
        {"a": offsets + rng.normal(0.0, 0.1, (4, 2000))}, np.random.default_rng(0), 2000
    ).means()["a"]
    assert wide.std() == pytest.approx(offsets.std() / 2.0, rel=0.05)


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    rng, covered, trials = np.random.default_rng(3), 0, 300
    for trial in range(trials):
        scores = (
            rng.normal(0.0, 0.5, (10, 1))
            + rng.normal(0.0, 1.0, 60)
            + rng.normal(0.0, 1.0, (10, 60))
        )
        low, high = interval(
            Bootstrap({"a": scores}, np.random.default_rng(trial), 500).means()["a"]
        )
        covered += low <= 0.0 <= high
    # Percentile intervals of ten seeds are a little narrow; those over episodes alone would cover
    # two thirds.
    assert 0.86 <= covered / trials <= 0.99


def test_means_are_paired_by_episode() -> None:
    hard_and_easy = np.random.default_rng(4).uniform(0.0, 1000.0, (1, 300))
    drawn = Bootstrap(
        {"a": hard_and_easy, "b": hard_and_easy + 3.0}, np.random.default_rng(0)
    ).means()
    np.testing.assert_allclose(drawn["b"] - drawn["a"], 3.0)


def test_bootstrapped_statistics_are_centred_on_their_value() -> None:
    a, b = some(4, 200), some(3, 200, 1, 1.0)
    both = Bootstrap({"a": a, "b": b}, np.random.default_rng(0), 2000)
    for samples, value in (
        (both.means()["a"], a.mean()),
        (both.iqms()["b"], iqm(b)),
        (both.improvements("b", "a"), probability_of_improvement(b, a)),
        (both.profiles("a", [10.0])[:, 0], performance_profile(a, [10.0])[0]),
    ):
        assert samples.shape == (2000,)
        low, high = interval(samples)
        assert low < value < high
        assert samples.mean() == pytest.approx(value, abs=0.15 * (high - low))


def test_every_call_draws_the_same_and_iqms_are_those_of_the_drawn_episodes() -> None:
    scores = some(1, 40)
    drawn = Bootstrap({"a": scores}, np.random.default_rng(5), 3)
    samples, (weights, _) = drawn.iqms()["a"], next(drawn._weights())
    for sample, one in zip(samples, weights, strict=True):
        assert sample == pytest.approx(iqm(np.repeat(scores[0], np.rint(40.0 * one).astype(int))))


def test_parts_do_not_change_the_draws_much(monkeypatch: pytest.MonkeyPatch) -> None:
    scores = {"a": some(3, 50)}
    whole = interval(Bootstrap(scores, np.random.default_rng(0)).means()["a"])
    monkeypatch.setattr("homeward.agents.evaluation.statistics._CHUNK", 1000)
    assert interval(Bootstrap(scores, np.random.default_rng(0)).means()["a"]) == pytest.approx(
        whole, rel=0.01
    )
