"""Diagnose a case as the command line does, and collect the answer."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import traceback
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from benchmarks.concealed.plants.cases import NEEDS, Case, Later, Part
from benchmarks.concealed.plants.catalogue import replayed_w
from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.plants.effects import EFFECTS
from benchmarks.concealed.scoring.ceiling import provable
from homeward.commands import diagnose
from homeward.diagnosis import Analysis, RecordingError
from homeward.diagnosis.tell.file_choice import filed
from homeward.physics import Robot, load_robot

USABLE_ENERGY = "usable energy"
NOMINAL = "nominal.toml"
"""Robot file of a case, in its folder."""
RECORDINGS = "recordings"
"""Folder of a case's recordings, in its folder; it is deleted after the diagnosis."""


class Interval(TypedDict):
    """A 95 % interval and the true value."""

    name: str
    true: float
    low: float
    high: float
    off: bool  # whether the robot file is said to be off


MODELS = ("nominal", "refit", "refit without noise", "corrected")
"""Robots whose energy is compared over later drives: the file given, the diagnosis's refit, the
refit of the same recordings without noise, and corrected.toml."""


@dataclass
class Outcome:
    """A case and its diagnosis; all fields are written to JSON."""

    part: str
    number: int
    vehicle: str
    label: str
    hidden: list[str]
    visible: dict[str, bool]
    fair: list[str]
    fault: str
    verdict: str = ""  # of the diagnosis, or "refused" (unusable input) or "crash"
    summary: str = ""
    # missing_physics: effect, then what it is confused with
    classes: list[list[str]] = field(default_factory=list)
    off: list[str] = field(default_factory=list)
    capacity: list[str] = field(default_factory=list)  # alternatives for a wrong usable energy
    # where the exact contribution of each is known
    provable: dict[str, bool] = field(default_factory=dict)
    holds: list[str] = field(default_factory=list)  # effects in corrected.toml
    # error of a drive's energy, %, of each of MODELS
    later: list[dict[str, float]] = field(default_factory=list)
    intervals: list[Interval] = field(default_factory=list)

    @property
    def kind(self) -> str:
        """The part or, for cases of another simulator, the part that such cases belong to."""
        if self.part not in NEEDS:
            return self.part
        if not self.hidden:
            return "controls"
        if len(self.hidden) == 2:
            return "pairs"
        return "singles" if self.hidden[0] in EFFECTS else "outside"


def run_case(
    part: Part, seed: int, number: int, out: Path, without: Collection[str] = ()
) -> Outcome:
    """Make one case and diagnose it."""
    case = make_case(part, seed, number)
    outcome = ask(case, out / part / f"{number:04d}", without)
    outcome.provable = provable(case)
    return outcome


def ask(case: Case, folder: Path, without: Collection[str] = ()) -> Outcome:
    """Write the case's recordings into the folder, diagnose them, and read diagnosis.json and
    corrected.toml."""
    outcome = unanswered(case)
    runs = write_inputs(case, folder)
    args = diagnose.Args(runs=tuple(runs), robot=str(folder / NOMINAL), out=folder)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            analysis = diagnose.main(args, without)
    except RecordingError as error:
        outcome.verdict = "refused"
        outcome.summary = str(error)
    except Exception:  # the robot file is valid, so that even a RobotError counts as a crash
        outcome.verdict = "crash"
        outcome.summary = traceback.format_exc(limit=-3)
    else:
        read_diagnosis(outcome, json.loads((folder / "diagnosis.json").read_text()), case)
        assert isinstance(analysis, Analysis)
        _read_corrected(outcome, case, folder, analysis)
    shutil.rmtree(folder / RECORDINGS)
    return outcome


def unanswered(case: Case) -> Outcome:
    """An outcome that says what is concealed, but not yet what the diagnosis says."""
    return Outcome(case.part, case.number, case.vehicle, case.label, list(case.hidden), case.visible,
                   sorted(case.fair), case.fault)  # fmt: skip


