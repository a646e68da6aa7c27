"""Which effects other channels than power identify: regressions of voltage and state of charge, a check of odometry.

Power at the terminals does not show losses inside the battery. But the voltage sags by the current times a resistance,
and the state of charge falls by the energy drawn and lost over the capacity. One capacity for all runs is a parameter,
refitted like the others; one that shrinks from run to run is ageing; and a loss that grows with the load or in the cold
is an effect of the battery. Each is validated as any effect: it must lower the held-out error of its channel, by more
than on random signs of blocks (wild cluster bootstrap).
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pandas as pd
from numpy.random import Generator
from scipy.optimize import minimize_scalar
from scipy.stats import binom, norm, spearmanr

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import CATALOGUE, battery, instruments, terms
from homeward.diagnosis.explain.hypothesis import SMALL_STEP, TINY, Hypothesis, Numbers, Setting, Term
from homeward.diagnosis.explain.proof import DRAWS
from homeward.diagnosis.fit.fitted import bounded
from homeward.diagnosis.fit.folds import FOLDS, per_block
from homeward.diagnosis.fit.held_out import delta_bic, gain, held_out
from homeward.diagnosis.fit.refit import Refit, standard_errors
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.diagnosis.result import Proof, Value
from homeward.logs.channels import Array, Index
from homeward.physics import Robot
from homeward.physics.battery import CHEMISTRIES, curve_of, energy_share
from homeward.physics.effects import EFFECTS
from homeward.physics.terminal_power import lost_inside

USABLE_ENERGY = "usable energy"
"""Name of the parameter identified from the state of charge."""

_MILD_C = 20.0  # air where it is unknown; chosen: room temperature, as in the replay
_SEARCHED = 3.0  # upper end of the search, over the linear estimate; chosen: room for one that bends


@dataclass(frozen=True)
class ChannelEffect:
    """An effect that another channel than power identifies."""

    hypothesis: Hypothesis
    parameters: Mapping[str, Value]
    contribution: Array  # (windows,), W
    proof: Proof  # in the channel that identifies it
    rivals: tuple[str, ...]  # effects that are confounded with it in that channel
    sentence: str  # the evidence, in words

    @property
    def in_file(self) -> Mapping[str, Numbers]:
        """Its entry in a robot file; empty for a fault of an instrument."""
        numbers = {name: value.value for name, value in self.parameters.items()}
        return {self.hypothesis.id: numbers} if self.hypothesis.physical else {}


@dataclass(frozen=True)
class Capacity:
    """Energy of a full battery by a recorded state of charge, J; `ci95` has the errors of gauge and curve."""

    assumed_j: float
    fitted_j: float  # one for all runs
    ci95: tuple[float, float]
    off: bool  # significantly differs from assumed, and is the same in all runs
    rivals: tuple[str, ...] = ()  # losses that explain the charge as well, with the file's capacity
    above_rated: bool = False  # above that of a new battery by the robot's file

    @property
    def asked(self) -> bool:
        """Whether it is off, and above what the battery's maker rates: asked about, and not written to a file."""
        return self.off and self.above_rated

    @property
    def written(self) -> bool:
        """Whether it is off, and a file may have it."""
        return self.off and not self.above_rated


def find_effects(
    fit: Refit, runs: Runs, block: Index, rng: Generator
) -> tuple[Capacity | None, tuple[ChannelEffect, ...]]:
    """Effects identified by voltage, state of charge and distance; windows of a `block`, (windows,), are dependent."""
    robot = fit.parameters.nominal
    sag = _sag(robot, runs, block, rng)
    # A recorded `power_w` counts as what the battery gives and loses, as it does in the replay, unless the charge
    # showed that it does not (`gauge.weigh_gauge`).
    at_terminals = np.array([run.at_terminals for run in runs.signals])[runs.run]
    lost_w = at_terminals * inside_w(robot, runs) + (0.0 if sag is None else sag.contribution)
    capacity, shown = _state_of_charge(fit, runs, lost_w, sag, block, rng)
    found = (sag, shown, _odometer(fit, runs))
    return capacity, tuple(one for one in found if one is not None)


