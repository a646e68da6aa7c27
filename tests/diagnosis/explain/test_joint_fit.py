"""Groups and effects fitted together get both right, within their bounds, and can be refitted on a
part."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Recording, diagnose
from homeward.diagnosis.chain import _known
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.change_points import Axis
from homeward.diagnosis.explain.hypothesis import Setting, Term, responses, rising
from homeward.diagnosis.explain.joint_fit import Corrected, Model, fit_model, immaterial
from homeward.diagnosis.explain.uncertainty import joint
from homeward.diagnosis.fit.estimates import covariance
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING
from homeward.diagnosis.fit.refit import holding, refit
from homeward.diagnosis.fit.replay import Runs, WithEffects, predict
from homeward.logs.channels import Array
from tests.diagnosis import hills
from tests.diagnosis.made_up import ends

TURNING = {"turning": {"scrub": 0.3}}
HARD = 1.25
"""C_rr of the true robot over that of its file."""


def as_recorded(runs: Runs, robot: Robot, noise_w: float = 0.0) -> Runs:
    """The drives of this robot, by the kernel."""
    noise = noise_w * np.random.default_rng(0).standard_normal(len(runs.observed))
    return dataclasses.replace(runs, observed=predict(runs, robot) + noise)


@pytest.fixture(scope="module")
def true(husky: Robot) -> Robot:
    return dataclasses.replace(
        husky, rolling_resistance=HARD * husky.rolling_resistance, effects=TURNING
    )


@pytest.fixture(scope="module")
def runs(short_runs: Runs, true: Robot) -> Runs:
    return as_recorded(short_runs, true, noise_w=1.0)


def fitted(runs: Runs, robot: Robot, *effects: str) -> Corrected:
    fit = refit(runs, robot)
    terms = [next(responses(CATALOGUE[effect], Setting.of(fit, runs))) for effect in effects]
    return fit_model(fit, terms, runs, cut_blocks(runs.run))


@pytest.fixture(scope="module")
def corrected(runs: Runs, husky: Robot) -> Corrected:
    return fitted(runs, husky, "turning")


def test_without_noise_groups_and_effect_are_exact(
    short_runs: Runs, husky: Robot, true: Robot
) -> None:
    fitted_model = fitted(as_recorded(short_runs, true), husky, "turning")
    assert fitted_model.values[0] == pytest.approx(0.3, rel=1e-4)
    assert fitted_model.theta[ROLLING] == pytest.approx(
        true.rolling_resistance * true.mass_kg, rel=1e-4
    )
    assert fitted_model.theta[MASS] == pytest.approx(true.mass_kg, rel=1e-4)


def test_the_interval_holds_the_true_size_and_the_error_of_the_meter(corrected: Corrected) -> None:
    value = corrected.parameters_of(0)["scrub"]
    assert (
        ends(value)[0] < 0.3 < ends(value)[1]
        and value.unit == CATALOGUE["turning"].entry.switch.unit
    )
    # A known gain error of half a per cent is in it: two standard errors at least.
    assert 0.02 * 0.3 < ends(value)[1] - ends(value)[0] < 0.2 * 0.3


def test_what_is_not_there_is_at_its_bound(short_runs: Runs, husky: Robot) -> None:
    """Less is drawn in turns than anything predicts; a scrub has no negative size."""
    plain = as_recorded(short_runs, husky)
    excess = predict(short_runs, dataclasses.replace(husky, effects=TURNING)) - plain.observed
    fitted_model = fitted(
        dataclasses.replace(plain, observed=plain.observed - 0.3 * excess), husky, "turning"
    )
    assert fitted_model.values[0] == 0.0 and fitted_model.ci95[0][0] == 0.0


def test_a_contribution_is_what_the_model_loses_without_its_term(
    corrected: Corrected, runs: Runs
) -> None:
    without = corrected.parameters.predict(runs, corrected.theta)
    np.testing.assert_allclose(corrected.contribution[0], corrected.predicted - without, atol=1e-9)
    straight = (runs.context["yaw_rate_radps"] == 0.0) & (runs.context["accel_mps2"] == 0.0)
    assert straight.any() and np.abs(corrected.contribution[0][straight]).max() < 1e-9


def test_the_jacobian_is_the_derivative_of_the_prediction(corrected: Corrected, runs: Runs) -> None:
    step = 1e-4
    for index in (ROLLING, MASS):
        moved = corrected.theta.copy()
        moved[index] += step * corrected.parameters.scale[index]
        slope = (
            corrected.model.predict(runs, moved, corrected.values) - corrected.predicted
        ) / step
        column = corrected.groups.jacobian[:, index]
        np.testing.assert_allclose(column, slope, atol=0.02 * np.abs(column).max())
    slope = (
        corrected.model.predict(runs, corrected.theta, corrected.values + step)
        - corrected.predicted
    ) / step
    np.testing.assert_allclose(corrected.beside[:, 0], slope, atol=0.02 * np.abs(slope).max())
    assert corrected.jacobian.shape == (len(runs.observed), len(corrected.theta) + 1)
    np.testing.assert_allclose(corrected.replayed(runs), corrected.predicted, atol=1e-9)


def test_a_part_is_fitted_to_what_it_holds(corrected: Corrected, runs: Runs, husky: Robot) -> None:
    """In the second half of the runs the robot scrubs less."""
    half = runs.run < 2
    less = dataclasses.replace(husky, rolling_resistance=HARD * husky.rolling_resistance,
                               effects={"turning": {"scrub": 0.2}})  # fmt: skip
    both = dataclasses.replace(runs, observed=np.where(half, runs.observed, predict(runs, less)))
    for refitted in (corrected.refitted(~half, both), corrected.fitted_to(~half, both.observed)):
        assert refitted.values[0] == pytest.approx(0.2, rel=0.05)
        assert refitted.theta[ROLLING] == pytest.approx(corrected.theta[ROLLING], rel=0.02)
    assert corrected.refitted(half, both).values[0] == pytest.approx(0.3, rel=0.05)


def test_a_part_that_is_like_all_takes_one_replay(
    corrected: Corrected, runs: Runs, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A diagnosis refits every hypothesis on every fold: a second step would take as long again,
    for nothing."""
    replays, predict_once = [], Model.predict

    def counted(model: Model, *arguments: Any, **keywords: Any) -> Array:
        replays.append(model)
        return predict_once(model, *arguments, **keywords)

    monkeypatch.setattr(Model, "predict", counted)
    part = corrected.refitted(runs.run < 2, runs)
    assert len(replays) == 1 and part.values[0] == pytest.approx(0.3, rel=0.02)


