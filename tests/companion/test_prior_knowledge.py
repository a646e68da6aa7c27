"""What a robot's file says of its own uncertainty gives intervals as wide as was measured, each
error counted once."""

import dataclasses
import math
from typing import Any

import pytest

from homeward.companion.prior_knowledge import PriorKnowledge, known_of
from homeward.estimation.tails import deviations
from homeward.physics import load_robot
from homeward.physics.uncertainty import Uncertainty

NORMAL_95 = 1.6448536  # standard deviations, above which 5 % of a normal distribution lie


def known(**sizes: Any) -> PriorKnowledge:
    return known_of(
        dataclasses.replace(load_robot("husky"), uncertainty=Uncertainty(**sizes)),
        has_forecast=True,
    )


def sd_of_power(own: float, between_runs: float) -> float:
    """Standard deviation of the power on the flat, a share, by a file whose rolling and idle power
    are off by `own`."""
    covariance = ((own**2, 0.0), (0.0, own**2))
    prior = known(
        fitted=("rolling", "idle_power"), covariance=covariance, between_runs=between_runs
    ).prior
    # its share of it
    of_idle = known(fitted=("idle_power",), covariance=((1.0,),), between_runs=0.0).prior.gain_sd
    return math.hypot((1.0 - of_idle) * prior.rolling_sd, prior.gain_sd)


@pytest.mark.parametrize("own", [0.001, 0.03, 0.08])
def test_the_spread_between_runs_has_the_error_of_the_file_in_it(own: float) -> None:
    assert deviations(0.95) * sd_of_power(own, 0.1) == pytest.approx(NORMAL_95 * 0.1, rel=1e-3)


def test_a_file_that_is_less_sure_than_runs_differ_is_as_sure_as_it_says() -> None:
    assert sd_of_power(0.3, 0.1) > 0.2


def test_battery_and_instruments_are_as_the_file_says() -> None:
    """A gain is uniform within its limits, and adds to what the file itself may be off by."""
    read = {"power_noise": 0.03, "soc_step": 0.01, "soc_noise": 0.02, "soc_lag_s": 40.0}
    battery: dict[str, Any] = {
        "fitted": ("capacity",),
        "covariance": ((0.02**2,),),
        "between_runs": 0.04,
    }
    instruments = (*read.items(), ("power_gain", 0.05), ("grade_noise", 0.006))
    prior, plain = known(**battery, instruments=instruments).prior, known(**battery).prior
    assert prior.capacity == 1.0 and prior.capacity_sd == pytest.approx(0.02)
    assert {name: getattr(prior, name) for name in read} == read and prior.slope_noise == 0.006
    assert prior.gain_sd**2 - plain.gain_sd**2 == pytest.approx(0.05**2 / 3.0)
    assert known().prior.capacity == 0.9  # where it says nothing: 80 to 100 %


def test_runs_that_differ_do_not_make_the_battery_unsure() -> None:
    """They differ by the ground or the load, and a capacity that was measured has its own error
    only."""
    battery: dict[str, Any] = {
        "fitted": ("capacity",),
        "covariance": ((0.02**2,),),
        "between_runs": 0.2,
    }
    assert known(**battery).prior.gain_sd > 0.05 and known(**battery).meter_sd == 0.0
    assert known(**battery, instruments=(("power_gain", 0.05),)).meter_sd == pytest.approx(
        0.05 / 3.0**0.5
    )
    assert (
        known(between_runs=0.2).meter_sd
        == known_of(load_robot("husky"), has_forecast=True).meter_sd
        > 0.0
    )


@pytest.mark.parametrize("way_m", [1.0, 300.0])
def test_what_nothing_explains_widens_by_its_measured_interval(way_m: float) -> None:
    sizes: dict[str, Any] = {"between_runs": 0.05, "unexplained": 0.4, "unexplained_m": 30.0}
    one = known(**sizes)
    added = math.sqrt(one.with_unexplained(way_m).model_error ** 2 - one.prior.model_error**2)
    assert deviations(0.95) * added == pytest.approx(
        NORMAL_95 * Uncertainty(**sizes).unexplained_over(way_m)
    )


def test_what_was_measured_at_the_wheels_narrows_the_prior() -> None:
    generic = known_of(load_robot("husky"), has_forecast=True).prior
    both = known(
        of="force",
        fitted=("rolling", "mass"),
        covariance=((0.02**2, 0.0), (0.0, 0.01**2)),
        source="a test",
    )
    assert both.prior.rolling == 1.0 and both.prior.rolling_sd == pytest.approx(0.02)
    assert both.prior.mass_sd == 0.0 and both.weight_sd == pytest.approx(0.01)
    assert (
        both.prior.capacity_sd == generic.capacity_sd
        and both.prior.model_error == generic.model_error
    )
    assert both.words[:2] == (
        "measured at the wheels: a test, of rolling, mass",
        "generic ranges of the rest (capacity 80 to 100 %, power at rest within 18%, 4% of a way's energy that the "
        "model omits)",
    )
    assert both.idle_sd == known_of(load_robot("husky"), has_forecast=True).idle_sd > 0.0
    idles = known(of="force", fitted=("idle_power",), covariance=((0.05**2,),))
    assert idles.idle_sd == pytest.approx(0.05) and "power at rest" not in idles.words[1]
    weighed = known(of="force", fitted=("mass",), covariance=((0.01**2,),))
    assert (
        weighed.prior.mass == 1.0
        and weighed.prior.mass_sd == pytest.approx(0.01)
        and weighed.weight_sd == 0.0
    )
    assert (
        weighed.prior.rolling_sd == generic.rolling_sd
        and "rolling resistance 80 to 130 %" in weighed.words[1]
    )
    rolled = known(of="force", fitted=("rolling",), covariance=((0.02**2,),))
    assert rolled.weight_sd == generic.mass_sd and "payload up to 20 %" in rolled.words[1]
