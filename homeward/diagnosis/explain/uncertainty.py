"""What a fit leaves open: covariance of what was fitted together, products that are known alone, spread of runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from homeward.diagnosis import rules
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.fit.held_out import bootstrap
from homeward.diagnosis.fit.refit import Refit, covariance
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.channels import Array, Index
from homeward.diagnosis.result import Product, Range, Value
from homeward.physics import Robot, d_max

_STEP = 1e-3  # of a group, for differences


@dataclass(frozen=True)
class Joint:
    """Everything that was fitted together: names, values in their units, and covariance, shape (numbers, numbers)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array


def joint(model: Refit | Corrected, runs: Runs, block: Index) -> Joint:
    """Joint covariance of fitted groups and sizes, clustered by block, shape (windows,); held groups are left out."""
    groups, problem = model.groups, model.parameters
    free = np.flatnonzero(~groups.held)
    active, to_group = problem.active()[free], problem.to_group[free]
    columns = np.column_stack([groups.jacobian[:, free], model.beside])
    unit = np.concatenate([problem.scale[active] * to_group, np.ones(model.beside.shape[1])])
    found = covariance(columns, runs.observed - model.predicted, block) * np.outer(unit, unit)
    names = [problem.groups[index].symbol for index in free]
    units = [problem.groups[index].unit for index in free]
    values = (model.theta[active] * to_group).tolist()
    if isinstance(model, Corrected):
        names += [f"{one.effect} {one.parameter}" for one in model.model.unknowns]
        units += [one.unit for one in model.model.unknowns]
        values += model.values.tolist()
    return Joint(tuple(names), tuple(units), np.array(values), found)


def products(model: Corrected, runs: Runs, block: Index) -> tuple[Product, ...]:
    """Products of which the recordings determine no factor alone.

    A group that is held as assumed, and that an effect is proportional to: what is known is their product. Two numbers
    of one effect that stand in for each other: what is known is the power that they make together. Windows of
    different `block`, shape (windows,), count as independent.
    """
    known = joint(model, runs, block)
    return (*_with_groups(model, known, runs), *_powers(model, known, runs))


def _with_groups(model: Corrected, known: Joint, runs: Runs) -> list[Product]:
    problem, theta = model.parameters, model.theta
    found = []
    for index in np.flatnonzero(model.groups.held):
        group, at = problem.groups[index], problem.active()[index]
        larger = theta.copy()
        larger[at] *= 1.0 + _STEP
        with_more = model.model.predict(runs, larger, model.values)
        column = with_more - model.predicted
        for number, one in enumerate(model.model.unknowns):
            added = model.contribution[one.term]
            more = with_more - model.model.predict(runs, larger, model.values, leave_out=one.term) - added
            scales = float(more @ added) / max(_STEP * float(added @ added), 1e-300)
            cosine = float(column @ added) / max(float(np.linalg.norm(column) * np.linalg.norm(added)), 1e-300)
            if cosine > rules.ENTWINED and scales > rules.ENTWINED and one.column is not None:
                name = f"{one.effect} {one.parameter}"
                assumed, at_joint = float(theta[at] * problem.to_group[index]), known.names.index(name)
                error = assumed * float(np.sqrt(max(known.covariance[at_joint, at_joint], 0.0)))
                unit = group.unit if one.unit == "1" else f"{group.unit} {one.unit}"
                found.append(_product((group.symbol, name), assumed * float(model.values[number]), error, unit))
    return found


def _powers(model: Corrected, kept: Joint, runs: Runs) -> list[Product]:
    """Mean power of each effect of which two numbers stand in for each other."""
    deviation = np.sqrt(np.maximum(np.diag(kept.covariance), 0.0))
    correlation = kept.covariance / np.maximum(np.outer(deviation, deviation), 1e-300)
    first = len(kept.names) - len(model.model.unknowns)
    found = []
    for index, term in enumerate(model.model.terms):
        mine = [first + at for at in model.model.of(index)]
        pairs = [(a, b) for a, b in combinations(mine, 2) if abs(correlation[a, b]) > rules.ENTWINED]
        if not pairs or term.hypothesis.of_the_day:
            continue
        mean = float(np.average(model.contribution[index], weights=runs.duration_s))
        slopes = np.array([model.beside[:, at - first].mean() for at in mine])
        error = float(np.sqrt(slopes @ kept.covariance[np.ix_(mine, mine)] @ slopes))
        names = tuple(dict.fromkeys(kept.names[at] for pair in pairs for at in pair))
        found.append(replace(_product(names, mean, error, runs.unit), together="mean power"))
    return found


def _product(of: tuple[str, ...], value: float, error: float, unit: str) -> Product:
    return Product(of, Value(value, (value - 1.96 * error, value + 1.96 * error), unit))


@dataclass(frozen=True)
class Spread:
    """How the mean of what is left differs from run to run, and how long it lasts within a run."""

    mean: Array  # (runs,), W or A
    deviation: float | None  # between runs, less what the noise within runs makes; None of one run
    rest: float  # standard deviation within runs
    correlation_s: float


def spread(left: Array, runs: Runs, memory_windows: float) -> Spread:
    """Spread of what a model leaves, (windows,), between and within runs (one-way random effects, by moments)."""
    count = np.bincount(runs.run)
    mean = np.bincount(runs.run, left) / count
    within = float(np.sqrt(np.mean((left - mean[runs.run]) ** 2)))
    between = None
    if len(count) > 1:
        noise = np.mean(within**2 * memory_windows / count)
        between = max(float(np.var(mean, ddof=1)) - float(noise), 0.0) ** 0.5
    return Spread(mean, between, within, memory_windows * float(np.median(runs.duration_s)))


def recorded_range(robots: Sequence[Robot], predictions: Sequence[Array], runs: Runs, seed: int) -> Range | None:
    """Range of a robot that goes on driving as it was recorded, m; None of motor current or where nothing drove.

    Usable energy over energy per metre: of what was recorded, and of what two robot files, as given and as handed over,
    predict of the same trips, shape (windows,) each. The interval is by bootstrap over runs or, of fewer than three,
    over minutes of driving.
    """
    path_m, drawn_j = np.abs(runs.context["speed_mps"]) * runs.duration_s, runs.observed * runs.duration_s
    if runs.unit == "A" or path_m.sum() <= 0.0 or drawn_j.sum() <= 0.0:
        return None
    before, after = robots
    piece = runs.run if len(runs.signals) > 2 else np.cumsum(runs.duration_s) // 60.0
    number = np.unique(piece, return_inverse=True)[1]
    energy_j, way_m = (np.bincount(number, one) for one in (drawn_j, path_m))
    low, high = bootstrap(
        np.stack([energy_j, way_m]), seed, lambda drawn: (after.usable_energy_j * drawn[1] / drawn[0])[drawn[0] > 0.0]
    )
    nominal_m, file_m = (
        float(robot.usable_energy_j * path_m.sum() / max(float((one * runs.duration_s).sum()), 1e-9))
        for robot, one in zip(robots, predictions, strict=True)
    )
    recorded_m = float(after.usable_energy_j * path_m.sum() / drawn_j.sum())
    return Range(recorded_m, (low, high), nominal_m, file_m, float(d_max(before)), float(d_max(after)))
