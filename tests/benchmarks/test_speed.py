"""What is timed is what is said to be timed."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import speed
from benchmarks.speed import SIZES, TARGETS, THREE, paired, robot_with, some_actions
from homeward.physics import EFFECTS, load_robot


def test_effects_are_on_and_change_nothing() -> None:
    assert robot_with("no effects").active_effects == ()
    assert set(robot_with("3 effects").active_effects) == set(THREE)
    everything = robot_with("all effects")
    assert set(everything.active_effects) == {effect.id for effect in EFFECTS}
    assert everything.usable_energy_j == load_robot("rusti_computer").usable_energy_j


def test_actions_are_any_speed_and_rate_with_few_stops_and_returns() -> None:
    actions = np.array(some_actions(1000))
    assert actions.shape == (100, 1000, 3)
    for column, levels in ((0, 5), (1, 5)):
        np.testing.assert_allclose(
            np.bincount(actions[..., column].ravel()) / 1e5, 1.0 / levels, rtol=0.05
        )
    stops, goes, returns = np.bincount(actions[..., 2].ravel()) / 1e5
    assert (stops, goes) == (pytest.approx(0.098, rel=0.05), pytest.approx(0.9, rel=0.01))
    assert returns == pytest.approx(0.002, rel=0.3)


def test_a_ratio_is_the_median_over_pairs_and_no_ratio_of_medians(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The median pair has ours twice as fast; the medians are of different pairs."""
    monkeypatch.setattr(speed, "PAIRS", 3)
    clock_s = itertools.accumulate([0.0, 2.0, 0.0, 1.0, 0.0, 4.0, 0.0, 4.0, 0.0, 40.0, 0.0, 10.0])
    monkeypatch.setattr(speed, "time", SimpleNamespace(perf_counter=lambda: next(clock_s)))
    called = []
    found = paired(lambda: called.append("peer"), lambda: called.append("ours"))
    assert found == (4.0, 4.0, 2.0)
    assert called == ["peer", "ours"] * 4  # once before, for what is compiled


def test_every_size_has_a_target() -> None:
    assert all(len(of) == len(SIZES) and list(of) == sorted(of) for of in TARGETS.values())
