"""The chain from recordings to verdict: check, refit, test the residual, locate, name, validate,
conclude."""

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.random import Generator
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.channel_effects.find import find_effects
from homeward.diagnosis.explain.channel_effects.shown import USABLE_ENERGY, ChannelEffect
from homeward.diagnosis.explain.conditions import check_names
from homeward.diagnosis.explain.explanation import explain
from homeward.diagnosis.explain.formula import Empirical
from homeward.diagnosis.explain.gauge import capacity_question, weigh_gauge
from homeward.diagnosis.explain.joint_fit import Corrected, immaterial
from homeward.diagnosis.explain.limits import Limit, limited
from homeward.diagnosis.explain.residual_test import dependences, independent_blocks
from homeward.diagnosis.explain.uncertainty import joint, profiled, recorded_range
from homeward.diagnosis.fit.channel_errors import tilt_error
from homeward.diagnosis.fit.estimates import Estimate, estimates
from homeward.diagnosis.fit.fitted import Fitted, with_columns
from homeward.diagnosis.fit.folds import FOLDS, cut_folds
from homeward.diagnosis.fit.held_out import better, black_box, held_out, score
from homeward.diagnosis.fit.refit import Refit, holding, refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import Finding, usable_runs
from homeward.diagnosis.result import (
    Diagnosis,
    Fit,
    FittedGroup,
    MissingPhysics,
    Place,
    Product,
    Range,
    RecordingInfo,
    Verdict,
)
from homeward.diagnosis.tell.file_choice import FileChoice, choose_file, determined
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

# standard errors of the tilt of a slope sensor
_CLEAR_OF_TILT = float(norm.isf(thresholds.FALSE_ALARM_RATE / 2.0))

