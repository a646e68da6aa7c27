"""What is read of a diagnosis: classes, intervals beside the truth, and errors of later drives."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.concealed.plants.cases import Case, Later
from benchmarks.concealed.plants.catalogue import replayed_w
from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.scoring.outcome import (
    MODELS,
    USABLE_ENERGY,
    Outcome,
    ask,
    read_diagnosis,
    true_groups,
)
from homeward.commands import diagnose
from homeward.diagnosis import Analysis, Diagnosis, RecordingError
from homeward.physics import Robot, load_robot
from tests.benchmarks.concealed.plants.steady import ROBOT, motion


def case(part: str = "singles", truth: Robot = ROBOT, **changes: object) -> Case:
    made = Case(part, 0, "a robot", "low", ("payload",), truth, ROBOT, [], {})  # type: ignore[arg-type]
    return dataclasses.replace(made, **changes)  # type: ignore[arg-type]


def empty(part: str = "singles", hidden: tuple[str, ...] = ("payload",)) -> Outcome:
    return Outcome(part, 0, "a robot", "low", list(hidden), {}, [], "none")


@pytest.mark.parametrize(
    ("part", "hidden", "kind"),
    [
        ("pairs", ("payload", "radio"), "pairs"),
        ("rover", (), "controls"),
        ("rover", ("payload",), "singles"),
        ("cell", ("payload", "standby"), "pairs"),
        ("rover", ("chatter",), "outside"),
    ],
)
def test_a_case_of_another_simulator_is_of_the_kind_that_it_hides(
    part: str, hidden: tuple[str, ...], kind: str
) -> None:
    assert empty(part, hidden).kind == kind


def test_groups_of_the_husky_are_those_of_its_file() -> None:
    husky = load_robot("husky")
    groups, gamma = true_groups(husky), husky.traction_efficiency
    assert groups["m / Gamma"] == pytest.approx(50.0 / gamma)
    assert groups["C_rr m / Gamma"] == pytest.approx(0.14 * 50.0 / gamma)
    assert groups["c / Gamma"] == pytest.approx(0.13 / gamma)
    assert groups["P_anc, per sample"] == pytest.approx(0.7)


def test_intervals_are_kept_where_the_truth_is_known() -> None:
    truth = dataclasses.replace(ROBOT, effects={"radio": {"w_per_km2": 500.0, "reach_m": 90.0}})
    unlimited = {"value": 90.0, "ci95": None}
    mass = {"group": "m / Gamma", "assumed": 1.0, "fitted": 2.0, "ci95": [1.9, 2.1], "unit": "kg"}
    energy = {**mass, "group": USABLE_ENERGY, "confused_with": ["rate_capacity"]}
    diagnosis = {
        "verdict": "missing_physics",
        "summary": "",
        "missing_physics": [
            {
                "effect": "radio",
                "confused_with": ["standby"],
                "parameters": {
                    name: {"value": 1.0, "ci95": [400.0, 600.0]}
                    for name in ("w_per_km2", "w_per_km2_level_2")
                }
                | {"reach_m": unlimited},
            }
        ],
        "parameters": [mass, energy],
        "parameters_off": [mass, energy],
    }
    coverage, single = empty("coverage"), empty()
    read_diagnosis(coverage, diagnosis, case("coverage", truth))
    read_diagnosis(single, diagnosis, case("singles", truth))
    assert single.intervals == [] and single.classes == coverage.classes == [["radio", "standby"]]
    assert coverage.capacity == ["ageing", "rate_capacity"]
    radio, group = coverage.intervals  # of a level, and of the usable energy, there is no truth
    assert radio == {
        "name": "radio.w_per_km2",
        "true": 500.0,
        "low": 400.0,
        "high": 600.0,
        "off": False,
    }
    assert group == {
        "name": "m / Gamma", "true": truth.mass_kg / truth.traction_efficiency, "low": 1.9, "high": 2.1, "off": True,
    }  # fmt: skip


def test_a_later_drive_has_the_error_of_its_energy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The truth draws a quarter more than the nominal file says; corrected.toml holds what draws
    it, or nothing."""
    run = motion()
    later = Later(run, 1.25 * replayed_w(ROBOT, run))
    whole = dataclasses.replace(
        ROBOT, effects={"standby": {"power_w": float(0.25 * np.mean(replayed_w(ROBOT, run)))}}
    )

    def diagnosed(args: diagnose.Args, without: tuple[str, ...]) -> Analysis:
        found = Diagnosis(ROBOT.name, (), "missing_physics", "")
        (args.out / "diagnosis.json").write_text(found.to_json())
        (args.out / "corrected.toml").write_text(whole.to_toml())
        return Analysis(found, ROBOT, whole, (), None)

    monkeypatch.setattr(diagnose, "main", diagnosed)
    found = ask(case(refit=ROBOT, later=[later]), tmp_path)
    (errors,) = found.later
    assert found.holds == ["standby"]
    assert [errors[name] for name in MODELS[:-1]] == pytest.approx([20.0, 20.0, 20.0])
    assert errors["corrected"] == pytest.approx(0.0, abs=1e-4)
    assert not (tmp_path / "recordings").exists() and (tmp_path / "nominal.toml").exists()


@pytest.mark.parametrize(
    ("error", "verdict"), [(RecordingError("no power"), "refused"), (KeyError("gone"), "crash")]
)
def test_what_is_raised_is_refused_if_it_says_why_and_a_crash_otherwise(
    error: Exception, verdict: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(args: diagnose.Args, without: tuple[str, ...]) -> None:
        raise error

    monkeypatch.setattr(diagnose, "main", failing)
    found = ask(make_case("controls", 1, 0, short=True), tmp_path)
    assert found.verdict == verdict and str(error) in found.summary
