"""What the state of charge says of the power meter: the charge falls by the true energy, whatever a meter reads."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import battery, terms
from homeward.diagnosis.explain.channel_effects.inside import matters
from homeward.diagnosis.explain.channel_effects.reading import Reading, least_squares
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect
from homeward.diagnosis.explain.hypothesis import Setting, Term
from homeward.diagnosis.fit.fitted import bounded
from homeward.diagnosis.fit.held_out import delta_bic
from homeward.diagnosis.fit.refit import Refit, standard_errors
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Value
from homeward.logs.channels import Array, Index
from homeward.physics.battery import energy_share


def not_contradicted(
    candidates: Sequence[Term], base: Array, setting: Setting, misread: Array, block: Index
) -> list[Term]:
    """Hypotheses that the state of charge does not contradict: what a faulty meter adds is not drawn, and what a load
    adds is.

    `base`, shape (windows, columns), is fitted beside the hypotheses; `misread`, W, (windows,), is known to be an error
    of the meter.
    """
    runs, soc = setting.runs, setting.runs.context.get("soc")
    any_fault = misread.any() or any(term.misread for term in candidates)
    if soc is None or runs.unit != "W" or not np.isfinite(soc).any() or not any_fault:
        return list(candidates)
    energy = energy_share(setting.parameters.nominal.curve, soc)
    channel, read_w = Reading(-energy, runs, block), runs.observed - misread

    def fallen(power_w: Array) -> Array:
        """The charge as it falls by the energy and by a loss inside the battery that grows with the square of power."""
        columns = np.column_stack([channel.summed(power_w), channel.summed(power_w**2)])
        least = np.array([-np.inf, 0.0])
        return columns @ bounded(columns.T @ columns, columns.T @ channel.target, least, np.full(2, np.inf))

    def contradicted(term: Term) -> bool:
        """Whether the charge falls by the energy with what a fault adds, or by that without what a load draws."""
        weights = least_squares(np.column_stack([base, term.columns]), setting.residual)
        added_w = term.columns @ weights[base.shape[1] :]
        gained_without = delta_bic(channel.target, fallen(read_w), fallen(read_w - added_w), channel.run, 0)
        return (-gained_without if term.misread else gained_without) >= thresholds.STRONG_BIC

    return [term for term in candidates if not ((term.misread or term.axis == "time") and contradicted(term))]


def misread(
    fit: Refit, runs: Runs, channel: Reading, drawn: Array, block: Index, rng: Generator
) -> ChannelEffect | None:
    """A fault of the meter that power shows, be it too little to be named: less its error, the charge falls by the
    energy drawn, at least as well as with a capacity for each run."""
    setting = Setting.of(fit, runs)
    faults: list[tuple[float, ChannelEffect]] = []
    for term in terms(setting):
        of_several = term.schedule is not None and term.schedule.of_several
        if term.misread and term.axis == "time" and term.columns.shape[1] == 1 and not of_several:
            fault = _fault(term, setting, fit, channel, drawn, block, rng)
            if fault is not None:
                faults.append(fault)
    if not faults:
        return None
    most, best = max(faults, key=lambda pair: pair[0])
    alike = [fault.hypothesis.id for gained, fault in faults if gained > most - thresholds.STRONG_BIC]
    others = [name for name in alike if name != best.hypothesis.id]
    return dataclasses.replace(best, rivals=tuple(dict.fromkeys([*others, *best.rivals])))


def _fault(
    term: Term, setting: Setting, fit: Refit, channel: Reading, drawn: Array, block: Index, rng: Generator
) -> tuple[float, ChannelEffect] | None:
    """By how much a fault of the meter lowers the BIC of the charge, and the fault, where it is proven."""
    runs = setting.runs
    design = np.column_stack([fit.jacobian, term.columns])
    weights = least_squares(design, setting.residual)
    size, added_w = float(weights[-1]), term.columns[:, 0] * weights[-1]
    true = drawn - channel.summed(added_w / fit.parameters.nominal.usable_energy_j)[:, None]
    by_ageing = channel.delta_bic(true, channel.per_run(drawn))
    proof = channel.proof(drawn, true, rng)
    if proof is None or by_ageing >= thresholds.STRONG_BIC or not matters(np.abs(added_w), runs):
        return None
    error = float(standard_errors(design, setting.residual - design @ weights, block)[-1])
    wide = thresholds.NORMAL_95 * error
    switch = term.hypothesis.entry.switch
    may_be_ageing = by_ageing > -thresholds.STRONG_BIC
    shown = ChannelEffect(
        term.hypothesis,
        {switch.name: Value(size, (size - wide, size + wide), switch.unit)},
        added_w,
        proof,
        (battery.AGEING.id,) if may_be_ageing else (),
        "Less an error of the meter that power shows, the state of charge falls by the energy drawn.",
    )
    return channel.delta_bic(drawn, true), shown
