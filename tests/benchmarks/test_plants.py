from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import homeward
from benchmarks.plants.case import Case, Run, anonymous, read_truth, write
from homeward.diagnosis.recordings import read_recording


@pytest.fixture
def case() -> Case:
    time_s = np.arange(50) / 10.0
    run = Run({"time_s": time_s, "speed_mps": 1.0 + 0.0 * time_s, "power_w": 50.0 + time_s}, time_s > 2.0)
    robot = homeward.load_robot("husky")
    return Case(anonymous("plant", 3), "plant", "single", ("standby",), "low", 3, robot, (run, run), 0.1)


def test_written_case_keeps_the_truth_out_of_sight(case: Case, tmp_path: Path) -> None:
    paths = write(case, tmp_path / "seen", tmp_path / "truth")
    assert sorted(p.name for p in (tmp_path / "seen" / case.name).iterdir()) == ["robot.toml", *(p.name for p in paths)]
    np.testing.assert_allclose(read_recording(paths[0]).channels["power_w"], case.runs[0].channels["power_w"])
    known = read_truth(tmp_path / "truth", case.name)
    assert (known.truth, known.kind, known.noise, known.seed) == (("standby",), "single", "low", 3)
    np.testing.assert_array_equal(known.affected[1], case.runs[1].affected)


def test_truth_beside_the_recordings_is_refused(case: Case, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="separate"):
        write(case, tmp_path, tmp_path / "truth")
