"""The chain from recordings to verdict: check, refit, test the residual, locate, name, validate, conclude."""

import dataclasses
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np
from numpy.random import Generator
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.channel_effects.find import find_effects
from homeward.diagnosis.explain.channel_effects.shown import USABLE_ENERGY
from homeward.diagnosis.explain.conditions import check_names
from homeward.diagnosis.explain.explanation import explain
from homeward.diagnosis.explain.formula import Empirical
from homeward.diagnosis.explain.gauge import capacity_question, weigh_gauge
from homeward.diagnosis.explain.joint_fit import Corrected, immaterial
from homeward.diagnosis.explain.residual_test import dependences, independent_blocks
from homeward.diagnosis.explain.uncertainty import joint, profiled, recorded_range
from homeward.diagnosis.fit.channel_errors import tilt_error
from homeward.diagnosis.fit.fitted import Fitted, with_columns
from homeward.diagnosis.fit.folds import FOLDS, cut_folds
from homeward.diagnosis.fit.held_out import better, black_box, held_out, score
from homeward.diagnosis.fit.refit import Estimate, Refit, estimates, holding, refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import Finding, usable_runs
from homeward.diagnosis.result import Diagnosis, Fit, FittedGroup, Product, RecordingInfo, Verdict
from homeward.diagnosis.tell.file_choice import choose_file, determined
from homeward.diagnosis.tell.made_by import made_by
from homeward.diagnosis.tell.missing import missing_physics, not_named
from homeward.diagnosis.tell.next_drive import next_experiment
from homeward.diagnosis.tell.words import nothing_usable, summary
from homeward.logs.autocorrelation import shifted_in_time
from homeward.logs.channels import Array, Index
from homeward.logs.columns import Columns
from homeward.logs.plausible import within_top_speed
from homeward.logs.recordings import Recording, RecordingError, read_recording
from homeward.physics import Robot, d_max, load_robot

Progress = Callable[[str], None]

_CLEAR_OF_TILT = float(norm.isf(thresholds.FALSE_ALARM_RATE / 2.0))  # standard errors of the tilt of a slope sensor

STAGES = ("reading", "checking", "refitting", "testing what remains", "locating", "naming", "proving")
"""Names that `progress` is called with, in order."""


def diagnose(
    recordings: Recording | str | Path | Sequence[Recording | str | Path],
    robot: Robot | str | Path,
    columns: Columns | str | Path | None = None,
    seed: int = 0,
) -> Diagnosis:
    """Decide whether a robot file explains recordings and, if not, what is wrong or missing.

    Args:
        recordings: Runs, or paths of their files; one by itself is a list of one.
        robot: Robot, preset name or TOML path that the simulator uses.
        columns: Mapping for foreign files.
        seed: Seed of all random numbers: those of bootstraps, placebos and trees.

    Raises:
        RecordingError: A file cannot be read.
        RobotError: The robot cannot be loaded.
    """
    return analyse(recordings, robot, columns, seed).diagnosis


def analyse(
    recordings: Recording | str | Path | Sequence[Recording | str | Path],
    robot: Robot | str | Path,
    columns: Columns | str | Path | None = None,
    seed: int = 0,
    progress: Progress = lambda stage: None,
    without: Collection[str] = (),
) -> Analysis:
    """As `diagnose`, with the evidence that the report shows; `progress` is called with the name of each stage.

    Conditions of naming `without` which it runs refuse nothing: an experiment, for what a condition is worth.
    """
    check_names(without)
    robot = load_robot(robot)
    progress("reading")
    recorded = _read(recordings, columns, robot)
    progress("checking")
    with threadpool_limits(1):  # busy waiting between threads slows many small products
        usable, findings = usable_runs(recorded, robot)
    infos = _infos(recorded, {run.name for run in usable})
    if not usable:
        untestable = Diagnosis(robot.name, infos, "not_testable", nothing_usable(findings), made_by=made_by(seed))
        return Analysis(untestable, robot, robot, tuple(findings), None)
    rng = np.random.default_rng(seed)
    with threadpool_limits(1):
        runs, gauge = weigh_gauge(average(usable, thresholds.SAMPLES_A_WINDOW), robot)
        evidence, fit = _gather(runs, robot, rng, progress, without)
        verdict, off = _conclude(evidence)
        choice = choose_file(robot, verdict, evidence, rng)
    if gauge is not None:
        gauge = dataclasses.replace(gauge, question=capacity_question(evidence.capacity, robot))
        lines = [line for line in (gauge.says, gauge.question) if line]
        findings += [Finding(runs.signals[0].name, line) for line in lines]
    if choice.held_out is not None:
        arm = score(choice.held_out, runs, evidence.block, evidence.trip, rng)
        fit = dataclasses.replace(fit, arms={**fit.arms, "file": arm})
        evidence = dataclasses.replace(evidence, predictions={**evidence.predictions, "file": choice.held_out})
    if choice.joint is not None:
        evidence = dataclasses.replace(evidence, joint=choice.joint)
    missing = missing_physics(evidence)
    where = evidence.location.places if evidence.location is not None else ()
    nominal = evidence.predictions.get("nominal")
    reach = None
    if nominal is not None and choice.replayed is not None:
        reach = recorded_range((robot, choice.robot), (nominal, choice.replayed), runs, rng)
    shows_range = runs.unit == "W" and verdict != "unknown_physics"
    diagnosis = Diagnosis(
        robot.name,
        infos,
        verdict,
        summary(verdict, evidence, off, fit, findings, missing, choice.file, gauge),
        parameters=() if verdict in ("unknown_physics", "not_testable") else evidence.measured,
        parameters_off=off if verdict in ("parameters_off", "missing_physics") else (),
        missing_physics=missing,
        not_named=not_named(evidence),
        together=evidence.naming.together,
        where=where or tuple(place for effect in missing for place in effect.where),
        fit=fit,
        what_this_log_can_show={effect: evidence.naming.absorbed.get(effect) for effect in CATALOGUE},
        products=evidence.products,
        range=reach,
        range_change_m=float(d_max(choice.robot) - d_max(robot)) if shows_range else None,
        file=choice.file,
        gauge=gauge,
        next_experiment=next_experiment(evidence),
        made_by=made_by(seed),
    )
    return Analysis(diagnosis, robot, choice.robot, tuple(findings), evidence)