class Reading:
    """Regression of a channel, where it is known, with fixed effects: a mean for each stretch without a gap.

    The energy drawn in a gap is unknown. Columns have shape (known windows, columns).
    """

    def __init__(self, values: Array, runs: Runs, block: Index) -> None:
        self.known = np.isfinite(values)
        follows = (np.diff(runs.run) == 0) & (np.diff(runs.time_s) < thresholds.WINDOWS_APART * runs.duration_s[1:])
        self.stretch = np.concatenate([[0], np.cumsum(~follows)])[self.known]
        self.run = runs.run[self.known]
        self.block = np.unique(block[self.known], return_inverse=True)[1]
        self.duration_s = runs.duration_s
        self.target = self.within(values)

    def within(self, values: Array) -> Array:
        """Within transformation of values of all windows, less the mean of their stretch, shape (known windows,)."""
        values = values[self.known]
        count = np.maximum(np.bincount(self.stretch), 1)
        return np.asarray(values - (np.bincount(self.stretch, values) / count)[self.stretch])

    def summed(self, rate: Array) -> Array:
        """A rate of all windows integrated over time, to the middle of each window, shape (known windows,)."""
        amount = rate * self.duration_s
        return self.within(np.cumsum(amount) - 0.5 * amount)

    def fit(self, columns: Array) -> tuple[Array, Array]:
        """Coefficients of columns and their standard errors, clustered by block, shape (columns,) each."""
        found = _fit(columns, self.target)
        return found, standard_errors(columns, self.target - columns @ found, self.block)

    def per_run(self, column: Array) -> Array:
        """A column of its own for each run, shape (known windows, runs)."""
        return np.asarray(column * (self.run[:, None] == np.unique(self.run)))

    def delta_bic(self, first: Array, second: Array) -> float:
        """Reduction of BIC by the second of two designs."""
        before, after = (columns @ _fit(columns, self.target) for columns in (first, second))
        return delta_bic(self.target, before, after, self.run, second.shape[1] - first.shape[1])

    def proof(self, base: Array, added: Array, rng: Generator, tried: Sequence[Array] = ()) -> Proof | None:
        """Evidence that the added columns, best of those tried, explain the channel beside the base; None if weak."""
        design = np.column_stack([base, added])
        before, after = (
            held_out(lambda chosen, of=of: of @ _fit(of[chosen], self.target[chosen]), self.block % FOLDS)  # type: ignore[misc]
            for of in (base, design)
        )
        gained = gain(self.target, before, after, self.block, rng)
        bic_gain = delta_bic(self.target, before, after, self.run, added.shape[1])
        if bic_gain < thresholds.STRONG_BIC or gained.share < thresholds.SMALLEST_GAIN or gained.ci95[0] <= 0.0:
            return None
        p_value = self._p_value(base, added, np.column_stack([added, *tried]), rng)
        return None if p_value > thresholds.FALSE_ALARM_RATE else Proof(bic_gain, gained.share, p_value)

    def _p_value(self, base: Array, added: Array, tried: Array, rng: Generator) -> float:
        """P-value: how often, on random signs of blocks, some column tried explains as much as the best added."""
        residual, own = (one - base @ _fit(base, one) for one in (self.target, tried))
        sums = per_block(own * residual[:, None], self.block)
        spread = np.sqrt((sums**2).sum(axis=0))
        sums = sums[:, spread > 0.0] / spread[spread > 0.0]
        signs = rng.choice([-1.0, 1.0], (DRAWS, len(sums)))
        reached = float(np.abs(sums.sum(axis=0))[: added.shape[1]].max(initial=0.0))
        return float((1 + np.sum(np.abs(signs @ sums).max(axis=1, initial=0.0) >= reached)) / (DRAWS + 1))


def _gained(proof: Proof) -> float:
    return proof.held_out_gain or 0.0  # no model was compared


def _fit(design: Array, target: Array) -> Array:
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0])


