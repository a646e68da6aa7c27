"""Runs on different ground are told apart without labels."""

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.diagnosis.real_recordings import group_runs
from homeward import Robot
from homeward.diagnosis import Analysis, Recording, analyse

Drive = Callable[..., list[Recording]]


def renamed(runs: list[Recording], name: str) -> list[Recording]:
    """The runs under other names, as other files."""
    return [Recording(f"{name}{i}.csv", f"{name}{i}", dict(run.channels)) for i, run in enumerate(runs)]


def test_runs_of_little_and_much_scrub_are_two_groups(short_drive: Drive, husky: Robot) -> None:
    ice = renamed(short_drive(husky, runs=3, effects={"turning": {"scrub": 0.15}}), "ice")
    floor = renamed(short_drive(husky, runs=3, effects={"turning": {"scrub": 0.5}}), "floor")
    found = group_runs(analyse([*ice, *floor], husky))
    groups = found.group.tolist()
    assert len(set(groups[:3])) == 1 and len(set(groups[3:])) == 1 and groups[0] != groups[3]
    turning = found.sizes[:, found.quantities.index("turning")]
    assert np.all(turning[:3] < 0.6 * turning[3:].min())


def test_nothing_named_is_nothing_to_group_by(faultless: Analysis) -> None:
    with pytest.raises(ValueError, match="no effect was named"):
        group_runs(faultless)