def test_a_group_that_a_rising_function_contains_is_held(runs: Runs, husky: Robot) -> None:
    """A function of the sensing rate contains the energy of each sample."""
    fit = refit(runs, husky)
    one = dataclasses.replace(CATALOGUE["standby"], rises_with="sensing_hz")
    (flexible,) = rising(one, Setting.of(fit, runs))
    held = fit_model(fit, [flexible], runs, cut_blocks(runs.run)).groups
    assert held.held.tolist() == [group.name == "sample_energy" for group in held.parameters.groups]
    assert held.theta[1] == pytest.approx(
        husky.sensing_j_per_sample + husky.computer_j_per_sample, rel=1e-4
    )


def observed_over(rise: Array, runs: Runs, robot: Robot) -> Array:
    """What is recorded over ground that is harder by `rise`; both of shape (windows,)."""
    on_it = dataclasses.replace(robot, effects={"surface": {"gain": 1.0}})
    return predict(runs, on_it, met=WithEffects(roughness=rise))


def fitted_over_ground(
    runs: Runs, robot: Robot, at_work: Array, axis: Axis, holds_rolling: bool = False
) -> Corrected:
    """The drives fitted with rough ground whose sizes are `at_work` there, shape (windows,
    sizes)."""
    fit = refit(runs, robot)
    held = fit.held.copy()
    held[ROLLING] = holds_rolling
    fit = holding(fit, runs, held)
    setting = Setting.of(fit, runs)
    surface = CATALOGUE["surface"]
    load = surface.load(surface, setting)
    assert load is not None
    low, high = surface.limits(at_work.shape[1], surface.signed)
    term = Term(
        surface,
        load[:, None] * at_work,
        low,
        high,
        axis=axis,
        of_rolling_kg=setting.rolling_kg,
        load=load,
        at_work=at_work,
    )
    return fit_model(fit, [term], runs, cut_blocks(runs.run))