def matters(lost_w: Array, runs: Runs) -> bool:
    """Whether a loss exceeds `MATERIAL_SHARE` of the energy drawn."""
    return float(lost_w @ runs.duration_s) >= thresholds.MATERIAL_SHARE * float(runs.observed @ runs.duration_s)


def inside_w(robot: Robot, runs: Runs) -> Array:
    """What the effects of a robot's file lose inside its battery, W, shape (windows,)."""
    air_c = np.nan_to_num(runs.context.get("temperature_c", np.full(len(runs.observed), _MILD_C)), nan=_MILD_C)
    record, conditions = robot.record().view(np.recarray)[0], SimpleNamespace(temperature_c=air_c)
    # The voltage is that at the state of charge; where none was recorded, that of a full battery, as a replay begins.
    soc = np.nan_to_num(runs.context.get("soc", np.ones(len(runs.observed))), nan=1.0)
    state = SimpleNamespace(energy_j=energy_share(robot.curve, np.clip(soc, 0.0, 1.0)), capacity_j=1.0)
    drawn_w = total_w = np.maximum(runs.observed, 0.0)
    for one in EFFECTS:
        if lost_inside(one) and one.id in robot.effects:
            total_w = total_w + np.asarray(one.function(record, state, conditions, total_w))
    return np.asarray(total_w - drawn_w)


def _values(one: Hypothesis, size: float, ci95: tuple[float, float], shape: Numbers) -> dict[str, Value]:
    units = {parameter.name: parameter.unit for parameter in one.entry.parameters}
    others = {name: Value(number, (number, number), units[name]) for name, number in shape.items()}
    return {one.entry.switch.name: Value(size, ci95, one.entry.switch.unit), **others}


def _sag(robot: Robot, runs: Runs, block: Index, rng: Generator) -> ChannelEffect | None:
    """Resistance by the voltage, beside the file's, where it loses a material share of the energy."""
    voltage_v, air_c = runs.context.get("voltage_v", np.zeros(1)), runs.context.get("temperature_c")
    known = voltage_v > 0.0
    if runs.unit != "W" or not known.any():
        return None
    one, cold = battery.INTERNAL_RESISTANCE, battery.COLD_BATTERY.id
    given_ohm, of_cold = one.in_file(robot)[0], robot.effects.get(cold, {})
    current_a = np.where(known, runs.observed / np.where(known, voltage_v, 1.0), 0.0)
    in_file_v = given_ohm * current_a
    if of_cold.get(battery.COLD_W.name):
        in_file_w = inside_w(dataclasses.replace(robot, effects={cold: of_cold}), runs)
        in_file_v = in_file_v + in_file_w / np.where(current_a > 0.0, current_a, np.inf)
    channel = Reading(np.where(known, voltage_v + in_file_v, np.nan), runs, block)
    base, drawn = channel.summed(current_a)[:, None], -channel.within(current_a)[:, None]
    found, errors = channel.fit(np.hstack([base, drawn]))
    ohm, wide = float(found[-1]), thresholds.NORMAL_95 * float(errors[-1])
    lost_w = max(ohm, 0.0) * current_a**2
    proof = channel.proof(base, drawn, rng) if matters(lost_w, runs) else None
    if proof is None or given_ohm + ohm > one.entry.switch.high:
        return None
    if (by_warmth := _falls_with_warmth(channel, base, drawn, current_a, robot, runs, rng)) is not None:
        return by_warmth
    rivals = (cold,) if air_c is None or float(np.nanmean(air_c)) < thresholds.COLD_C else ()
    return ChannelEffect(
        one, _values(one, given_ohm + ohm, (given_ohm + ohm - wide, given_ohm + ohm + wide), {}), lost_w, proof, rivals,
        f"The voltage sags by {given_ohm + ohm:.3g} ohm times the current.",
    )  # fmt: skip


