"""Robots that find themselves elsewhere on their way home: the ground between is kept, or is as
here."""

from __future__ import annotations

import numpy as np
import pytest

from homeward.estimation import Estimator
from homeward.estimation.drive import rolling
from homeward.estimation.prior import CLIMB, PER_CAPACITY, ROLLED, ROLLING, USED, WEIGHT
from tests.estimation.world import CALM, PLACE_M, alone, read

UNSURE = CALM._replace(rolling=1.05, rolling_sd=0.144, mass=1.1, mass_sd=0.058, slope_noise=0.005)


def driven(position_m: float = 200.0) -> Estimator:
    estimator = alone(UNSURE)
    for k in range(1, 9):
        read(estimator, position_m / 8.0 / 0.5, position_m * k / 8.0)
    return estimator


def rolls(estimator: Estimator, way_m: float) -> float:
    """Rolling of a level way by the file, over a full battery."""
    return rolling(estimator.vehicle, 0.0) * way_m / estimator.vehicle.full_j


def test_to_where_it_is_changes_nothing() -> None:
    estimator = driven()
    before = estimator.state.copy()
    estimator.relocate(200.0)
    assert estimator.state.tobytes() == before.tobytes()


@pytest.mark.parametrize("position_m", [0.0, 12.5, 50.0, 160.0])
def test_a_short_cut_over_even_ground_keeps_its_share(position_m: float) -> None:
    estimator = driven()
    estimator.state["hypotheses"]["mean"][..., CLIMB] = 1e-3
    before = estimator.estimate()
    estimator.relocate(position_m)
    after, share = estimator.estimate(), position_m / 200.0
    for state in (ROLLED, CLIMB):
        assert after.mean[0, state] == pytest.approx(share * before.mean[0, state], abs=1e-12)
        np.testing.assert_allclose(
            after.covariance[0, state, [state, ROLLING, USED]],
            before.covariance[0, state, [state, ROLLING, USED]] * [share**2, share, share],
            atol=1e-15,
        )
    others = [ROLLING, WEIGHT, USED, PER_CAPACITY]
    np.testing.assert_array_equal(after.mean[0, others], before.mean[0, others])
    assert estimator.state["robot"]["position_m"][0] == position_m
    np.testing.assert_allclose(
        estimator.state["hypotheses"]["rolled"][0, 0], rolls(estimator, position_m) * 1.155
    )


def test_a_short_cut_over_uneven_ground_keeps_that_near_home() -> None:
    """Rolling was 1 for two places and then 3 for another two: three places from home are 5 of 8
    parts."""
    estimator = alone(CALM)
    read(estimator, 200.0, 4.0 * PLACE_M)
    estimator.state["rollings"][:, :, :4] = 1.0, 1.0, 3.0, 3.0
    h = estimator.state["hypotheses"]
    h["rolled"] = 8.0 * rolls(estimator, PLACE_M)
    h["mean"][..., ROLLED] = 7.2 * rolls(estimator, PLACE_M)
    h["hessian"] = 1.0
    estimator.relocate(3.0 * PLACE_M)
    np.testing.assert_allclose(h["mean"][..., ROLLED], 7.2 * 5.0 / 8.0 * rolls(estimator, PLACE_M))
    np.testing.assert_allclose(h["rolled"], 5.0 * rolls(estimator, PLACE_M))
    np.testing.assert_allclose(h["hessian"], 5.0 / 8.0)


def test_a_home_that_moves_away_adds_ground_as_here() -> None:
    estimator = driven()
    before = estimator.estimate()
    estimator.relocate(300.0)
    after, more = estimator.estimate(), rolls(estimator, 100.0)
    assert after.mean[0, ROLLED] == pytest.approx(
        before.mean[0, ROLLED] + more * before.mean[0, ROLLING]
    )
    p = before.covariance[0]
    expected = p[ROLLED, ROLLED] + 2.0 * more * p[ROLLED, ROLLING] + more**2 * p[ROLLING, ROLLING]
    assert after.covariance[0, ROLLED, ROLLED] == pytest.approx(expected)
    assert after.covariance[0, ROLLED, ROLLING] == pytest.approx(
        p[ROLLED, ROLLING] + more * p[ROLLING, ROLLING]
    )
    assert after.mean[0, CLIMB] == before.mean[0, CLIMB]


def test_new_ground_has_slope_and_direction_as_here() -> None:
    estimator = alone(CALM)
    read(estimator, 100.0, 2.5 * PLACE_M, sine=0.04, east=0.6, north=0.8)
    estimator.relocate(4.5 * PLACE_M)
    places = estimator.state["places"][0]
    for name, value in (("sine", 0.04), ("sine_driven", 0.04), ("east", 0.6), ("north", 0.8)):
        np.testing.assert_allclose(places[name][:6], [value] * 5 + [0.0])
    np.testing.assert_allclose(estimator.state["rollings"][0, 0, :6], [1.0] * 5 + [0.0])


@pytest.mark.parametrize("position_m", [60.0, 380.0])
def test_the_way_home_costs_as_if_it_had_been_driven(position_m: float) -> None:
    """Over level ground all known robots are alike, whichever way they came to be where they
    are."""
    there, moved = driven(position_m), driven()
    moved.relocate(position_m)
    plans = there.plans(np.array([there.vehicle.idle_w * position_m / there.vehicle.cruise_mps]))
    costs = [one.margin(plans, 0.0).total["cost_j"][0] for one in (there, moved)]
    assert costs[0] == pytest.approx(costs[1])


def test_there_and_back_is_as_before() -> None:
    estimator = driven()
    before = estimator.estimate()
    estimator.relocate(300.0)
    estimator.relocate(200.0)
    after = estimator.estimate()
    assert after.mean[0, ROLLED] == pytest.approx(before.mean[0, ROLLED])
    assert after.covariance[0, ROLLED, ROLLED] == pytest.approx(
        before.covariance[0, ROLLED, ROLLED]
    )
