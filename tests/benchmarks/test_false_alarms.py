"""The diagnosis sees no mismatch where there is none; the benchmark counts over enough drives to know the rate."""

import pytest

from benchmarks.false_alarms import Args, main
from homeward.diagnosis import RecordingError


def test_false_alarms_are_as_rare_as_stated(capsys: pytest.CaptureFixture[str]) -> None:
    """Exactly nominal robots under noise with memory: at one alarm in a hundred, two in ten are 0.4 % likely."""
    assert main(Args(drives=10)) <= 1
    assert "false alarms in 10 drives: " in capsys.readouterr().out


def test_no_drives_are_refused() -> None:
    with pytest.raises(RecordingError, match="give at least 1"):
        main(Args(drives=0))