def _read(
    recordings: Recording | str | Path | Sequence[Recording | str | Path],
    columns: Columns | str | Path | None,
    robot: Robot,
) -> list[Recording]:
    """The recordings, without readings faster than the robot can drive."""
    given = list(recordings) if isinstance(recordings, Sequence) and not isinstance(recordings, str) else [recordings]
    if not given:
        raise RecordingError("no recordings given")
    strange = [type(recording).__name__ for recording in given if not isinstance(recording, Recording | str | Path)]
    if strange:
        raise RecordingError(f"a recording is a path or what read_recording returns, not a {strange[0]}")
    recorded = [
        recording if isinstance(recording, Recording) else read_recording(recording, columns) for recording in given
    ]
    return [within_top_speed(recording, robot.max_speed_mps) for recording in recorded]


def _infos(recorded: Sequence[Recording], used: Collection[str]) -> tuple[RecordingInfo, ...]:
    """The recordings that are used, each once."""
    by_name = {recording.name: recording for recording in recorded}
    return tuple(
        RecordingInfo(name, recording.sha256, recording.duration_s, len(recording))
        for name, recording in by_name.items()
        if name in used
    )


def _gather(
    runs: Runs, robot: Robot, rng: Generator, progress: Progress, without: Collection[str]
) -> tuple[Evidence, Fit]:
    progress("refitting")
    fitted = refit(runs, robot)
    blocks = independent_blocks(fitted, runs)
    block = blocks.channels
    fold, held_out_by = cut_folds(runs, block)
    enough = int(block.max()) + 1 >= thresholds.FEWEST_BLOCKS
    progress("testing what remains")
    dependent = dependences(fitted, runs, blocks, fold, rng) if enough else []
    explanation = explain(fitted, runs, dependent, block, fold, rng, progress, without)
    corrected = explanation.naming.corrected
    if corrected is not None and any(effect.term.axis == "time" for effect in explanation.naming.named):
        # A change at one moment of a run does not predict other runs: hold out stretches.
        fold, held_out_by = block % FOLDS, "block"
    capacity, shown = find_effects(fitted, _fault_free(runs, corrected), block, rng) if enough else (None, ())
    progress("proving")
    # A group that is held because an effect compensates for it is confounded with the effect.
    named = fitted if corrected is None or (corrected.groups.held & ~immaterial(fitted, runs)).any() else corrected
    plain, corrected = determined(fitted, corrected, runs, block)
    together: tuple[Product, ...] = ()
    if corrected is None:
        known = _known(named, plain, runs, block)
    else:
        left_open = profiled(holding(fitted, runs, corrected.groups.held), corrected, runs, block)
        corrected = left_open.spanning
        known = left_open.spanned(_known(named, corrected, runs, block), runs, block)
        together = left_open.products(runs, block)
    predicted = _predictions(fitted, corrected, explanation.empirical, runs, fold, rng)
    evidence = Evidence(
        runs=runs,
        fitted=fitted,
        plain=plain,
        block=block,
        fold=fold,
        held_out_by=held_out_by,
        predictions=predicted,
        estimates=known,
        dependences=tuple(dependent),
        location=explanation.location,
        naming=explanation.naming,
        corrected=corrected,
        empirical=explanation.empirical,
        capacity=capacity,
        channel_effects=shown,
        remaining=explanation.remaining,
        products=together,
        joint=joint(corrected or plain, runs, block),
    )
    arms = {name: score(values, runs, block, evidence.trip, rng) for name, values in predicted.items()}
    return evidence, Fit(runs.unit, held_out_by, len(np.unique(fold)), arms)