@pytest.mark.parametrize("rise", [0.5, -0.85])
def test_a_change_of_the_ground_is_a_share_of_the_rolling_resistance_fitted_with_it(
    rise: float, short_runs: Runs, husky: Robot
) -> None:
    """From 60 s on. So are its bounds: on much smoother ground a refit finds a fraction of the
    resistance."""
    at_work = (short_runs.time_s > 60.0).astype(np.float64)
    observed = observed_over(rise * at_work, short_runs, husky)
    fitted_model = fitted_over_ground(
        dataclasses.replace(short_runs, observed=observed), husky, at_work[:, None], axis="time"
    )
    assert fitted_model.theta[ROLLING] == pytest.approx(
        husky.rolling_resistance * husky.mass_kg, rel=0.01
    )
    (share,) = fitted_model.parameters_of(0).values()
    assert share.value == pytest.approx(rise, rel=0.03)
    added_w = observed - predict(short_runs, husky)
    np.testing.assert_allclose(
        fitted_model.contribution[0], added_w, atol=0.03 * np.abs(added_w).max()
    )
    # Its columns stay in W per unit of a size, but for downhill, where the drive draws nothing.
    by_columns_w = fitted_model.model.terms[0].columns @ fitted_model.sizes(0)
    draws = np.abs(added_w) > 1.0
    assert np.median(by_columns_w[draws] / added_w[draws]) == pytest.approx(1.0, rel=0.02)


