"""Estimates of the groups: intervals that cover, and no value where recordings show none."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.fit.estimates import covariance, estimates, standard_errors
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.logs.channels import Array
from tests.diagnosis.fit.test_refit import NAMES, of
from tests.diagnosis.hills import noisy, only, recordings


@pytest.fixture(scope="module")
def dragging(husky: Robot) -> Robot:
    """A robot whose drag is far from zero, so that no noise brings it there."""
    return dataclasses.replace(husky, drag_ns2_per_m2=20.0)


def test_a_robot_as_its_file_says_is_not_off(dragging: Robot, short_runs: Runs) -> None:
    noise = np.random.default_rng(0).standard_normal(len(short_runs.observed))
    runs = of(short_runs, dragging, noise)
    for one in estimates(refit(runs, dragging), runs, cut_blocks(runs.run)):
        assert one.ci95 is not None and one.assumed is not None and not one.off
        assert one.ci95[0] <= one.assumed <= one.ci95[1]


@pytest.mark.parametrize(("phi", "tolerance"), [(0.0, 0.12), (0.8, 0.2)])
def test_standard_errors_are_the_scatter_of_repeated_fits(
    phi: float, tolerance: float, dragging: Robot, short_runs: Runs
) -> None:
    """Also of autocorrelated noise, which a fit that takes windows for independent gets three times
    too small."""
    rng = np.random.default_rng(0)
    fit = refit(of(short_runs, dragging), dragging)
    block = cut_blocks(
        short_runs.run,
        np.asarray(lfilter([1.0], [1.0, -phi], rng.standard_normal(len(fit.predicted)))),
    )
    everything = np.ones(len(fit.predicted), dtype=bool)
    found, said = [], []
    for _ in range(300):
        noise = np.asarray(lfilter([1.0], [1.0, -phi], rng.standard_normal(len(fit.predicted))))
        again = fit.fitted_to(everything, fit.predicted + noise)
        found.append((again.theta - fit.theta) / fit.parameters.scale)
        said.append(standard_errors(fit.jacobian, fit.predicted + noise - again.predicted, block))
    scatter, errors = np.std(found, axis=0), np.sqrt(np.mean(np.square(said), axis=0))
    np.testing.assert_allclose(errors, scatter, rtol=tolerance)


def test_the_covariance_of_a_mean_is_that_of_its_blocks() -> None:
    """By hand: the variance of the sums of four blocks over the squared number of windows, times
    4/3."""
    residual = np.array([1.0, 2.0, -1.0, 0.0, 3.0, -3.0, 0.5, -2.5])
    found = covariance(np.ones((8, 1)), residual, np.repeat(np.arange(4), 2))
    assert found == pytest.approx(np.array([[(3.0**2 + 1.0 + 0.0 + 2.0**2) / 64.0 * 4.0 / 3.0]]))
    assert covariance(np.ones((8, 0)), residual, np.zeros(8, dtype=np.intp)).shape == (0, 0)


def test_what_a_drive_does_not_excite_or_tells_only_together_has_no_value(husky: Robot) -> None:
    """At one speed on the level, idle power and rolling resistance are one number."""
    rng, time_s = np.random.default_rng(0), np.arange(3000) / 10.0
    channels = {
        "time_s": time_s,
        "speed_mps": np.full(3000, 0.5),
        "power_w": 130.0 + rng.standard_normal(3000),
    }
    runs = average(usable_runs([Recording("run", "0", channels)], husky)[0])
    known = {
        one.group.name: one for one in estimates(refit(runs, husky), runs, cut_blocks(runs.run))
    }
    assert all(one.fitted is None and one.ci95 is None for one in known.values())
    assert known["sample_energy"].status == "not excited"
    assert (
        known["idle_power"].status == "confounded"
        and "C_rr m / Gamma" in known["idle_power"].mixed_with
    )


def test_an_interval_is_no_narrower_than_the_scale_of_the_meter_or_the_tilt_of_the_sensor(
    dragging: Robot, short_runs: Runs
) -> None:
    """Without any noise: a tilt acts as rolling resistance does, and a scale on every group."""
    runs = of(short_runs, dragging)
    tilted = [dataclasses.replace(run, tilt_error_rad=0.01) for run in runs.signals]
    tilting = dataclasses.replace(runs, signals=tilted)

    def widths(runs: Runs) -> Array:
        known = estimates(refit(runs, dragging), runs, cut_blocks(runs.run))
        return np.array(
            [np.diff(one.ci95)[0] / one.fitted for one in known if one.ci95 and one.fitted]
        )

    plain, wider = widths(runs), widths(tilting)
    np.testing.assert_allclose(plain, 0.02, rtol=0.05)  # one per cent either way
    rolling = NAMES.index("rolling")
    np.testing.assert_allclose(np.delete(wider, rolling), np.delete(plain, rolling), rtol=1e-6)
    tilt = 2.0 * 1.96 * 0.01 / dragging.rolling_resistance
    assert wider[rolling] == pytest.approx(np.hypot(plain[rolling], tilt), rel=0.05)


def test_a_channel_that_is_smoothed_much_bears_no_parameter(husky: Robot) -> None:
    spoilt = recordings(
        "husky", lambda c, rng: noisy(only(c, "elevation_m"), "elevation_m", 8.0, rng)
    )
    runs = average(usable_runs(spoilt, husky)[0])
    fit = refit(runs, husky)
    mass = next(
        one for one in estimates(fit, runs, cut_blocks(runs.run)) if one.group.name == "mass"
    )
    assert mass.status in ("attenuated", "not excited") and mass.fitted is None
