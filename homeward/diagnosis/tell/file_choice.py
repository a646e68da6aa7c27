"""Choice of corrected.toml: a fit made to predict, the named effects, fitted parameters only, or the given file.

The file itself is validated: each fold's fit is written as a robot file, by the code that writes corrected.toml, and
replayed on the held-out windows. A file cannot contain schedules (except of an effect that begins once and stays),
weather, and faults of instruments.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.explain.naming import Named
from homeward.diagnosis.explain.uncertainty import Joint, joint
from homeward.diagnosis.fit.held_out import bootstrap, held_out
from homeward.diagnosis.fit.parameter_groups import GROUPS, with_effects_of
from homeward.diagnosis.fit.predictive import INERTIA, Predictive, fit_predictive
from homeward.diagnosis.fit.refit import Refit, estimates, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import CorrectedFile, FileNumber, Verdict
from homeward.diagnosis.tell.corrected import (
    file_content,
    is_expressible,
    of_capacity,
    replayed,
    rounded_robot,
    written,
)
from homeward.logs.channels import Array, Index, Mask
from homeward.physics import Robot

Model = TypeVar("Model", Refit, Corrected)


@dataclass(frozen=True)
class FileChoice:
    """The robot of corrected.toml, the predictions of its file, and its content and why."""

    robot: Robot
    held_out: Array | None  # each fold by the file of the others, (windows,); None if not predictable
    replayed: Array | None  # by the file itself, (windows,)
    file: CorrectedFile
    joint: Joint | None = None  # of the fit made to predict; that of the evidence otherwise

    @property
    def predicted(self) -> Array:
        """The held-out prediction of a candidate, shape (windows,)."""
        assert self.held_out is not None
        return self.held_out


def determined(fit: Refit, corrected: Corrected | None, runs: Runs, block: Index) -> tuple[Refit, Corrected | None]:
    """The fits with each group that is not identifiable held at the robot file's value, where the data allow that.

    One group after the other is held, first that whose assumed value raises the error least: of two confounded groups,
    the other is then identifiable. Windows of different `block`, shape (windows,), count as independent.
    """
    nothing = np.zeros(len(fit.held), np.bool_)
    plain = _determined(lambda held: holding(fit, runs, held), nothing, runs, block)
    if corrected is None:
        return plain, None
    terms = corrected.model.terms
    return plain, _determined(
        lambda held: fit_model(holding(fit, runs, held), terms, runs, block), corrected.groups.held, runs, block
    )


def expressible(
    plain: Refit, corrected: Corrected | None, named: Sequence[Named], runs: Runs, block: Index
) -> Corrected | None:
    """The fit of all that a robot file can express, beside faults of instruments; None if it is nothing of the `named`.

    The groups and effects that are kept absorb what they can of schedules, weather and flexible forms; so do they of
    effects that are confounded with a fault of the meter.
    """
    if corrected is None:
        return None
    terms = corrected.model.terms
    forms = [term.plain or term for term in terms]
    kept = [form for form, effect in zip(forms, named, strict=True) if not _excluded(effect, form)]
    if not kept:
        return None
    if [id(form) for form in kept] == [id(term) for term in terms]:
        return corrected
    held = corrected.groups.held
    if any(term.flexible for term in terms):
        held = held & plain.held  # a flexible form spans groups that its form in a file does not
    return _determined(lambda more: fit_model(holding(plain, runs, more), kept, runs, block), held, runs, block)


def _excluded(named: Named, form: Term) -> str:
    """Why a robot file does not contain a named effect; empty where it does, and for a fault of an instrument."""
    effect, meant = form.hypothesis, (named.term, *named.rivals)
    if any(term.misread for term in meant) and any(term.hypothesis.physical for term in meant):
        return f"{effect.name} is confounded with a fault of the meter"
    if effect.is_weather:
        return f"{effect.name} is weather"
    if effect.physical and not is_expressible(form):
        return f"a robot file cannot hold when {effect.name} is at work"
    return ""


def _determined(fit_holding: Callable[[Mask], Model], held: Mask, runs: Runs, block: Index) -> Model:
    model = fit_holding(held)
    while True:
        estimated = estimates(model, runs, block)
        is_open = np.array([estimate.status != "fitted" for estimate in estimated]) & ~held
        if not is_open.any():
            return model
        at_bound = np.array([estimate.status == "at bound" for estimate in estimated])
        columns = model.groups.jacobian / np.maximum(np.linalg.norm(model.groups.jacobian, axis=0), 1e-300)
        # Groups correlated with one at a bound may have absorbed a part of it.
        alike = ((columns.T @ columns)[:, is_open & at_bound] ** 2 > thresholds.HALF).any(axis=1)
        candidates = (is_open | alike) & ~held
        holding_more = [held | (np.arange(len(held)) == index) for index in np.flatnonzero(candidates)]
        fits = [fit_holding(more) for more in holding_more]
        errors = [runs.squared_error(fit.predicted) for fit in fits]
        best = int(np.argmin(errors))
        if errors[best] > thresholds.NO_WORSE * runs.squared_error(model.predicted):
            return model
        model, held = fits[best], holding_more[best]


def choose_file(robot: Robot, verdict: Verdict, evidence: Evidence, rng: np.random.Generator) -> FileChoice:
    """Choose the robot of corrected.toml, from `robot` as its file has it.

    Nothing is changed where the verdict is no mismatch. Otherwise it is the candidate that predicts held-out drives
    best, in power and energy together: the given file, its parameters fitted, or with the named effects. If that
    leaves more of their energy unexplained than the instruments do, it is the fit made to predict. None may predict
    worse than the given file. Effects of the battery are added. `rng` draws a bootstrap.
    """
    choice = _chosen(robot, verdict, evidence, rng)
    changed, file, capacity = choice.robot, choice.file, evidence.capacity
    shown = [effect.in_file for effect in evidence.channel_effects if effect.in_file]
    for numbers in shown:
        changed = with_effects_of(changed, numbers)
    if shown:
        file = replace(file, why=f"{file.why}; it also holds what voltage or charge show of the battery")
    if capacity is not None and capacity.written and verdict != "unknown_physics":
        changed = of_capacity(changed, capacity.fitted_j / capacity.assumed_j)
    return replace(choice, robot=changed, file=file)


def _chosen(robot: Robot, verdict: Verdict, evidence: Evidence, rng: np.random.Generator) -> FileChoice:
    runs, trip, nominal = evidence.runs, evidence.trip, evidence.predictions.get("nominal")
    if verdict in ("no_mismatch", "not_testable"):
        why = "the verdict requires no change of the robot file"
        return FileChoice(robot, nominal, nominal, CorrectedFile("nominal", why))
    if nominal is None:
        why = "the robot file gives no thrust per ampere (traction_n_per_a), so that its prediction cannot be tested"
        return FileChoice(robot, None, None, CorrectedFile("nominal", why))
    reasons = [_excluded(effect, effect.term.plain or effect.term) for effect in evidence.naming.named]
    if verdict == "unknown_physics":
        reasons.append("its parameters absorb a part of the unknown physics and are no measurement")
    named = expressible(evidence.plain, evidence.corrected, evidence.naming.named, runs, evidence.block)
    given = FileChoice(robot, nominal, nominal, CorrectedFile("nominal", ""))
    candidates = [given, _refitted(robot, evidence)]
    candidates += [] if named is None else [_named(robot, named, evidence)]
    ranked = sorted(candidates, key=lambda candidate: _error(candidate, evidence))
    # Beyond what the instruments explain, drives are consumed by what nothing proven models.
    if error_parts(ranked[0].predicted, runs, trip)[1] > thresholds.CLEAR * thresholds.GAIN_ERROR:
        ranked.insert(0, _predictive(robot, named, evidence))
    best = given
    for candidate in ranked:
        worse = "" if candidate is given else worse_than(nominal, candidate.predicted, runs, trip, rng)
        if not worse:
            best = candidate
            break
        reasons.append(f"with {_WORDS[candidate.file.holds]}, {worse}")
    share = " and ".join(f"{100.0 * part:.3g} %" for part in error_parts(best.predicted, runs, trip))
    why = f"off by {share} on held-out drives (power, energy)"
    why = "; ".join([why, *dict.fromkeys(filter(None, reasons))])
    return replace(best, file=replace(best.file, why=why))


def _error(choice: FileChoice, evidence: Evidence) -> float:
    """Sum of the errors of power and of the energy of trips, by which files are compared."""
    return sum(error_parts(choice.predicted, evidence.runs, evidence.trip))


_WORDS = {
    "nominal": "the given file",
    "refit": "that with fitted parameters",
    "corrected": "that with the named effects",
    "predictive": "the fit made to predict",
}


def error_parts(predicted: Array, runs: Runs, trip: Index) -> tuple[float, float]:
    """Error of a held-out prediction, (windows,): of power, over its rms, and of a trip's energy, each at most a half.

    A trip of next to no energy would otherwise decide alone.
    """
    error = predicted - runs.observed
    of_power = float(np.sqrt(np.mean(error**2) / max(float(np.mean(runs.observed**2)), 1e-300)))
    missed, drawn = (np.abs(np.bincount(trip, values * runs.duration_s)) for values in (error, runs.observed))
    of_trips = np.minimum(missed / np.maximum(drawn, 1e-300), thresholds.HALF)
    return of_power, float(of_trips.mean())


def _refitted(robot: Robot, evidence: Evidence) -> FileChoice:
    changed, by_file = filed(robot, evidence.plain, evidence.runs)
    numbers = _numbers(evidence, joint(evidence.plain, evidence.runs, evidence.block))
    return FileChoice(changed, _held_out(robot, evidence.plain, evidence), by_file, CorrectedFile("refit", "", numbers))


def _named(robot: Robot, model: Corrected, evidence: Evidence) -> FileChoice:
    changed, by_file = filed(robot, model, evidence.runs)
    numbers = _numbers(evidence, joint(model, evidence.runs, evidence.block))
    return FileChoice(changed, _held_out(robot, model, evidence), by_file, CorrectedFile("corrected", "", numbers))


def _predictive(robot: Robot, model: Corrected | None, evidence: Evidence) -> FileChoice:
    runs = evidence.runs
    content = file_content(evidence.plain, runs) if model is None else file_content(model, runs)
    base = robot if model is None else written(robot, content, runs.unit)

    def by_file(part: Predictive) -> Array:
        return replayed(rounded_robot(robot, part.changed), content, runs)

    fit = fit_predictive(runs, robot, base, lambda changed: replayed(changed, content, runs), evidence.fold)
    held = held_out(lambda chosen: by_file(fit.fitted_to(chosen, runs)), evidence.fold)
    symbols = {group.name: group.symbol for group in GROUPS[runs.unit]}
    names = tuple(symbols.get(entry.name, entry.name.replace(".", " ")) for entry in fit.entries)
    # The accelerated mass is in the file as a share of the mass.
    share = np.array([1.0 / fit.numbers["mass"] if entry.name == INERTIA else 1.0 for entry in fit.entries])
    units = tuple("1" if entry.name == INERTIA else entry.unit for entry in fit.entries)
    known = Joint(names, units, share * fit.values, np.outer(share, share) * fit.covariance(runs, evidence.block))
    numbers = []
    for number, entry, factor in zip(_numbers(evidence, known), fit.entries, share.tolist(), strict=True):
        low, high = (min(max(end, factor * entry.low), factor * entry.high) for end in number.ci95)
        numbers.append(replace(number, ci95=(low, high)))
    file = CorrectedFile("predictive", "", tuple(numbers))
    return FileChoice(rounded_robot(robot, fit.changed), held, by_file(fit), file, known)


def _numbers(evidence: Evidence, known: Joint) -> tuple[FileNumber, ...]:
    """The fitted numbers with their intervals; proven are those of named effects and of parameters that are off.

    An effect that may be a fault of the meter is not proven to be one of the robot.
    """
    off = {estimate.group.symbol for estimate in evidence.estimates if estimate.off}
    explaining = evidence.naming.named
    named = {effect.term.effect for effect in explaining if not _excluded(effect, effect.term.plain or effect.term)}
    wide = thresholds.NORMAL_95 * np.sqrt(np.maximum(np.diag(known.covariance), 0.0))
    numbers = []
    for name, unit, value, half in zip(known.names, known.units, known.values.tolist(), wide.tolist(), strict=True):
        proven = name in off or name.partition(" ")[0] in named
        numbers.append(FileNumber(name, value, (value - half, value + half), unit, proven))
    return tuple(numbers)


def worse_than(before: Array, after: Array, runs: Runs, trip: Index, rng: np.random.Generator) -> str:
    """Why to prefer the held-out prediction `before` to `after`, shape (windows,) each; empty if not.

    The interval of the trips' errors is by bootstrap; `trip` numbers the trips, shape (windows,).
    """
    rms_before = float(np.sqrt(np.mean((before - runs.observed) ** 2)))
    rms_after = float(np.sqrt(np.mean((after - runs.observed) ** 2)))
    if rms_after >= rms_before:
        return f"the held-out error would be {rms_after:.4g} {runs.unit} instead of {rms_before:.4g}"
    off_before = np.abs(np.bincount(trip, (before - runs.observed) * runs.duration_s))
    off_after = np.abs(np.bincount(trip, (after - runs.observed) * runs.duration_s))
    least_worse = bootstrap((off_after - off_before)[None], rng, lambda drawn: drawn[0])[0]
    if least_worse <= 0.0:
        return ""
    consumed, unit = ("energy", "J") if runs.unit == "W" else ("charge", "A s")
    return (
        f"the {consumed} of a held-out trip would be off by {off_after.mean():.3g} {unit} on average instead of "
        f"{off_before.mean():.3g}"
    )


def _held_out(robot: Robot, model: Refit | Corrected, evidence: Evidence) -> Array:
    """Prediction of each fold by the file fitted to the others, shape (windows,)."""
    runs = evidence.runs
    return held_out(lambda chosen: filed(robot, model.refitted(chosen, runs), runs)[1], evidence.fold)


def filed(robot: Robot, model: Refit | Corrected, runs: Runs) -> tuple[Robot, Array]:
    """A fit as a robot file, and its prediction, shape (windows,)."""
    content = file_content(model, runs)
    robot = written(robot, content, runs.unit)
    return robot, replayed(robot, content, runs)
