"""The next experiment is the drive that tells candidates apart, as far as any drive does."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Recording
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.menu import MENU
from homeward.diagnosis.explain.residual_test import independent_blocks
from homeward.diagnosis.fit.estimates import estimates
from homeward.diagnosis.fit.refit import Refit, refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.tell.next_drive import (
    SizedEffect,
    at_its_size,
    gains,
    responses,
    to_determine,
    to_tell_apart,
)
from homeward.physics import replay

Drive = Callable[..., list[Recording]]

BEST: Mapping[str, tuple[str, float, Mapping[str, float]]] = {
    "turning": ("on_the_spot", 0.2, {}),
    "inertia": ("stop_and_go", 1.0, {}),
    "heater": ("cold_and_warm", 1.0, {"on_below_c": 10.0}),
    "radio": ("far_and_back", 100.0, {}),
    "motor_heating": ("full_load", 0.003, {"rise_k_per_w": 1.0, "time_constant_s": 600.0}),
    "wind": ("both_ways", 2.0, {}),
    "sensor_offset": ("on_and_off", 20.0, {}),
}


@pytest.fixture(scope="module")
def known(drive: Drive) -> tuple[Refit, Runs, np.ndarray]:
    """A refit of hilly drives in still air, its windows and its residual."""
    husky = dataclasses.replace(load_robot("husky"), drag_ns2_per_m2=8.0)
    runs = average(usable_runs(drive(husky), husky)[0])
    fit = refit(runs, husky)
    return fit, runs, runs.observed - fit.predicted


def alike(known: tuple[Refit, Runs, np.ndarray], **sizes: float) -> list[SizedEffect]:
    """Effects that the recordings at hand see only together: the same load in the second half of
    each."""
    _, runs, _ = known
    column = np.where(runs.time_s > 240.0, 20.0, 0.0)
    return [SizedEffect(CATALOGUE[effect], size, {}, column) for effect, size in sizes.items()]


def best(found: Mapping[str, float]) -> str:
    """The drive with the largest gain."""
    return max(found, key=found.__getitem__)


@pytest.mark.parametrize("effect", BEST)
def test_an_effect_is_measured_by_the_drive_that_excites_it(
    effect: str, known: tuple[Refit, Runs, np.ndarray]
) -> None:
    manoeuvre, size, shape = BEST[effect]
    found = gains(
        *known, [SizedEffect(CATALOGUE[effect], size, shape, np.zeros_like(known[1].observed))]
    )
    assert best(found) == manoeuvre
    others = [gain for name, gain in found.items() if name != manoeuvre]
    assert found[manoeuvre] > max(others) >= 0.0


@pytest.mark.parametrize(
    ("sizes", "manoeuvre"),
    [
        ({"wind": 2.0, "hidden_grade": 0.03}, "both_ways"),
        ({"standby": 20.0, "sensor_offset": 20.0}, "on_and_off"),
        ({"payload": 10.0, "surface": 0.2}, "known_mass"),
        ({"heater": 1.0, "standby": 20.0}, "cold_and_warm"),
    ],
)
def test_rivals_are_set_apart_by_the_drive_that_changes_one_of_them(
    sizes: Mapping[str, float], manoeuvre: str, known: tuple[Refit, Runs, np.ndarray]
) -> None:
    candidates = [
        dataclasses.replace(one, shape={"on_below_c": 40.0})
        if one.hypothesis.id == "heater"
        else one
        for one in alike(known, **sizes)
    ]
    assert best(gains(*known, candidates)) == manoeuvre


def test_after_the_advised_drive_a_fit_tells_the_rivals_apart(
    known: tuple[Refit, Runs, np.ndarray],
) -> None:
    """Simulated: with the drive a fit gets the sizes of both rivals right, with the worst drive it
    does not."""
    fit, runs, residual = known
    rivals = alike(known, wind=2.0, hidden_grade=0.03)
    found = gains(fit, runs, residual, rivals)
    ranked = sorted(MENU, key=lambda one: -found[one.id])
    at_hand = np.column_stack([fit.jacobian, *(one.column for one in rivals)])
    rng, noise_w = np.random.default_rng(0), float(residual.std())
    true = np.array([0.0] * fit.jacobian.shape[1] + [1.0, 0.0])  # it is the wind
    errors = {}
    for manoeuvre in (ranked[0], ranked[-1]):
        design = np.vstack([at_hand, responses(fit, runs, manoeuvre, rivals)])
        design = np.vstack([design, 1e-3 * noise_w * np.eye(design.shape[1])])
        estimates = [
            np.linalg.lstsq(
                design, design @ true + noise_w * rng.normal(size=len(design)), rcond=None
            )[0][-2:]
            for _ in range(50)
        ]
        errors[manoeuvre.id] = float(np.sqrt(np.mean((np.array(estimates) - true[-2:]) ** 2)))
    assert errors[ranked[0].id] < 0.2 < 1.0 < errors[ranked[-1].id]


def test_an_instrument_that_no_drive_shows_is_checked_with_a_meter(
    known: tuple[Refit, Runs, np.ndarray],
) -> None:
    fit, runs, residual = known
    column = np.where(runs.time_s > 240.0, np.maximum(fit.predicted, 0.0), 0.0)
    both = [
        Term(CATALOGUE[effect], column[:, None], np.array([0.0]), np.array([0.9]), 1)
        for effect in ("ageing", "sensor_gain")
    ]
    observed = dataclasses.replace(runs, observed=runs.observed + 0.2 * column)
    advice = to_tell_apart(fit, observed, residual, both[0], both[1:])
    assert advice.startswith("To distinguish ageing from sensor gain, ") and "clamp meter" in advice


def test_advice_without_rivals_is_the_drive_that_measures_best(
    known: tuple[Refit, Runs, np.ndarray],
) -> None:
    fit, runs, residual = known
    column = np.where(runs.time_s > 240.0, 30.0, 0.0)
    term = Term(CATALOGUE["standby"], column[:, None] / 30.0, np.array([0.0]), np.array([100.0]), 1)
    observed = dataclasses.replace(runs, observed=runs.observed + column)
    assert at_its_size(fit, observed, term).size == pytest.approx(30.0, rel=0.1)
    advice = to_tell_apart(fit, observed, residual, term, [])
    assert advice.startswith("To measure standby better, ") and advice.endswith(".")


def test_a_mass_that_level_ground_does_not_show_asks_for_a_slope(
    drive: Drive, husky: Robot
) -> None:
    flat = []
    for run in drive(husky):
        given = {**run.channels, "grade_rad": np.zeros(len(run))}
        power_w = replay(
            husky, given["time_s"], given["speed_mps"], sensing_hz=given["sensing_hz"]
        ).power_w
        given["power_w"] = power_w + np.random.default_rng(int(run.sha256)).normal(size=len(run))
        flat.append(dataclasses.replace(run, channels=given))
    runs = average(usable_runs(flat, husky)[0])
    fit = refit(runs, husky)
    known = estimates(fit, runs, independent_blocks(fit, runs).channels)
    residual = runs.observed - fit.predicted
    assert "mass" in [one.group.name for one in known if one.fitted is None]
    found = gains(fit, runs, residual, [], ["mass"])
    assert best(found) in ("slope", "known_mass")
    advice = to_determine(fit, runs, residual, known)
    assert advice is not None and "m / Gamma" in advice.split(", drive ")[0]


def test_nothing_is_advised_where_nothing_is_open(faultless: Analysis) -> None:
    assert faultless.diagnosis.next_experiment is None


def test_motor_current_has_drives_too(husky: Robot) -> None:
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, 600.0, 0.1)
    speed = np.repeat(rng.choice([0.0, 0.4, 0.8], 100), 60)
    current = (speed > 0.0) * 4.0 + rng.normal(size=len(time_s)) * 0.05
    channels = {
        "time_s": time_s,
        "speed_mps": speed,
        "motor_left_a": current / 2.0,
        "motor_right_a": current / 2.0,
    }
    runs = average(usable_runs([Recording("run", "0", channels)], husky)[0])
    fit = refit(runs, husky)
    found = gains(
        fit,
        runs,
        runs.observed - fit.predicted,
        [SizedEffect(CATALOGUE["turning"], 0.2, {}, np.zeros(len(runs.run)))],
    )
    assert best(found) == "on_the_spot"