def _falls_with_warmth(
    channel: Reading, base: Array, drawn: Array, current_a: Array, robot: Robot, runs: Runs, rng: Generator
) -> ChannelEffect | None:
    """A cold battery, where the resistance falls with warmth, and explains the voltage no worse than one that differs
    from run to run or changes as the battery empties; a rival where it explains it no better."""
    air_c, voltage_v = runs.context.get("temperature_c", np.full(1, np.nan)), runs.context["voltage_v"]
    one, switch = battery.COLD_BATTERY, battery.COLD_BATTERY.entry.switch
    if not np.isfinite(air_c).all() or one.in_file(robot)[0]:
        return None
    warmth, emptied = air_c - np.mean(air_c), pd.Series(current_a * runs.duration_s).groupby(runs.run).cumsum()
    bent, warmer, later = (channel.within(current_a * of)[:, None] for of in (warmth**2, warmth, emptied.to_numpy()))
    by_warmth = np.hstack([base, drawn, warmer])
    others = np.hstack([base, channel.per_run(drawn)]), np.hstack([base, drawn, later])
    (*_, ohm, per_k), (*_, error) = channel.fit(by_warmth)
    warm_c = float(np.mean(air_c) + ohm / max(per_k, TINY))
    reference_w = float(np.median(runs.observed[runs.observed > 0.0]))
    share_per_ohm = reference_w / float(np.mean(voltage_v[voltage_v > 0.0]) ** 2 + ohm * reference_w)
    size, wide = float(share_per_ohm * per_k), float(share_per_ohm * thresholds.NORMAL_95 * error)
    possible = battery.WARM_C.low <= warm_c <= battery.WARM_C.high and size <= switch.high
    better = max(min(channel.delta_bic(of, by) for of in (by_warmth, np.hstack([by_warmth, bent]))) for by in others)
    falls = (
        possible and better < thresholds.STRONG_BIC and channel.proof(np.hstack([base, drawn]), warmer, rng) is not None
    )
    if not falls or (proof := channel.proof(base, np.hstack([drawn, warmer]), rng)) is None:
        return None
    clear = all(channel.delta_bic(by, by_warmth) >= thresholds.STRONG_BIC for by in others)
    shape = {battery.WARM_C.name: warm_c, battery.COLD_W.name: reference_w}
    rivals = () if clear else (battery.INTERNAL_RESISTANCE.id,)
    lost_w = np.maximum(ohm - per_k * warmth, 0.0) * current_a**2
    return ChannelEffect(
        one, _values(one, size, (size - wide, size + wide), shape), lost_w, proof, rivals,
        f"The voltage sags by {ohm:.3g} ohm times the current, and by {per_k:.2g} ohm less for each kelvin of warmth.",
    )  # fmt: skip


def _state_of_charge(
    fit: Refit, runs: Runs, lost_w: Array, sag: ChannelEffect | None, block: Index, rng: Generator
) -> tuple[Capacity | None, ChannelEffect | None]:
    """Capacity by the state of charge, and an effect that changes its fall; None of both where it hardly fell.

    The capacity is one for all runs, of an aged battery that of the last; the effect is not that of the voltage's sag.
    """
    robot, soc = fit.parameters.nominal, runs.context.get("soc")
    if soc is None or runs.unit != "W":
        return None, None
    of_run = pd.Series(soc).groupby(runs.run)  # NaN of a run that lacks it
    if float((of_run.max() - of_run.min()).sum()) < thresholds.LEAST_FALL:
        return None, None
    channel = Reading(-energy_share(robot.curve, soc), runs, block)
    drawn = channel.summed((runs.observed + lost_w) / robot.usable_energy_j)[:, None]
    (*_, rate), (*_, error) = channel.fit(channel.per_run(drawn) if battery.AGEING.in_file(robot)[0] else drawn)
    if rate <= 0.0:
        return None, None
    capacity = _capacity(robot, float(rate), float(error), covered(soc, runs.run))
    off = capacity is not None and capacity.off
    right = None if capacity is None else dataclasses.replace(capacity, off=False)
    if (misread := _misread(fit, runs, channel, drawn, block, rng)) is not None:
        return right, misread
    losses = _Losses(fit, runs, channel, drawn, sag)
    both = (losses.found(rng), _fading(channel, runs, robot, drawn, rng))
    if not (found := sorted((one for one in both if one is not None), key=lambda one: -_gained(one.proof))):
        if capacity is None or not off:
            return capacity, None
        return dataclasses.replace(capacity, rivals=losses.instead(float(rate))), None
    best = found[0]
    alike = (
        one.hypothesis.id for one in found[1:] if _gained(one.proof) > thresholds.RIVAL_SHARE * _gained(best.proof)
    )
    best = dataclasses.replace(best, rivals=tuple(dict.fromkeys([*best.rivals, *alike])))
    return right, best


