"""The next experiment: the drive of the menu that separates the effects best.

The Fisher information of the recordings is a matrix for the groups of the refit and the size of
each effect; each drive of the menu adds its own, simulated by the kernel. The groups are nuisance
parameters, so the criterion is the determinant of the information on the effects alone
(D_s-optimality: Atkinson & Donev, Optimum Experimental Designs, 1992). The prior standard deviation
of an effect is its fitted size, that of a group a plausible change.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.hypothesis import Hypothesis, Term
from homeward.diagnosis.explain.menu import MENU, Drive, Manoeuvre
from homeward.diagnosis.explain.places import Location
from homeward.diagnosis.fit.bounded import bounded
from homeward.diagnosis.fit.estimates import Estimate
from homeward.diagnosis.fit.parameter_groups import derivatives
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.autocorrelation import noise_of
from homeward.logs.channels import Array, Mask

_WORTHWHILE = float(np.log(thresholds.TWICE))  # log-determinant of information: a variance halved

GUIDE = "docs/recording_guide.md"
"""The page that describes how to drive and record each drive of the menu."""


@dataclass(frozen=True)
class SizedEffect:
    """An effect at its size in the recordings; `column` is its contribution there, shape
    (windows,)."""

    hypothesis: Hypothesis
    size: float
    shape: Mapping[str, float]
    column: Array


def at_its_size(fit: Refit, runs: Runs, term: Term) -> SizedEffect:
    """An effect at its fitted size; of several sizes (levels, places) the one with the largest
    contribution."""
    term = term.plain or term
    columns = np.column_stack([fit.jacobian, term.columns])
    residual = runs.observed - fit.predicted
    low_of_groups, high_of_groups = fit.freedom()
    low = np.append(low_of_groups, term.low)
    high = np.append(high_of_groups, term.high)
    weights = bounded(columns.T @ columns, columns.T @ residual, low, high)
    sizes = weights[fit.jacobian.shape[1] :]
    if term.axis == "steady" and len(sizes) > 1:
        size = float(np.linalg.norm(sizes))  # they are the components of one vector, such as wind
    else:
        largest = int(np.argmax(np.abs(sizes) * np.linalg.norm(term.columns, axis=0)))
        size = float(sizes[largest])
    return SizedEffect(term.hypothesis, size, term.shape, term.columns @ sizes)


def gains(
    fit: Refit,
    runs: Runs,
    residual: Array,
    effects: Sequence[SizedEffect],
    groups: Sequence[str] = (),
) -> dict[str, float]:
    """Rise of the log-determinant of the information on effects and named groups by each drive of
    the menu.

    `residual` is that of the best model, shape (windows,); groups that are not named are nuisance
    parameters.
    """
    names = [group.name for group in fit.parameters.groups]
    of_interest = np.array([name in groups for name in names] + [True] * len(effects))
    # A residual of next to nothing would make any drive seem to measure everything.
    # W or A
    noise = max(noise_of(residual, runs.run).long_run, 1e-6 * float(np.abs(runs.observed).max()))
    recorded = np.column_stack([fit.jacobian, *(effect.column for effect in effects)]) / noise
    # The prior is the unit matrix: columns are per plausible change of a group, or of an effect at
    # its size.
    information = recorded.T @ recorded + np.eye(recorded.shape[1])
    log_determinant = _log_determinant(information, of_interest)
    windows_a_second = 1.0 / float(np.median(runs.duration_s))
    rises = {}
    for manoeuvre in MENU:
        driven = responses(fit, runs, manoeuvre, effects) / noise
        if effects and not driven[:, len(names) :].any():
            # a drive without the effect may identify the groups, but does not test the effect
            driven = 0.0 * driven
        with_drive = information + windows_a_second * driven.T @ driven
        rises[manoeuvre.id] = _log_determinant(with_drive, of_interest) - log_determinant
    return rises


def _log_determinant(information: Array, of_interest: Mask) -> float:
    """Log-determinant of the information on some of the parameters when the others are unknown.

    It is that of the Schur complement: the determinant of the matrix over that of its part for the
    others.
    """
    nuisance = information[np.ix_(~of_interest, ~of_interest)]
    of_all = np.linalg.slogdet(information)[1]
    of_nuisance = np.linalg.slogdet(nuisance)[1]
    return float(of_all - of_nuisance)


def responses(
    fit: Refit, runs: Runs, manoeuvre: Manoeuvre, effects: Sequence[SizedEffect]
) -> Array:
    """Responses to the groups (per unit of `scale`) and the effects on a drive, shape (samples,
    groups + effects)."""
    mean_c = float(np.mean(np.concatenate([run.temperature_c for run in runs.signals])))
    drive = Drive(fit, manoeuvre, runs.unit, mean_c)
    to_groups = derivatives(fit.parameters, fit.theta, drive.plain, drive.predict)
    to_effects = [
        effect.hypothesis.on_drive(effect.hypothesis, drive, effect.size, effect.shape)
        for effect in effects
    ]
    return np.column_stack([*to_groups, *to_effects])


def to_tell_apart(
    fit: Refit, runs: Runs, residual: Array, term: Term, rivals: Sequence[Term]
) -> str:
    """The drive or, where no drive of the menu does, the measurement that separates an effect from
    its rivals.

    Without rivals: the drive that determines its size best. `residual` is that of the best model,
    (windows,).
    """
    explanations = (term, *rivals)
    effects = [at_its_size(fit, runs, explanation) for explanation in explanations]
    drive, gain = _most_informative(
        gains(fit, runs, residual, [effect for effect in effects if effect.size != 0.0])
    )
    if gain >= _WORTHWHILE:
        advice = drive.sentence
    else:
        hypotheses = [explanation.hypothesis for explanation in explanations]
        faults = [hypothesis for hypothesis in hypotheses if not hypothesis.physical]
        # Of measurements, that of a fault of an instrument comes before that of physics.
        advice = (faults or hypotheses)[0].measurement
    name = term.hypothesis.name
    if not rivals:
        return f"To measure {name} better, {advice}."
    names_of_rivals = " and ".join(rival.hypothesis.name for rival in rivals)
    return f"To distinguish {name} from {names_of_rivals}, {advice}."


def _most_informative(gain_of_drive: Mapping[str, float]) -> tuple[Manoeuvre, float]:
    """The drive of the menu with the largest gain, and its gain."""
    drive = max(MENU, key=lambda manoeuvre: gain_of_drive[manoeuvre.id])
    return drive, gain_of_drive[drive.id]


def next_experiment(evidence: Evidence) -> str | None:
    """The next experiment, or None where nothing is ambiguous."""
    fit = evidence.fitted
    runs = evidence.runs
    residual = evidence.residual
    for named in evidence.naming.named:
        if named.rivals:
            return to_tell_apart(fit, runs, residual, named.term, named.rivals)
    if evidence.location is not None and not evidence.naming.named:
        return repeat(evidence.location)
    return to_determine(
        fit, runs, residual, evidence.estimates, evidence.blocks >= thresholds.FEWEST_BLOCKS
    )


def to_determine(
    fit: Refit, runs: Runs, residual: Array, estimates: Sequence[Estimate], long_enough: bool = True
) -> str | None:
    """The drive that identifies the groups without a value, or a longer one if recordings are too
    short to test.

    `residual` is that of the best model, shape (windows,).
    """
    open_groups = [estimate.group for estimate in estimates if estimate.fitted is None]
    drive, gain = _most_informative(
        gains(fit, runs, residual, [], [group.name for group in open_groups])
    )
    if open_groups and gain >= _WORTHWHILE:
        longer = "" if long_enough else ", for five minutes or more"
        unknown = ", ".join(
            f"{group.name.replace('_', ' ')} ({group.symbol})" for group in open_groups
        )
        return f"To determine {unknown}, {drive.sentence}{longer}."
    if long_enough:
        return None
    return "Record the same drive for longer, at least five minutes."


def repeat(location: Location) -> str | None:
    """The drive that tests whether a condition causes the unexplained excess; None where there is
    no place of it."""
    if not location.places:
        return None
    if all(place.condition == location.condition for place in location.places):
        return (
            f"To find out what is missing, alternate a minute with {location.condition} and a minute without, "
            "ten times, and change nothing else."
        )
    largest = max(location.places, key=lambda place: place.share_of_excess)
    return (
        f"To find out what is missing, repeat the drive of {largest.recording.rsplit('/', 1)[-1]} and note what is "
        f"switched on, carried or different on the way ({largest.condition})."
    )
