"""Choice of corrected.toml: a file with the effects, one with fitted parameters only, or the given one unchanged.

The file itself is validated: each fold's fit is written as a robot file, by the code that writes corrected.toml, and
replayed on the held-out windows. A file cannot contain schedules (except of an effect that begins once and stays),
weather, faults of instruments, and the current at rest, which is added to the replay.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from homeward.diagnosis import rules
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.explain.naming import Named
from homeward.diagnosis.fit.held_out import bootstrap, held_out
from homeward.diagnosis.fit.parameter_groups import with_effects_of
from homeward.diagnosis.fit.refit import Refit, estimates, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import CorrectedFile, Verdict
from homeward.diagnosis.tell.corrected import file_content, is_expressible, of_capacity, replayed, written
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
    kept = [form for form, one in zip(forms, named, strict=True) if not _excluded(one, form)]
    if not kept or [id(one) for one in kept] == [id(one) for one in terms]:
        return corrected if kept else None
    # A flexible form spans groups that its form in a file does not.
    held = corrected.groups.held & plain.held if any(one.flexible for one in terms) else corrected.groups.held
    return _determined(lambda more: fit_model(holding(plain, runs, more), kept, runs, block), held, runs, block)


def _excluded(named: Named, form: Term) -> str:
    """Why a robot file does not contain a named effect; empty where it does, and for a fault of an instrument."""
    one, meant = form.hypothesis, (named.term, *named.rivals)
    if any(term.misread for term in meant) and any(term.hypothesis.physical for term in meant):
        return f"{one.name} is confounded with a fault of the meter"
    if one.is_weather:
        return f"{one.name} is weather"
    return f"a robot file cannot hold when {one.name} is at work" if one.physical and not is_expressible(form) else ""


def _determined(fit_holding: Callable[[Mask], Model], held: Mask, runs: Runs, block: Index) -> Model:
    model = fit_holding(held)
    while True:
        estimated = estimates(model, runs, block)
        is_open = np.array([one.status != "fitted" for one in estimated]) & ~held
        if not is_open.any():
            return model
        at_bound = np.array([one.status == "at bound" for one in estimated])
        columns = model.groups.jacobian / np.maximum(np.linalg.norm(model.groups.jacobian, axis=0), 1e-300)
        # Groups correlated with one at a bound may have absorbed a part of it.
        alike = ((columns.T @ columns)[:, is_open & at_bound] ** 2 > rules.ABSORBING).any(axis=1)
        candidates = (is_open | alike) & ~held
        each = [held | (np.arange(len(held)) == index) for index in np.flatnonzero(candidates)]
        fits = [model] + [fit_holding(one) for one in each]
        errors = [float(np.sum((runs.observed - one.predicted) ** 2)) for one in fits]
        best = 1 + int(np.argmin(errors[1:]))
        if errors[best] > rules.EQUAL * errors[0]:
            return model
        model, held = fits[best], each[best - 1]


def choose_file(robot: Robot, verdict: Verdict, evidence: Evidence, rng: np.random.Generator) -> FileChoice:
    """Choose the robot of corrected.toml, from `robot` as its file has it.

    The effects must predict held-out windows better than the refit, and the energy (the charge) of trips no worse; the
    fitted parameters better than the given file. Nothing is changed where the verdict is no mismatch. Parameters that
    compensate for unknown physics are no measurement. Effects of the battery are added. `rng` draws a bootstrap.
    """
    choice = _proven(robot, verdict, evidence, rng)
    changed, file, capacity = choice.robot, choice.file, evidence.capacity
    if shown := [one.in_file for one in evidence.channel_effects if one.in_file]:
        for numbers in shown:
            changed = with_effects_of(changed, numbers)
        file = replace(file, why=f"{file.why}; it also holds what voltage or charge show of the battery")
    if capacity is not None and capacity.written and verdict != "unknown_physics":
        changed = of_capacity(changed, capacity.fitted_j / capacity.assumed_j)
    return replace(choice, robot=changed, file=file)


def _proven(robot: Robot, verdict: Verdict, evidence: Evidence, rng: np.random.Generator) -> FileChoice:
    runs, nominal = evidence.runs, evidence.predictions.get("nominal")
    if verdict in ("no_mismatch", "not_testable"):
        why = "the verdict requires no change of the robot file"
        return FileChoice(robot, nominal, nominal, CorrectedFile("nominal", why))
    if nominal is None:
        why = "the robot file gives no thrust per ampere (traction_n_per_a), so that its prediction cannot be tested"
        return FileChoice(robot, None, None, CorrectedFile("nominal", why))
    reason = "; ".join(filter(None, (_excluded(one, one.term.plain or one.term) for one in evidence.naming.named)))
    caveat = f"{reason}; " if reason else ""
    if verdict == "unknown_physics":
        caveat = "its parameters absorb a part of the unknown physics and are no measurement; "
    model = expressible(evidence.plain, evidence.corrected, evidence.naming.named, runs, evidence.block)
    if model is not None:
        after = _held_out(robot, model, evidence)
        if not (worse := worse_than(evidence.predictions["refit"], after, runs, evidence.trip, rng)):
            why = "replayed as written, it predicts held-out windows better than the refit"
            why += f"; {reason}" if reason else ""
            changed, by_file = filed(robot, model, runs)
            return FileChoice(changed, after, by_file, CorrectedFile("corrected", why))
        caveat = f"with the missing physics that a robot file can express, {worse}; "
    after = _held_out(robot, evidence.plain, evidence)
    if worse := worse_than(nominal, after, runs, evidence.trip, rng):
        why = f"{caveat}with its parameters fitted, {worse}"
        return FileChoice(robot, nominal, nominal, CorrectedFile("nominal", why))
    why = f"{caveat}replayed as written, it predicts held-out windows better than the given file"
    changed, by_file = filed(robot, evidence.plain, runs)
    return FileChoice(changed, after, by_file, CorrectedFile("refit", why))


def worse_than(before: Array, after: Array, runs: Runs, trip: Index, rng: np.random.Generator) -> str:
    """Why to prefer the held-out prediction `before` to `after`, shape (windows,) each; empty if not.

    The interval of the trips' errors is by bootstrap; `trip` numbers the trips, shape (windows,).
    """
    errors = [float(np.sqrt(np.mean((one - runs.observed) ** 2))) for one in (after, before)]
    if errors[0] >= errors[1]:
        return f"the held-out error would be {errors[0]:.4g} {runs.unit} instead of {errors[1]:.4g}"
    misses = [np.abs(np.bincount(trip, (one - runs.observed) * runs.duration_s)) for one in (after, before)]
    if bootstrap((misses[0] - misses[1])[None], rng, lambda drawn: drawn[0])[0] > 0.0:
        consumed, unit = ("energy", "J") if runs.unit == "W" else ("charge", "A s")
        return (
            f"the {consumed} of a held-out trip would be off by {misses[0].mean():.3g} {unit} on average instead of "
            f"{misses[1].mean():.3g}"
        )
    return ""


def _held_out(robot: Robot, model: Refit | Corrected, evidence: Evidence) -> Array:
    """Prediction of each fold by the file fitted to the others, shape (windows,)."""
    runs = evidence.runs
    return held_out(lambda chosen: filed(robot, model.refitted(chosen, runs), runs)[1], evidence.fold)


def filed(robot: Robot, model: Refit | Corrected, runs: Runs) -> tuple[Robot, Array]:
    """A fit as a robot file, and its prediction, shape (windows,)."""
    content = file_content(model, runs)
    robot = written(robot, content, runs.unit)
    return robot, replayed(robot, content, runs)