def test_ground_that_differs_all_along_leaves_the_rolling_resistance_where_it_was(
    short_runs: Runs, husky: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sizes of a profile add up to C_rr m, and only their sum is known. Its 24 sizes take no
    replays of their own."""
    replays, predict_once = [], Model.predict

    def counted(model: Model, *arguments: Any, **keywords: Any) -> Array:
        replays.append(model)
        return predict_once(model, *arguments, **keywords)

    monkeypatch.setattr(Model, "predict", counted)
    passed = (short_runs.time_s / short_runs.time_s.max())[:, None] * 23.0
    hats = np.maximum(1.0 - np.abs(passed - np.arange(24)), 0.0)
    rise = 0.5 * np.sin(2.0 * np.pi * passed[:, 0] / 23.0)
    hilly = dataclasses.replace(husky, rolling_resistance=0.03)  # downhill its drive draws nothing
    noise = np.random.default_rng(0).standard_normal(len(rise))
    runs = dataclasses.replace(short_runs, observed=observed_over(rise, short_runs, hilly) + noise)
    fitted_model = fitted_over_ground(runs, hilly, hats, axis="place")
    assert fitted_model.theta[ROLLING] == pytest.approx(
        hilly.rolling_resistance * hilly.mass_kg, rel=0.1
    )
    assert len(replays) < 3 * 24
    of_rolling_kg = fitted_model.model.terms[0].of_rolling_kg
    assert of_rolling_kg is not None
    estimate = _known(refit(runs, hilly), fitted_model, runs, cut_blocks(runs.run))[ROLLING]
    assert (
        estimate.status == "confounded" and estimate.mixed_with == ("surface",) and not estimate.off
    )
    by_all = (
        fitted_model.beside.sum(axis=1) / of_rolling_kg * fitted_model.parameters.scale[ROLLING]
    )
    np.testing.assert_allclose(by_all, fitted_model.groups.jacobian[:, ROLLING], rtol=1e-9)


def hats_along(runs: Runs) -> Array:
    """Six hats along a way that each run drives once, at a steady pace, shape (windows, 6)."""
    passed = 5.0 * runs.time_s / runs.time_s.max()
    return np.asarray(np.maximum(1.0 - np.abs(passed[:, None] - np.arange(6)), 0.0))


def test_sizes_of_a_profile_of_the_ground_are_relative_to_its_mean(
    short_runs: Runs, husky: Robot
) -> None:
    """With these intervals; and with C_rr of the mean ground they replay what was fitted."""
    hats = hats_along(short_runs)
    by_place = hats.T @ np.abs(short_runs.context["speed_mps"])
    shares = by_place / by_place.sum()
    covered = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        rolling = rng.uniform(0.7, 1.4) * np.exp(0.3 * rng.standard_normal(6))
        noise_w = 4.0 * rng.standard_normal(len(short_runs.observed))
        observed = observed_over(hats @ rolling - 1.0, short_runs, husky) + noise_w
        runs = dataclasses.replace(short_runs, observed=observed)
        fitted_model = fitted_over_ground(runs, husky, hats, axis="place")
        true_sizes = rolling / (shares @ rolling) - 1.0
        for true, value in zip(true_sizes, fitted_model.parameters_of(0).values(), strict=True):
            covered.append(ends(value)[0] <= true <= ends(value)[1])
            assert ends(value)[1] - ends(value)[0] < 0.5
    assert np.mean(covered) >= 0.85
    reported = fitted_model.reported
    assert shares @ reported.sizes == pytest.approx(0.0, abs=1e-9)
    mean_ground = fitted_model.theta.copy()
    mean_ground[ROLLING] = reported.rolling_kg
    on_it = WithEffects({"surface": {"gain": 1.0}}, roughness=hats @ reported.sizes)
    replayed = fitted_model.parameters.predict(runs, mean_ground, on_it)
    np.testing.assert_allclose(replayed, fitted_model.predicted, atol=1e-6)
    all_numbers = joint(fitted_model, runs, cut_blocks(runs.run))
    symbol = fitted_model.parameters.groups[ROLLING].symbol
    assert all_numbers.relative_error[symbol] < 0.05
    assert all_numbers.values[-6:] == pytest.approx(reported.sizes)


@pytest.mark.parametrize("axis", ["place", "time"])
def test_what_sizes_of_the_ground_rest_on_is_what_their_intervals_hold(
    axis: Axis, short_runs: Runs, husky: Robot
) -> None:
    """Derivatives of the sizes and of C_rr m as reported are difference quotients."""
    hats = hats_along(short_runs)
    rises = np.array([0.5, 0.8, 0.7, 0.3, 0.6, 0.9])
    noise_w = np.random.default_rng(0).standard_normal(len(short_runs.observed))
    observed = observed_over(hats @ rises, short_runs, husky) + noise_w
    runs = dataclasses.replace(short_runs, observed=observed)
    fitted_model = fitted_over_ground(runs, husky, hats if axis == "place" else hats[:, 3:4], axis)
    fitted = np.concatenate([fitted_model.theta, fitted_model.values])
    groups = len(fitted_model.theta)

    def reported(numbers: Array) -> Array:
        theta, values = numbers[:groups], numbers[groups:]
        answer = fitted_model.model.reported(
            theta, values, fitted_model.by_distance, fitted_model.groups.held
        )
        return np.append(answer.sizes, answer.rolling_kg)

    steps = 1e-6 * np.eye(len(fitted))
    quotients = [(reported(fitted + step) - reported(fitted - step)) / 2e-6 for step in steps]
    by_all = np.vstack([fitted_model.reported.by_all, fitted_model.reported.rolling_by_all])
    np.testing.assert_allclose(by_all.T, quotients, atol=1e-7)
    # the same of C_rr m, of all that is fitted together
    block = cut_blocks(runs.run)
    all_numbers = joint(fitted_model, runs, block)
    scale = np.append(fitted_model.parameters.scale, np.ones(len(fitted_model.values)))
    clustered = covariance(fitted_model.jacobian, runs.observed - fitted_model.predicted, block)
    rolling_by_columns = (
        np.array(quotients)[:, -1] * scale * fitted_model.parameters.to_group[ROLLING]
    )
    variance = rolling_by_columns @ clustered @ rolling_by_columns
    assert all_numbers.covariance[groups + ROLLING, groups + ROLLING] == pytest.approx(variance)


def test_sizes_are_of_the_rolling_resistance_that_is_held(short_runs: Runs, husky: Robot) -> None:
    """As where the recordings do not show it: no mean ground would be reported beside them."""
    hats = hats_along(short_runs)
    rises = np.array([0.5, 0.8, 0.7, 0.3, 0.6, 0.9])
    noise_w = np.random.default_rng(0).standard_normal(len(short_runs.observed))
    observed = observed_over(hats @ rises, short_runs, husky) + noise_w
    runs = dataclasses.replace(short_runs, observed=observed)
    fitted_model = fitted_over_ground(runs, husky, hats, axis="place", holds_rolling=True)
    sizes = [value.value for value in fitted_model.parameters_of(0).values()]
    assert sizes == pytest.approx(rises.tolist(), abs=0.03)
    # Where the power at rest would take its level, they are relative to their mean.
    shares = np.full(6, 1.0 / 6.0)
    unlevelled = dataclasses.replace(fitted_model, by_distance=(shares,))
    mean = float(rises.mean())
    assert unlevelled.reported.sizes == pytest.approx(rises - mean, abs=0.03)
    assert unlevelled.reported.rolling_kg == fitted_model.theta[ROLLING]


@pytest.mark.parametrize("both_ways", [False, True])
def test_slopes_have_a_level_only_where_both_ways_were_driven(
    both_ways: bool, short_runs: Runs, husky: Robot
) -> None:
    """One way only, a slope all along is a larger C_rr."""
    hats = hats_along(short_runs)
    signals = [
        dataclasses.replace(run, direction=np.full(len(run.time_s), -1.0 if homewards else 1.0))
        for run, homewards in zip(short_runs.signals, [False, both_ways] * 2, strict=True)
    ]
    runs = dataclasses.replace(short_runs, signals=signals)
    slope = CATALOGUE["hidden_grade"]
    load = slope.load(slope, Setting.of(refit(runs, husky), runs))
    assert load is not None
    true = np.array([0.02, 0.08, -0.03, 0.05, 0.01, 0.04])
    low, high = slope.limits(6)
    covered = []
    for seed in range(8):
        noise_w = 4.0 * np.random.default_rng(seed).standard_normal(len(load))
        observed = predict(runs, husky) + load * (hats @ true) + noise_w
        steep = dataclasses.replace(runs, observed=observed)
        columns = load[:, None] * hats
        term = Term(slope, columns, low=low, high=high, axis="place", load=load, at_work=hats)
        fitted_model = fit_model(refit(steep, husky), [term], steep, cut_blocks(runs.run))
        shares = fitted_model.by_distance[0]
        assert (shares is None) == both_ways
        level = 0.0 if shares is None else float(shares @ true)
        for size, value in zip(true, fitted_model.parameters_of(0).values(), strict=True):
            covered.append(ends(value)[0] <= size - level <= ends(value)[1])
            assert ends(value)[1] - ends(value)[0] < 0.05
    assert np.mean(covered) >= 0.85


def test_a_mass_on_level_ground_is_immaterial(short_runs: Runs, husky: Robot) -> None:
    level = [dataclasses.replace(run, grade_rad=0.0 * run.grade_rad) for run in short_runs.signals]
    for runs, expected in (
        (short_runs, False),
        (dataclasses.replace(short_runs, signals=level), True),
    ):
        fit = refit(as_recorded(runs, husky, noise_w=0.1), husky)
        assert immaterial(fit, runs)[MASS] == expected
        assert not immaterial(fit, runs)[ROLLING]


def test_an_effect_far_from_the_refit_is_named_by_its_joint_replay() -> None:
    """Over hills a refit without regeneration is so far off that forces change sign in other
    windows."""
    given = load_robot("jackal")
    given = dataclasses.replace(given, rolling_resistance=0.5 * given.rolling_resistance)
    robot = dataclasses.replace(given, effects={"regeneration": {"share": 0.7, "up_to_w": 1e3}})
    recorded = [
        Recording(f"run{seed}.csv", str(seed), hills.drive(robot, seed)) for seed in (100, 101, 102)
    ]
    (regeneration,) = diagnose(recorded, given).missing_physics
    assert regeneration.effect == "regeneration"
    assert regeneration.parameters["share"].value == pytest.approx(0.7, rel=0.05)


@pytest.mark.parametrize("in_file", [0.0, 0.15])
def test_a_load_on_top_also_makes_turning_harder_where_that_is_flexible(
    in_file: float, short_runs: Runs, husky: Robot
) -> None:
    turns = dataclasses.replace(husky, effects=TURNING)
    given = (
        dataclasses.replace(husky, effects={"turning": {"scrub": in_file}}) if in_file else husky
    )
    recorded = as_recorded(short_runs, turns)
    fit = refit(recorded, given)
    setting = Setting.of(fit, recorded)
    (flexible,) = rising(CATALOGUE["turning"], setting)
    (plain,) = responses(CATALOGUE["turning"], setting)
    term = dataclasses.replace(flexible, plain=plain)
    fitted_model = fit_model(fit, [term], recorded, cut_blocks(recorded.run))
    beside = fitted_model.model.setting(recorded, fitted_model.theta, fitted_model.values)
    payload = CATALOGUE["payload"]
    load, load_alone = payload.load(payload, beside), payload.load(payload, setting)
    with_it = dataclasses.replace(turns, effects={**TURNING, "payload": {"mass_kg": 1.0}})
    true = predict(recorded, with_it) - predict(recorded, turns)
    assert load is not None and load_alone is not None
    assert np.std(load - true) < 0.5 * np.std(load_alone - true)
    assert beside.present.effects["turning"]["scrub"] == pytest.approx(0.3, rel=0.25)
