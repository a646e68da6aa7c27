"""Scores by the integrals that define them, and the transform of calibrated and other
predictions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest
from scipy.stats import t as student

from homeward.estimation.tails import deviations
from homeward.estimation.thresholds import DEGREES
from homeward.watch import scores
from homeward.watch.predictions import Watched

HALF = deviations(0.95)


def predicted(took_j: Any, mean_j: float = 5.0, scale_j: float = 1.5) -> Watched:
    took = np.atleast_1d(np.asarray(took_j, float))
    mean, half = np.full_like(took, mean_j), np.full_like(took, HALF * scale_j)
    return Watched(
        "a run", took, took, took, mean, np.maximum(mean - half, 0.0), mean + half, 9.0, (), ()
    )


def test_scores_are_those_of_their_definitions() -> None:
    pytest.importorskip("scoringrules", reason="needs the extra scores")
    took_j = np.array([3.0, 5.0, 9.5])
    found = scores.scores_of(predicted(took_j))
    x = np.linspace(-200.0, 200.0, 100_001)
    for crps, truth in zip(found.crps, took_j, strict=True):
        square = (student.cdf((x - 5.0) / 1.5, DEGREES) - (x >= truth)) ** 2
        assert crps == pytest.approx(np.trapezoid(square, x), rel=2e-3)
    width = 2.0 * HALF * 1.5
    assert found.interval[:2] == pytest.approx(width)
    assert found.interval[2] == pytest.approx(width + 20.0 * (9.5 - 5.0 - 0.5 * width))


def test_the_transform_is_uniform_where_predictions_are_calibrated() -> None:
    drawn = 5.0 + 1.5 * student.rvs(DEGREES, size=4000, random_state=0)
    assert kstest(scores.transforms_of(predicted(drawn)), "uniform").pvalue > 0.01
    narrow = scores.transforms_of(predicted(drawn, scale_j=0.5))
    assert np.mean((narrow < 0.1) | (narrow > 0.9)) > 0.4
    assert scores.transforms_of(predicted(drawn, mean_j=9.0)).mean() < 0.2
    held_at_0 = predicted(1.0, mean_j=1.0)  # its lower end says nothing of the spread
    assert held_at_0.low_j[0] == 0.0 and scores.scales_of(held_at_0)[0] == pytest.approx(1.5)


def test_without_scoringrules_a_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scores, "find_spec", lambda name: None)
    lacking = scores.missing()
    assert lacking is not None and lacking.startswith(
        "No CRPS and no interval score: they need scoringrules, pip install"
    )
