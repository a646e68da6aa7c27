"""A recorded state of charge shows what no power does: how much the battery holds, and whether that shrinks."""

import dataclasses
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Diagnosis, Recording, analyse, diagnose
from homeward.diagnosis.tell.report import write_outputs

Drive = Callable[..., list[Recording]]


def with_charge(runs: Sequence[Recording], robot: Robot, lost: Sequence[float], step: float = 0.001) -> list[Recording]:
    """The runs with the state of charge of a gauge that shows whole steps, its battery having lost a share of all."""
    told = []
    for run, gone in zip(runs, lost, strict=True):
        time_s, power_w = run.channels["time_s"], run.channels["power_w"]
        drawn_j = np.concatenate(([0.0], np.cumsum(power_w[:-1] * np.diff(time_s))))
        soc = 0.95 - drawn_j / (robot.usable_energy_j * (1.0 - gone))
        told.append(dataclasses.replace(run, channels={**run.channels, "soc": np.round(soc / step) * step}))
    return told


@pytest.fixture(scope="module")
def small() -> Robot:
    """A robot whose battery a drive of minutes empties by a good part."""
    return dataclasses.replace(load_robot("husky"), rated_energy_j=1.2e5)


def test_a_battery_that_fades_from_run_to_run_is_named_and_handed_back(
    drive: Drive, small: Robot, tmp_path: Path
) -> None:
    lost = (0.0, 0.08, 0.16, 0.24)
    analysis = analyse(with_charge(drive(small, runs=4), small, lost), small)
    diagnosis = analysis.diagnosis
    assert diagnosis.verdict == "missing_physics"
    (found,) = diagnosis.missing_physics
    low, high = found.parameters["lost_share"].ci95
    assert found.effect == "ageing"
    assert low <= found.parameters["lost_share"].value <= high
    assert found.parameters["lost_share"].value == pytest.approx(0.24, abs=0.03)
    assert {place.recording for place in found.where} >= {"run2.csv", "run3.csv"}
    assert "state of charge" in diagnosis.summary
    assert Diagnosis.from_json(diagnosis.to_json()) == diagnosis
    write_outputs(analysis, tmp_path)
    corrected = tomllib.loads((tmp_path / "corrected.toml").read_text())
    assert corrected["effects"]["ageing"]["lost_share"] == pytest.approx(0.24, abs=0.03)
    assert "not as assumed" not in (tmp_path / "report.html").read_text()


def test_a_battery_that_holds_less_in_all_runs_is_a_parameter_that_is_off(drive: Drive, small: Robot) -> None:
    analysis = analyse(with_charge(drive(small, runs=3), small, (0.3, 0.3, 0.3)), small)
    diagnosis = analysis.diagnosis
    assert diagnosis.verdict == "parameters_off"
    (off,) = diagnosis.parameters_off
    assert off.group == "usable energy"
    assert off.ci95[0] <= 0.7 * small.usable_energy_j <= off.ci95[1]
    assert analysis.corrected.rated_energy_j == pytest.approx(0.7 * small.rated_energy_j, rel=0.02)


@pytest.mark.parametrize("step", [0.0005, 0.01])
def test_a_gauge_that_agrees_is_no_mismatch(drive: Drive, small: Robot, step: float) -> None:
    diagnosis = diagnose(with_charge(drive(small, runs=4), small, (0.0, 0.0, 0.0, 0.0), step), small)
    assert diagnosis.verdict == "no_mismatch"


def test_a_gauge_that_goes_up_and_down_between_runs_is_not_called_ageing(drive: Drive, small: Robot) -> None:
    diagnosis = diagnose(with_charge(drive(small, runs=4), small, (0.0, 0.2, 0.0, 0.2)), small)
    assert not diagnosis.missing_physics


def test_fading_that_goes_with_the_cold_may_be_the_cold(drive: Drive, small: Robot) -> None:
    runs = [
        dataclasses.replace(
            run, channels={**run.channels, "temperature_c": np.full(len(run.channels["time_s"]), 20.0 - 8.0 * index)}
        )
        for index, run in enumerate(drive(small, runs=4))
    ]
    diagnosis = diagnose(with_charge(runs, small, (0.0, 0.08, 0.16, 0.24)), small)
    (found,) = diagnosis.missing_physics
    assert {found.effect, *found.confused_with} == {"ageing", "cold_battery"}
    assert found.to_tell_apart