def covered(soc: Array, run: Index) -> tuple[float, float]:
    """Lowest and highest state of charge, (windows,), of the widest part of a battery that runs cover together."""
    known = np.isfinite(soc)
    of_run = pd.Series(soc[known]).clip(0.0, 1.0).groupby(run[known])
    widest = low, high = 0.0, 0.0
    for least, most in sorted(zip(of_run.min(), of_run.max(), strict=True)):
        low, high = (low, max(high, most)) if least <= high else (least, most)
        widest = max(widest, (low, high), key=lambda part: part[1] - part[0])
    return widest


def _capacity(robot: Robot, rate: float, error: float, part: tuple[float, float]) -> Capacity | None:
    """Capacity of a battery whose charge falls `rate` times as fast as its file implies, with a standard error of the
    regression, from a part of its charge; None from less than half."""
    if part[1] - part[0] < thresholds.HALF:
        return None
    total = float(np.hypot(error, rate * np.hypot(thresholds.GAUGE_GAIN_SD, _curve_error(robot, part))))
    off = abs(rate - 1.0) > float(norm.ppf(1.0 - thresholds.FALSE_ALARM_RATE / 2.0)) * total
    low, high = (robot.usable_energy_j / max(rate + sign * thresholds.NORMAL_95 * total, 1e-9) for sign in (1.0, -1.0))
    fitted_j = robot.usable_energy_j / rate
    return Capacity(robot.usable_energy_j, fitted_j, (low, high), off, above_rated=fitted_j > robot.rated_energy_j)


def _curve_error(robot: Robot, part: tuple[float, float]) -> float:
    """Relative standard error of the energy of a part of the charge, as the open-circuit curve may be another one: any
    of the known ones where the robot's file has none."""
    low, high = part
    if robot.curve.mean_v > 0.0:
        return thresholds.CURVE_SD * (1.0 - (high - low))
    curves = [curve_of(points) for points in CHEMISTRIES.values()]
    energies = [float(energy_share(curve, high) - energy_share(curve, low)) for curve in curves]
    return max(abs(energy / (high - low) - 1.0) for energy in energies) / thresholds.NORMAL_95


def not_contradicted(
    candidates: Sequence[Term], base: Array, setting: Setting, misread: Array, block: Index
) -> list[Term]:
    """Hypotheses that the state of charge does not contradict: it falls by the true energy, whatever a meter reads.

    What a faulty meter adds is not drawn, and what a load adds is.
    `base`, shape (windows, columns), is fitted beside the hypotheses; `misread`, W, (windows,), is known to be an error
    of the meter.
    """
    runs, soc = setting.runs, setting.runs.context.get("soc")
    faults = [term for term in candidates if term.misread]
    if soc is None or runs.unit != "W" or not np.isfinite(soc).any() or not (faults or misread.any()):
        return list(candidates)
    energy = energy_share(setting.parameters.nominal.curve, soc)
    channel, read = Reading(-energy, runs, block), runs.observed - misread

    def fallen(power: Array) -> Array:
        """The charge as it falls by the energy and by a loss inside the battery that grows with the square of power."""
        columns = np.column_stack([channel.summed(power), channel.summed(power**2)])
        least = np.array([-np.inf, 0.0])
        return columns @ bounded(columns.T @ columns, columns.T @ channel.target, least, np.full(2, np.inf))

    def contradicted(term: Term) -> bool:
        """Whether the charge falls by the energy with what a fault adds, or by that without what a load draws."""
        weights = _fit(np.column_stack([base, term.columns]), setting.residual)
        added = term.columns @ weights[base.shape[1] :]
        gained = delta_bic(channel.target, fallen(read), fallen(read - added), channel.run, 0)
        return (-gained if term.misread else gained) >= thresholds.STRONG_BIC

    return [term for term in candidates if not ((term.misread or term.axis == "time") and contradicted(term))]


