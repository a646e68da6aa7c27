"""What is file over is what was proven: the file, replayed as written."""

import dataclasses
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.predictive import INERTIA, Entry, Predictive
from homeward.diagnosis.fit.refit import Refit, refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.tell.corrected import file_content, replayed
from homeward.diagnosis.tell.file_choice import (
    _in_file_by_fitted,
    determined,
    expressible,
    worse_than,
)
from homeward.diagnosis.tell.report import corrected_toml
from homeward.physics import ancillary_power, replay
from tests.diagnosis.conftest import Analyse
from tests.diagnosis.made_up import ends

Drive = Callable[..., list[Recording]]


def replay_equals_fit(analysis: Analysis) -> bool:
    """Whether the file that is file over predicts what the joint fit to all data predicts, to its
    six digits."""
    evidence, file = analysis.evidence, analysis.diagnosis.file
    assert evidence is not None and file is not None and file.holds != "nominal"
    model: Refit | Corrected | None = evidence.plain
    if file.holds == "corrected":
        model = expressible(
            evidence.plain, evidence.corrected, evidence.naming.named, evidence.runs, evidence.block
        )
    assert model is not None
    by_file = replayed(analysis.corrected, file_content(model, evidence.runs), evidence.runs)
    return float(np.abs(by_file - model.predicted).max()) < 1e-5 * float(
        np.abs(evidence.runs.observed).max()
    )


def test_a_group_whose_assumed_value_hardly_counts_is_handed_over_as_fitted(
    short_drive: Drive, husky: Robot
) -> None:
    """Ten times the idle power, beside a missing effect: it is neither frozen nor written as
    assumed."""
    idle_w = float(ancillary_power(husky, 0.0))
    hidden = dataclasses.replace(husky, controller_w=husky.controller_w + 9.0 * idle_w)
    small = dataclasses.replace(
        husky,
        controller_w=0.005 * idle_w,
        communication_w=0.0,
        sensing_idle_w=0.0,
        sensing_j_per_sample=0.7,
    )
    analysis = analyse(short_drive(hidden, effects={"turning": {"scrub": 0.3}}), small)
    assert analysis.diagnosis.file is not None and analysis.diagnosis.file.holds == "corrected"
    assert float(ancillary_power(analysis.corrected, 0.0)) == pytest.approx(10.0 * idle_w, rel=0.01)
    assert replay_equals_fit(analysis)
    arms = analysis.diagnosis.fit.arms if analysis.diagnosis.fit else {}
    assert arms["file"].rmse == pytest.approx(arms["corrected"].rmse, rel=0.01)


def test_a_drag_of_zero_is_a_value_like_any_other(drive: Drive, husky: Robot) -> None:
    dragging = dataclasses.replace(husky, drag_ns2_per_m2=30.0, mass_kg=0.6 * husky.mass_kg)
    analysis = analyse(drive(husky, minutes=4.0, drag_ns2_per_m2=0.0), dragging)
    assert analysis.diagnosis.verdict == "parameters_off"
    off = {one.group: one for one in analysis.diagnosis.parameters_off}
    assert (
        off["c / Gamma"].fitted == pytest.approx(0.0, abs=1.0) and off["c / Gamma"].ci95[0] == 0.0
    )
    assert analysis.diagnosis.file is not None and analysis.diagnosis.file.holds == "refit"
    assert replay_equals_fit(analysis)


def test_what_may_be_a_zero_of_the_meter_is_not_in_the_file(
    short_drive: Drive, husky: Robot
) -> None:
    """A load or a zero that shifts at some moment: a wrong guess is worse than the mean that the
    refit takes."""
    recordings = []
    for number, run in enumerate(short_drive(husky)):
        read_w = run.channels["power_w"] + 30.0 * (number > 0)
        air_c = np.full(len(run), 15.0)
        channels = {**run.channels, "power_w": read_w, "temperature_c": air_c}
        recordings.append(dataclasses.replace(run, channels=channels))
    analysis = analyse(recordings, husky)
    (found,) = analysis.diagnosis.missing_physics
    assert {"standby", "sensor_offset"} <= {found.effect, *found.confused_with}
    assert analysis.diagnosis.file is not None and analysis.diagnosis.file.holds == "predictive"
    assert "is confounded with a fault of the meter" in analysis.diagnosis.file.why
    assert "it takes tyres to roll 0.86 % harder per kelvin of cold" in analysis.diagnosis.file.why
    assert not {"standby", "intermittent_load"} & set(analysis.corrected.active_effects)


def test_of_unknown_physics_the_file_holds_what_makes_up_for_it_and_says_so(
    short_drive: Drive, husky: Robot
) -> None:
    """A robot that draws more is sooner home empty: a fit is safer than the file, but measures
    nothing.

    No effect of the catalogue chatters so, though a schedule would follow it.
    """
    recordings = []
    for run in short_drive(husky, controller_w=1.5 * husky.controller_w):
        speed = run.channels["speed_mps"]  # and chatters in a band of speeds
        read_w = run.channels["power_w"] + 60.0 * np.exp(-(((np.abs(speed) - 0.5) / 0.08) ** 2))
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": read_w}))
    analysis = analyse(recordings, husky)
    assert analysis.diagnosis.verdict == "unknown_physics" and analysis.diagnosis.where
    assert analysis.diagnosis.file is not None and analysis.diagnosis.file.holds == "predictive"
    assert "no measurement" in analysis.diagnosis.file.why
    assert analysis.diagnosis.parameters == ()
    shown = {number.name: number for number in analysis.diagnosis.file.numbers}
    assert not any(number.proven for number in shown.values())
    mass = shown["m / Gamma"]
    assert mass.value * husky.traction_efficiency == pytest.approx(
        analysis.corrected.mass_kg, rel=1e-3
    )
    assert ends(mass)[0] <= mass.value <= ends(mass)[1]


