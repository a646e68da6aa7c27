"""corrected.toml says how sure it is: from what was held out, in shares, and read back by the loader."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.diagnosis.tell.own_uncertainty import uncertainty_of
from homeward.diagnosis.tell.report import write_outputs

Drive = Callable[..., list[Recording]]


@pytest.fixture(scope="module")
def off(drive: Drive, husky: Robot) -> Analysis:
    """Three drives of a Husky that rolls a third harder than its file says."""
    return analyse(drive(husky, minutes=6.0, rolling_resistance=1.33 * husky.rolling_resistance), husky)


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
    missed = off.corrected.rolling_resistance * off.corrected.mass_kg / (1.33 * husky.rolling_resistance * 50.0) - 1.0
    assert 1e-4 < sd < 0.05 and abs(missed) < 5.0 * sd
    assert "3 runs" in found.source and found.between_runs is not None


def test_what_nothing_explains_is_what_the_file_leaves_of_held_out_windows(off: Analysis) -> None:
    found, evidence = uncertainty_of(off), off.evidence
    assert found is not None and evidence is not None
    left = evidence.runs.observed - evidence.predictions["file"]
    assert found.unexplained == pytest.approx(left.std() / np.abs(evidence.runs.observed).mean(), rel=0.1)
    assert 0.0 < found.unexplained_m < 20.0
    assert dict(found.instruments)["power_noise"] < found.unexplained + 0.05
