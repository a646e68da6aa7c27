from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import concealed
from benchmarks.plants.case import Case, Kind, Noise, Run, Truth, anonymous
from benchmarks.scoring.outcome import Outcome, covered
from benchmarks.scoring.plot import draw_confusion
from benchmarks.scoring.score import (
    Headline,
    Rate,
    class_size,
    columns,
    confusion,
    failures,
    headlines,
    reason,
    rows,
)  # fmt: skip
from benchmarks.scoring.table import Grid, as_data, grids
from benchmarks.scoring.work import Alone, Aside, diagnose_case, keep_out
from homeward.diagnosis.arms import Arm
from homeward.diagnosis.location import Place
from homeward.diagnosis.result import Diagnosis, Evidence, Fit, MissingPhysics, Verdict
from homeward.physics import load_robot, replay

TIME_S = np.arange(100) / 10.0


def named(effect: str, *confused_with: str, where: tuple[Place, ...] = ()) -> MissingPhysics:
    return MissingPhysics(effect, effect, "", "", "", {}, where, Evidence(50.0, 0.4, 0.05), confused_with, "")


def outcome(
    *missing: MissingPhysics,
    truth: tuple[str, ...] = ("standby",),
    kind: Kind = "single",
    noise: Noise = "low",
    verdict: Verdict = "no_mismatch",
    corrected: float | None = None,
    where: tuple[Place, ...] = (),
) -> Outcome:
    """A case of two runs of 10 s, in which something was at work from 5 s on in the second; noise of 1 W."""
    arms = {"refit": Arm(3.0, None, None, (3.0, 3.0))}
    if corrected is not None:
        arms["corrected"] = Arm(corrected, None, None, (corrected, corrected))
    diagnosis = Diagnosis("husky", (), "missing_physics" if missing else verdict, "", missing_physics=missing,
                          where=where, fit=Fit("W", "block", 5, arms))  # fmt: skip
    affected = () if not truth else (TIME_S < 0.0, TIME_S >= 5.0)
    known = Truth("case_1", "plant", kind, truth, noise, 1, 1.0, affected)
    return Outcome(known, diagnosis, Aside(2.0, 1.0), (TIME_S, TIME_S))


def crashed(one: Outcome) -> Outcome:
    return replace(one, diagnosis=None, aside=Aside(1.0, 1.0, "ValueError: no"))


def headline(what: str, *outcomes: Outcome) -> Headline:
    return next(one for one in headlines(outcomes) if one.what == what)


def test_single_is_right_where_the_class_named_first_holds_it() -> None:
    first, held = outcome(named("standby")), outcome(named("sensor_offset", "standby"))
    second, none = outcome(named("radio"), named("standby")), outcome()
    assert [one.first_is_true for one in (first, held, second, none)] == [True, False, False, False]
    assert [one.is_right for one in (first, held, second, none)] == [True, True, False, False]
    assert [one.is_named_anywhere for one in (first, held, second, none)] == [True, False, True, False]
    assert class_size([first, held, none]) == 1.5


def test_rows_keep_noise_levels_apart() -> None:
    every = [outcome(named("standby")), outcome(noise="high"), outcome(named("standby"), noise="high")]
    low, high = rows(every)
    assert (low.noise, str(low.in_class.share), high.noise, high.in_class) == ("low", "1.0", "high", Rate(1, 2))


def test_targets_are_of_their_noise_level() -> None:
    what = "singles, {} noise: true effect, or class that holds it, first"
    every = [
        outcome(named("standby")),
        *(outcome(named("standby"), noise="high") for _ in range(3)),
        outcome(noise="high"),
    ]
    assert headline(what.format("low"), *every).met
    assert headline(what.format("high"), *every).rate == Rate(3, 4)
    assert headline(what.format("high"), *every).met is False


def test_pair_needs_two_named_effects() -> None:
    truth = ("inertia", "wind")
    both = outcome(named("wind"), named("slip", "inertia"), truth=truth, kind="pair")
    one_for_both = outcome(named("wind", "inertia"), truth=truth, kind="pair")
    one = outcome(named("wind"), named("slip"), truth=truth, kind="pair")
    assert [case.both_found for case in (both, one_for_both, one)] == [True, False, False]
    assert [case.both_mentioned for case in (both, one_for_both, one)] == [True, True, False]
    assert reason(one) == "only wind found"
    assert headline("pairs: both found", both, one_for_both, one).rate == Rate(1, 3)


def test_controls_count_false_alarms() -> None:
    quiet = [outcome(truth=(), kind="exact") for _ in range(19)]
    off = outcome(truth=(), kind="misset", verdict="parameters_off")
    loud = outcome(named("wind"), truth=(), kind="exact")
    unknown = outcome(truth=(), kind="misset", verdict="unknown_physics")
    called = "controls called missing_physics"
    assert headline(called, *quiet, loud).met and not headline(called, *quiet[1:], loud, loud).met
    assert headline("misset controls called parameters_off", *quiet, off, unknown).rate == Rate(1, 2)
    assert [one.is_right for one in (quiet[0], off, loud, unknown)] == [True, True, False, False]
    assert [one.location_f1 for one in (off, loud)] == [None, None]


