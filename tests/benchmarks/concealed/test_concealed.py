"""The concealed benchmark: cases come from their seed, recordings obey the format, and the counts are right."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.concealed.plants.cases import NEEDS, PARTS, Part, make_case
from benchmarks.concealed.plants.chain import rollout
from benchmarks.concealed.plants.effects import EFFECTS
from benchmarks.concealed.plants.instruments import FAULTS, NOISES, Logging, record
from benchmarks.concealed.plants.motion import make_drives, make_route
from benchmarks.concealed.plants.outside import OUTSIDE, make_outside
from benchmarks.concealed.plants.vehicles import SCOUT
from benchmarks.concealed.scoring.count import false_alarm, found_first, share, tables, wrongly_named
from benchmarks.concealed.scoring.outcome import Outcome, read_diagnosis

ALLOWED = {
    "time_s", "speed_mps", "wheel_left_mps", "wheel_right_mps", "yaw_rate_radps", "grade_rad", "elevation_m",
    "distance_m", "heading_rad", "power_w", "voltage_v", "current_a", "sensing_hz", "soc", "temperature_c",
    "base_distance_m",
}  # fmt: skip
WITHOUT_REPLAY: tuple[Part, ...] = tuple(
    part for part in PARTS if part != "coverage" and part not in NEEDS
)  # which compiles kernels or needs simulators


@pytest.mark.parametrize("part", WITHOUT_REPLAY)
def test_a_seed_always_gives_the_same_cases(part: Part) -> None:
    first, again, other = (make_case(part, seed, 3, short=True) for seed in (5, 5, 6))
    assert (first.hidden, first.label, first.fault, first.nominal) == (again.hidden, again.label, again.fault,
                                                                      again.nominal)  # fmt: skip
    for frame, same in zip(first.recordings, again.recordings, strict=True):
        pd.testing.assert_frame_equal(frame, same)
    assert not first.recordings[0].equals(other.recordings[0])


@pytest.mark.parametrize(("part", "kinds"), [("singles", 78), ("controls", 30), ("outside", 17)])
def test_every_kind_comes_in_turn(part: Part, kinds: int) -> None:
    expected = {"singles": len(EFFECTS) * len(NOISES), "controls": 2 * (len(FAULTS) + 1), "outside": len(OUTSIDE)}
    assert kinds == expected[part]
    few = [make_case(part, 2, number, short=True) for number in range(4)]
    assert len({(case.hidden, case.label, case.fault) for case in few}) == 4


@pytest.mark.parametrize("part", WITHOUT_REPLAY)
def test_recordings_obey_the_format(part: Part) -> None:
    for number in range(3):
        for frame in make_case(part, 1, number, short=True).recordings:
            assert set(frame) <= ALLOWED
            assert np.all(np.diff(frame["time_s"]) > 0.0)
            assert np.isfinite(frame.to_numpy()).all()
            assert "power_w" in frame or {"voltage_v", "current_a"} <= set(frame)
            assert "speed_mps" in frame or {"wheel_left_mps", "wheel_right_mps"} <= set(frame)


def test_every_mechanism_and_fault_changes_what_is_recorded() -> None:
    rng = np.random.default_rng(1)
    drives = make_drives(SCOUT, [make_route(SCOUT, rng) for _ in range(2)], rng, 5, -4.0, short=True)
    hidden = {name: draw(SCOUT, rng, 5) for name, draw in EFFECTS.items()}
    hidden |= {name: make_outside(name, SCOUT, rng, 5)[0] for name in OUTSIDE}

    def written(*names: str) -> pd.DataFrame:
        works = [
            rollout(SCOUT, run, [hidden[n] for n in names], np.random.default_rng(2), "terminals") for run in drives
        ]
        noise = NOISES["low"]
        return pd.concat([record(work, noise, Logging(), np.random.default_rng(3)) for work in works])

    clean = written()
    for name in set(hidden) - {"regeneration"}:  # which wants steeper hills than these
        assert not written(name).equals(clean), name
    work = rollout(SCOUT, drives[0], [], rng)
    frame = record(work, NOISES["low"], Logging(), rng)
    for name, fault in FAULTS.items():
        assert not fault(frame, work, 0.5, rng).equals(frame), name


def outcome(**given: object) -> Outcome:
    made = Outcome("singles", 0, "jackal_plant", "low", ["payload"], {"payload": True}, [], "none")
    for name, value in given.items():
        setattr(made, name, value)
    return made


def test_counts_of_a_diagnosis_written_by_hand(tmp_path: Path) -> None:
    case = make_case("singles", 1, 0, short=True)
    entry = {
        "effect": "surface",
        "confused_with": ["payload"],
        "parameters": {"gain": {"value": 1.0, "ci95": [0.9, 1.1]}},
    }
    second = {"effect": "radio", "confused_with": [], "parameters": {}}
    (tmp_path / "diagnosis.json").write_text(json.dumps({
        "verdict": "missing_physics", "summary": "two things", "missing_physics": [entry, second],
        "parameters_off": [{"group": "m / Gamma", "assumed": 1.0, "fitted": 2.0, "ci95": [1.9, 2.1], "unit": "kg"}],
    }))  # fmt: skip
    diagnosis = json.loads((tmp_path / "diagnosis.json").read_text())
    right, late = outcome(), outcome(hidden=["radio"], visible={"radio": True}, number=1)
    for made in (right, late):
        read_diagnosis(made, diagnosis, case)
    assert right.classes == [["surface", "payload"], ["radio"]]
    assert right.off == ["m / Gamma"]
    assert found_first(right)
    assert not found_first(late)
    singles = tables([right, late])[0]
    assert singles.rows[0][1].startswith("1/2 = 50 %")
    assert singles.rows[0][-1] == "2.00"
    pair = outcome(part="pairs", hidden=["payload", "radio"], classes=right.classes, verdict="missing_physics")
    assert [cell.split(" ")[0] for cell in tables([pair])[0].rows[0][1:]] == ["1/1", "0/1", "1/1", "1/1"]


def test_cases_of_other_simulators_are_counted_by_kind() -> None:
    hidden: list[list[str]] = [["turning"], ["turning", "payload"], ["chatter"], []]
    made = tables([outcome(part="rover", hidden=one, visible=dict.fromkeys(one, True)) for one in hidden])
    titles = ["One hidden effect", "Two hidden effects", "Controls: no physics is missing",
              "Mechanisms outside the catalogue"]  # fmt: skip
    assert [table.title for table in made] == [*(f"{title}, rover" for title in titles), "Seconds a case"]


def test_what_counts_as_a_false_alarm() -> None:
    assert false_alarm(outcome(verdict="missing_physics"))
    assert false_alarm(outcome(verdict="unknown_physics", summary="no grade was recorded"))
    assert not false_alarm(outcome(verdict="unknown_physics", fault="no_grade", summary="no grade was recorded"))
    assert false_alarm(outcome(verdict="unknown_physics", fault="no_grade", summary="further from base"))
    assert not false_alarm(outcome(verdict="parameters_off"))


def test_what_counts_as_wrongly_named() -> None:
    assert wrongly_named(outcome(part="outside", classes=[["radio", "surface"]]))
    assert not wrongly_named(outcome(part="outside", classes=[["radio", "surface"]], fair=["surface"]))
    assert not wrongly_named(outcome(part="outside", classes=[["a_formula"]]))


def test_later_drives_and_intervals_are_counted() -> None:
    drive = {"kind": "new route", "nominal_pct": 9.0, "refit_pct": 5.0, "corrected_pct": 6.5}
    better = drive | {"corrected_pct": 5.9}
    made = {table.title: table for table in tables([outcome(later=[drive, better], holds=["radio"])])}
    assert made["Energy of later drives"].rows[0][1].startswith("1/2")
    assert made["Mean error of a file over its later drives"].rows[0][1].startswith("1/1")
    held = made["Visible effects that a file can say, for which corrected.toml holds"].rows
    assert [row[1].split(" ")[0] for row in held] == ["1/1", "0/1"]
    intervals = [{"name": "slip.per_load", "true": 1.0, "low": 0.8, "high": top, "off": False} for top in (0.9, 1.2)]
    covered = tables([outcome(part="coverage", intervals=intervals)])[0]
    assert covered.rows[0][1].startswith("1/2")
    assert covered.rows[0][2] == "0.250"


def test_a_share_has_its_wilson_interval() -> None:
    assert share([True] * 9 + [False]) == "9/10 = 90 % (60–98)"  # Newcombe 1998's formula by hand: 59.58 to 98.21
    assert share([]) == "–"
