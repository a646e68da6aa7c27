"""What the state of charge says of the power meter: the charge falls by the true energy, whatever a
meter reads."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import battery, terms
from homeward.diagnosis.explain.channel_effects.inside import matters
from homeward.diagnosis.explain.channel_effects.reading import Reading, least_squares
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect
from homeward.diagnosis.explain.hypothesis import Setting, Term
from homeward.diagnosis.fit.bounded import bounded
from homeward.diagnosis.fit.estimates import standard_errors
from homeward.diagnosis.fit.held_out import delta_bic
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Value
from homeward.logs.channels import Array, Index
from homeward.physics.battery import energy_share


def not_contradicted(
    candidates: Sequence[Term], base: Array, setting: Setting, misread: Array, block: Index
) -> list[Term]:
    """Hypotheses that the state of charge does not contradict: what a faulty meter adds is not
    drawn, and what a load adds is.

    `base`, shape (windows, columns), is fitted beside the hypotheses; `misread`, W, (windows,), is
    known to be an error of the meter.
    """
    runs = setting.runs
    soc = runs.context.get("soc")
    any_fault = misread.any() or any(term.misread for term in candidates)
    if soc is None or runs.unit != "W" or not np.isfinite(soc).any() or not any_fault:
        return list(candidates)
    energy = energy_share(setting.parameters.nominal.curve, soc)
    channel = Reading(-energy, runs, block)
    read_w = runs.observed - misread

    def fallen(power_w: Array) -> Array:
        """The charge as it falls by the energy and by a loss inside the battery that grows with the
        square of power."""
        columns = np.column_stack([channel.summed(power_w), channel.summed(power_w**2)])
        low = np.array([-np.inf, 0.0])
        high = np.array([np.inf, np.inf])
        weights = bounded(columns.T @ columns, columns.T @ channel.target, low, high)
        return columns @ weights

    def contradicted(term: Term) -> bool:
        """Whether the charge falls by the energy with what a fault adds, or by that without what a
        load draws."""
        weights = least_squares(np.column_stack([base, term.columns]), setting.residual)
        added_w = term.columns @ weights[base.shape[1] :]
        gained_without = delta_bic(
            channel.target, fallen(read_w), fallen(read_w - added_w), channel.run, 0
        )
        if term.misread:
            return -gained_without >= thresholds.STRONG_BIC
        return gained_without >= thresholds.STRONG_BIC

    remaining = []
    for term in candidates:
        is_tested = term.misread or term.axis == "time"
        if not (is_tested and contradicted(term)):
            remaining.append(term)
    return remaining


def misread(
    fit: Refit, runs: Runs, channel: Reading, drawn: Array, block: Index, rng: Generator
) -> ChannelEffect | None:
    """A fault of the meter that power shows, be it too little to be named: less its error, the
    charge falls by the energy drawn, at least as well as with a capacity for each run."""
    setting = Setting.of(fit, runs)
    faults: list[_Fault] = []
    for term in terms(setting):
        if _is_single_fault(term):
            fault = _fault(term, setting, fit, channel, drawn, block, rng)
            if fault is not None:
                faults.append(fault)
    if not faults:
        return None
    likeliest = max(faults, key=lambda fault: fault.gained_bic)
    rivals = []
    for fault in faults:
        is_other = fault.effect.hypothesis.id != likeliest.effect.hypothesis.id
        if is_other and fault.gained_bic > likeliest.gained_bic - thresholds.STRONG_BIC:
            rivals.append(fault.effect.hypothesis.id)
    rivals += likeliest.effect.rivals
    return dataclasses.replace(likeliest.effect, rivals=tuple(dict.fromkeys(rivals)))


def _is_single_fault(term: Term) -> bool:
    """Whether a term is one fault of the meter that begins, or creeps, in time."""
    if not term.misread or term.axis != "time" or term.columns.shape[1] != 1:
        return False
    return term.schedule is None or not term.schedule.of_several


class _Fault(NamedTuple):
    gained_bic: float  # by how much it lowers the BIC of the charge
    effect: ChannelEffect


def _fault(
    term: Term,
    setting: Setting,
    fit: Refit,
    channel: Reading,
    drawn: Array,
    block: Index,
    rng: Generator,
) -> _Fault | None:
    """A fault of the meter, where it is proven."""
    runs = setting.runs
    design = np.column_stack([fit.jacobian, term.columns])
    weights = least_squares(design, setting.residual)
    size = float(weights[-1])
    added_w = term.columns[:, 0] * weights[-1]
    truly_drawn = drawn - channel.summed(added_w / fit.parameters.nominal.usable_energy_j)[:, None]
    gained_by_ageing = channel.delta_bic(truly_drawn, channel.per_run(drawn))
    proof = channel.proof(drawn, truly_drawn, rng)
    if (
        proof is None
        or gained_by_ageing >= thresholds.STRONG_BIC
        or not matters(np.abs(added_w), runs)
    ):
        return None
    error = float(standard_errors(design, setting.residual - design @ weights, block)[-1])
    half_width = thresholds.NORMAL_95 * error
    switch = term.hypothesis.entry.switch
    rivals: tuple[str, ...] = ()
    if gained_by_ageing > -thresholds.STRONG_BIC:
        rivals = (battery.AGEING.id,)
    effect = ChannelEffect(
        hypothesis=term.hypothesis,
        parameters={switch.name: Value(size, (size - half_width, size + half_width), switch.unit)},
        contribution=added_w,
        proof=proof,
        rivals=rivals,
        sentence="Less an error of the meter that power shows, the state of charge falls by the energy drawn.",
    )
    return _Fault(gained_bic=channel.delta_bic(drawn, truly_drawn), effect=effect)
