"""The chain from recordings to verdict: check, refit, test what remains, locate, name, model, prove, conclude."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis import wording
from homeward.diagnosis.arms import better, black_box, held_out, range_accuracy_pct, score
from homeward.diagnosis.bench import FOLDS
from homeward.diagnosis.blocks import correlation_windows, cut_folds
from homeward.diagnosis.charge import USABLE_ENERGY, Charge, weigh_charge
from homeward.diagnosis.columns import Columns
from homeward.diagnosis.correct import of_capacity, range_change
from homeward.diagnosis.describe import fading, missing_physics
from homeward.diagnosis.empirical import Empirical
from homeward.diagnosis.experiment import next_experiment, to_tell_apart
from homeward.diagnosis.explanation import Explanation, Left, explain
from homeward.diagnosis.fitted import Fitted, with_columns
from homeward.diagnosis.handover import determined, hand_over, sayable
from homeward.diagnosis.hypotheses import what_can_be_shown
from homeward.diagnosis.location import Location
from homeward.diagnosis.modelling import Corrected
from homeward.diagnosis.naming import Naming, shifted_in_time
from homeward.diagnosis.parameters import with_effects_of
from homeward.diagnosis.quality import Finding, usable_runs
from homeward.diagnosis.recordings import Recording, RecordingError, read_recording
from homeward.diagnosis.refit import Estimate, Refit, estimates, refit
from homeward.diagnosis.replay import Runs, average, power_w
from homeward.diagnosis.result import Diagnosis, Fit, ParameterOff, Product, RecordingInfo, Verdict
from homeward.diagnosis.rules import FALSE_ALARM_RATE, FEWEST_BLOCKS, SAMPLES_A_WINDOW
from homeward.diagnosis.signals import Array
from homeward.diagnosis.structure import Dependence, dependences, independent_blocks
from homeward.diagnosis.uncertainty import Joint, Spread, joint, products, recorded_range, spread
from homeward.physics import Robot, load_robot

Progress = Callable[[str], None]

STAGES = (
    "reading", "checking", "refitting", "testing what remains", "locating", "naming", "proving",
)  # fmt: skip
"""Names that `progress` is called with, in order."""


@dataclass(frozen=True)
class Evidence:
    """What the verdict rests on, for the report; arrays of shape (windows,).

    There is no arm `nominal` where the robot file cannot predict what was recorded (motor current without a known
    thrust per ampere), and none `corrected` where nothing was named and no formula was found.
    """

    runs: Runs
    fitted: Refit
    plain: Refit  # with every group that the recordings leave open as the robot file has it
    block: NDArray[np.intp]
    fold: NDArray[np.intp]  # what is held out together
    held_out_by: Literal["run", "block"]
    predictions: Mapping[str, Array]  # by arm, held out
    estimates: tuple[Estimate, ...]
    dependences: tuple[Dependence, ...]
    location: Location | None
    naming: Naming
    corrected: Corrected | None  # the fitted model, where effects were named
    empirical: Empirical | None  # the formula that the mismatch follows, where no effect explains it
    range_accuracy_pct: Mapping[str, float | None]  # by arm, of held-out trips
    charge: Charge | None  # of the battery beside the drive, where its state was recorded
    remains: Left | None  # what the named effects leave, where it still depends on a channel
    products: tuple[Product, ...]  # of which the recordings determine no factor alone
    joint: Joint  # covariance of everything that was fitted together
    spread: Spread  # of what the last model leaves, between runs and within them

    @property
    def held(self) -> tuple[str, ...]:
        """Symbols of the groups that stay as the robot file has them."""
        groups = (self.plain if self.corrected is None else self.corrected).groups
        return tuple(one.symbol for one, held in zip(groups.parameters.groups, groups.held, strict=True) if held)

    @property
    def trip(self) -> NDArray[np.intp]:
        """What counts as one trip, shape (windows,)."""
        return self.runs.run if self.held_out_by == "run" else self.fold

    @property
    def fades(self) -> bool:
        """Whether the recorded state of charge shows a battery that ages."""
        return self.charge is not None and self.charge.fading is not None

    @property
    def contributions(self) -> tuple[Array, ...]:
        """What each named effect adds, in the order of the diagnosis, shape (windows,) each."""
        found = () if self.corrected is None else self.corrected.contribution
        return (*found, self.charge.wasted(self.runs)) if self.charge is not None and self.fades else found

    @property
    def left(self) -> Array:
        """What the named effects leave or, where there are none, the refit; shape (windows,)."""
        model = self.fitted if self.corrected is None else self.corrected
        return self.runs.observed - model.predicted

    @property
    def nominal(self) -> Array | None:
        """What the robot file predicts."""
        return self.predictions.get("nominal")

    @property
    def refit(self) -> Array:
        """What the refit predicts of what it has not seen."""
        return self.predictions["refit"]


@dataclass(frozen=True)
class Analysis:
    """A diagnosis with its evidence and the corrected robot."""

    diagnosis: Diagnosis
    robot: Robot
    corrected: Robot
    findings: tuple[Finding, ...]
    evidence: Evidence | None  # None where no run can be used

    def per_sample(self, name: str) -> Array:
        """Battery power that the corrected file says of one run, W, shape (samples,), at the run's `time_s`.

        Args:
            name: Path of the recording.

        Raises:
            KeyError: No usable run has this name.
        """
        runs = {} if self.evidence is None else {run.name: run for run in self.evidence.runs.signals}
        return power_w(runs[name], self.corrected)


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
    evidence, fit = _weigh(average(usable, SAMPLES_A_WINDOW), robot, seed, progress)
    verdict, off = _conclude(evidence)
    handover = hand_over(
        robot, verdict, (evidence.plain, sayable(evidence.plain, evidence.corrected, evidence.runs, evidence.block)),
        evidence.predictions, evidence.runs, evidence.fold, evidence.trip, seed,
    )  # fmt: skip
    evidence, fit = _with_file(evidence, fit, handover.held_out, seed)
    found = (
        ()
        if evidence.corrected is None
        else missing_physics(evidence.corrected, evidence.naming.named, evidence.runs, _drives(evidence))
    )
    corrected = handover.robot
    if evidence.charge is not None and evidence.charge.fading is not None:
        faded = fading(evidence.charge.fading, evidence.contributions[-1], evidence.runs)
        found = (*found, faded)
        numbers = {name: value.value for name, value in faded.parameters.items()}
        corrected = with_effects_of(corrected, {faded.effect: numbers})
    if evidence.charge is not None and evidence.charge.off and verdict != "unknown_physics":
        corrected = of_capacity(corrected, evidence.charge.fitted_j / evidence.charge.assumed_j)
    where = evidence.location.places if evidence.location is not None else ()
    diagnosis = Diagnosis(
        robot.name,
        infos,
        verdict,
        wording.summary(verdict, evidence, off, fit, findings, found, handover.handed),
        parameters_off=off if verdict in ("parameters_off", "missing_physics") else (),
        missing_physics=found,
        where=where or tuple(place for one in found for place in one.where),
        fit=fit,
        what_this_log_can_show=what_can_be_shown(evidence.naming.absorbed),
        products=evidence.products,
        range=None
        if evidence.nominal is None or handover.replayed is None
        else recorded_range((robot, corrected), (evidence.nominal, handover.replayed), evidence.runs, seed),
        range_change_m=None
        if evidence.runs.unit == "A" or verdict == "unknown_physics"
        else range_change(robot, corrected),
        file=handover.handed,
        next_experiment=_next(evidence),
    )
    return Analysis(diagnosis, robot, corrected, tuple(findings), evidence)


def _drives(evidence: Evidence) -> list[str]:
    """For each named effect the drive that would tell it from its rivals."""
    return [
        to_tell_apart(evidence.fitted, evidence.runs, evidence.left, one.term, one.rivals)
        for one in evidence.naming.named
    ]


def _next(evidence: Evidence) -> str | None:
    return next_experiment(
        evidence.fitted,
        evidence.runs,
        evidence.left,
        evidence.estimates,
        [(one.term, one.rivals) for one in evidence.naming.named],
        evidence.location,
        enough=int(evidence.block.max()) + 1 >= FEWEST_BLOCKS,
    )


def _weigh(runs: Runs, robot: Robot, seed: int, progress: Progress) -> tuple[Evidence, Fit]:
    progress("refitting")
    fitted = refit(runs, robot)
    blocks = independent_blocks(fitted, runs)
    block = blocks.channels
    fold, held_out_by = cut_folds(runs, block)
    problem = fitted.parameters
    nominal = problem.predict(runs, problem.start) if problem.current_known else None
    enough = int(block.max()) + 1 >= FEWEST_BLOCKS
    progress("testing what remains")
    found = dependences(fitted, runs, blocks, fold, seed) if enough else []
    told = explain(fitted, runs, found, block, fold, seed, progress) if found else Explanation(Naming(), None, None)
    corrected = told.naming.corrected
    if corrected is not None and any(one.term.axis == "time" for one in told.naming.named):
        # What happened at some moment of a run says nothing of other runs: hold out stretches.
        fold, held_out_by = block % FOLDS, "block"
    charge = weigh_charge(runs, robot, block, seed) if enough else None
    progress("proving")
    named = fitted if corrected is None else corrected
    plain, corrected = determined(fitted, corrected, runs, block)
    last = plain if corrected is None else corrected
    predicted = _predictions(fitted, corrected, told.empirical, nominal, runs, fold, seed)
    known = _known(named, last, runs, block)
    left = runs.observed - last.predicted
    evidence = Evidence(
        runs,
        fitted,
        plain,
        block,
        fold,
        held_out_by,
        predicted,
        known,
        tuple(found),
        told.location,
        told.naming,
        corrected,
        told.empirical,
        {
            name: range_accuracy_pct(one, runs, runs.run if held_out_by == "run" else fold)
            for name, one in predicted.items()
        },
        charge,
        told.left,
        () if corrected is None else products(corrected, runs, block),
        joint(last, runs, block),
        spread(left, runs, correlation_windows(left, runs.run)),
    )
    arms = {name: score(one, runs, block, fold, held_out_by, seed) for name, one in predicted.items()}
    return evidence, Fit(runs.unit, held_out_by, len(np.unique(fold)), arms)


def _known(named: Fitted, determined: Fitted, runs: Runs, block: NDArray[np.intp]) -> tuple[Estimate, ...]:
    """What is known of each group, fitted beside those that are held: of these, and of what was confounded, nothing."""
    known = []
    rows = zip(
        estimates(named, runs, block), estimates(determined, runs, block), determined.groups.held.tolist(), strict=True
    )
    for free, last, held in rows:
        if held and free.status == "fitted":
            known.append(dataclasses.replace(free, fitted=None, ci95=None, status="confounded", off=False))
        else:
            known.append(free if held or free.status == "confounded" else last)
    return tuple(known)


def _with_file(evidence: Evidence, fit: Fit, predicted: Array | None, seed: int) -> tuple[Evidence, Fit]:
    """Evidence and arms with what the file that is handed over predicts."""
    if predicted is None:
        return evidence, fit
    runs = evidence.runs
    arm = score(predicted, runs, evidence.block, evidence.fold, evidence.held_out_by, seed)
    accuracy = range_accuracy_pct(predicted, runs, evidence.trip)
    return (
        dataclasses.replace(
            evidence,
            predictions={**evidence.predictions, "file": predicted},
            range_accuracy_pct={**evidence.range_accuracy_pct, "file": accuracy},
        ),
        dataclasses.replace(fit, arms={**fit.arms, "file": arm}),
    )


def _predictions(
    fitted: Refit,
    corrected: Corrected | None,
    empirical: Empirical | None,
    nominal: Array | None,
    runs: Runs,
    fold: NDArray[np.intp],
    seed: int,
) -> dict[str, Array]:
    """What each arm predicts of windows that it has not seen."""
    arms: dict[str, Array] = {} if nominal is None else {"nominal": nominal}
    arms["refit"] = held_out(lambda chosen: fitted.fitted_to(chosen, runs.observed).replayed(runs), fold)
    rng = np.random.default_rng(seed)
    added = None
    if corrected is not None:
        arms["corrected"] = held_out(lambda chosen: corrected.fitted_to(chosen, runs.observed).replayed(runs), fold)
        added = np.column_stack(corrected.contribution)
    elif empirical is not None:
        added = empirical.columns
        arms["corrected"] = held_out(
            lambda chosen: with_columns(fitted, chosen, runs.observed, empirical.columns), fold
        )
    if added is not None:
        placebo = shifted_in_time(added, rng)
        arms["placebo"] = held_out(lambda chosen: with_columns(fitted, chosen, runs.observed, placebo), fold)
    arms["black_box"] = held_out(lambda chosen: black_box(runs, fitted.predicted, chosen, rng), fold)
    return arms


def _conclude(evidence: Evidence) -> tuple[Verdict, tuple[ParameterOff, ...]]:
    """The verdict by precedence, and the parameters whose interval excludes what the robot file assumes."""
    off = tuple(
        ParameterOff(one.group.symbol, one.assumed, one.fitted, one.ci95, one.group.unit)
        for one in evidence.estimates
        if one.off and one.assumed is not None and one.fitted is not None and one.ci95 is not None
    )
    if evidence.charge is not None and evidence.charge.off:
        charge = evidence.charge
        off = (*off, ParameterOff(USABLE_ENERGY, charge.assumed_j, charge.fitted_j, charge.ci95, "J"))
    if int(evidence.block.max()) + 1 < FEWEST_BLOCKS:
        return "not_testable", ()
    if evidence.naming.named or evidence.fades:
        return "missing_physics", off
    if evidence.location is not None:
        return "unknown_physics", off
    if all(one.fitted is None for one in evidence.estimates):
        return "not_testable", ()
    if evidence.nominal is None:
        return "no_mismatch", ()
    p_value = better(evidence.refit, evidence.nominal, evidence.runs.observed, evidence.block)
    if p_value > FALSE_ALARM_RATE and evidence.charge is not None and evidence.charge.off:
        return "parameters_off", off[-1:]
    if p_value > FALSE_ALARM_RATE:
        return "no_mismatch", ()
    if any(one.status == "at bound" for one in evidence.estimates):
        return "unknown_physics", off  # only unphysical parameters would explain the recordings
    return "parameters_off", off