def _misread(
    fit: Refit, runs: Runs, channel: Reading, drawn: Array, block: Index, rng: Generator
) -> ChannelEffect | None:
    """A fault of the meter that power shows, be it too little to be named: less its error, the charge falls by the
    energy drawn, at least as well as with a capacity for each run."""
    setting, per_run = Setting.of(fit, runs), channel.per_run(drawn)
    found: list[tuple[float, ChannelEffect]] = []
    for term in terms(setting):
        one_of_several = term.schedule is not None and term.schedule.of_several
        if not term.misread or term.axis != "time" or term.columns.shape[1] > 1 or one_of_several:
            continue
        design = np.column_stack([fit.jacobian, term.columns])
        weights = _fit(design, setting.residual)
        size, added = float(weights[-1]), term.columns[:, 0] * weights[-1]
        true = drawn - channel.summed(added / fit.parameters.nominal.usable_energy_j)[:, None]
        by_ageing = channel.delta_bic(true, per_run)
        proof = channel.proof(drawn, true, rng)
        if proof is None or by_ageing >= thresholds.STRONG_BIC or not matters(np.abs(added), runs):
            continue
        wide = thresholds.NORMAL_95 * float(standard_errors(design, setting.residual - design @ weights, block)[-1])
        switch, rivals = (
            term.hypothesis.entry.switch,
            (battery.AGEING.id,) if by_ageing > -thresholds.STRONG_BIC else (),
        )
        shown = ChannelEffect(
            term.hypothesis, {switch.name: Value(size, (size - wide, size + wide), switch.unit)}, added, proof, rivals,
            "Less an error of the meter that power shows, the state of charge falls by the energy drawn.",
        )  # fmt: skip
        found.append((channel.delta_bic(drawn, true), shown))
    if not found:
        return None
    most, best = max(found, key=lambda one: one[0])
    alike = [one.hypothesis.id for gained, one in found if gained > most - thresholds.STRONG_BIC]
    others = (*(one for one in alike if one != best.hypothesis.id), *best.rivals)
    return dataclasses.replace(best, rivals=tuple(dict.fromkeys(others)))


