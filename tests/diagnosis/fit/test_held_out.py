"""Held-out errors are of what a fit has not seen, and their intervals are as wide as they should
be."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from homeward.diagnosis.fit.held_out import (
    better,
    black_box,
    bootstrap,
    delta_bic,
    gain,
    held_out,
    range_accuracy_pct,
    score,
)
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Mask

COUNT = 400
BLOCK = np.arange(COUNT) // 4


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def windows(observed: Array, unit: str = "W", **context: Array) -> Any:
    return SimpleNamespace(
        observed=observed, duration_s=np.full(len(observed), 0.5), unit=unit, context=context
    )


def test_each_window_is_predicted_by_a_fit_to_the_other_folds() -> None:
    observed, fold = np.array([1.0, 2.0, 3.0, 4.0, 8.0]), np.array([0, 1, 1, 0, 2])
    masks: list[Mask] = []

    def mean(chosen: Mask) -> Array:
        masks.append(chosen)
        return np.full(5, observed[chosen].mean())

    np.testing.assert_allclose(held_out(mean, fold), [13 / 3, 13 / 3, 13 / 3, 13 / 3, 2.5])
    assert [one.tolist() for one in masks] == [(fold != one).tolist() for one in range(3)]


def test_the_bootstrap_interval_of_a_mean_is_the_analytic_one() -> None:
    values = rng().standard_normal(COUNT)
    low, high = bootstrap(
        np.stack([values, np.ones(COUNT)]), rng(), lambda drawn: drawn[0] / drawn[1]
    )
    half = 1.96 * values.std() / np.sqrt(COUNT)
    assert (low, high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.1 * half
    )


def test_the_bootstrap_interval_covers_the_truth_about_as_often_as_it_says() -> None:
    generator, covered = rng(), 0
    for _ in range(100):
        sums = np.stack([2.0 + generator.standard_normal(40), np.ones(40)])
        low, high = bootstrap(sums, generator, lambda drawn: drawn[0] / drawn[1])
        covered += low <= 2.0 <= high
    assert 87 <= covered <= 100


@pytest.mark.parametrize(("share", "factor"), [(0.0, 1.0), (0.75, 0.5), (1.0, 0.0), (-3.0, 2.0)])
def test_a_gain_is_a_share_of_the_squared_error(share: float, factor: float) -> None:
    observed = rng().standard_normal(COUNT)
    found = gain(observed, np.zeros(COUNT), (1.0 - factor) * observed, BLOCK, rng())
    assert found.share == pytest.approx(share)
    assert found.ci95 == pytest.approx((share, share))  # of every draw


def test_the_interval_of_a_gain_is_wider_where_few_blocks_hold_it() -> None:
    observed = rng().standard_normal(COUNT)
    everywhere = gain(
        observed, np.zeros(COUNT), 0.5 * observed + 0.3 * rng().permutation(observed), BLOCK, rng()
    )
    at_once = gain(observed, np.zeros(COUNT), np.where(BLOCK < 10, observed, 0.0), BLOCK, rng())
    for one in (everywhere, at_once):
        assert one.ci95[0] < one.share < one.ci95[1]
    assert np.diff(at_once.ci95)[0] > 0.05


def test_bic_counts_windows_and_parameters() -> None:
    """Of white noise every window counts: n log(4) for half the error, less log(n) a parameter."""
    error = rng().standard_normal(COUNT)
    found = [
        delta_bic(error, np.zeros(COUNT), 0.5 * error, np.zeros(COUNT, dtype=np.intp), freedom)
        for freedom in (0, 1, 5)
    ]
    assert found[0] == pytest.approx(COUNT * np.log(4.0), rel=0.1)
    assert found[0] - found[1] == pytest.approx(np.log(COUNT), rel=0.05)
    assert found[0] - found[2] == pytest.approx(5.0 * np.log(COUNT), rel=0.05)


def test_a_residual_that_lasts_has_less_weight_in_bic() -> None:
    run, lasting = np.zeros(COUNT, dtype=np.intp), np.repeat(rng().standard_normal(COUNT // 8), 8)
    assert delta_bic(lasting, np.zeros(COUNT), 0.5 * lasting, run) < 0.3 * COUNT * np.log(4.0)


def test_the_better_of_two_predictions() -> None:
    observed = rng().standard_normal(COUNT)
    exact, noisy = observed + 0.1, observed + 0.3 * np.random.default_rng(1).standard_normal(COUNT)
    p_value = better(exact, noisy, observed, BLOCK)
    assert p_value < 1e-6
    assert better(noisy, exact, observed, BLOCK) == pytest.approx(1.0 - p_value)
    assert better(exact, exact, observed, BLOCK) == 1.0


def test_predictions_that_are_equally_good_are_told_apart_as_often_as_the_level_says() -> None:
    generator = rng()
    p_values = [
        better(
            generator.standard_normal(COUNT),
            generator.standard_normal(COUNT),
            np.zeros(COUNT),
            BLOCK,
        )
        for _ in range(400)
    ]
    assert np.mean(np.array(p_values) <= 0.1) == pytest.approx(0.1, abs=0.05)


def test_the_range_of_a_trip_that_is_predicted_a_quarter_too_dear_is_eighty_per_cent_accurate() -> (
    None
):
    observed, trip = np.full(8, 100.0), np.repeat([0, 1], 4)
    predicted = np.where(trip == 0, 125.0, 100.0)
    assert range_accuracy_pct(predicted, windows(observed), trip) == pytest.approx(90.0)
    assert range_accuracy_pct(3.0 * observed, windows(observed), trip) == pytest.approx(100.0 / 3.0)
    assert range_accuracy_pct(0.3 * observed, windows(observed), trip) == 0.0
    assert range_accuracy_pct(predicted, windows(observed, "A"), trip) is None
    assert range_accuracy_pct(predicted, windows(-observed), trip) is None


def test_errors_of_a_prediction() -> None:
    observed = np.tile([80.0, 120.0], COUNT // 2)
    trip = np.arange(COUNT) // (COUNT // 2)
    predicted = observed + np.where(trip == 0, 10.0, -30.0)
    found = score(predicted, windows(observed), BLOCK, trip, rng())
    assert found.rmse == pytest.approx(np.sqrt(500.0))
    assert found.r2 == pytest.approx(1.0 - 500.0 / 400.0)
    assert found.energy_error_pct == pytest.approx(20.0)  # of 10 and 30 per cent
    assert found.rmse_ci95[0] < found.rmse < found.rmse_ci95[1]
    assert score(predicted, windows(observed, "A"), BLOCK, trip, rng()).energy_error_pct is None
    assert score(observed + 1.0, windows(np.full(COUNT, 5.0)), BLOCK, trip, rng()).r2 is None


def test_trees_find_what_depends_on_a_channel_and_only_from_what_they_are_shown(
    short_runs: Runs,
) -> None:
    nominal = np.zeros(len(short_runs.observed))
    speed = short_runs.context["speed_mps"]
    runs = dataclasses.replace(short_runs, observed=np.where(np.abs(speed - 0.5) < 0.1, 50.0, 0.0))
    chosen = runs.run > 0
    found = black_box(runs, nominal, chosen, rng())
    assert np.mean((runs.observed - found)[~chosen] ** 2) < 0.1 * np.var(runs.observed)
    unseen = dataclasses.replace(runs, observed=np.where(chosen, runs.observed, 1e6))
    np.testing.assert_array_equal(black_box(unseen, nominal, chosen, rng()), found)
    blind = black_box(runs, nominal, chosen, rng(), channels=("sensing_hz",))
    assert np.mean((runs.observed - blind)[~chosen] ** 2) > 0.5 * np.var(runs.observed)
    beside = black_box(runs, nominal, chosen, rng(), channels=(), beside=[speed])
    np.testing.assert_allclose(beside[~chosen], runs.observed[~chosen], atol=50.0)
    assert np.mean((runs.observed - beside)[~chosen] ** 2) < 0.1 * np.var(runs.observed)


def test_trees_of_a_handful_of_windows_are_the_fit_itself(short_runs: Runs) -> None:
    few, nominal = np.arange(len(short_runs.observed)) < 20, short_runs.observed + 1.0
    np.testing.assert_array_equal(black_box(short_runs, nominal, few, rng()), nominal)