@pytest.mark.parametrize(
    ("after", "reason"),
    [
        (np.array([1.0, -1.0, 1.0, -1.0]), ""),
        (np.array([2.0, -2.0, 2.0, -2.0]), "the held-out error would be 2 W instead of 2"),
        (
            np.array([1.0, 1.0, 1.0, 1.0]),
            "the energy of a held-out trip would be off by 1 J on average instead of 0",
        ),
    ],
)
def test_a_file_must_be_better_and_its_trips_no_worse(after: np.ndarray, reason: str) -> None:
    runs: Any = SimpleNamespace(observed=np.full(4, 10.0), duration_s=np.full(4, 0.5), unit="W")
    before = runs.observed + np.array([2.0, -2.0, 2.0, -2.0])
    assert (
        worse_than(
            before, runs.observed + after, runs, np.array([0, 0, 1, 1]), np.random.default_rng(0)
        )
        == reason
    )


def test_groups_are_held_at_no_value_that_the_data_contradict(husky: Robot) -> None:
    """Only the sum of idle and rolling power is known at one speed, and either of the file alone
    exceeds it."""
    (run,) = recordings_at_one_speed(husky)
    wrong = dataclasses.replace(
        husky, controller_w=1000.0, rolling_resistance=6.0 * husky.rolling_resistance
    )
    runs = average(usable_runs([run], wrong)[0])
    plain, corrected = determined(refit(runs, wrong), None, runs, cut_blocks(runs.run))
    assert corrected is None
    assert float(np.abs(plain.predicted - runs.observed).mean()) < 0.05 * float(
        runs.observed.mean()
    )


def recordings_at_one_speed(robot: Robot) -> list[Recording]:
    time_s = np.arange(0.0, 600.0, 0.1)
    speed = 0.8 + 0.001 * np.random.default_rng(0).standard_normal(len(time_s))
    power_w = replay(robot, time_s, speed, accel_mps2=0.0).power_w
    return [Recording("level.csv", "0", {"time_s": time_s, "speed_mps": speed, "power_w": power_w})]


def test_a_form_that_a_file_lacks_is_replaced_by_the_nearest_that_it_has(
    short_drive: Drive, husky: Robot
) -> None:
    """A computer whose power rises fast at first: the file says a part at once and the rest by the
    sample, and beats the refit, which knows a line only."""
    rng, recordings = np.random.default_rng(0), []
    for run in short_drive(husky):
        before_hz = run.channels["sensing_hz"]
        hz = np.repeat(rng.choice([0.0, 5.0, 20.0, 50.0], 1 + len(before_hz) // 50), 50)[
            : len(before_hz)
        ]
        read_w = run.channels["power_w"] + husky.computer_j_per_sample * (hz - before_hz)
        read_w += 3.0 * hz + 40.0 * np.sqrt(hz / 50.0) + 40.0 * (hz > 0.0)
        recordings.append(
            dataclasses.replace(run, channels={**run.channels, "sensing_hz": hz, "power_w": read_w})
        )
    analysis = analyse(recordings, husky)
    assert analysis.evidence is not None and analysis.diagnosis.fit is not None
    assert analysis.diagnosis.file is not None and analysis.diagnosis.file.holds == "corrected"
    assert [*analysis.corrected.active_effects] == ["compute"]
    arms = analysis.diagnosis.fit.arms
    assert arms["file"].rmse < arms["refit"].rmse


def test_the_error_of_the_mass_is_in_that_of_the_accelerated_over_the_moved_mass() -> None:
    """They are fitted as masses: the file has their ratio."""
    entries = [
        Entry(name, "kg", centre=0.0, scale=1.0, low=0.0, high=1e4)
        for name in ("mass", "drag", INERTIA)
    ]
    masses = np.array([700.0, 0.4, 1900.0])
    fit = Predictive(
        load_robot("husky"), tuple(entries), masses, np.empty(0), np.empty(0), 1.0, 1.0
    )
    in_file, by_fitted = _in_file_by_fitted(fit)
    assert in_file == pytest.approx([700.0, 0.4, 1900.0 / 700.0])
    for index in range(3):
        step = 1e-6 * masses * (np.arange(3) == index)
        moved, _ = _in_file_by_fitted(dataclasses.replace(fit, values=masses + step))
        assert (moved - in_file) / step[index] == pytest.approx(by_fitted[:, index], abs=1e-8)


def test_a_file_of_what_nothing_proves_says_so_and_is_no_worse_than_the_given_one(
    short_drive: Drive, husky: Robot, analyse_once: Analyse
) -> None:
    """Runs of another load each, which no channel shows: a fit of four runs predicts, and hardly a
    number is proven."""
    recordings = []
    for number, run in enumerate(
        short_drive(husky, rolling_resistance=1.3 * husky.rolling_resistance)
    ):
        power_w = run.channels["power_w"] * (1.0 + 0.05 * (-1) ** number)
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    analysis = analyse_once(recordings, husky)
    file, fit = analysis.diagnosis.file, analysis.diagnosis.fit
    assert file is not None and fit is not None
    nominal, by_file = fit.arms["nominal"].energy_error_pct, fit.arms["file"].energy_error_pct
    assert nominal is not None and by_file is not None and by_file < nominal
    text = corrected_toml(analysis)
    for fitted in file.numbers:
        assert fitted.ci95 is None or fitted.ci95[0] <= fitted.value <= fitted.ci95[1]
    assert ("fitted, not proven" in text) == (not all(fitted.proven for fitted in file.numbers))