def test_outside_the_catalogue_a_catalogue_name_is_wrong() -> None:
    words = ("a pump",)
    unknown = outcome(truth=words, kind="outside", verdict="unknown_physics")
    empirical = outcome(named("empirical"), truth=words, kind="outside")
    wrong = outcome(named("slip"), truth=words, kind="outside")
    missed = outcome(truth=words, kind="outside")
    assert [one.is_right for one in (unknown, empirical, wrong, missed)] == [True, True, False, False]
    assert headline("outside the catalogue: wrongly named", unknown, empirical, wrong, missed).rate == Rate(1, 4)


@pytest.mark.parametrize(
    ("verdict", "right"), [("parameters_off", True), ("no_mismatch", True), ("unknown_physics", False)]
)
def test_invisible_effect_is_no_physics(verdict: Verdict, right: bool) -> None:
    assert outcome(kind="invisible", verdict=verdict).is_right == right
    assert outcome(named("sensor_offset", "standby"), kind="invisible").is_right
    assert not outcome(named("sensor_offset"), kind="invisible").is_right


def test_crash_is_a_failure_of_every_kind() -> None:
    for kind, truth in (("single", ("standby",)), ("pair", ("wind", "slip")), ("outside", ("a pump",)),
                        ("invisible", ("standby",)), ("exact", ()), ("misset", ())):  # fmt: skip
        one = crashed(outcome(truth=truth, kind=kind))  # type: ignore[arg-type]
        assert not one.is_right
        assert not one.location_f1
        assert not one.error_fell
        assert failures([one])[0].reason == "crashed: ValueError: no"
        assert headline("crashed", one).rate == Rate(1, 1)


def test_location_is_that_of_the_true_effect_or_of_the_mismatch() -> None:
    true, wrong = Place("seen/run_2.csv.gz", 5.0, 9.9, "", 1.0), Place("seen/run_1.csv.gz", 0.0, 9.9, "", 1.0)
    half = Place("seen/run_2.csv.gz", 5.0, 7.45, "", 1.0)
    assert outcome(named("standby", where=(true,))).location_f1 == 1.0
    assert outcome(named("radio", where=(wrong,)), named("slip", "standby", where=(true,))).location_f1 == 1.0
    assert outcome(named("radio", where=(true,)), where=(wrong,)).location_f1 == 0.0
    assert outcome(verdict="unknown_physics", where=(half,)).location_f1 == pytest.approx(2 * 25 / 75)
    assert outcome().location_f1 == 0.0
    np.testing.assert_array_equal(covered((half, true), (TIME_S, TIME_S))[1], TIME_S >= 5.0)


@pytest.mark.parametrize(
    ("corrected", "fell"), [(1.05, True), (1.7, True), (1.75, False), (3.0, False), (0.5, True), (None, False)]
)
def test_error_in_excess_of_the_noise_must_fall_by_half(corrected: float | None, fell: bool) -> None:
    # The refit's excess is sqrt(3^2 - 1^2); half of it is sqrt(2), which with the noise is sqrt(3) = 1.73.
    assert outcome(named("standby"), corrected=corrected).error_fell is fell


def test_rate_has_wilsons_interval() -> None:
    z, share, n = 1.959964, 0.9, 10
    middle, half = share + z**2 / (2 * n), z * np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    assert Rate(9, 10).ci95 == pytest.approx([(middle + sign * half) / (1 + z**2 / n) for sign in (-1, 1)], abs=1e-6)
    assert Rate(0, 0).share is None


def test_confusion_counts_what_was_named_first() -> None:
    every = [outcome(named("standby")), outcome(named("radio"), named("standby")), outcome(verdict="unknown_physics"),
             outcome(truth=(), kind="exact"), outcome(truth=("wind", "slip"), kind="pair")]  # fmt: skip
    matrix = confusion(every)
    assert matrix == {"standby": {"standby": 1, "radio": 1, "unknown_physics": 1}, "exact": {"no_mismatch": 1}}
    assert columns(matrix) == ["standby", "radio", "unknown_physics", "no_mismatch"]


def test_failures_say_why_most_frequent_first() -> None:
    alone = Aside(1.0, 1.0, None, (Alone("radio", "steady", 90.0, 0.5), Alone("standby", "time", 40.0, 0.3)))
    behind = replace(outcome(named("radio", "slip"), named("standby")), aside=alone)
    found = failures([behind, outcome(), outcome(noise="high"), outcome(named("standby"))])
    assert [one.reason for one in found] == ["nothing named, no_mismatch, the true one not tried"] * 2 + [
        "radio first, the true one after it"
    ]
    assert (found[2].named, found[2].alone) == ("radio [slip]; standby", "dBIC 40 (best 90), gain 0.300")


