"""The sentences of a diagnosis: what is off by how much, where, and what could not be used."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from homeward.diagnosis import Analysis
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.channel_effects.shown import USABLE_ENERGY
from homeward.diagnosis.explain.places import Location
from homeward.diagnosis.fit.estimates import Estimate
from homeward.diagnosis.fit.usable import Finding
from homeward.diagnosis.result import CorrectedFile, FileNumber, Fit, FittedGroup, Place, Value
from homeward.diagnosis.tell.words import nothing_usable, spanned, summary, why_open

KEPT = CorrectedFile("nominal", "nothing is to be corrected")


@pytest.fixture(scope="module")
def evidence(faultless_evidence: Evidence) -> Evidence:
    return faultless_evidence


@pytest.fixture(scope="module")
def fit(faultless: Analysis) -> Fit:
    assert faultless.diagnosis.fit is not None
    return faultless.diagnosis.fit


def refused(number: int, text: str = "has no power") -> Finding:
    return Finding(f"data/run{number}.csv", text, refused=True)


def said(
    verdict: Any,
    evidence: Evidence,
    fit: Fit,
    off: tuple[FittedGroup, ...] = (),
    findings: Any = (),
) -> str:
    return summary(verdict, evidence, off, fit, findings, (), KEPT)


@pytest.mark.parametrize(
    ("findings", "text"),
    [
        ([refused(0)], "None of the recordings can be used: run0.csv has no power."),
        (
            [refused(0, "is it in km/h?")],
            "None of the recordings can be used: run0.csv is it in km/h?",
        ),
        (
            [Finding("kept.csv", "has gaps"), *(refused(number) for number in range(5))],
            "None of the recordings can be used: run0.csv has no power; run1.csv has no power; run2.csv has no power; "
            "and 2 more.",
        ),
    ],
)
def test_the_reasons_why_no_run_can_be_used_are_said_of_three(
    findings: list[Finding], text: str
) -> None:
    assert nothing_usable(findings) == text


def estimate(evidence: Evidence, **changes: Any) -> Estimate:
    return dataclasses.replace(evidence.estimates[0], **changes)


def test_a_value_that_is_limited_from_one_side_states_its_limit() -> None:
    value = Value(0.95, (0.826, 0.95), "1")
    assert spanned(value) == "0.826 to 0.950"
    assert spanned(dataclasses.replace(value, limit="at least")) == "at least 0.826"
    assert spanned(dataclasses.replace(value, limit="at most")) == "at most 0.950"


@pytest.mark.parametrize(
    ("status", "mixed", "text"),
    [
        ("not excited", (), "has no influence on these recordings"),
        ("confounded", ("c / Gamma", "turning"), "is confounded with c / Gamma, turning"),
        ("too uncertain", (), "its interval is too wide"),
        ("attenuated", (), "errors of its channel make it too small"),
        ("at bound", (), "fitted at its physical bound, so not a measurement"),
    ],
)
def test_a_group_without_a_value_has_a_reason(
    evidence: Evidence, status: str, mixed: tuple[str, ...], text: str
) -> None:
    assert why_open(estimate(evidence, status=status, mixed_with=mixed)) == text


def located(evidence: Evidence, excess_w: float, places: tuple[Place, ...] = ()) -> Evidence:
    """The first twentieth of all windows is predicted too low by so much more than everything
    else."""
    inside = np.arange(len(evidence.runs.observed)) < len(evidence.runs.observed) // 20
    refit = evidence.runs.observed - np.where(inside, excess_w, 0.0) - 3.0
    location = Location(
        "driving faster than 0.5 m/s", inside, np.where(inside, excess_w, 0.0), places
    )
    return dataclasses.replace(
        evidence, location=location, predictions={**evidence.predictions, "refit": refit}
    )


PLACES = (
    Place("a/run0.csv", 0.0, 10.0, "after 20 s", 0.5),
    Place("a/run1.csv", 0.0, 10.0, "before 10 s", 0.3),
)


@pytest.mark.parametrize(
    ("excess_w", "places", "text"),
    [
        (
            12.0,
            (),
            ": driving faster than 0.5 m/s, the robot draws 12 W more than the model predicts",
        ),
        (
            -12.0,
            (),
            ": driving faster than 0.5 m/s, the robot draws 12 W less than the model predicts",
        ),
        (
            12.0,
            PLACES,
            ": after 20 s in run0.csv and in 1 more stretch of time, the robot draws 12 W more",
        ),
    ],
)
def test_a_mismatch_without_a_name_is_said_by_place_and_size(
    evidence: Evidence, fit: Fit, excess_w: float, places: tuple[Place, ...], text: str
) -> None:
    found = said("unknown_physics", located(evidence, excess_w, places), fit)
    assert text in found and "No known effect explains it" in found
    assert ("80% of the unexplained excess" in found) == bool(places)


def test_a_mismatch_at_no_place_or_at_a_bound_says_so(evidence: Evidence, fit: Fit) -> None:
    nowhere = Location(
        "in some stretches of time", np.zeros(len(evidence.fold), np.bool_), np.zeros(1), ()
    )
    found = said("unknown_physics", dataclasses.replace(evidence, location=nowhere), fit)
    assert "and no stretch of time stands out." in found
    bound = dataclasses.replace(
        evidence,
        estimates=(estimate(evidence, status="at bound"), *evidence.estimates[1:]),
        location=None,
    )
    assert "ends at a physical bound (P_anc, idle part)" in said("unknown_physics", bound, fit)


def test_a_parameter_that_is_off_is_said_with_both_values(evidence: Evidence, fit: Fit) -> None:
    off = FittedGroup("c / Gamma", 0.186, 8.0, (7.0, 9.0), "N s^2/m^2")
    found = said("parameters_off", evidence, fit, (off,))
    assert "its parameters are off: c / Gamma is 8 N s^2/m^2, not 0.186." in found
    assert "corrected.toml keeps the robot as it was: nothing is to be corrected." in found
    assert "which of them is not identifiable" in said("parameters_off", evidence, fit)
    energy = FittedGroup(USABLE_ENERGY, 1.0e6, 8.0e5, (7.0e5, 9.0e5), "J", ("ageing",))
    found = said("parameters_off", evidence, fit, (energy,))
    assert (
        "but not how fast the state of charge falls: usable energy is 8e+05 J, not 1e+06" in found
    )
    assert "(or as much is lost by ageing)" in found and "its parameters are off" not in found


def test_a_file_with_another_battery_is_not_said_to_be_as_it_was(
    evidence: Evidence, fit: Fit
) -> None:
    energy = FileNumber("usable energy", 8.0e5, (7.0e5, 9.0e5), "J", proven=True)
    file = dataclasses.replace(KEPT, numbers=(energy,))
    text = summary("parameters_off", evidence, (), fit, (), (), file)
    assert "corrected.toml keeps all but the battery as it was" in text


def test_what_tests_nothing_says_what_is_needed(evidence: Evidence, fit: Fit) -> None:
    short = dataclasses.replace(evidence, block=np.zeros_like(evidence.block))
    assert "they hold 1 independent stretches and 16 are needed" in said("not_testable", short, fit)
    still = dataclasses.replace(
        evidence,
        estimates=tuple(
            dataclasses.replace(one, status="not excited") for one in evidence.estimates
        ),
    )
    assert "(P_anc, idle part: has no influence on these recordings; " in said(
        "not_testable", still, fit
    )


def test_a_low_r2_is_no_praise_of_the_file(evidence: Evidence, fit: Fit) -> None:
    assert "The robot file explains the recorded battery power" in said(
        "no_mismatch", evidence, fit
    )
    arms = {**fit.arms, "refit": dataclasses.replace(fit.arms["refit"], r2=0.5)}
    found = said("no_mismatch", evidence, dataclasses.replace(fit, arms=arms))
    assert (
        "do not contradict the robot file" in found
        and "explains the recorded battery power" not in found
    )


def test_without_thrust_per_ampere_only_the_structure_is_said_to_explain(
    evidence: Evidence, fit: Fit
) -> None:
    unpredicted = dataclasses.replace(
        evidence, predictions={"refit": evidence.predictions["refit"]}
    )
    text = said("no_mismatch", unpredicted, dataclasses.replace(fit, unit="A"))
    assert (
        "The model's structure explains the recorded motor current; the robot file gives no thrust"
        in text
    )
    assert "robot file explains" not in text
    arms = {**fit.arms, "refit": dataclasses.replace(fit.arms["refit"], r2=0.5)}
    text = said("no_mismatch", unpredicted, dataclasses.replace(fit, unit="A", arms=arms))
    assert (
        "The recordings do not contradict the model's structure; the robot file gives no thrust"
        in text
    )


def test_a_low_r2_names_slopes_that_were_not_recorded_where_the_residual_drifts(
    evidence: Evidence, fit: Fit
) -> None:
    """White noise points to no channel, and a high R^2 needs none."""
    context = {
        name: values for name, values in evidence.runs.context.items() if name != "grade_rad"
    }
    unrecorded = dataclasses.replace(
        evidence, runs=dataclasses.replace(evidence.runs, context=context)
    )
    arms = {**fit.arms, "refit": dataclasses.replace(fit.arms["refit"], r2=0.5)}
    low = dataclasses.replace(fit, arms=arms)
    drift_w = 50.0 * np.sin(evidence.runs.time_s / 20.0)
    noise_w = 50.0 * np.random.default_rng(0).standard_normal(len(drift_w))

    def asks(of: Evidence, fit: Fit, residual: np.ndarray) -> bool:
        predictions = {**of.predictions, "refit": of.runs.observed - residual}
        found = said("no_mismatch", dataclasses.replace(of, predictions=predictions), fit)
        return (
            "of the variance: slopes that these runs, or some of them, lack (grade_rad or elevation_m)"
            in found
        )

    assert asks(unrecorded, low, drift_w)
    in_one_run = {
        **context,
        "grade_rad": np.where(evidence.runs.run == 0, np.nan, evidence.runs.context["grade_rad"]),
    }
    assert asks(
        dataclasses.replace(evidence, runs=dataclasses.replace(evidence.runs, context=in_one_run)),
        low,
        drift_w,
    )
    assert not asks(unrecorded, low, noise_w)
    assert not asks(unrecorded, fit, drift_w)
    assert not asks(evidence, low, drift_w)


@pytest.mark.parametrize("verdict", ["no_mismatch", "parameters_off"])
def test_where_an_unrecorded_channel_may_be_why_no_dependence_is_denied(
    verdict: str, evidence: Evidence, fit: Fit
) -> None:
    denied = "the residual depends on no recorded channel"
    assert denied in said(verdict, evidence, fit)
    asks = dataclasses.replace(
        evidence, naming=dataclasses.replace(evidence.naming, unrecorded=True)
    )
    found = said(verdict, asks, fit)
    assert denied not in found and "The robot file explains" not in found and ".." not in found


def test_runs_that_were_set_aside_are_counted(evidence: Evidence, fit: Fit) -> None:
    findings = [Finding("kept.csv", "has gaps"), refused(3), refused(4)]
    assert said("no_mismatch", evidence, fit, findings=findings).endswith(
        "2 of the runs excluded (run3.csv has no power, ...)."
    )
    assert "excluded" not in said("no_mismatch", evidence, fit, findings=findings[:1])