def write_inputs(case: Case, folder: Path) -> list[Path]:
    """Write the robot file and the recordings of a case into the folder; the recordings' paths."""
    recordings = folder / RECORDINGS
    recordings.mkdir(parents=True, exist_ok=True)
    runs = []
    for index, frame in enumerate(case.recordings):
        runs.append(recordings / f"drive{index}.parquet")
        frame.to_parquet(runs[-1], index=False)
    (folder / NOMINAL).write_text(case.nominal.to_toml())
    return runs


def read_diagnosis(outcome: Outcome, diagnosis: dict[str, Any], case: Case) -> None:
    """Store verdict, classes and, where the true values are known, intervals."""
    outcome.verdict = diagnosis["verdict"]
    outcome.summary = diagnosis["summary"]
    outcome.classes = [
        [entry["effect"], *entry["confused_with"]] for entry in diagnosis["missing_physics"]
    ]
    outcome.off = [entry["group"] for entry in diagnosis["parameters_off"]]
    outcome.capacity = []
    for entry in diagnosis["parameters_off"]:
        if entry["group"] == USABLE_ENERGY:
            outcome.capacity += ["ageing", *entry["confused_with"]]
    if case.part == "coverage":
        outcome.intervals = _intervals_of_effects(diagnosis, case) + _intervals_of_groups(
            diagnosis, case, outcome.off
        )


def _intervals_of_effects(diagnosis: dict[str, Any], case: Case) -> list[Interval]:
    intervals = []
    for entry in diagnosis["missing_physics"]:
        true = case.truth.effects.get(entry["effect"], {})
        for name, parameter in entry["parameters"].items():
            if name in true and parameter["ci95"] is not None:
                intervals.append(
                    _interval(f"{entry['effect']}.{name}", true[name], parameter["ci95"])
                )
    return intervals


def _intervals_of_groups(
    diagnosis: dict[str, Any], case: Case, off: Collection[str]
) -> list[Interval]:
    true = true_groups(case.truth)
    intervals = []
    for parameter in diagnosis["parameters"]:
        name = parameter["group"]
        if name in true:
            intervals.append(_interval(name, true[name], parameter["ci95"], name in off))
    return intervals


def _interval(name: str, true: float, ci95: list[float], off: bool = False) -> Interval:
    return {"name": name, "true": true, "low": ci95[0], "high": ci95[1], "off": off}


def true_groups(robot: Robot) -> dict[str, float]:
    """Parameter groups that recordings identify for a robot without effects, by their names in the
    diagnosis."""
    gamma = robot.traction_efficiency
    return {
        "P_anc, idle part": robot.sensing_idle_w + robot.communication_w + robot.controller_w,
        "P_anc, per sample": robot.sensing_j_per_sample + robot.computer_j_per_sample,
        "C_rr m / Gamma": robot.rolling_resistance * robot.mass_kg / gamma,
        "c / Gamma": robot.drag_ns2_per_m2 / gamma,
        "m / Gamma": robot.mass_kg / gamma,
    }


def _read_corrected(outcome: Outcome, case: Case, folder: Path, analysis: Analysis) -> None:
    """Replay corrected.toml and both refits over the later drives."""
    corrected = load_robot(folder / "corrected.toml")
    outcome.holds = list(corrected.active_effects)
    if case.refit is None:
        return
    refitted = case.nominal
    if analysis.evidence is not None:
        refitted, *_ = filed(case.nominal, analysis.evidence.plain, analysis.evidence.runs)
    robots = dict(zip(MODELS, (case.nominal, refitted, case.refit, corrected), strict=True))
    for drive in case.later:
        outcome.later.append({name: error_pct(robot, drive) for name, robot in robots.items()})


def error_pct(robot: Robot, drive: Later) -> float:
    """Absolute error of a trip's energy, %."""
    run = drive.run
    true_j = float(np.sum(drive.power_w)) * run.dt_s
    return float(abs(np.sum(replayed_w(robot, run)) * run.dt_s - true_j) / abs(true_j) * 100.0)