class _Losses:
    """Effects of the battery that make the charge fall faster at some loads or temperatures than at others."""

    def __init__(self, fit: Refit, runs: Runs, channel: Reading, drawn: Array, sag: ChannelEffect | None) -> None:
        self.runs, self.channel, self.drawn, self.robot = runs, channel, drawn, fit.parameters.nominal
        setting, self.in_file_w = Setting.of(fit, runs), inside_w(self.robot, runs)
        self.tried = [
            (one, shape, self._fallen(one, shape, TINY) / TINY)
            for one in CATALOGUE.values()
            if lost_inside(one.entry) and one.steady is not None and not one.missing(runs)
            if self._most(one) > TINY and (sag is None or one is not sag.hypothesis)
            for given, others in (one.in_file(self.robot),)
            for shape in ([others] if given else one.shapes(setting))
        ]

    def found(self, rng: Generator) -> ChannelEffect | None:
        """The loss that explains most beside a capacity, if one is proven."""
        tried = [added for *_, added in self.tried]
        proofs = [(self.channel.proof(self.drawn, added, rng, tried), one, shape) for one, shape, added in self.tried]
        if not (proven := [(proof, one, shape) for proof, one, shape in proofs if proof is not None]):
            return None
        proof, one, shape = max(proven, key=lambda found: _gained(found[0]))
        rate, per_size = _fit(np.column_stack([self.drawn, self._fallen(one, shape, TINY) / TINY]), self.channel.target)
        size = self._size(one, shape, per_size / max(float(rate), 1e-9), self._residual_beside_capacity)
        lost_w = self._loss_w(one, shape, size)
        if not matters(lost_w, self.runs):
            return None
        step = SMALL_STEP * max(size, TINY) * (-1.0 if (1.0 + SMALL_STEP) * size > self._most(one) else 1.0)
        at = self._fallen(one, shape, size)
        design = np.column_stack([self.drawn + at, (self._fallen(one, shape, size + step) - at) / step])
        errors = standard_errors(design, self._residual_beside_capacity(at), self.channel.block)
        wide, more = thresholds.NORMAL_95 * float(errors[-1]), one.in_file(self.robot)[0] + size
        alike = (
            other.id for share, other, _ in proven if _gained(share) > thresholds.CONFUSABLE_SHARE * _gained(proof)
        )
        parameters = _values(one, more, (max(more - wide, 0.0), more + wide), shape)
        rivals = tuple(rival for rival in dict.fromkeys(alike) if rival != one.id)
        sentence = "The state of charge falls faster than the energy drawn implies where it is at work."
        return ChannelEffect(one, parameters, lost_w, proof, rivals, sentence)

    def instead(self, rate: float) -> tuple[str, ...]:
        """Losses that explain a charge which falls `rate` times as fast as the file's capacity implies, as well as a
        smaller capacity does; a voltage that was recorded would have shown a resistance."""
        residual = self.channel.target - rate * self.drawn[:, 0]
        most = thresholds.EQUAL * float(residual @ residual)
        voltage_v = self.runs.context.get("voltage_v", np.zeros(1))
        known = {battery.INTERNAL_RESISTANCE.id} if (voltage_v > 0.0).any() else ()
        found, missing = [], self.channel.target - self.drawn[:, 0]
        for one, shape, added in self.tried:
            (per_size,) = _fit(added, missing)
            if one.id in known or per_size <= 0.0:
                continue
            size = self._size(one, shape, float(per_size), lambda fallen: missing - fallen[:, 0])
            if float(np.sum((missing - self._fallen(one, shape, size)[:, 0]) ** 2)) <= most:
                found.append(one.id)
        return tuple(dict.fromkeys(found))

    def _size(self, one: Hypothesis, shape: Numbers, about: float, residual: Callable[[Array], Array]) -> float:
        """Size with the least squared residual: searched up to a multiple of the linear estimate, as sizes are
        often far below their bound."""
        most = float(np.clip(_SEARCHED * about, TINY * self._most(one), self._most(one)))

        def error(size: float) -> float:
            return float(np.sum(residual(self._fallen(one, shape, size)) ** 2))

        return float(minimize_scalar(error, bounds=(0.0, most), method="bounded").x)

    def _most(self, one: Hypothesis) -> float:
        """Largest size that an effect may have beyond the robot file's."""
        return one.entry.switch.high - one.in_file(self.robot)[0]

    def _residual_beside_capacity(self, fallen: Array) -> Array:
        """Residual of the charge with a loss, its capacity fitted: at most that of the file, as a larger one together
        with a larger loss fits a loss of any form."""
        design = self.drawn + fallen
        rate = np.maximum(_fit(design, self.channel.target), 1.0)
        return np.asarray(self.channel.target - design @ rate)

    def _fallen(self, one: Hypothesis, shape: Numbers, size: float) -> Array:
        """Fall of the charge by a loss, shape (known windows, 1)."""
        return self.channel.summed(self._loss_w(one, shape, size) / self.robot.usable_energy_j)[:, None]

    def _loss_w(self, one: Hypothesis, shape: Numbers, size: float) -> Array:
        """What an effect loses that is larger by this size than the robot file's, W, shape (windows,)."""
        numbers = {**shape, one.entry.switch.name: one.in_file(self.robot)[0] + size}
        with_it = dataclasses.replace(self.robot, effects={**self.robot.effects, one.id: numbers})
        return inside_w(with_it, self.runs) - self.in_file_w


