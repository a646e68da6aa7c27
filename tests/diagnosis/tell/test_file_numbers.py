"""Every number of corrected.toml that was changed says whether it is proven, and its one interval,
within the bounds of its quantity."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Analysis, Recording
from homeward.diagnosis.result import Diagnosis, FileNumber
from homeward.diagnosis.tell.corrected import ROUNDING
from homeward.diagnosis.tell.report import corrected_toml, report_html
from homeward.diagnosis.tell.words import UNLIMITED
from homeward.physics.effects import EFFECTS
from tests.diagnosis.conftest import Analyse
from tests.diagnosis.explain.test_channel_effects import at_terminals, with_charge
from tests.diagnosis.explain.test_naming import replayed_w
from tests.diagnosis.made_up import ends

Drive = Callable[..., list[Recording]]
Made = tuple[list[Recording], Robot]
"""Recordings, and the robot of their file."""


def of_rolling(drive: Drive, husky: Robot) -> Made:
    """A robot that rolls harder than its file says."""
    return drive(husky, rolling_resistance=0.2), husky


def of_recovery(drive: Drive, husky: Robot) -> Made:
    """A robot that recovers energy without a limit, and has rotating parts."""
    robot = dataclasses.replace(husky, rolling_resistance=0.2 * husky.rolling_resistance)
    effects = {"regeneration": {"share": 0.6}, "inertia": {"mass_factor": 1.2}}
    return drive(robot, runs=3, effects=effects), robot


def of_currents(drive: Drive, husky: Robot) -> Made:
    """Motor currents that are the same at any speed, and larger in turns: rolling takes next to
    nothing."""
    rng = np.random.default_rng(1)
    runs = []
    for number in range(6):
        time_s = np.arange(0.0, 300.0, 0.15)
        stretches = len(time_s) // 40
        turns = np.repeat(rng.random(stretches) < 1.0 / 3.0, 40)
        speed_mps = np.where(turns, 0.0, np.repeat(rng.uniform(0.2, 0.9, stretches), 40))
        yaw_radps = np.where(turns, np.repeat(rng.uniform(0.5, 1.5, stretches), 40), 0.0)
        current_a = 7.5 + 14.0 * turns + rng.normal(0.0, 0.8, len(turns))
        channels = {
            "time_s": time_s[: len(turns)],
            "wheel_left_mps": speed_mps - 0.285 * yaw_radps,
            "wheel_right_mps": speed_mps + 0.285 * yaw_radps,
            "motor_left_a": current_a / 2.0,
            "motor_right_a": current_a / 2.0,
        }
        runs.append(Recording(f"run{number}.csv", str(number), channels))
    return runs, husky


def of_worn_battery(drive: Drive, husky: Robot) -> Made:
    """A battery that holds less than its file says."""
    tiny = dataclasses.replace(husky, rated_energy_j=2.6e4)
    return with_charge(drive(tiny, runs=3), tiny, (0.3, 0.3, 0.3)), tiny


def of_resistance(drive: Drive, husky: Robot) -> Made:
    """A battery whose voltage sags."""
    return at_terminals(drive(husky), 0.15), husky


def of_uneven_runs(drive: Drive, husky: Robot) -> Made:
    """Runs that draw more and less for no recorded reason."""
    recordings = []
    for number, run in enumerate(drive(husky, rolling_resistance=1.3 * husky.rolling_resistance)):
        power_w = run.channels["power_w"] * (1.0 + 0.05 * (-1) ** number)
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    return recordings, husky


def of_rough_ground(drive: Drive, husky: Robot) -> Made:
    """Ground that rolls harder between 40 and 75 m from base."""
    rough = dataclasses.replace(husky, rolling_resistance=1.4 * husky.rolling_resistance)
    recordings = []
    for run in drive(husky, runs=3, minutes=6.0):
        way_m = np.cumsum(np.abs(run.channels["speed_mps"]) * np.gradient(run.channels["time_s"]))
        base_m = np.minimum(way_m, way_m[-1] - way_m)
        is_rough = (base_m > 40.0) & (base_m < 75.0)
        more_w = (replayed_w(rough, run) - replayed_w(husky, run)) * is_rough
        power_w = run.channels["power_w"] + more_w
        channels = {**run.channels, "base_distance_m": base_m, "power_w": power_w}
        recordings.append(dataclasses.replace(run, channels=channels))
    return recordings, husky


MADE = [
    of_rolling,
    of_recovery,
    of_currents,
    of_worn_battery,
    of_resistance,
    of_uneven_runs,
    of_rough_ground,
]


@pytest.fixture(scope="module", params=MADE, ids=lambda made: made.__name__)
def analysis(
    request: pytest.FixtureRequest, short_drive: Drive, husky: Robot, analyse_once: Analyse
) -> Analysis:
    return analyse_once(*request.param(short_drive, husky))


def changed_lines(analysis: Analysis) -> list[str]:
    """Lines of numbers in corrected.toml that the given file does not have."""
    given = {line.split("  #")[0] for line in analysis.robot.to_toml().splitlines()}
    of_robot = corrected_toml(analysis).split("[uncertainty]")[0]
    changed = [line for line in of_robot.splitlines() if line.split("  #")[0] not in given]
    return [line for line in changed if " = " in line.split("#")[0]]


def test_every_changed_number_says_how_sure_it_is_and_has_an_interval(analysis: Analysis) -> None:
    lines = changed_lines(analysis)
    assert lines
    for line in lines:
        _, _, comment = line.partition("  # by diagnose.py, ")
        assert comment.startswith(("proven: ", "fitted, not proven: ")), line
        assert " to " in comment or UNLIMITED in comment, line


def test_an_interval_holds_its_number_and_never_leaves_the_bounds(analysis: Analysis) -> None:
    for number in numbers_of(analysis):
        if number.ci95 is None:
            assert not number.proven
            continue
        low, high = number.ci95
        margin = ROUNDING * abs(number.value)
        assert low - margin <= number.value <= high + margin, number
        least, most = bounds(number.name)
        assert least <= low <= high <= most, number
        assert (low, high) != (least, most), number
        is_size = " " not in number.name or " / " in number.name
        assert not (number.proven and is_size and low <= 0.0), number


def test_what_the_report_measures_has_the_same_interval_in_the_file(analysis: Analysis) -> None:
    measured = measured_by(analysis.diagnosis)
    for number in numbers_of(analysis):
        if number.proven and number.name in measured:
            assert ends(number) == pytest.approx(measured[number.name]), number
    page = report_html(analysis)
    for number in numbers_of(analysis):
        if number.ci95 is None:
            assert UNLIMITED in page


def numbers_of(analysis: Analysis) -> tuple[FileNumber, ...]:
    assert analysis.diagnosis.file is not None
    return analysis.diagnosis.file.numbers


def bounds(name: str) -> tuple[float, float]:
    """Bounds of a number by its name: those of an effect's parameter, or of what is not
    negative."""
    of_effects = {
        f"{effect.id} {parameter.name}": (parameter.low, parameter.high)
        for effect in EFFECTS
        for parameter in effect.parameters
    }
    return of_effects.get(name, (0.0, math.inf))


def measured_by(diagnosis: Diagnosis) -> dict[str, tuple[float, float]]:
    """Intervals of the report, by the names of corrected.toml."""
    measured = {}
    for group in (*diagnosis.parameters, *diagnosis.parameters_off):
        measured[group.group] = group.ci95
    for effect in diagnosis.missing_physics:
        for name, value in effect.parameters.items():
            if value.ci95 is not None:
                measured[f"{effect.effect} {name}"] = value.ci95
    return measured