STAGES = (
    "reading",
    "checking",
    "refitting",
    "testing what remains",
    "locating",
    "naming",
    "proving",
)
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
    """As `diagnose`, with the evidence that the report shows; `progress` is called with the name of
    each stage.

    Conditions of naming `without` which it runs refuse nothing: an experiment, for what a condition
    is worth.
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
        untestable = Diagnosis(
            robot.name, infos, "not_testable", nothing_usable(findings), made_by=made_by(seed)
        )
        return Analysis(untestable, robot, robot, tuple(findings), None)
    # All steps draw from one sequence: their order is part of the result, to the last digit.
    rng = np.random.default_rng(seed)
    with threadpool_limits(1):
        runs, gauge = weigh_gauge(average(usable, thresholds.SAMPLES_A_WINDOW), robot)
        evidence, fit = _gather(runs, robot, rng, progress, without)
        verdict, off = _conclude(evidence)
        choice = choose_file(robot, verdict, evidence, rng)
    if gauge is not None:
        gauge = dataclasses.replace(gauge, question=capacity_question(evidence.capacity, robot))
        findings += [
            Finding(runs.signals[0].name, line) for line in (gauge.says, gauge.question) if line
        ]
    evidence, fit = _with_file(choice, evidence, fit, rng)
    missing = missing_physics(evidence)
    diagnosis = Diagnosis(
        robot=robot.name,
        recordings=infos,
        verdict=verdict,
        summary=summary(verdict, evidence, off, fit, findings, missing, choice.file, gauge),
        parameters=() if verdict in ("unknown_physics", "not_testable") else evidence.measured,
        parameters_off=off if verdict in ("parameters_off", "missing_physics") else (),
        missing_physics=missing,
        not_named=not_named(evidence),
        together=evidence.naming.together,
        where=_where(evidence, missing),
        fit=fit,
        what_this_log_can_show={
            effect: evidence.naming.absorbed.get(effect) for effect in CATALOGUE
        },
        products=evidence.products,
        range=_range(robot, choice, evidence, rng),
        range_change_m=_range_change_m(robot, choice.robot, verdict, runs),
        file=choice.file,
        gauge=gauge,
        next_experiment=next_experiment(evidence),
        made_by=made_by(seed),
    )
    return Analysis(diagnosis, robot, choice.robot, tuple(findings), evidence)


def _where(evidence: Evidence, missing: Sequence[MissingPhysics]) -> tuple[Place, ...]:
    """The places of the mismatch or, where it was not located, those of the effects."""
    if evidence.location is not None and evidence.location.places:
        return evidence.location.places
    return tuple(place for effect in missing for place in effect.where)


def _with_file(
    choice: FileChoice, evidence: Evidence, fit: Fit, rng: Generator
) -> tuple[Evidence, Fit]:
    """Evidence and fit with the arm of corrected.toml, where its prediction can be tested, and its
    joint covariance."""
    if choice.held_out is not None:
        arm = score(choice.held_out, evidence.runs, evidence.block, evidence.trip, rng)
        fit = dataclasses.replace(fit, arms={**fit.arms, "file": arm})
        evidence = dataclasses.replace(
            evidence, predictions={**evidence.predictions, "file": choice.held_out}
        )
    if choice.joint is not None:
        evidence = dataclasses.replace(evidence, joint=choice.joint)
    return evidence, fit


def _range(robot: Robot, choice: FileChoice, evidence: Evidence, rng: Generator) -> Range | None:
    """Range as recorded and by both files; None where one of them cannot predict the recordings."""
    nominal = evidence.predictions.get("nominal")
    if nominal is None or choice.replayed is None:
        return None
    return recorded_range((robot, choice.robot), (nominal, choice.replayed), evidence.runs, rng)


def _range_change_m(robot: Robot, corrected: Robot, verdict: Verdict, runs: Runs) -> float | None:
    """Change of d_max by the correction; None of motor current, and of a fit that absorbs unknown
    physics."""
    if runs.unit != "W" or verdict == "unknown_physics":
        return None
    return float(d_max(corrected) - d_max(robot))


def _read(
    recordings: Recording | str | Path | Sequence[Recording | str | Path],
    columns: Columns | str | Path | None,
    robot: Robot,
) -> list[Recording]:
    """The recordings, without readings faster than the robot can drive."""
    if isinstance(recordings, Recording | str | Path) or not isinstance(recordings, Sequence):
        recordings = [recordings]
    if not recordings:
        raise RecordingError("no recordings given")
    for recording in recordings:
        if not isinstance(recording, Recording | str | Path):
            kind = type(recording).__name__
            raise RecordingError(
                f"a recording is a path or what read_recording returns, not a {kind}"
            )
    recorded = [
        recording if isinstance(recording, Recording) else read_recording(recording, columns)
        for recording in recordings
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
    """The evidence from the runs, and the held-out errors of each arm; no arm of corrected.toml
    yet."""
    progress("refitting")
    fitted = refit(runs, robot)
    blocks = independent_blocks(fitted, runs)
    block = blocks.channels
    fold, held_out_by = cut_folds(runs, block)
    enough_blocks = int(block.max()) + 1 >= thresholds.FEWEST_BLOCKS
    progress("testing what remains")
    dependent = dependences(fitted, runs, blocks, fold, rng) if enough_blocks else []
    explanation = explain(fitted, runs, dependent, block, fold, rng, progress, without)
    model = explanation.naming.corrected
    if model is not None and any(named.term.axis == "time" for named in explanation.naming.named):
        # A change at one moment of a run does not predict other runs: hold out stretches.
        fold = block % FOLDS
        held_out_by = "block"
    capacity = None
    channel_effects: tuple[ChannelEffect, ...] = ()
    if enough_blocks:
        capacity, channel_effects = find_effects(fitted, _fault_free(runs, model), block, rng)
    progress("proving")
    free_fit = _estimated_freely(fitted, model, runs)
    plain, model = determined(fitted, model, runs, block)
    limits: Mapping[str, Limit] = {}
    products: tuple[Product, ...] = ()
    if model is None:
        estimated = _known(free_fit, plain, runs, block)
    else:
        material = holding(fitted, runs, model.groups.held)
        profile = profiled(material, model, runs, block, beyond_recorded=True)
        model = profile.spanning
        estimated = profile.spanned(_known(free_fit, model, runs, block), runs, block)
        with_limits = limited(model, estimated, fitted.parameters, runs, block)
        model = with_limits.model
        estimated = with_limits.estimates
        limits = with_limits.limits
        products = (*profile.products(runs, block), *with_limits.products)
    predicted = _predictions(fitted, model, explanation.empirical, runs, fold, rng)
    evidence = Evidence(
        runs=runs,
        fitted=fitted,
        plain=plain,
        block=block,
        fold=fold,
        held_out_by=held_out_by,
        predictions=predicted,
        estimates=estimated,
        dependences=tuple(dependent),
        location=explanation.location,
        naming=explanation.naming,
        corrected=model,
        empirical=explanation.empirical,
        capacity=capacity,
        channel_effects=channel_effects,
        remaining=explanation.remaining,
        limits=limits,
        products=products,
        joint=joint(model or plain, runs, block),
    )
    arms = {
        name: score(values, runs, block, evidence.trip, rng) for name, values in predicted.items()
    }
    return evidence, Fit(runs.unit, held_out_by, len(np.unique(fold)), arms)


def _estimated_freely(fitted: Refit, model: Corrected | None, runs: Runs) -> Fitted:
    """The fit in which no group is held because an effect compensates for it: such a group is
    confounded with it."""
    if model is None:
        return fitted
    compensated = model.groups.held & ~immaterial(fitted, runs)
    return fitted if compensated.any() else model


def _fault_free(runs: Runs, corrected: Corrected | None) -> Runs:
    """The runs corrected for named faults of the meter."""
    if corrected is None:
        return runs
    return dataclasses.replace(runs, observed=runs.observed - corrected.misread)


def _known(free_fit: Fitted, determined: Fitted, runs: Runs, block: Index) -> tuple[Estimate, ...]:
    """Estimate of each group, fitted beside those that are held; held and confounded groups have
    none.

    Args:
        free_fit: The fit before groups were held that are not identifiable.
        determined: The fit with these held.
        runs: The runs.
        block: Windows of one block, (windows,), are dependent.
    """
    estimated = []
    of_free_fit = estimates(free_fit, runs, block)
    of_determined = estimates(determined, runs, block)
    held = determined.groups.held.tolist()
    for number, (free_estimate, estimate) in enumerate(
        zip(of_free_fit, of_determined, strict=True)
    ):
        is_held = held[number]
        profiles = _profiles_over(determined, number)
        if is_held and free_estimate.status in ("fitted", "at bound"):
            estimated.append(
                free_estimate.confounded(free_estimate.mixed_with or _effects(determined))
            )
        elif is_held or free_estimate.status == "confounded":
            estimated.append(free_estimate)
        elif profiles:
            estimated.append(estimate.confounded(profiles))
        else:
            estimated.append(estimate)
    return tuple(estimated)


def _effects(model: Fitted) -> tuple[str, ...]:
    """Names of the effects in a model."""
    if isinstance(model, Corrected):
        return tuple(term.hypothesis.name for term in model.model.terms)
    return ()


def _profiles_over(model: Fitted, group: int) -> tuple[str, ...]:
    """Names of the effects whose profile along the way contains a group, by its index."""
    if isinstance(model, Corrected):
        return tuple(term.hypothesis.name for term in model.profiles_over(group))
    return ()


def _predictions(
    fitted: Refit,
    corrected: Corrected | None,
    empirical: Empirical | None,
    runs: Runs,
    fold: Index,
    rng: Generator,
) -> dict[str, Array]:
    """Held-out predictions of each arm, shape (windows,)."""
    problem = fitted.parameters

    def refit_with(columns: Array) -> Array:
        return held_out(
            lambda training: with_columns(fitted, training, runs.observed, columns), fold
        )

    arms: dict[str, Array] = {}
    if problem.current_known:
        arms["nominal"] = problem.predict(runs, problem.start)
    arms["refit"] = held_out(
        lambda training: fitted.fitted_to(training, runs.observed).replayed(runs), fold
    )
    # The placebo, the same columns at other times, says what such columns gain by chance.
    if corrected is not None:
        arms["corrected"] = held_out(
            lambda training: corrected.refitted(training, runs).replayed(runs), fold
        )
        arms["placebo"] = refit_with(shifted_in_time(np.column_stack(corrected.contribution), rng))
    elif empirical is not None:
        arms["corrected"] = refit_with(empirical.columns)
        arms["placebo"] = refit_with(shifted_in_time(empirical.columns, rng))
    # Trees see what the refit predicts and every channel: they bound what a model of these channels
    # can gain.
    arms["black_box"] = held_out(
        lambda training: black_box(runs, fitted.predicted, training, rng), fold
    )
    return arms


def _conclude(evidence: Evidence) -> tuple[Verdict, tuple[FittedGroup, ...]]:
    """The verdict by precedence, and the parameters whose interval excludes the robot file's
    value."""
    off = _parameters_off(evidence)
    if evidence.blocks < thresholds.FEWEST_BLOCKS:
        return "not_testable", ()  # too short: whatever is missing could not be significant
    if evidence.naming.named or evidence.channel_effects:
        return "missing_physics", off
    if evidence.location is not None:
        # the residual depends on a channel, and no known effect explains it
        return "unknown_physics", off
    if all(estimate.fitted is None for estimate in evidence.estimates):
        return "not_testable", ()
    nominal = evidence.predictions.get("nominal")
    if nominal is None:
        # the file gives no thrust per ampere: there is nothing to compare with currents
        return "no_mismatch", ()
    if not _refit_is_better(nominal, evidence):
        of_battery = tuple(group for group in off if group.group == USABLE_ENERGY)
        if of_battery:
            return "parameters_off", of_battery
        return "no_mismatch", ()
    if any(estimate.status == "at bound" for estimate in evidence.estimates):
        return "unknown_physics", off  # only unphysical parameters would explain the recordings
    return "parameters_off", off


def _parameters_off(evidence: Evidence) -> tuple[FittedGroup, ...]:
    """Groups whose interval excludes the robot file's value, and last the battery's usable energy,
    where it does."""
    excluded = {estimate.group.symbol for estimate in evidence.estimates if estimate.off}
    groups = [group for group in evidence.measured if group.group in excluded]
    capacity = evidence.capacity
    if capacity is not None and capacity.written:
        groups.append(
            FittedGroup(
                group=USABLE_ENERGY,
                assumed=capacity.assumed_j,
                fitted=capacity.fitted_j,
                ci95=capacity.ci95,
                unit="J",
                confused_with=capacity.rivals,
            )
        )
    return tuple(groups)


def _refit_is_better(nominal: Array, evidence: Evidence) -> bool:
    """Whether the refit predicts held-out windows better than the robot file, `nominal`, shape
    (windows,).

    The gain must be significant, and larger than the instruments' own errors and than that required
    of an effect: a smaller one is no wrong parameter.
    """
    observed = evidence.runs.observed
    refitted = evidence.predictions["refit"]
    p_value = better(refitted, nominal, observed, evidence.block)
    if p_value > thresholds.FALSE_ALARM_RATE:
        return False
    nominal_error = float(np.mean((observed - nominal) ** 2))
    refit_error = float(np.mean((observed - refitted) ** 2))
    smallest_gain = max(
        thresholds.SMALLEST_GAIN * nominal_error,
        (thresholds.CLEAR * thresholds.GAIN_ERROR) ** 2 * float(np.mean(observed**2)),
        (_CLEAR_OF_TILT * tilt_error(evidence.fitted, evidence.runs)) ** 2,
    )
    return nominal_error - refit_error >= smallest_gain
