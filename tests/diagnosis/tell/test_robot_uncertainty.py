"""corrected.toml says how sure it is: from what was held out, in shares, and read back by the
loader."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.diagnosis.tell.report import write_outputs
from homeward.diagnosis.tell.robot_uncertainty import (
    FittedTo,
    between_runs,
    uncertainty_of,
    within_runs,
)

Drive = Callable[..., list[Recording]]


@pytest.fixture(scope="module")
def off(drive: Drive, husky: Robot) -> Analysis:
    """Three drives of a Husky that rolls a third harder than its file says."""
    return analyse(
        drive(husky, minutes=4.0, rolling_resistance=1.33 * husky.rolling_resistance), husky
    )


def test_it_is_written_and_read_back(off: Analysis, tmp_path: Path) -> None:
    write_outputs(off, tmp_path)
    robot = load_robot(tmp_path / "corrected.toml")
    assert robot.uncertainty == uncertainty_of(off)
    assert replace(robot, uncertainty=None) == replace(off.corrected, uncertainty=None)


def test_it_holds_what_was_fitted_as_shares_of_it(off: Analysis, husky: Robot) -> None:
    found = uncertainty_of(off)
    assert found is not None and off.evidence is not None and off.diagnosis.file is not None
    assert off.diagnosis.file.holds == "refit" and "rolling" in found.fitted
    sd = np.sqrt(found.variance("rolling") or 0.0)
    missed = (
        off.corrected.rolling_resistance
        * off.corrected.mass_kg
        / (1.33 * husky.rolling_resistance * 50.0)
        - 1.0
    )
    assert 1e-4 < sd < 0.05 and abs(missed) < 5.0 * sd
    assert "3 runs" in found.source and found.between_runs is not None


def test_of_few_runs_the_spread_is_as_wide_as_their_number_asks(off: Analysis) -> None:
    """Each run was predicted from the two others; Student's t of two degrees of freedom has 2.92
    for 1.645."""
    found, evidence = uncertainty_of(off), off.evidence
    assert found is not None and evidence is not None and found.between_runs is not None
    runs, predicted = evidence.runs, evidence.predictions["file"]
    off_w, said_w = (
        np.array([one[runs.run == run].mean() for run in range(3)])
        for one in (runs.observed - predicted, predicted)
    )
    wide = 2.92 / 1.645 * np.sqrt(np.mean(off_w**2) / np.mean(said_w**2))
    way_m = np.abs(runs.context["speed_mps"] * runs.duration_s).sum() / 3.0
    assert np.hypot(found.between_runs, found.unexplained_over(way_m)) == pytest.approx(
        wide, rel=0.15
    )


@pytest.mark.parametrize("fitted_to", ["nothing", "others", "all"])
@pytest.mark.parametrize("runs", [2, 4, 12])
def test_the_interval_holds_one_more_run_as_often_as_it_should(
    fitted_to: FittedTo, runs: int
) -> None:
    """Runs take a mean of 10 W; each differs from it by 1 W, and each window by another 1 W."""
    rng, windows, held = np.random.default_rng(0), 50, []
    run = np.repeat(np.arange(runs), windows)
    for _ in range(1000):
        mean_w = 10.0 + rng.normal(size=runs)
        observed = mean_w[run] + rng.normal(size=len(run))
        by_run = np.bincount(run, observed) / windows
        says_w = 10.0 if fitted_to == "nothing" else by_run.mean()
        of_each = (
            (by_run.sum() - by_run) / (runs - 1) if fitted_to == "others" else np.full(runs, says_w)
        )
        sd = between_runs(observed - of_each[run], of_each[run], run, fitted_to)
        assert sd is not None
        one_more_w = 10.0 + rng.normal() + rng.normal() / np.sqrt(windows)
        held.append(
            abs(one_more_w - says_w) < 1.645 * np.hypot(sd * says_w, 1.0 / np.sqrt(windows))
        )
    assert np.mean(held) == pytest.approx(0.9, abs=0.03)


def test_of_one_run_the_spread_is_not_known() -> None:
    assert between_runs(np.ones(50), np.ones(50), np.zeros(50, dtype=np.intp), "nothing") is None


def test_levels_of_runs_are_no_correlation_within_them() -> None:
    rng = np.random.default_rng(0)
    run = np.repeat(np.arange(40), 200)
    noise, levels = rng.normal(size=8000), 3.0 * rng.normal(size=40)[run]
    assert within_runs(noise + levels, run) == pytest.approx((1.0, 1.0), rel=0.05)


def test_a_noisy_charge_has_noise_and_one_in_steps_has_steps(drive: Drive, husky: Robot) -> None:
    rng, found = np.random.default_rng(0), []
    for step in (0.0, 0.001):
        recordings = []
        for one in drive(husky, minutes=2.0):
            used_j = np.cumsum(one.channels["power_w"]) * np.diff(
                one.channels["time_s"], prepend=0.0
            )
            soc = 0.9 - used_j / husky.usable_energy_j
            soc = np.round(soc / step) * step if step else soc + 0.002 * rng.normal(size=len(soc))
            recordings.append(replace(one, channels={**one.channels, "soc": soc}))
        sure = uncertainty_of(analyse(recordings, husky))
        assert sure is not None
        found.append(dict(sure.instruments))
    noisy, stepped = found
    assert noisy["soc_noise"] == pytest.approx(0.002, rel=0.1) and noisy["soc_step"] == 0.0
    assert stepped["soc_step"] == pytest.approx(0.001, rel=0.01) and stepped["soc_noise"] == 0.0
    assert noisy["reading_s"] == pytest.approx(np.diff(recordings[0].channels["time_s"]).mean())


def test_of_motor_currents_it_is_of_charge(drive: Drive, husky: Robot) -> None:
    recordings = []
    for one in drive(replace(husky, rolling_resistance=0.1), minutes=3.0):
        amps = 4.0 + 0.1 * one.channels["power_w"]
        channels = {name: values for name, values in one.channels.items() if name != "power_w"}
        recordings.append(
            replace(
                one, channels={**channels, "motor_left_a": 0.5 * amps, "motor_right_a": 0.5 * amps}
            )
        )
    analysis = analyse(recordings, husky)
    sure = uncertainty_of(analysis)
    assert sure is not None and sure.of == "charge" and not sure.instruments
    assert analysis.corrected.rest_current_a > 1.0


def test_what_nothing_explains_is_what_the_file_leaves_of_held_out_windows(off: Analysis) -> None:
    found, evidence = uncertainty_of(off), off.evidence
    assert found is not None and evidence is not None
    residual = evidence.runs.observed - evidence.predictions["file"]
    assert found.unexplained == pytest.approx(
        residual.std() / np.abs(evidence.runs.observed).mean(), rel=0.1
    )
    assert 0.0 < found.unexplained_m < 20.0
    assert dict(found.instruments)["power_noise"] < found.unexplained + 0.05
