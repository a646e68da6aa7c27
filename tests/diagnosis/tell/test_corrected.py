"""A robot file says what was fitted: replayed it predicts what the joint fit does, for every effect
it can say."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.hypothesis import TINY, Setting, Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.parameter_groups import ROLLING as RESISTANCE
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import Runs, WithEffects, average, predict
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.result import FileNumber
from homeward.diagnosis.tell.corrected import (
    FileContent,
    comments,
    file_content,
    is_expressible,
    replayed,
    written,
)
from homeward.physics.effects import EFFECTS
from homeward.physics.model import headwind

Drive = Callable[..., list[Recording]]

ROUNDING = 1e-4
"""Of the rms of what is predicted: what the six digits of a file may leave."""

ROLLING: Mapping[str, float] = {"regeneration": 0.03}
"""C_rr of a robot that an effect is at work in: one that rolls hard has to push downhill too."""

NOT_SAID: Mapping[str, str] = {
    "payload": "a file says what is carried, and not from when on",
    "standby": "what always draws is in the idle power, and a file does not say from when on something does",
    "intermittent_load": "a file says a rhythm, and not at which beat a drive begins",
    "ageing": "power shows nothing of it, and it is written as the gauge shows it",
    "wind": "it is weather",
}
"""Effects that the joint fit holds in no form that a file can say, and why."""


@pytest.fixture(scope="module")
def robot(husky: Robot) -> Robot:
    """A robot that wind matters to."""
    return dataclasses.replace(husky, drag_ns2_per_m2=8.0)


@pytest.fixture(scope="module")
def runs(drive: Drive, robot: Robot) -> Runs:
    """Two drives out and back, in the cold and in the heat, with every channel that tells of an
    effect."""
    recordings = []
    for number, run in enumerate(drive(robot, runs=2)):
        of = {name: values[:3000] for name, values in run.channels.items()}
        time_s = of["time_s"]
        way_m = 0.1 * np.cumsum(np.abs(of["speed_mps"]))
        of["base_distance_m"] = 300.0 * number + np.minimum(way_m, way_m[-1] - way_m)
        of["heading_rad"] = np.where(way_m < 0.5 * way_m[-1], 0.0, np.pi) + 0.3 * np.sin(
            time_s / 40.0
        )
        of["temperature_c"] = -5.0 + 35.0 * number + 8.0 * time_s / time_s[-1]
        recordings.append(dataclasses.replace(run, channels=of))
    return average(usable_runs(recordings, robot)[0])


def met(runs: Runs) -> WithEffects:
    """A wind of 2 m/s on all drives, and rough ground far from base."""
    headings = [run.context["heading_rad"] for run in runs.signals]
    winds = [
        np.asarray(headwind(2.0 * np.cos(0.4), 2.0 * np.sin(0.4), np.cos(one), np.sin(one)))
        for one in headings
    ]
    place_m = runs.context["place_m"]
    return WithEffects(headwind_mps=winds, roughness=(place_m > np.median(place_m)).astype(float))


def drawn_w(robot: Robot, effect: str, size: float, runs: Runs) -> np.ndarray:
    switch = CATALOGUE[effect].entry.switch
    return predict(
        runs, dataclasses.replace(robot, effects={effect: {switch.name: size}}), met=met(runs)
    )


def a_tenth(robot: Robot, effect: str, runs: Runs) -> float:
    """Size of an effect that adds a tenth to what is drawn on these drives."""
    switch = CATALOGUE[effect].entry.switch
    little = TINY * switch.high
    plain = drawn_w(robot, effect, 0.0, runs)
    size = (
        0.1
        * np.mean(plain)
        * little
        / np.mean(np.abs(drawn_w(robot, effect, little, runs) - plain))
    )
    return min(float(size), 0.9 * switch.high)


def recorded(robot: Robot, effect: str, runs: Runs) -> Runs:
    """What these drives record of the robot with an effect of that size."""
    power_w = drawn_w(robot, effect, a_tenth(robot, effect, runs), runs)
    return dataclasses.replace(
        runs, observed=power_w + np.random.default_rng(0).standard_normal(len(power_w))
    )


def joint_fit(robot: Robot, effect: str, runs: Runs) -> Corrected | None:
    """The groups fitted together with that form of an effect which explains most of those that a
    file can say."""
    fit = refit(runs, robot)
    residual = runs.observed - fit.predicted
    setting = Setting.of(fit, runs, residual)
    forms = [
        one
        for one in CATALOGUE[effect].forms(setting, True)
        if is_expressible(one) and one.columns.any()
    ]

    def unexplained(term: Term) -> float:
        columns = np.column_stack([fit.jacobian, term.columns])
        return float(
            np.sum((residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]) ** 2)
        )

    return (
        fit_model(fit, [min(forms, key=unexplained)], runs, cut_blocks(runs.run, residual))
        if forms
        else None
    )


@pytest.mark.parametrize("effect", [one.id for one in EFFECTS if one.id not in NOT_SAID])
def test_the_file_replayed_predicts_what_the_joint_fit_predicts(
    effect: str, robot: Robot, runs: Runs
) -> None:
    robot = dataclasses.replace(
        robot, rolling_resistance=ROLLING.get(effect, robot.rolling_resistance)
    )
    runs = recorded(robot, effect, runs)
    model = joint_fit(robot, effect, runs)
    assert model is not None
    content = file_content(model, runs)
    file = written(robot, content, runs.unit)
    assert effect in file.active_effects
    rms = float(np.sqrt(np.mean(model.predicted**2)))
    assert np.abs(model.contribution[0]).max() > 10.0 * ROUNDING * rms  # it is at work
    np.testing.assert_allclose(
        replayed(file, content, runs), model.predicted, rtol=0.0, atol=ROUNDING * rms
    )


@pytest.mark.parametrize("effect", [one.id for one in EFFECTS if one.id not in NOT_SAID])
def test_so_it_does_where_the_given_file_holds_a_part_of_the_effect(
    effect: str, robot: Robot, runs: Runs
) -> None:
    robot = dataclasses.replace(
        robot, rolling_resistance=ROLLING.get(effect, robot.rolling_resistance)
    )
    half = {CATALOGUE[effect].entry.switch.name: 0.5 * a_tenth(robot, effect, runs)}
    others = {"usual": 0.4} if effect == "surface" else {}
    runs = recorded(robot, effect, runs)
    given = dataclasses.replace(robot, effects={effect: {**half, **others}})
    model = joint_fit(given, effect, runs)
    assert model is not None
    content = file_content(model, runs)
    rms = float(np.sqrt(np.mean(model.predicted**2)))
    by_file = replayed(written(given, content, runs.unit), content, runs)
    np.testing.assert_allclose(by_file, model.predicted, rtol=0.0, atol=ROUNDING * rms)


def test_ground_of_which_nothing_is_known_is_as_rough_as_that_of_the_drives(
    robot: Robot, runs: Runs
) -> None:
    runs = recorded(robot, "surface", runs)
    model = joint_fit(robot, "surface", runs)
    assert model is not None
    content = file_content(model, runs)
    unknown = dataclasses.replace(content, met=dataclasses.replace(content.met, roughness=None))
    drawn_w = replayed(written(robot, content, runs.unit), unknown, runs)
    smooth_w = replayed(
        written(robot, dataclasses.replace(content, effects={}), runs.unit), unknown, runs
    )
    assert float(np.mean(drawn_w)) == pytest.approx(float(np.mean(runs.observed)), rel=0.01)
    assert float(np.mean(smooth_w)) < 0.97 * float(np.mean(runs.observed))


def test_ground_that_adds_as_much_is_a_smaller_share_of_a_larger_resistance(
    robot: Robot, runs: Runs
) -> None:
    model = joint_fit(robot, "surface", recorded(robot, "surface", runs))
    assert model is not None
    theta = model.theta.copy()
    theta[RESISTANCE] *= 2.0  # as where the last pass of the fit still changed it
    twice = dataclasses.replace(model, groups=dataclasses.replace(model.groups, theta=theta))
    gain, of_twice = (
        file_content(fitted, runs).effects["surface"]["gain"] for fitted in (model, twice)
    )
    assert of_twice == pytest.approx(0.5 * gain)


def test_before_an_effect_began_the_file_is_replayed_without_it(robot: Robot, runs: Runs) -> None:
    """Also where the drive draws nothing with it, such as on a slope that was not there before."""
    theta = refit(runs, robot).theta
    had_not_begun = np.arange(len(runs.observed)) < len(runs.observed) // 2
    slope = {"hidden_grade": {"slope": -0.2}}
    content = FileContent(theta, slope, WithEffects(), not_begun={"hidden_grade": had_not_begun})
    predicted = replayed(written(robot, content, runs.unit), content, runs)
    for effects, mask in (({}, had_not_begun), (slope, ~had_not_begun)):
        always = FileContent(theta, effects, WithEffects())
        np.testing.assert_allclose(
            predicted[mask],
            replayed(written(robot, always, runs.unit), always, runs)[mask],
            rtol=0.0,
            atol=1e-9,
        )


def test_a_radio_is_written_as_far_from_base_as_was_recorded(robot: Robot, runs: Runs) -> None:
    model = joint_fit(robot, "radio", recorded(robot, "radio", runs))
    assert model is not None
    effect = written(robot, file_content(model, runs), runs.unit).effects["radio"]
    assert effect["reach_m"] == pytest.approx(
        float(runs.context["base_distance_m"].max()), rel=1e-5
    )


@pytest.mark.parametrize("effect", NOT_SAID)
def test_what_a_file_cannot_say_is_in_no_form_that_is_written(
    effect: str, robot: Robot, runs: Runs
) -> None:
    assert joint_fit(robot, effect, recorded(robot, effect, runs)) is None, NOT_SAID[effect]


def test_rough_ground_is_fitted_where_the_refit_without_it_takes_all_rolling_for_none(
    robot: Robot, runs: Runs
) -> None:
    robot = dataclasses.replace(robot, rolling_resistance=0.03)
    runs = recorded(robot, "surface", runs)
    model = joint_fit(robot, "surface", runs)
    assert model is not None
    # the noise
    assert float(np.std(runs.observed - model.predicted)) == pytest.approx(1.0, abs=0.5)


def test_ground_that_no_file_can_say_is_written_as_the_smoothest_that_one_can(
    robot: Robot, runs: Runs
) -> None:
    """Forty times as hard far from base: a gain above the largest allowed would end the
    diagnosis."""
    ground = WithEffects(roughness=np.where(met(runs).roughness == 1.0, 1.0, -0.95))
    rough = dataclasses.replace(robot, effects={"surface": {"gain": 1.0}})
    runs = dataclasses.replace(runs, observed=predict(runs, rough, met=ground))
    model = joint_fit(robot, "surface", runs)
    assert model is not None
    content = file_content(model, runs)
    file = written(robot, content, runs.unit)
    highest = CATALOGUE["surface"].entry.switch.high
    assert file.effects["surface"]["gain"] == highest
    hardest = file.rolling_resistance * (1.0 + highest)
    assert hardest == pytest.approx(2.0 * robot.rolling_resistance, rel=0.05)


def test_the_comment_says_of_which_ground_the_rolling_resistance_is(robot: Robot) -> None:
    """The fitted number beside it is that of the mean ground."""
    smoother = dataclasses.replace(robot, rolling_resistance=0.5 * robot.rolling_resistance)
    rough = dataclasses.replace(smoother, effects={"surface": {"gain": 1.0}})
    fitted = FileNumber("C_rr m / Gamma", 10.0, (9.0, 11.0), "kg", proven=True)
    on_smooth = comments(robot, smoother, [fitted])["rolling_resistance"]
    on_rough = comments(robot, rough, [fitted])["rolling_resistance"]
    assert "smoothest" not in on_smooth
    assert on_rough.endswith("is that of the smoothest ground")


def test_a_number_that_follows_from_a_fitted_one_says_so(robot: Robot) -> None:
    """With C_rr m held, another mass is another C_rr."""
    heavier = dataclasses.replace(
        robot,
        mass_kg=2.0 * robot.mass_kg,
        rolling_resistance=0.5 * robot.rolling_resistance,
    )
    mass = FileNumber("m / Gamma", 10.0, (9.0, 11.0), "kg", proven=True)
    said = comments(robot, heavier, [mass])
    assert "proven: m / Gamma" in said["mass_kg"]
    assert "it follows from the others" in said["rolling_resistance"]
