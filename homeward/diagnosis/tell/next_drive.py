"""The next experiment: the drive of the menu that separates the effects best.

The Fisher information of the recordings is a matrix for the groups of the refit and the size of each effect; each drive
of the menu adds its own, simulated by the kernel. The groups are nuisance parameters, so the criterion is the
determinant of the information on the effects alone (D_s-optimality: Atkinson & Donev, Optimum Experimental Designs,
1992). The prior standard deviation of an effect is its fitted size, that of a group a plausible change.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.hypothesis import Hypothesis, Term
from homeward.diagnosis.explain.menu import MENU, Drive, Manoeuvre
from homeward.diagnosis.explain.places import Location
from homeward.diagnosis.fit.fitted import bounded
from homeward.diagnosis.fit.parameter_groups import derivatives
from homeward.diagnosis.fit.refit import Estimate, Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.autocorrelation import noise_of
from homeward.logs.channels import Array, Mask

_WORTHWHILE = float(np.log(thresholds.TWICE))  # log-determinant of information: a variance halved

GUIDE = "docs/recording_guide.md"
"""The page that describes how to drive and record each drive of the menu."""


@dataclass(frozen=True)
class SizedEffect:
    """An effect at its size in the recordings; `column` is its contribution there, shape (windows,)."""

    hypothesis: Hypothesis
    size: float
    shape: Mapping[str, float]
    column: Array


def at_its_size(fit: Refit, runs: Runs, term: Term) -> SizedEffect:
    """An effect at its fitted size; of several sizes (levels, places) the one with the largest contribution."""
    term = term.plain or term
    columns = np.column_stack([fit.jacobian, term.columns])
    low, high = (np.append(bound, of) for bound, of in zip(fit.freedom(), (term.low, term.high), strict=True))
    weights = bounded(columns.T @ columns, columns.T @ (runs.observed - fit.predicted), low, high)
    weights = weights[fit.jacobian.shape[1] :]
    largest = int(np.argmax(np.abs(weights) * np.linalg.norm(term.columns, axis=0)))
    of_one = term.axis == "steady" and len(weights) > 1  # its sizes are the components of one
    size = float(np.linalg.norm(weights) if of_one else weights[largest])
    return SizedEffect(term.hypothesis, size, term.shape, term.columns @ weights)


def gains(
    fit: Refit, runs: Runs, residual: Array, effects: Sequence[SizedEffect], groups: Sequence[str] = ()
) -> dict[str, float]:
    """Rise of the log-determinant of the information on effects and named groups by each drive of the menu.

    `residual` is that of the best model, shape (windows,); groups that are not named are nuisance parameters.
    """
    names = [group.name for group in fit.parameters.groups]
    of_interest = np.array([name in groups for name in names] + [True] * len(effects))
    noise_w = max(noise_of(residual, runs.run).long_run, 1e-6 * float(np.abs(runs.observed).max()))
    known = np.column_stack([fit.jacobian, *(one.column for one in effects)]) / noise_w
    before = known.T @ known + np.eye(known.shape[1])
    windows_a_second = 1.0 / float(np.median(runs.duration_s))
    found = {}
    for manoeuvre in MENU:
        added = responses(fit, runs, manoeuvre, effects) / noise_w
        if effects and not added[:, len(names) :].any():
            added = 0.0 * added  # a drive without the effect may identify the groups, but does not test the effect
        after = before + windows_a_second * added.T @ added
        found[manoeuvre.id] = _determinant(after, of_interest) - _determinant(before, of_interest)
    return found


def _determinant(information: Array, of_interest: Mask) -> float:
    """Log-determinant of the information on some of the parameters when the others are unknown."""
    whole = np.linalg.slogdet(information)[1]
    return float(whole - np.linalg.slogdet(information[np.ix_(~of_interest, ~of_interest)])[1])


def responses(fit: Refit, runs: Runs, manoeuvre: Manoeuvre, effects: Sequence[SizedEffect]) -> Array:
    """Responses to the groups (per unit of `scale`) and the effects on a drive, shape (samples, groups + effects)."""
    mean_c = float(np.mean(np.concatenate([run.temperature_c for run in runs.signals])))
    drive = Drive(fit, manoeuvre, runs.unit, mean_c)
    added = [one.hypothesis.on_drive(one.hypothesis, drive, one.size, one.shape) for one in effects]
    return np.column_stack([*derivatives(fit.parameters, fit.theta, drive.plain, drive.predict), *added])


def to_tell_apart(fit: Refit, runs: Runs, residual: Array, first: Term, rivals: Sequence[Term]) -> str:
    """The drive or, where no drive of the menu does, the measurement that separates an effect from its rivals.

    Without rivals: the drive that determines its size best. `residual` is that of the best model, (windows,).
    """
    effects = [at_its_size(fit, runs, term) for term in (first, *rivals)]
    best, gain = _best(gains(fit, runs, residual, [one for one in effects if one.size != 0.0]))
    worthwhile = gain >= _WORTHWHILE
    # Of measurements, that of a fault of an instrument comes before that of physics.
    measured = min((one.hypothesis for one in (first, *rivals)), key=lambda one: one.physical)
    advice = best.sentence if worthwhile else measured.measurement
    name = first.hypothesis.name
    if not rivals:
        return f"To measure {name} better, {advice}."
    others = " and ".join(rival.hypothesis.name for rival in rivals)
    return f"To distinguish {name} from {others}, {advice}."


def _best(found: Mapping[str, float]) -> tuple[Manoeuvre, float]:
    best = max(MENU, key=lambda one: found[one.id])
    return best, found[best.id]


def next_experiment(evidence: Evidence) -> str | None:
    """The next experiment, or None where nothing is ambiguous."""
    fit, runs, residual, named = evidence.fitted, evidence.runs, evidence.residual, evidence.naming.named
    if rivalled := next((one for one in named if one.rivals), None):
        return to_tell_apart(fit, runs, residual, rivalled.term, rivalled.rivals)
    if evidence.location is not None and not named:
        return repeat(evidence.location)
    return to_determine(fit, runs, residual, evidence.estimates, evidence.blocks >= thresholds.FEWEST_BLOCKS)


def to_determine(
    fit: Refit, runs: Runs, residual: Array, estimates: Sequence[Estimate], long_enough: bool = True
) -> str | None:
    """The drive that identifies the groups without a value, or a longer one if recordings are too short to test.

    `residual` is that of the best model, shape (windows,).
    """
    open_groups = [one.group for one in estimates if one.fitted is None]
    best, gain = _best(gains(fit, runs, residual, [], [group.name for group in open_groups]))
    if open_groups and gain >= _WORTHWHILE:
        longer = "" if long_enough else ", for five minutes or more"
        unknown = ", ".join(f"{group.name.replace('_', ' ')} ({group.symbol})" for group in open_groups)
        return f"To determine {unknown}, {best.sentence}{longer}."
    return None if long_enough else "Record the same drive for longer, at least five minutes."


def repeat(location: Location) -> str | None:
    """The drive that tests whether a condition causes the unexplained excess; None where there is no place of it."""
    if not location.places:
        return None
    if all(place.condition == location.condition for place in location.places):
        return (
            f"To find out what is missing, alternate a minute with {location.condition} and a minute without, "
            "ten times, and change nothing else."
        )
    first = max(location.places, key=lambda place: place.share_of_excess)
    return (
        f"To find out what is missing, repeat the drive of {first.recording.rsplit('/', 1)[-1]} and note what is "
        f"switched on, carried or different on the way ({first.condition})."
    )
