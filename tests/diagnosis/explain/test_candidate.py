"""A set of effects is scored at its joint replay, on windows that its fit has not seen."""

from dataclasses import replace

import numpy as np
import pytest

from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.candidate import Candidate, EffectSet, followed
from homeward.diagnosis.explain.catalogue import terms
from homeward.diagnosis.explain.hypothesis import Setting
from homeward.diagnosis.explain.proof import Bench


@pytest.fixture(scope="module")
def turning(scrubbing_evidence: Evidence) -> Candidate:
    """What is concealed, beside the refit."""
    evidence = scrubbing_evidence
    assert evidence.corrected is not None
    rng = np.random.default_rng(0)
    refit, corrected = (
        EffectSet(model, evidence.runs, evidence.block, rng)
        for model in (evidence.fitted, evidence.corrected)
    )
    setting = Setting.of(evidence.fitted, evidence.runs)
    candidates = tuple(term for term in terms(setting, varying=False))
    bench = Bench(evidence.fitted, candidates, evidence.runs, setting.residual, evidence.block)
    index = next(
        index
        for index, term in enumerate(candidates)
        if term.effect == "turning" and not term.flexible
    )
    return Candidate(0, corrected, refit, 0.0, lambda: (bench, index))


def test_the_effect_that_is_concealed_explains_the_held_out_error(turning: Candidate) -> None:
    assert turning.term.effect == "turning"
    assert turning.gain.share > 0.9 and turning.gain.ci95[0] > 0.85
    assert turning.explained == pytest.approx(
        turning.without.squared_error - turning.with_it.squared_error, rel=1e-9
    )  # fmt: skip
    assert turning.delta_bic > 100.0


def test_a_set_is_scored_where_its_fit_has_not_seen_the_windows(turning: Candidate) -> None:
    runs = turning.runs
    in_sample = float(np.sum((runs.observed - turning.with_it.model.predicted) ** 2))
    assert turning.with_it.squared_error > in_sample


def test_what_noise_explains_need_not_be_explained(turning: Candidate) -> None:
    half = replace(turning, noise=0.5 * turning.without.squared_error)
    assert half.gain_beyond_noise == pytest.approx(2.0 * turning.gain_beyond_noise)


def test_what_is_like_a_slope_may_absorb_errors_of_slopes(turning: Candidate) -> None:
    """All of what acts by place, or as a slope does, repeats with the slopes; a turn does not."""
    bench, index = turning.bench, turning.index
    assert followed(bench, index) == 0.0
    of_place = replace(bench, candidates=(replace(bench.candidates[index], axis="place"),))
    assert followed(of_place, 0) == 1.0
    slopes = next(
        index
        for index, term in enumerate(bench.candidates)
        if term.hypothesis.map_channel == "grade_rad"
    )
    assert followed(bench, slopes) == 1.0
