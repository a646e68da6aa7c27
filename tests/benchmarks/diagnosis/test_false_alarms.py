"""The diagnosis sees no mismatch where there is none; the benchmark counts over enough drives to know the rate."""

import numpy as np
import pytest

from benchmarks.diagnosis.false_alarms import Args, drive, main, smallest_p_value
from homeward.diagnosis import RecordingError


def test_p_values_are_no_smaller_than_chance_makes_them() -> None:
    """Exactly nominal robots under noise with memory: at one in ten, ten of forty are 0.5 % likely."""
    smallest = np.array([smallest_p_value(drive(seed)) for seed in range(40)])
    assert (smallest <= 0.1).sum() < 10
    assert (smallest < 1.0).any()


def test_the_benchmark_prints_how_often_it_was_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(Args(drives=2)) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("0 false alarms in 2 drives: 0.0% (")
    assert [line.split(":")[0] for line in printed[1:]] == [f"smallest p-value <= {p}" for p in (0.01, 0.1, 0.5)]


def test_no_drives_are_refused() -> None:
    with pytest.raises(RecordingError, match="give at least 1"):
        main(Args(drives=0))