def test_score_is_data_tables_and_a_picture(tmp_path: Path) -> None:
    every = [outcome(named("standby")), outcome(), outcome(truth=(), kind="misset", verdict="parameters_off")]
    data = json.loads(json.dumps(as_data(every), allow_nan=False))
    assert (data["cases"], len(data["failures"]), data["each"][0]["right"]) == (3, 1, True)
    assert all(grid.markdown().startswith("## ") and grid.rich().row_count == len(grid.rows) for grid in grids(every))
    draw_confusion(confusion(every), tmp_path / "confusion.png")
    assert (tmp_path / "confusion.png").read_bytes().startswith(b"\x89PNG")


def test_markdown_escapes_bars() -> None:
    assert "| a \\|x\\| |" in Grid("t", ("h",), (("a |x|",),)).markdown()


def test_diagnosis_cannot_open_the_truth(tmp_path: Path) -> None:
    hook = keep_out(tmp_path / "truth")
    hook("open", (str(tmp_path / "seen" / "case_1.json"), "r", 0))
    hook("os.listdir", (str(tmp_path / "truth"),))
    with pytest.raises(PermissionError, match="truth"):
        hook("open", (str(tmp_path / "seen" / ".." / "truth" / "case_1.json"), "r", 0))


def small_cases() -> Iterator[Case]:
    """A load that is switched on half-way, and a control: a Husky that drives at changing speed."""
    rng = np.random.default_rng(4)
    robot = load_robot("husky")
    for number, load_w in enumerate((60.0, 0.0)):
        runs = []
        for _ in range(3):
            time_s = np.arange(1200) / 10.0
            speed_mps = np.repeat(rng.uniform(0.0, 1.0, 24), 50)
            on = (time_s > 60.0) & (load_w > 0.0)
            power_w = replay(robot, time_s, speed_mps).power_w + load_w * on + rng.normal(0.0, 2.0, time_s.size)
            runs.append(Run({"time_s": time_s, "speed_mps": speed_mps, "power_w": power_w}, on))
        truth, kind = (("standby",), "single") if load_w else ((), "exact")
        yield Case(anonymous("cell", number), "cell", kind, truth, "low", number, robot, tuple(runs), 1.0)  # type: ignore[arg-type]


def test_from_cases_to_score(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "benchmarks.plants.cell", SimpleNamespace(cases=small_cases))
    args = concealed.Args(only="cell", out=tmp_path, jobs=1)
    concealed.main(args)
    score = json.loads((tmp_path / "score.json").read_text(encoding="utf-8"))
    hidden, control = (next(one for one in score["each"] if one["kind"] == kind) for kind in ("single", "exact"))
    assert (hidden["truth"], hidden["named"][:1], hidden["right"]) == (["standby"], ["standby"], True)
    assert hidden["f1"] > 0.9 and hidden["error_fell"] and control["right"]
    assert (tmp_path / "concealed.md").exists() and (tmp_path / "concealed.png").exists()

    (tmp_path / "aside" / f"{control['name']}.json").unlink()  # as if the first run had been interrupted before it
    (tmp_path / "seen" / control["name"] / "robot.toml").write_text("mass_kg = 1", encoding="utf-8")
    kept = (tmp_path / "aside" / f"{hidden['name']}.json").read_text(encoding="utf-8")
    concealed.main(replace(args, resume=True))
    score = json.loads((tmp_path / "score.json").read_text(encoding="utf-8"))
    assert (tmp_path / "aside" / f"{hidden['name']}.json").read_text(encoding="utf-8") == kept
    assert [one["verdict"] for one in score["each"] if one["name"] == control["name"]] == ["crashed"]
    with pytest.raises(concealed.SourceError, match="other cases"):
        concealed.main(replace(args, resume=True, seed=1))


def test_drawn_cases_do_not_depend_on_their_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    every = list(small_cases())
    drawn = []
    for order in (every, every[::-1]):
        monkeypatch.setitem(
            sys.modules, "benchmarks.plants.cell", SimpleNamespace(cases=lambda order=order: iter(order))
        )
        drawn.append(concealed.write_cases(concealed.Args(only="cell", cases=1, out=tmp_path)))
    assert drawn[0] == drawn[1] and len(drawn[0]) == 1


def test_crashed_case_is_written_down(tmp_path: Path) -> None:
    (tmp_path / "seen" / "case_1").mkdir(parents=True)
    diagnose_case(tmp_path, "case_1")
    error = Aside.read(tmp_path, "case_1").error
    assert error is not None and error.startswith("RobotError: ")


def test_missing_source_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "benchmarks.plants.rover", None)
    with pytest.raises(concealed.SourceError, match="rover"):
        concealed.main(concealed.Args(only="rover", out=tmp_path))
    with pytest.raises(concealed.SourceError, match="--jobs 0"):
        concealed.main(concealed.Args(jobs=0, out=tmp_path))
