"""The verdict by precedence, and the steps that lead to it."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Analysis, analyse
from homeward.diagnosis.chain import STAGES, _conclude, _fault_free, _known
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.channel_effects.shown import USABLE_ENERGY, Capacity, ChannelEffect
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.explain.places import Location
from homeward.diagnosis.fit.estimates import Estimate
from homeward.diagnosis.result import Proof
from tests.diagnosis.conftest import Drive


@pytest.fixture(scope="module")
def corrected(scrubbing: Analysis) -> Corrected:
    assert scrubbing.evidence is not None and scrubbing.evidence.corrected is not None
    return scrubbing.evidence.corrected


def wrong(
    evidence: Evidence, nominal_w: float = 30.0, refit_w: float = 1.0, **of_rolling: Any
) -> Evidence:
    """A file that is wrong by so many watts where a refit is by so few, and the estimate of C_rr
    m."""
    sign = np.random.default_rng(0).choice([-1.0, 1.0], int(evidence.block.max()) + 1)[
        evidence.block
    ]
    observed = evidence.runs.observed
    predictions = {"nominal": observed + nominal_w, "refit": observed + refit_w * sign}
    estimates = tuple(
        dataclasses.replace(one, off=True, **of_rolling) if one.group.name == "rolling" else one
        for one in evidence.estimates
    )
    return dataclasses.replace(evidence, predictions=predictions, estimates=estimates)


def located(evidence: Evidence) -> Evidence:
    inside = np.ones(len(evidence.fold), np.bool_)
    return dataclasses.replace(
        evidence, location=Location("anywhere", inside, inside.astype(np.float64), ())
    )


def named(evidence: Evidence) -> Evidence:
    shown = ChannelEffect(
        CATALOGUE["internal_resistance"], {}, np.zeros(1), Proof(None, 0.5, 0.001), (), ""
    )
    return dataclasses.replace(evidence, channel_effects=(shown,))


def short(evidence: Evidence) -> Evidence:
    return dataclasses.replace(evidence, block=evidence.block % 3)


def open_(evidence: Evidence) -> Evidence:
    estimates = tuple(one.confounded(()) for one in evidence.estimates)
    return dataclasses.replace(evidence, estimates=estimates)


def without_nominal(evidence: Evidence) -> Evidence:
    return dataclasses.replace(evidence, predictions={"refit": evidence.predictions["refit"]})


def test_verdicts_by_precedence(faultless_evidence: Evidence) -> None:
    """Each of these by itself, and with all that come after it."""
    off = wrong(faultless_evidence)
    assert _conclude(faultless_evidence)[0] == "no_mismatch"
    assert _conclude(off)[0] == "parameters_off"
    assert (
        _conclude(wrong(faultless_evidence, status="at bound", fitted=None, ci95=None))[0]
        == "unknown_physics"
    )
    assert _conclude(without_nominal(off))[0] == "no_mismatch"
    assert _conclude(open_(off))[0] == "not_testable"
    assert _conclude(located(open_(off)))[0] == "unknown_physics"
    assert _conclude(named(located(open_(off))))[0] == "missing_physics"
    assert _conclude(short(named(located(open_(off))))) == ("not_testable", ())


def test_only_parameters_whose_interval_excludes_the_file_are_off(
    faultless_evidence: Evidence,
) -> None:
    _, off = _conclude(wrong(faultless_evidence))
    assert [one.group for one in off] == ["C_rr m / Gamma"]


@pytest.mark.parametrize(
    ("nominal_w", "refit_w", "verdict"),
    [
        (30.0, 1.0, "parameters_off"),
        (30.0, 29.9, "no_mismatch"),  # hardly better
        (0.3, 0.1, "no_mismatch"),  # within the error of the meter's scale
        (1.0, 30.0, "no_mismatch"),  # worse
    ],
)
def test_a_parameter_is_off_only_if_the_refit_is_better_by_more_than_instruments_explain(
    faultless_evidence: Evidence, nominal_w: float, refit_w: float, verdict: str
) -> None:
    assert _conclude(wrong(faultless_evidence, nominal_w, refit_w))[0] == verdict


def test_one_stretch_in_which_the_refit_is_better_is_no_proof(faultless_evidence: Evidence) -> None:
    off = wrong(faultless_evidence)
    nominal = np.where(
        faultless_evidence.block == 0, off.predictions["refit"] + 300.0, off.predictions["refit"]
    )
    assert (
        _conclude(dataclasses.replace(off, predictions={**off.predictions, "nominal": nominal}))[0]
        == "no_mismatch"
    )


def test_a_capacity_that_differs_is_off_though_power_is_as_predicted(
    faultless_evidence: Evidence,
) -> None:
    capacity = Capacity(1.0e6, 8.0e5, (7.5e5, 8.5e5), True, ("ageing",))
    verdict, off = _conclude(dataclasses.replace(faultless_evidence, capacity=capacity))
    assert verdict == "parameters_off"
    (one,) = off
    assert (one.group, one.assumed, one.fitted, one.confused_with) == (
        USABLE_ENERGY,
        1.0e6,
        8.0e5,
        ("ageing",),
    )
    same = dataclasses.replace(capacity, off=False)
    assert _conclude(dataclasses.replace(faultless_evidence, capacity=same)) == ("no_mismatch", ())
    _, off = _conclude(dataclasses.replace(wrong(faultless_evidence), capacity=same))
    assert [one.group for one in off] == ["C_rr m / Gamma"]


def test_a_fault_of_the_meter_is_taken_out_of_what_it_read_and_physics_is_not(
    corrected: Corrected,
) -> None:
    analysed_w = np.full(len(corrected.predicted), 100.0)
    runs: Any = _Runs(analysed_w)
    np.testing.assert_array_equal(_fault_free(runs, None).observed, analysed_w)
    np.testing.assert_array_equal(_fault_free(runs, corrected).observed, analysed_w)
    fault = dataclasses.replace(
        corrected.model.terms[0], hypothesis=CATALOGUE["sensor_offset"], fixed=True
    )
    model = dataclasses.replace(corrected.model, terms=(fault,))
    np.testing.assert_allclose(
        _fault_free(runs, dataclasses.replace(corrected, model=model)).observed,
        analysed_w - corrected.contribution[0],
    )


@dataclasses.dataclass(frozen=True)
class _Runs:
    observed: np.ndarray


def test_a_group_that_is_held_beside_an_effect_is_confounded_with_it(
    scrubbing: Analysis, corrected: Corrected
) -> None:
    """The refit alone determines it: another value makes up for what turning takes."""
    evidence = scrubbing.evidence
    assert evidence is not None
    held = np.array([one.name == "rolling" for one in corrected.parameters.groups])
    beside = dataclasses.replace(corrected, groups=dataclasses.replace(corrected.groups, held=held))
    known: dict[str, Estimate] = {
        one.group.name: one
        for one in _known(evidence.fitted, beside, evidence.runs, evidence.block)
    }
    assert (known["rolling"].status, known["rolling"].mixed_with) == ("confounded", ("turning",))
    assert known["rolling"].fitted is None
    assert known["idle_power"].fitted == pytest.approx(corrected.theta[0], rel=1e-6)


def test_stages_are_told_in_their_order(short_drive: Drive, husky: Robot) -> None:
    told: list[str] = []
    analyse(short_drive(husky, runs=1), husky, progress=told.append)
    first = list(dict.fromkeys(told))
    assert first == [one for one in STAGES if one in first] and {"reading", "proving"} <= set(
        first
    ) <= set(STAGES)


def test_a_run_by_itself_is_a_list_of_one(short_drive: Drive, husky: Robot) -> None:
    (run,) = short_drive(husky, runs=1)
    dead = dataclasses.replace(run, channels={**run.channels, "power_w": np.zeros(len(run))})
    one, several = analyse(dead, husky), analyse([dead], husky)
    assert one.diagnosis == several.diagnosis and one.evidence is None
    assert [finding.refused for finding in one.findings] == [True]
