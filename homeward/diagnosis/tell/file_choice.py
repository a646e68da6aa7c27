"""Choice of corrected.toml: a fit made to predict, the named effects, fitted parameters only, or
the given file.

The file itself is validated: each fold's fit is written as a robot file, by the code that writes
corrected.toml, and replayed on the held-out windows. A file cannot contain schedules (except of an
effect that begins once and stays), weather, and faults of instruments.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.explain.named import Named
from homeward.diagnosis.explain.uncertainty import Joint, joint
from homeward.diagnosis.fit.estimates import estimates
from homeward.diagnosis.fit.held_out import bootstrap, held_out
from homeward.diagnosis.fit.parameter_groups import GROUPS, with_effects_of
from homeward.diagnosis.fit.predictive import (
    INERTIA,
    ROLLING_PER_K,
    Predictive,
    fit_predictive,
)
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import CorrectedFile, Verdict
from homeward.diagnosis.tell.corrected import (
    file_content,
    is_expressible,
    of_capacity,
    replayed,
    rounded_robot,
    with_losses_of,
    written,
)
from homeward.diagnosis.tell.file_numbers import battery_numbers, fitted_numbers
from homeward.logs.channels import Array, Index, Mask
from homeward.physics import Robot
from homeward.physics.effects import air_temperature, inertia

Model = TypeVar("Model", Refit, Corrected)


@dataclass(frozen=True)
class FileChoice:
    """The robot of corrected.toml, the predictions of its file, and its content and why."""

    robot: Robot
    # each fold by the file of the others, (windows,); None if not predictable
    held_out: Array | None
    replayed: Array | None  # by the file itself, (windows,)
    file: CorrectedFile
    joint: Joint | None = None  # of the fit made to predict; that of the evidence otherwise

    @property
    def predicted(self) -> Array:
        """The held-out prediction of a candidate, shape (windows,)."""
        assert self.held_out is not None
        return self.held_out


def determined(
    fit: Refit, corrected: Corrected | None, runs: Runs, block: Index
) -> tuple[Refit, Corrected | None]:
    """The fits with each group that is not identifiable held at the robot file's value, where the
    data allow that.

    One group after the other is held, first that whose assumed value raises the error least: of two
    confounded groups, the other is then identifiable. Windows of different `block`, shape
    (windows,), count as independent.
    """
    no_groups = np.zeros(len(fit.held), np.bool_)
    plain = _determined(lambda groups: holding(fit, runs, groups), no_groups, runs, block)
    if corrected is None:
        return plain, None
    terms = corrected.model.terms

    def model_holding(groups: Mask) -> Corrected:
        return fit_model(holding(fit, runs, groups), terms, runs, block)

    return plain, _determined(model_holding, corrected.groups.held, runs, block)


def expressible(
    plain: Refit, corrected: Corrected | None, named: Sequence[Named], runs: Runs, block: Index
) -> Corrected | None:
    """The fit of all that a robot file can express, beside faults of instruments; None if it is
    nothing of the `named`.

    The groups and effects that are kept absorb what they can of schedules, weather and flexible
    forms; so do they of effects that are confounded with a fault of the meter.
    """
    if corrected is None:
        return None
    terms = corrected.model.terms
    forms = [term.plain or term for term in terms]
    forms_in_file = [
        form for form, effect in zip(forms, named, strict=True) if not _excluded(effect, form)
    ]
    if not forms_in_file:
        return None
    # Terms hold arrays, which have no single truth value: compare which objects they are.
    if [id(form) for form in forms_in_file] == [id(term) for term in terms]:
        return corrected
    held_groups = corrected.groups.held
    if any(term.flexible for term in terms):
        # a flexible form spans groups that its form in a file does not
        held_groups = held_groups & plain.held

    def model_holding(groups: Mask) -> Corrected:
        return fit_model(holding(plain, runs, groups), forms_in_file, runs, block)

    return _determined(model_holding, held_groups, runs, block)


def _excluded(named: Named, form: Term) -> str:
    """Why a robot file does not contain a named effect; empty where it does, and for a fault of an
    instrument."""
    hypothesis = form.hypothesis
    explanations = (named.term, *named.rivals)
    may_be_misread = any(term.misread for term in explanations)
    may_be_physical = any(term.hypothesis.physical for term in explanations)
    if may_be_misread and may_be_physical:
        return f"{hypothesis.name} is confounded with a fault of the meter"
    if hypothesis.is_weather:
        return f"{hypothesis.name} is weather"
    if hypothesis.physical and not is_expressible(form):
        return f"a robot file cannot hold when {hypothesis.name} is at work"
    return ""


def _determined(
    fit_holding: Callable[[Mask], Model], held_groups: Mask, runs: Runs, block: Index
) -> Model:
    """The model after holding one group after the other; `held_groups`, (groups,), are held from
    the start."""
    model = fit_holding(held_groups)
    numbers = np.arange(len(held_groups))
    while True:
        candidates = _groups_to_hold(model, held_groups, runs, block)
        if not candidates.any():
            return model
        # Of confounded groups, holding one makes the others identifiable: hold that which raises
        # the error least.
        holding_one_more = [
            held_groups | (numbers == number) for number in np.flatnonzero(candidates)
        ]
        fits = [fit_holding(groups) for groups in holding_one_more]
        errors = [runs.squared_error(fit.predicted) for fit in fits]
        smallest = int(np.argmin(errors))
        if errors[smallest] > thresholds.NO_WORSE * runs.squared_error(model.predicted):
            return model
        model = fits[smallest]
        held_groups = holding_one_more[smallest]


def _groups_to_hold(model: Refit | Corrected, held_groups: Mask, runs: Runs, block: Index) -> Mask:
    """Free groups without a value, and those correlated with one at a bound, shape (groups,)."""
    estimated = estimates(model, runs, block)
    is_open = np.array([estimate.status != "fitted" for estimate in estimated]) & ~held_groups
    if not is_open.any():
        return is_open
    at_bound = np.array([estimate.status == "at bound" for estimate in estimated])
    jacobian = model.groups.jacobian
    columns = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    # Groups correlated with one at a bound may have absorbed a part of it.
    shared_variance = (columns.T @ columns)[:, is_open & at_bound] ** 2
    correlated = (shared_variance > thresholds.HALF).any(axis=1)
    return np.asarray((is_open | correlated) & ~held_groups)


def choose_file(
    robot: Robot, verdict: Verdict, evidence: Evidence, rng: np.random.Generator
) -> FileChoice:
    """Choose the robot of corrected.toml, from `robot` as its file has it.

    Nothing is changed where the verdict is no mismatch. Otherwise it is the candidate that predicts
    held-out drives best, in power and energy together: the given file, its parameters fitted, or
    with the named effects. If that leaves more of their energy unexplained than the instruments do,
    it is the fit made to predict. None may predict worse than the given file. Effects of the
    battery are added. `rng` draws a bootstrap.
    """
    choice = _chosen(robot, verdict, evidence, rng)
    changed = choice.robot
    capacity = evidence.capacity
    has_capacity = capacity is not None and capacity.written and verdict != "unknown_physics"
    for effect in evidence.channel_effects:
        if effect.in_file:
            changed = with_effects_of(changed, effect.in_file)
    if capacity is not None and has_capacity:
        changed = of_capacity(changed, capacity.fitted_j / capacity.assumed_j)
    file = choice.file
    of_battery = battery_numbers(evidence, has_capacity)
    if of_battery:
        why = f"{file.why}; it also holds what voltage or charge show of the battery"
        names_of_battery = {number.name for number in of_battery}
        others = [number for number in file.numbers if number.name not in names_of_battery]
        file = replace(file, why=why, numbers=(*others, *of_battery))
    return replace(choice, robot=changed, file=file)


def _chosen(
    robot: Robot, verdict: Verdict, evidence: Evidence, rng: np.random.Generator
) -> FileChoice:
    """The choice by held-out drives, without effects of the battery; see `choose_file`."""
    runs = evidence.runs
    trip = evidence.trip
    nominal = evidence.predictions.get("nominal")
    if verdict in ("no_mismatch", "not_testable"):
        return _unchanged(robot, nominal, why="the verdict requires no change of the robot file")
    if nominal is None:
        why = "the robot file gives no thrust per ampere (traction_n_per_a), so that its prediction cannot be tested"
        return _unchanged(robot, None, why)
    reasons = [
        _excluded(effect, effect.term.plain or effect.term) for effect in evidence.naming.named
    ]
    if verdict == "unknown_physics":
        reasons.append("its parameters absorb a part of the unknown physics and are no measurement")
    unchanged = _unchanged(robot, nominal)
    choice = unchanged  # where every other candidate is worse
    for candidate in _ranked(robot, unchanged, evidence):
        worse = ""
        if candidate is not unchanged:
            worse = worse_than(nominal, candidate.predicted, runs, trip, rng)
        if not worse:
            choice = candidate
            break
        reasons.append(f"with {_WORDS[candidate.file.holds]}, {worse}")
    power_error, energy_error = error_parts(choice.predicted, runs, trip)
    why = f"off by {_percent(power_error)} and {_percent(energy_error)} on held-out drives (power, energy)"
    reasons.append(choice.file.why)
    distinct_reasons = dict.fromkeys(reason for reason in reasons if reason)
    why = "; ".join([why, *distinct_reasons])
    file = replace(choice.file, why=why)
    if verdict == "unknown_physics":
        file = replace(
            file, numbers=tuple(replace(number, proven=False) for number in file.numbers)
        )
    return replace(choice, file=file)


def _unchanged(robot: Robot, nominal: Array | None, why: str = "") -> FileChoice:
    """The given file, with its prediction, (windows,): it is fitted to nothing, so that all of it
    is held out."""
    return FileChoice(
        robot=robot, held_out=nominal, replayed=nominal, file=CorrectedFile("nominal", why)
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _ranked(robot: Robot, unchanged: FileChoice, evidence: Evidence) -> list[FileChoice]:
    """The candidates, the smallest held-out error first; before them the fit made to predict, where
    one is needed."""
    runs = evidence.runs
    model = expressible(
        evidence.plain, evidence.corrected, evidence.naming.named, runs, evidence.block
    )
    candidates = [unchanged, _candidate(robot, evidence.plain, "refit", evidence)]
    if model is not None:
        candidates.append(_candidate(robot, model, "corrected", evidence))
    ranked = sorted(candidates, key=lambda candidate: _error(candidate, evidence))
    _, energy_error = error_parts(ranked[0].predicted, runs, evidence.trip)
    # Beyond what the instruments explain, drives are consumed by what nothing proven models.
    if energy_error > thresholds.CLEAR * thresholds.GAIN_ERROR:
        ranked.insert(0, _predictive(robot, model, evidence))
    return ranked


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
    """Error of a held-out prediction, (windows,): of power, over its rms, and of a trip's energy,
    each at most a half.

    A trip of next to no energy would otherwise decide alone.
    """
    error = predicted - runs.observed
    mean_square = max(float(np.mean(runs.observed**2)), 1e-300)
    power_error = float(np.sqrt(np.mean(error**2) / mean_square))
    # Of each trip, J or A s.
    missed = np.abs(np.bincount(trip, error * runs.duration_s))
    drawn = np.abs(np.bincount(trip, runs.observed * runs.duration_s))
    trip_errors = np.minimum(missed / np.maximum(drawn, 1e-300), thresholds.HALF)
    return power_error, float(trip_errors.mean())


def _candidate(
    robot: Robot, model: Refit | Corrected, holds: Literal["refit", "corrected"], evidence: Evidence
) -> FileChoice:
    """A fit as a candidate, with the held-out prediction of its file."""
    changed, by_file = filed(robot, model, evidence.runs)
    fitted = joint(model, evidence.runs, evidence.block)
    numbers = fitted_numbers(robot, changed, model, fitted, _proven_effects(evidence), evidence)
    return FileChoice(
        robot=changed,
        held_out=_held_out(robot, model, evidence),
        replayed=by_file,
        file=CorrectedFile(holds, "", numbers),
    )


def _predictive(robot: Robot, model: Corrected | None, evidence: Evidence) -> FileChoice:
    """The fit made to predict as a candidate, with or without named effects."""
    runs = evidence.runs
    if model is None:
        content = file_content(evidence.plain, runs)
        base = robot
    else:
        content = file_content(model, runs)
        base = written(with_losses_of(robot, model), content, runs.unit)

    def replay(changed: Robot) -> Array:
        return replayed(changed, content, runs)

    def replay_of_file(fit: Predictive) -> Array:
        return replay(rounded_robot(robot, fit.changed))

    # Fitted with all digits, and judged with those of a file.
    fit = fit_predictive(runs, robot, base, replay, evidence.fold)
    fitted = _joint_of(fit, evidence)
    changed = rounded_robot(robot, fit.changed)
    numbers = fitted_numbers(
        robot, changed, model or evidence.plain, fitted, _proven_effects(evidence), evidence
    )
    return FileChoice(
        robot=changed,
        held_out=held_out(
            lambda windows: replay_of_file(fit.fitted_to(windows, runs)), evidence.fold
        ),
        replayed=replay_of_file(fit),
        file=CorrectedFile("predictive", _of_tyres(robot, fit), numbers),
        joint=fitted,
    )


def _of_tyres(robot: Robot, fit: Predictive) -> str:
    """What the fit takes from other vehicles, in words: how tyres roll in the cold if the robot's
    file does not say."""
    if ROLLING_PER_K not in fit.numbers or air_temperature.EFFECT.id in robot.effects:
        return ""
    per_k = _percent(fit.numbers[ROLLING_PER_K])
    return f"it takes tyres to roll {per_k} harder per kelvin of cold, as cars' do: the temperature was recorded"


def _in_file_by_fitted(fit: Predictive) -> tuple[Array, Array]:
    """The fitted numbers as the file has them, shape (entries,), and their derivatives by what was
    fitted: it has the accelerated mass over the mass."""
    values = fit.values.copy()
    by_fitted = np.eye(len(values))
    names = [entry.name for entry in fit.entries]
    accelerated = names.index(INERTIA)
    mass = names.index("mass")
    values[accelerated] = min(
        fit.values[accelerated] / fit.values[mass], inertia.EFFECT.switch.high
    )
    by_fitted[accelerated, accelerated] = 1.0 / fit.values[mass]
    by_fitted[accelerated, mass] = -values[accelerated] / fit.values[mass]
    return values, by_fitted


def _joint_of(fit: Predictive, evidence: Evidence) -> Joint:
    """The numbers of the fit made to predict, as the file has them, and their covariance."""
    symbols = {group.name: group.symbol for group in GROUPS[evidence.runs.unit]}
    names = [symbols.get(entry.name, entry.name.replace(".", " ")) for entry in fit.entries]
    units = ["1" if entry.name == INERTIA else entry.unit for entry in fit.entries]
    values, by_fitted = _in_file_by_fitted(fit)
    covariance = by_fitted @ fit.covariance(evidence.runs, evidence.block) @ by_fitted.T
    return Joint(tuple(names), tuple(units), values, covariance)


def _proven_effects(evidence: Evidence) -> set[str]:
    """Named effects that a robot file holds.

    One that may be a fault of the meter is not proven to be one of the robot.
    """
    proven = set()
    for named in evidence.naming.named:
        if not _excluded(named, named.term.plain or named.term):
            proven.add(named.term.effect)
    return proven


def worse_than(
    reference: Array, candidate: Array, runs: Runs, trip: Index, rng: np.random.Generator
) -> str:
    """Why to prefer the held-out prediction `reference` to `candidate`, shape (windows,) each;
    empty if not.

    The interval of the trips' errors is by bootstrap; `trip` numbers the trips, shape (windows,).
    """
    rms_of_reference = float(np.sqrt(np.mean((reference - runs.observed) ** 2)))
    rms_of_candidate = float(np.sqrt(np.mean((candidate - runs.observed) ** 2)))
    if rms_of_candidate >= rms_of_reference:
        return f"the held-out error would be {rms_of_candidate:.4g} {runs.unit} instead of {rms_of_reference:.4g}"
    off_of_reference = np.abs(np.bincount(trip, (reference - runs.observed) * runs.duration_s))
    off_of_candidate = np.abs(np.bincount(trip, (candidate - runs.observed) * runs.duration_s))
    # Paired by trip; worse is what the whole interval of the rise says.
    rise_low, _ = bootstrap(
        (off_of_candidate - off_of_reference)[None], rng, lambda drawn: drawn[0]
    )
    if rise_low <= 0.0:
        return ""
    consumed = "energy" if runs.unit == "W" else "charge"
    unit = "J" if runs.unit == "W" else "A s"
    return (
        f"the {consumed} of a held-out trip would be off by {off_of_candidate.mean():.3g} {unit} on average instead of "
        f"{off_of_reference.mean():.3g}"
    )


def _held_out(robot: Robot, model: Refit | Corrected, evidence: Evidence) -> Array:
    """Prediction of each fold by the file fitted to the others, shape (windows,)."""
    runs = evidence.runs

    def prediction(windows: Mask) -> Array:
        _, by_file = filed(robot, model.refitted(windows, runs), runs)
        return by_file

    return held_out(prediction, evidence.fold)


def filed(robot: Robot, model: Refit | Corrected, runs: Runs) -> tuple[Robot, Array]:
    """A fit as a robot file, and its prediction, shape (windows,)."""
    content = file_content(model, runs)
    robot = written(with_losses_of(robot, model), content, runs.unit)
    return robot, replayed(robot, content, runs)
