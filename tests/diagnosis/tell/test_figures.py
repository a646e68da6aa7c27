"""Plots of the report: the worst run first, all values within the axes, and means with their errors
in a table."""

import base64
import dataclasses
import json
import re
from typing import Any

import numpy as np
import pytest

from homeward.diagnosis import Analysis
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.tell.figures import conditions, time_figure
from homeward.layout.plots import MOST_RUNS
from tests.diagnosis.made_up import windows


def traces(page: str) -> list[dict[str, Any]]:
    """What a figure draws."""
    data = re.search(r'Plotly\.newPlot\(\s*"[^"]*",\s*(\[.*?\]),\s*\{"', page, re.DOTALL)
    assert data is not None
    found: list[dict[str, Any]] = json.loads(data[1])
    return found


def of_simple_runs(
    analysis: Analysis, runs: Runs, error_w: np.ndarray
) -> tuple[Analysis, Evidence]:
    """Nothing named or located, and a refit with this error."""
    assert analysis.evidence is not None
    evidence = dataclasses.replace(
        analysis.evidence, runs=runs, predictions={"refit": runs.observed - error_w}, location=None
    )
    diagnosis = dataclasses.replace(analysis.diagnosis, missing_physics=())
    return dataclasses.replace(analysis, diagnosis=diagnosis, evidence=evidence), evidence


def test_the_run_with_the_largest_error_comes_first(scrubbing: Analysis) -> None:
    runs = windows(40, runs=3)
    _, choices = time_figure(*of_simple_runs(scrubbing, runs, np.array([1.0, 3.0, -2.0])[runs.run]))
    assert [one["name"] for one in choices] == ["1.csv", "2.csv", "0.csv"]
    assert [one["number"] for one in choices] == [0, 1, 2]
    assert {(one["start_s"], one["end_s"], one["length_s"]) for one in choices} == {
        (0.0, 19.5, 19.5)
    }


def test_of_many_runs_only_the_worst_are_drawn(scrubbing: Analysis) -> None:
    runs = windows(20, runs=MOST_RUNS + 3)
    _, choices = time_figure(*of_simple_runs(scrubbing, runs, runs.run.astype(np.float64)))
    assert [one["name"] for one in choices] == [f"{run}.csv" for run in range(MOST_RUNS + 2, 2, -1)]


@pytest.mark.parametrize("start_s", [0.0, 600.0])
def test_a_long_run_opens_on_its_worst_two_minutes(start_s: float, scrubbing: Analysis) -> None:
    """However small the errors are, and from the first window on."""
    runs = windows(2000)  # a thousand seconds
    error_w = np.where((runs.time_s > start_s) & (runs.time_s < start_s + 120.0), 0.05, 0.01)
    _, (choice,) = time_figure(*of_simple_runs(scrubbing, runs, error_w))
    assert choice["start_s"] == pytest.approx(start_s, abs=0.1)
    assert choice["end_s"] - choice["start_s"] == pytest.approx(120.0)


def test_every_line_fits_into_the_axes_which_hold_zero(scrubbing: Analysis) -> None:
    runs = windows(40, observed=np.linspace(80.0, 120.0, 40))
    _, (choice,) = time_figure(*of_simple_runs(scrubbing, runs, np.linspace(0.0, 20.0, 40)))
    assert choice["low"] < 0.0 and 120.0 < choice["high"] < 140.0
    _, (charging,) = time_figure(
        *of_simple_runs(scrubbing, windows(40, observed=-50.0), np.zeros(40))
    )
    assert charging["low"] < -50.0 and charging["high"] > 0.0


def test_a_long_line_is_drawn_by_means_of_neighbours(scrubbing: Analysis) -> None:
    saw_w = 100.0 + np.where(np.arange(5000) % 3 == 0, 30.0, 0.0)
    page, _ = time_figure(*of_simple_runs(scrubbing, windows(5000, observed=saw_w), np.zeros(5000)))
    recorded = next(one for one in traces(page) if one["name"] == "recorded")
    shown = np.frombuffer(base64.b64decode(recorded["y"]["bdata"]), recorded["y"]["dtype"])
    assert len(shown) == -(-5000 // 3)  # fewer than two thousand
    np.testing.assert_allclose(shown[:-1], 110.0)


def test_an_effect_is_shown_against_its_channel_before_and_after(
    scrubbing: Analysis, scrubbing_evidence: Evidence
) -> None:
    (found,) = conditions(scrubbing, scrubbing_evidence)
    assert found["dependence"].channel.name == "yaw_rate_radps" and found["effects"] == ["turning"]
    assert found["after"] is not None
    centres = [centre for centre, _ in found["rows"]]
    assert centres == sorted(centres) and len(centres) > 3
    before, after = (np.array([row[which][0] for _, row in found["rows"]]) for which in (0, 1))
    assert np.ptp(before) > 5.0 * np.ptp(after)


def test_a_residual_that_is_the_same_everywhere_has_that_mean_and_no_error(
    scrubbing: Analysis, scrubbing_evidence: Evidence
) -> None:
    unnamed = dataclasses.replace(
        scrubbing, diagnosis=dataclasses.replace(scrubbing.diagnosis, missing_physics=())
    )
    predictions = {"refit": scrubbing_evidence.runs.observed - 5.0}
    (found,) = conditions(unnamed, dataclasses.replace(scrubbing_evidence, predictions=predictions))
    assert found["effects"] == [] and found["after"] is None
    assert found["dependence"] is scrubbing_evidence.dependences[0]
    for _, ((mean, half),) in found["rows"]:
        assert (mean, half) == (pytest.approx(5.0), pytest.approx(0.0, abs=1e-9))


def test_the_error_of_a_mean_counts_blocks_and_not_windows(
    scrubbing: Analysis, scrubbing_evidence: Evidence
) -> None:
    """A residual of its own in each block: twice the windows of a block say nothing more."""
    unnamed = dataclasses.replace(
        scrubbing, diagnosis=dataclasses.replace(scrubbing.diagnosis, missing_physics=())
    )
    dependence = dataclasses.replace(
        scrubbing_evidence.dependences[0],
        bin=np.zeros_like(scrubbing_evidence.fold),
        centre=np.zeros(1),
        effect=np.zeros(1),
    )
    length = 20
    block = np.arange(len(scrubbing_evidence.fold)) // length
    sign = np.random.default_rng(0).choice([-1.0, 1.0], block.max() + 1)[block]
    made = dataclasses.replace(
        scrubbing_evidence,
        dependences=(dependence,),
        block=block,
        predictions={"refit": scrubbing_evidence.runs.observed - sign},
    )
    (found,) = conditions(unnamed, made)
    ((_, ((_, half),)),) = found["rows"]
    assert half == pytest.approx(1.96 / np.sqrt(block.max() + 1), rel=0.05)
