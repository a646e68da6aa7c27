"""The chain from recordings to verdict: check, refit, compare held out, test what remains, locate, conclude."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis import wording
from homeward.diagnosis.arms import better, held_out, score
from homeward.diagnosis.blocks import FEWEST_BLOCKS, cut_folds
from homeward.diagnosis.columns import Columns
from homeward.diagnosis.correct import correct, range_change
from homeward.diagnosis.location import Location, locate
from homeward.diagnosis.quality import Finding, usable_runs
from homeward.diagnosis.recordings import Recording, RecordingError, read_recording
from homeward.diagnosis.refit import Estimate, estimates, refit
from homeward.diagnosis.replay import Runs, average
from homeward.diagnosis.result import Diagnosis, Fit, ParameterOff, RecordingInfo, Verdict
from homeward.diagnosis.signals import Array
from homeward.diagnosis.structure import FALSE_ALARM_RATE, Dependence, dependences, independent_blocks
from homeward.physics import Robot, load_robot

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Evidence:
    """What the verdict rests on, for the report; arrays of shape (windows,).

    `nominal` is None where the robot file cannot predict what was recorded (motor current without a known thrust per
    ampere).
    """

    runs: Runs
    block: NDArray[np.intp]
    nominal: Array | None
    refit: Array  # held out
    estimates: tuple[Estimate, ...]
    dependences: tuple[Dependence, ...]
    location: Location | None


@dataclass(frozen=True)
class Analysis:
    """A diagnosis with its evidence and the corrected robot."""

    diagnosis: Diagnosis
    robot: Robot
    corrected: Robot
    findings: tuple[Finding, ...]
    evidence: Evidence | None  # None where no run can be used


def diagnose(
    recordings: Sequence[Recording | str | Path],
    robot: Robot | str | Path,
    columns: Columns | str | Path | None = None,
    seed: int = 0,
) -> Diagnosis:
    """Say whether a robot file explains recordings and, if not, what is off.

    Args:
        recordings: Runs, or paths of their files.
        robot: Robot, preset name or TOML path that the simulator uses.
        columns: Mapping for foreign files.
        seed: Seed of the bootstrap draws.

    Raises:
        RecordingError: A file cannot be read.
        RobotError: The robot cannot be loaded.
    """
    return analyse(recordings, robot, columns, seed).diagnosis


def analyse(
    recordings: Sequence[Recording | str | Path],
    robot: Robot | str | Path,
    columns: Columns | str | Path | None = None,
    seed: int = 0,
    progress: Progress = lambda stage: None,
) -> Analysis:
    """As `diagnose`, with the evidence that the report shows; `progress` is called with the name of each stage."""
    robot = load_robot(robot)
    if not recordings:
        raise RecordingError("no recordings given")
    progress("reading")
    runs_read = [one if isinstance(one, Recording) else read_recording(one, columns) for one in recordings]
    progress("checking")
    usable, findings = usable_runs(runs_read, robot)
    used = {run.name for run in usable}
    infos = tuple(
        RecordingInfo(one.name, one.sha256, one.duration_s, len(one))
        for one in {one.name: one for one in runs_read}.values()
        if one.name in used
    )
    if not usable:
        untestable = Diagnosis(robot.name, infos, "not_testable", wording.nothing_usable(findings))
        return Analysis(untestable, robot, robot, tuple(findings), None)
    evidence, fit = _weigh(average(usable), robot, seed, progress)
    verdict, off = _conclude(evidence)
    corrected = correct(robot, evidence.estimates, evidence.runs.unit, verdict)
    diagnosis = Diagnosis(
        robot.name,
        infos,
        verdict,
        wording.summary(verdict, evidence, off, fit, findings),
        parameters_off=off if verdict == "parameters_off" else (),
        where=evidence.location.places if evidence.location is not None else (),
        fit=fit,
        range_change_m=None
        if evidence.runs.unit == "A" or verdict == "unknown_physics"
        else range_change(robot, corrected),
        next_experiment=wording.next_experiment(verdict, evidence),
    )
    return Analysis(diagnosis, robot, corrected, tuple(findings), evidence)


def _weigh(runs: Runs, robot: Robot, seed: int, progress: Progress) -> tuple[Evidence, Fit]:
    progress("refitting")
    fitted = refit(runs, robot)
    blocks = independent_blocks(fitted, runs)
    block = blocks.channels
    fold, held_out_by = cut_folds(runs, block)
    problem = fitted.parameters
    nominal = problem.predict(runs, problem.start) if problem.current_known else None
    predicted = held_out(fitted, runs, fold)
    progress("testing what remains")
    found = dependences(fitted, runs, blocks, fold, seed) if block.max() + 1 >= FEWEST_BLOCKS else []
    progress("locating")
    location = locate(found[0], runs) if found and found[0].found else None
    arms = {} if nominal is None else {"nominal": score(nominal, runs, block, fold, held_out_by, seed)}
    arms["refit"] = score(predicted, runs, block, fold, held_out_by, seed)
    fit = Fit(runs.unit, held_out_by, len(np.unique(fold)), arms)
    known = tuple(estimates(fitted, runs, block))
    return Evidence(runs, block, nominal, predicted, known, tuple(found), location), fit


def _conclude(evidence: Evidence) -> tuple[Verdict, tuple[ParameterOff, ...]]:
    """The verdict by precedence, and the parameters whose interval excludes what the robot file assumes."""
    off = tuple(
        ParameterOff(one.group.symbol, one.assumed, one.fitted, one.ci95, one.group.unit)
        for one in evidence.estimates
        if one.off and one.assumed is not None and one.fitted is not None and one.ci95 is not None
    )
    if int(evidence.block.max()) + 1 < FEWEST_BLOCKS:
        return "not_testable", ()
    if evidence.location is not None:
        return "unknown_physics", off
    if all(one.fitted is None for one in evidence.estimates):
        return "not_testable", ()
    if evidence.nominal is None:
        return "no_mismatch", ()
    p_value = better(evidence.refit, evidence.nominal, evidence.runs.observed, evidence.block)
    if p_value > FALSE_ALARM_RATE:
        return "no_mismatch", ()
    if any(one.status == "at bound" for one in evidence.estimates):
        return "unknown_physics", off  # only unphysical parameters would explain the recordings
    return "parameters_off", off
