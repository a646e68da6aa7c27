"""The vector step is timed beside that of another checkout."""

from pathlib import Path

import pytest

from benchmarks.before_after import Args, SpeedError, Stepper, main


def test_a_checkout_is_stepped_and_settings_that_it_does_not_know_are_left_out(root: Path) -> None:
    for settings in ({"difficulty": "known"}, {"difficulty": "known", "instruments": "of the future"}):
        stepper = Stepper(root, settings, 2)
        assert stepper.decisions_per_s() > 0.0
        stepper.end()


def test_what_is_no_checkout_is_refused(tmp_path: Path, root: Path) -> None:
    with pytest.raises(SpeedError, match="no checkout of homeward"):
        main(Args(tmp_path))
    with pytest.raises(SpeedError, match="cannot be timed"):
        Stepper(root, {"difficulty": "of the future"}, 2)