def _fading(channel: Reading, runs: Runs, robot: Robot, drawn: Array, rng: Generator) -> ChannelEffect | None:
    """Ageing: a capacity that shrinks from run to run."""
    numbers = np.unique(channel.run)
    if len(numbers) < thresholds.FEWEST_RUNS:
        return None
    rate, errors = channel.fit(per_run := channel.per_run(drawn))
    shrinks = bool((np.diff(rate) >= -thresholds.CLEAR * (errors[1:] + errors[:-1])).all()) and rate[-1] > rate[0]
    if not shrinks or (proof := channel.proof(drawn, per_run[:, 1:], rng)) is None:
        return None
    lost = np.zeros(len(runs.signals))
    lost[numbers] = np.clip(1.0 - 1.0 / np.maximum(rate, 1e-9), 0.0, None)
    left, wide = 1.0 - battery.AGEING.in_file(robot)[0], thresholds.NORMAL_95 * float(errors[-1])
    ends, now = (1.0 - left / np.maximum(rate[-1] + np.array(off), 1e-9) for off in ((-wide, wide), 0.0))
    last = Value(float(now), (max(float(ends[0]), 0.0), float(ends[1])), "1")
    of_window = lost[runs.run]
    lost_w = np.maximum(runs.observed, 0.0) * of_window / (1.0 - of_window)
    # No battery that has lost more than the effect allows drives a robot: its reading is wrong.
    if not matters(lost_w, runs) or max(now, lost.max()) > battery.AGEING.entry.switch.high:
        return None
    return ChannelEffect(
        battery.AGEING, {battery.AGEING.entry.switch.name: last}, lost_w, proof, _confounders(rate, runs, numbers),
        "The battery fades from run to run, as the state of charge falls faster than the energy drawn implies: in "
        f"the last run {last.value:.0%} of the usable energy is lost, which explains {_gained(proof):.0%} of the "
        "held-out squared error of the state of charge.",
    )  # fmt: skip


def _confounders(rate: Array, runs: Runs, numbers: Index) -> tuple[str, ...]:
    """Confounders of ageing: cold or load, where they are rank-correlated with the faster fall of the charge."""
    air = runs.context.get("temperature_c")
    load, warmth = (
        None if of is None else pd.Series(of).groupby(runs.run).mean()[numbers] for of in (runs.observed, air)
    )
    found = [battery.CONFOUNDED_WITH_LOAD] if spearmanr(rate, load).statistic > thresholds.SAME else []
    if warmth is None or (np.ptp(warmth) > 0.0 and spearmanr(rate, warmth).statistic < -thresholds.SAME):
        found.append(battery.CONFOUNDED_WITH_COLD)
    return tuple(found)


def _odometer(fit: Refit, runs: Runs) -> ChannelEffect | None:
    """Speeds that a recorded distance contradicts; they were corrected when the runs were read."""
    scales = np.array([run.odometer_scale for run in runs.signals])
    if not scales.any():
        return None
    # Probability that as many runs disagree in all parts of their way, if the sign of each part is random.
    p_value = float(binom.sf(np.count_nonzero(scales) - 1, len(scales), 2.0 ** (1 - thresholds.ODOMETER_PARTS)))
    if p_value > thresholds.FALSE_ALARM_RATE:
        return None
    one = instruments.ODOMETRY_SCALE
    off = WithEffects(speed_factors=(1.0 + scales).tolist())
    added = fit.parameters.predict(runs, fit.theta, off) - fit.parameters.predict(runs, fit.theta)
    of = scales[scales != 0.0]
    value = Value(float(np.mean(of)), (float(of.min()), float(of.max())), one.entry.switch.unit)
    many = "all runs" if scales.all() else f"{len(of)} of {len(scales)} runs"
    return ChannelEffect(
        one, {one.entry.switch.name: value}, added, Proof(None, None, p_value), (),
        f"In {many} the speed adds up to {1.0 + value.value:.3g} times the recorded distance: it is set right by that.",
    )  # fmt: skip
