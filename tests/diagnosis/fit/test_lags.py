"""Lags of a slope and drifts of a clock are found with their size and sign, and none where there
are none."""

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis.fit.lags import drive_columns, late_slope, without_drift
from homeward.diagnosis.read.signals import Signals, signals
from homeward.logs.recordings import Recording
from tests.diagnosis.hills import ROBOTS, Spoil, late, only, recordings


def read(spoil: Spoil, robot: Robot, count: int = 1) -> tuple[list[Signals], list[Recording]]:
    found = recordings(robot.name, spoil)[:count]
    return [signals(one, robot) for one in found], found


@pytest.mark.parametrize("lag_s", [0.0, 3.0, 8.37])
def test_a_slope_that_is_late_is_found_with_its_lag(lag_s: float, husky: Robot) -> None:
    runs, found = read(lambda of, rng: late(only(of, "grade_rad"), "grade_rad", lag_s), husky)
    assert late_slope(runs, found, husky) == pytest.approx(lag_s, abs=0.1)


@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(lambda of, rng: late(only(of, "grade_rad"), "grade_rad", -3.0), id="early"),
        pytest.param(lambda of, rng: late(only(of, "grade_rad"), "power_w", 2.0), id="late power"),
        pytest.param(lambda of, rng: only(of), id="no slope"),
    ],
)  # fmt: skip
def test_what_is_no_late_slope_is_not_corrected(spoil: Spoil, husky: Robot) -> None:
    """Filters are causal, and late power is named as a fault of an instrument."""
    runs, found = read(spoil, husky)
    assert late_slope(runs, found, husky) == 0.0
    assert without_drift(runs, husky) == (runs, {})


@pytest.mark.parametrize("drift_s", [1.5, -1.5])
def test_a_clock_that_falls_back_is_set_forward_and_one_that_runs_ahead_back(
    drift_s: float, husky: Robot
) -> None:
    plain, _ = read(lambda of, rng: only(of, "grade_rad"), husky)
    runs, _ = read(
        lambda of, rng: late(only(of, "grade_rad"), "power_w", drift_s * of["time_s"] / 250.0),
        husky,
    )
    fixed, drifts = without_drift(runs, husky)
    assert list(drifts) == [run.name for run in runs]
    assert list(drifts.values()) == pytest.approx([drift_s] * len(runs), abs=0.2)
    for true, spoilt, mended in zip(plain, runs, fixed, strict=True):
        middle = slice(50, -50)
        before, after = (
            float(np.std((one.observed - true.observed)[middle])) for one in (spoilt, mended)
        )
        assert after < 0.5 * before


def test_a_short_run_has_no_drift(husky: Robot) -> None:
    runs, _ = read(
        lambda of, rng: late(only(of, "grade_rad"), "power_w", of["time_s"] / 100.0), husky
    )
    short = [run.only(run.time_s < 90.0) for run in runs]
    assert without_drift(short, husky) == (short, {})


def test_columns_are_those_of_the_drive(husky: Robot) -> None:
    """Power by the model of a robot without losses or gradients is a sum of them."""
    (run, *_), _ = read(lambda of, rng: only(of, "grade_rad"), husky)
    columns = drive_columns(run, husky, run.grade_rad)
    assert columns.shape[0] == len(run.time_s) and np.isfinite(columns).all()
    weights = np.linalg.lstsq(columns, run.observed, rcond=None)[0]
    unexplained = run.observed - columns @ weights
    assert float(np.var(unexplained)) < 0.01 * float(np.var(run.observed))
    flat = drive_columns(run, husky, 0.0 * run.grade_rad)
    weights = np.linalg.lstsq(flat, run.observed, rcond=None)[0]
    assert float(np.var(run.observed - flat @ weights)) > 0.1 * float(np.var(run.observed))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("drift_s", [0.0, 0.4, 2.0])
def test_a_drifting_clock_is_set_right(name: str, drift_s: float) -> None:
    runs = recordings(
        name, lambda c, rng: late(only(c, "grade_rad"), "power_w", drift_s * c["time_s"] / 250.0)
    )
    robot = load_robot(name)
    _, drifts = without_drift([signals(one, robot) for one in runs], robot)
    assert len(drifts) == (3 if drift_s else 0)
    assert all(found == pytest.approx(drift_s, abs=0.2) for found in drifts.values())
