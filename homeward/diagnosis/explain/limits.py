"""Numbers that recordings limit from one side only, and what is known in their place.

A size at its bound would fit better beyond it: something else is not as assumed, and what trades
with the size stands in for it. Errors of a channel attenuate the group that rests on it (Fuller,
Measurement Error Models, 1987, ch. 1), so that what trades with the group is not known either. What
is known is their product.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.explain.uncertainty import Joint, combined_unit, joint, lasting_joint
from homeward.diagnosis.fit.estimates import Estimate
from homeward.diagnosis.fit.parameter_groups import Parameters
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Combination, Product, Side, Value
from homeward.logs.channels import Array, Index

LOSSES = "losses"
"""Name of the share that the drive loses, in motor and friction together."""


@dataclass(frozen=True)
class Limit:
    """The side from which a number is limited, and the interval from that end to its bound."""

    side: Side
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Limited:
    """A fit with what is limited in it: intervals of its sizes, the groups that remain known, and
    products that are known instead."""

    model: Corrected
    estimates: tuple[Estimate, ...]
    limits: Mapping[str, Limit] = field(default_factory=dict)  # by name of a number
    products: tuple[Product, ...] = ()

    def with_limit(self, name: str, side: Side, ci95: tuple[float, float]) -> Limited:
        """The same with a number limited from one side."""
        return replace(self, limits={**self.limits, name: Limit(side, ci95)})

    def with_limited_size(
        self, number: int, side: Side, ci95: tuple[float, float] | None = None
    ) -> Limited:
        """The same with an unknown, by its number, limited from one side: by an interval or, without
        one, by an end of its own."""
        if ci95 is None:
            low, high = self.model.ci95[number]
            least, largest = self.model.reported.bounds[:, number].tolist()
            ci95 = (low, largest) if side == "at least" else (least, high)
        intervals = list(self.model.ci95)
        intervals[number] = ci95
        model = replace(self.model, ci95=tuple(intervals))
        name = model.model.unknowns[number].name
        return replace(self, model=model).with_limit(name, side, ci95)

    def with_confounded(self, index: int, mixed_with: tuple[str, ...]) -> Limited:
        """The same with a group, by its index, that is not known apart from others."""
        estimates = list(self.estimates)
        estimates[index] = estimates[index].confounded(mixed_with)
        return replace(self, estimates=tuple(estimates))

    def with_product(self, product: Product) -> Limited:
        """The same with a product that is known."""
        return replace(self, products=(*self.products, product))


def limited(
    model: Corrected, estimates: Sequence[Estimate], in_file: Parameters, runs: Runs, block: Index
) -> Limited:
    """The fitted model with its limits.

    Args:
        model: The model with the named effects.
        estimates: Its groups.
        in_file: The groups by the robot file, with the losses of the drive that it assumes.
        runs: The runs.
        block: Windows of one block, (windows,), are dependent.
    """
    fitted = joint(model, runs, block)
    so_far = Limited(model, tuple(estimates))
    so_far = _beside_bounds(so_far, runs)
    so_far = _times_efficiency(so_far, fitted, in_file)
    return _beside_attenuated(so_far, fitted, lasting_joint(model, runs))


def _beside_bounds(so_far: Limited, runs: Runs) -> Limited:
    """Sizes at a bound are limited from one side, and so is what would leave its interval if they
    had none."""
    model = so_far.model
    sizes = model.reported.sizes
    least, largest = model.reported.bounds
    # No effect is a regular value.
    at_low = (sizes <= least) & (least != 0.0)
    at_high = sizes >= largest
    at_bound = np.flatnonzero(at_low | at_high).tolist()
    if not at_bound:
        return so_far
    theta, values = model.beyond_bounds(at_bound, runs.observed)
    effects = tuple(dict.fromkeys(model.model.unknowns[number].effect for number in at_bound))
    groups = (theta * model.parameters.to_group).tolist()
    for index, (estimate, value) in enumerate(zip(so_far.estimates, groups, strict=True)):
        if estimate.ci95 is not None and _side(estimate.ci95, value) is not None:
            so_far = so_far.with_confounded(index, effects)
    for number, value in enumerate((sizes + values - model.values).tolist()):
        side = _side(model.ci95[number], value)
        if at_high[number]:
            side = "at least"
        if at_low[number]:
            side = "at most"
        if side is not None:
            so_far = so_far.with_limited_size(number, side)
    return so_far


def _side(ci95: tuple[float, float], value: float) -> Side | None:
    """On which side of an interval a value is; None within it."""
    low, high = ci95
    if value < low:
        return "at most"
    if value > high:
        return "at least"
    return None


def _times_efficiency(so_far: Limited, fitted: Joint, in_file: Parameters) -> Limited:
    """Of a size that only the losses of the file would take beyond its bound, the product with the
    efficiency of the drive is known.

    The drive may lose the most that the bound allows, or nothing.
    """
    problem = so_far.model.parameters
    efficiency = problem.nominal.traction_efficiency
    loses_less = efficiency > in_file.nominal.traction_efficiency
    deviation = _deviation(fitted)
    for number, unknown in enumerate(so_far.model.model.unknowns):
        hypothesis = so_far.model.model.terms[unknown.term].hypothesis
        is_product = hypothesis.times_efficiency and unknown.column is not None
        is_limited = loses_less or unknown.name in so_far.limits
        if not is_product or not is_limited:
            continue
        position = fitted.names.index(unknown.name)
        value = efficiency * float(fitted.values[position])
        half_width = thresholds.NORMAL_95 * efficiency * float(deviation[position])
        low = max(value - half_width, unknown.low)
        high = min(value + half_width, unknown.high)
        product = Product((unknown.name, "Gamma"), Value(value, (low, high), unknown.unit))
        so_far = so_far.with_product(product)
        so_far = so_far.with_limited_size(number, "at least", (low, unknown.high))
        if loses_less:
            least_efficient = in_file.of_efficiency(max(low / unknown.high, 1e-9)).nominal
            most_lost = least_efficient.motor_loss + least_efficient.friction_loss
            so_far = so_far.with_limit(LOSSES, "at most", (0.0, most_lost))
    return so_far


def _beside_attenuated(so_far: Limited, fitted: Joint, lasting: Joint) -> Limited:
    """What trades with a group that errors of its channel attenuate is limited from one side, and
    their product is known.

    Two numbers trade where their joint fit tells them apart as little as two estimates of one.
    """
    deviation = _deviation(fitted)
    correlation = fitted.covariance / np.maximum(np.outer(deviation, deviation), 1e-300)
    for estimate in so_far.estimates:
        symbol = estimate.group.symbol
        if estimate.status != "attenuated" or symbol not in fitted.names:
            continue
        position = fitted.names.index(symbol)
        so_far = _limited_group(so_far, estimate, float(deviation[position]))
        for index, other in enumerate(so_far.estimates):
            if other.status != "fitted" or other.group.symbol not in fitted.names:
                continue
            partner = fitted.names.index(other.group.symbol)
            if abs(correlation[position, partner]) > thresholds.NEARLY_ALL:
                so_far = so_far.with_confounded(index, (symbol,))
        for number, unknown in enumerate(so_far.model.model.unknowns):
            partner = fitted.names.index(unknown.name)
            # The group is larger than fitted: what rises with it is, too.
            if correlation[position, partner] > thresholds.NEARLY_ALL:
                product = _combination(fitted, lasting, position, partner, "ratio")
                so_far = so_far.with_limited_size(number, "at least").with_product(product)
            if correlation[position, partner] < -thresholds.NEARLY_ALL:
                product = _combination(fitted, lasting, position, partner, "product")
                so_far = so_far.with_limited_size(number, "at most").with_product(product)
    return so_far


def _limited_group(so_far: Limited, estimate: Estimate, deviation: float) -> Limited:
    """A group that is at least as large as fitted."""
    problem = so_far.model.parameters
    index = problem.groups.index(estimate.group)
    to_group = problem.to_group[index]
    low = float(so_far.model.theta[index] * to_group) - thresholds.NORMAL_95 * deviation
    least = float(problem.low[index] * to_group)
    largest = float(problem.high[index] * to_group)
    return so_far.with_limit(estimate.group.symbol, "at least", (max(low, least), largest))


def _combination(
    fitted: Joint, lasting: Joint, group: int, size: int, combination: Combination
) -> Product:
    """Product or ratio of a group and a size, by their positions in the joint fit.

    Errors of a channel may last for longer than a block: its interval is at least that of errors
    that do, `lasting`.
    """
    values = fitted.values
    power = 1.0 if combination == "product" else -1.0
    value = float(values[group] * values[size] ** power)
    relative = np.zeros(len(values))
    relative[group] = 1.0 / values[group]
    relative[size] = power / values[size]
    by_blocks = float(relative @ fitted.covariance @ relative)
    variance = max(by_blocks, float(relative @ lasting.covariance @ relative))
    error = float(np.hypot(np.sqrt(variance), thresholds.GAIN_ERROR))
    half_width = thresholds.NORMAL_95 * abs(value) * error
    names = (fitted.names[group], fitted.names[size])
    unit = combined_unit(fitted.units[group], fitted.units[size], combination)
    return Product(names, Value(value, (value - half_width, value + half_width), unit), combination)


def _deviation(fitted: Joint) -> Array:
    """Standard deviations of the numbers of a joint fit, (numbers,)."""
    return np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