def _fault_free(runs: Runs, corrected: Corrected | None) -> Runs:
    """The runs corrected for named faults of the meter."""
    return runs if corrected is None else dataclasses.replace(runs, observed=runs.observed - corrected.misread)


def _known(named: Fitted, determined: Fitted, runs: Runs, block: Index) -> tuple[Estimate, ...]:
    """Estimate of each group, fitted beside those that are held; held and confounded groups have none."""
    known = []
    terms = determined.model.terms if isinstance(determined, Corrected) else ()
    effects = tuple(term.effect.replace("_", " ") for term in terms)
    rows = zip(
        estimates(named, runs, block), estimates(determined, runs, block), determined.groups.held.tolist(), strict=True
    )
    for free, last, held in rows:
        if held and free.status in ("fitted", "at bound"):
            known.append(free.confounded(free.mixed_with or effects))
        else:
            known.append(free if held or free.status == "confounded" else last)
    return tuple(known)


def _predictions(
    fitted: Refit, corrected: Corrected | None, empirical: Empirical | None, runs: Runs, fold: Index, rng: Generator
) -> dict[str, Array]:
    """Held-out predictions of each arm, shape (windows,)."""
    problem = fitted.parameters
    arms = {"nominal": problem.predict(runs, problem.start)} if problem.current_known else {}
    arms["refit"] = held_out(lambda chosen: fitted.fitted_to(chosen, runs.observed).replayed(runs), fold)

    def beside(columns: Array) -> Array:
        return held_out(lambda chosen: with_columns(fitted, chosen, runs.observed, columns), fold)

    if corrected is not None:
        arms["corrected"] = held_out(lambda chosen: corrected.refitted(chosen, runs).replayed(runs), fold)
        arms["placebo"] = beside(shifted_in_time(np.column_stack(corrected.contribution), rng))
    elif empirical is not None:
        arms["corrected"] = beside(empirical.columns)
        arms["placebo"] = beside(shifted_in_time(empirical.columns, rng))
    arms["black_box"] = held_out(lambda chosen: black_box(runs, fitted.predicted, chosen, rng), fold)
    return arms


def _conclude(evidence: Evidence) -> tuple[Verdict, tuple[FittedGroup, ...]]:
    """The verdict by precedence, and the parameters whose interval excludes the robot file's value."""
    excluded = {estimate.group.symbol for estimate in evidence.estimates if estimate.off}
    off = tuple(group for group in evidence.measured if group.group in excluded)
    capacity = evidence.capacity
    if capacity is not None and capacity.written:
        interval, rivals = capacity.ci95, capacity.rivals
        off = (*off, FittedGroup(USABLE_ENERGY, capacity.assumed_j, capacity.fitted_j, interval, "J", rivals))
    if evidence.blocks < thresholds.FEWEST_BLOCKS:
        return "not_testable", ()
    if evidence.naming.named or evidence.channel_effects:
        return "missing_physics", off
    if evidence.location is not None:
        return "unknown_physics", off
    if all(estimate.fitted is None for estimate in evidence.estimates):
        return "not_testable", ()
    nominal, refitted = evidence.predictions.get("nominal"), evidence.predictions["refit"]
    if nominal is None:
        return "no_mismatch", ()
    observed = evidence.runs.observed
    before, after = float(np.mean((observed - nominal) ** 2)), float(np.mean((observed - refitted) ** 2))
    # A gain below the instruments' own errors, or below that required of an effect, is no wrong parameter.
    least = max(
        thresholds.SMALLEST_GAIN * before, (thresholds.CLEAR * thresholds.GAIN_ERROR) ** 2 * float(np.mean(observed**2))
    )
    least = max(least, (_CLEAR_OF_TILT * tilt_error(evidence.fitted, evidence.runs)) ** 2)
    p_value = better(refitted, nominal, observed, evidence.block)
    if p_value > thresholds.FALSE_ALARM_RATE or before - after < least:
        other_capacity = capacity is not None and capacity.written
        return ("parameters_off", off[-1:]) if other_capacity else ("no_mismatch", ())
    if any(estimate.status == "at bound" for estimate in evidence.estimates):
        return "unknown_physics", off  # only unphysical parameters would explain the recordings
    return "parameters_off", off
