"""What other channels than power tell: the battery's voltage, its gauge, and a distance beside the odometer.

Power at the terminals cannot show what is lost inside the battery. But the voltage sags by the current times a
resistance, and a recorded state of charge falls by the energy drawn, and lost, over what a full battery holds. One
capacity for all runs is a parameter, to be refitted like the others; one that shrinks from run to run is ageing; and a
loss that grows with the load or in the cold is an effect of the battery. Each is held to the proof of any effect: it
must lower the held-out error of its channel, and more than random signs of blocks do (wild cluster bootstrap).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import norm, spearmanr

from homeward.diagnosis.explain.hypotheses import CATALOGUE, ageing, internal_resistance, odometry_scale
from homeward.diagnosis.explain.hypothesis import TINY, Hypothesis, Numbers, Setting
from homeward.diagnosis.explain.proof import FOLDS
from homeward.diagnosis.fit.folds import correlation_windows
from homeward.diagnosis.fit.held_out import gain, held_out
from homeward.diagnosis.fit.parameter_groups import WithEffects
from homeward.diagnosis.fit.refit import Refit, standard_errors
from homeward.diagnosis.fit.replay import Runs, lost_inside
from homeward.diagnosis.read.signals import Array
from homeward.diagnosis.result import Value
from homeward.diagnosis.rules import (
    ALIKE_BY_NATURE,
    ALIKE_IN_SIZE,
    CLEARLY_OFF,
    COLD_C,
    FALSE_ALARM_RATE,
    GAUGE_ERROR,
    IN_STEP,
    LEAST_FALL,
    MATTERS,
    MUST_PAY,
    SMALLEST_GAIN,
)
from homeward.physics import Robot

USABLE_ENERGY = "usable energy"
"""Name of the parameter that the state of charge determines."""

Index = NDArray[np.intp]

_DRAWS = 1999
_FEWEST_RUNS = 3
_GAP = 1.5  # windows
_SEARCHED = 3.0  # times the size that a linear response says


@dataclass(frozen=True)
class Proof:
    """What speaks for an effect, in the channel that shows it."""

    delta_bic: float  # against the same without it
    held_out_gain: float  # share of the squared held-out error of that channel
    p_value: float


@dataclass(frozen=True)
class Witnessed:
    """An effect that another channel than power shows."""

    hypothesis: Hypothesis
    parameters: Mapping[str, Value]
    contribution: Array  # (windows,), W
    proof: Proof
    rivals: tuple[str, ...]  # what that channel cannot tell from it
    told: str  # how it shows, in a sentence

    @property
    def in_file(self) -> Mapping[str, Numbers]:
        """What a robot file says of it."""
        numbers = {name: value.value for name, value in self.parameters.items()}
        return {self.hypothesis.id: numbers} if self.hypothesis.physical else {}


@dataclass(frozen=True)
class Capacity:
    """What a recorded state of charge says of the energy that a full battery holds, J."""

    assumed_j: float
    fitted_j: float  # one for all runs
    ci95: tuple[float, float]
    off: bool  # clearly another than assumed, and the same in all runs


def witnesses(fit: Refit, runs: Runs, block: Index, seed: int) -> tuple[Capacity | None, tuple[Witnessed, ...]]:
    """What voltage, gauge and distance tell.

    Args:
        fit: The refit.
        runs: The runs.
        block: Stretches that count as independent, shape (windows,).
        seed: Seed of intervals and random signs.
    """
    robot = fit.parameters.nominal
    sag = _sag(robot, runs, block, seed)
    inside_w = np.zeros(len(runs.observed)) if sag is None else sag.contribution
    capacity, shown = _gauge(fit, runs, inside_w, block, seed)
    found = (sag, shown, _odometer(fit, runs))
    return capacity, tuple(one for one in found if one is not None)


# --- the proof ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Channel:
    """A channel that is to be explained, less its mean over stretches without a gap; arrays of shape (windows,)."""

    target: Array
    base: Array  # (windows, columns): what explains it without any effect
    run: Index
    block: Index
    seed: int

    def proof(self, added: Array, tried: Sequence[Array] = ()) -> Proof | None:
        """Proof that columns explain the channel beside the base, if there is one.

        Args:
            added: The columns, shape (windows, columns).
            tried: All columns that these are the best of.
        """
        design = np.column_stack([self.base, added])
        before, after = (
            held_out(lambda chosen, of=of: of @ _fit(of[chosen], self.target[chosen]), self.block % FOLDS)  # type: ignore[misc]
            for of in (self.base, design)
        )
        gained = gain(self.target, before, after, self.block, self.seed)
        independent = max(len(after) / correlation_windows(self.target - after, self.run), 2.0)
        ratio = -np.log(max(1.0 - gained.share, 1e-300))
        delta_bic = float(independent * ratio - added.shape[1] * np.log(independent))
        if delta_bic < MUST_PAY or gained.share < SMALLEST_GAIN or gained.ci95[0] <= 0.0:
            return None
        p_value = self._p_value(added, np.column_stack([added, *tried]))
        return None if p_value > FALSE_ALARM_RATE else Proof(delta_bic, gained.share, p_value)

    def _p_value(self, added: Array, tried: Array) -> float:
        """How often random signs of blocks make some column tried explain as much as the best of those added."""
        left = self.target - self.base @ _fit(self.base, self.target)
        own = tried - self.base @ _fit(self.base, tried)
        sums = np.zeros((int(self.block.max()) + 1, own.shape[1]))
        np.add.at(sums, self.block, own * left[:, None])
        spread = np.sqrt((sums**2).sum(axis=0))
        sums = sums[:, spread > 0.0] / spread[spread > 0.0]
        signs = np.random.default_rng(self.seed).choice([-1.0, 1.0], (_DRAWS, len(sums)))
        reached = float(np.abs(sums.sum(axis=0))[: added.shape[1]].max(initial=0.0))
        chance = np.abs(signs @ sums).max(axis=1, initial=0.0)
        return float((1 + np.sum(chance >= reached)) / (_DRAWS + 1))


def _fit(design: Array, target: Array) -> Array:
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0])


def _stretches(runs: Runs) -> Index:
    """Number of the stretch that each window is in, shape (windows,): what was drawn in a gap is not known."""
    follows = (np.diff(runs.run) == 0) & (np.diff(runs.time_s) < _GAP * runs.duration_s[1:])
    return np.concatenate([[0], np.cumsum(~follows)])


def _within(values: Array, stretch: Index) -> Array:
    """The values less their mean over each stretch."""
    return np.asarray(values - (np.bincount(stretch, values) / np.maximum(np.bincount(stretch), 1))[stretch])


def _summed(rate: Array, runs: Runs) -> Array:
    """A rate summed over time, to the middle of each window."""
    amount = rate * runs.duration_s
    return np.asarray(np.cumsum(amount) - 0.5 * amount)


# --- the voltage --------------------------------------------------------------------------------------------------


def _sag(robot: Robot, runs: Runs, block: Index, seed: int) -> Witnessed | None:
    """A resistance that the voltage shows, beside that of the file, where it loses a good part of the energy."""
    voltage_v = runs.context.get("voltage_v")
    known = np.zeros(0, np.bool_) if voltage_v is None else np.isfinite(voltage_v) & (voltage_v > 0.0)
    if voltage_v is None or runs.unit != "W" or not known.any():
        return None
    entry = internal_resistance.HYPOTHESIS.entry
    in_file_ohm = robot.effects.get(entry.id, {}).get(entry.switch.name, 0.0)
    current_a = np.where(known, runs.observed / np.where(known, voltage_v, 1.0), 0.0)
    stretch = _stretches(runs)[known]
    sagged = _within((voltage_v + in_file_ohm * current_a)[known], stretch)
    channel = _Channel(sagged, _within(_summed(current_a, runs)[known], stretch)[:, None], runs.run[known],
                       _renumbered(block[known]), seed)  # fmt: skip
    drawn = -_within(current_a[known], stretch)
    design = np.column_stack([channel.base, drawn])
    ohm = float(_fit(design, sagged)[-1])
    wide = 1.96 * float(standard_errors(design, sagged - design @ _fit(design, sagged), channel.block)[-1])
    lost_w = max(ohm, 0.0) * current_a**2
    if float((lost_w * runs.duration_s).sum()) < MATTERS * float((runs.observed * runs.duration_s).sum()):
        return None
    proof = channel.proof(drawn[:, None])
    if proof is None:
        return None
    air = runs.context.get("temperature_c")
    cold = air is None or float(np.nanmean(air)) < COLD_C
    value = Value(in_file_ohm + ohm, (in_file_ohm + ohm - wide, in_file_ohm + ohm + wide), entry.switch.unit)
    return Witnessed(
        internal_resistance.HYPOTHESIS, {entry.switch.name: value}, lost_w, proof,
        (ageing.IN_STEP_WITH_COLD,) if cold else (),
        f"The voltage sags by {value.value:.3g} ohm times the current.",
    )  # fmt: skip


def _renumbered(block: Index) -> Index:
    return np.unique(block, return_inverse=True)[1]


# --- the gauge ----------------------------------------------------------------------------------------------------


def _gauge(
    fit: Refit, runs: Runs, inside_w: Array, block: Index, seed: int
) -> tuple[Capacity | None, Witnessed | None]:
    """Capacity by the state of charge, and what makes it fall otherwise; nothing where it hardly fell."""
    robot, soc = fit.parameters.nominal, runs.context.get("soc")
    if soc is None or runs.unit != "W":
        return None, None
    known = np.isfinite(soc)
    numbers = [one for one in np.unique(runs.run) if known[runs.run == one].any()]
    if not numbers or sum(float(np.ptp(soc[known & (runs.run == one)])) for one in numbers) < LEAST_FALL:
        return None, None
    stretch = _stretches(runs)[known]

    def fallen_by(power_w: Array) -> Array:
        return _within(_summed(power_w, runs)[known] / robot.usable_energy_j, stretch)

    drawn = fallen_by(runs.observed + inside_w)
    channel = _Channel(_within(-soc[known], stretch), drawn[:, None], runs.run[known], _renumbered(block[known]), seed)
    capacity = _capacity(channel, robot)
    if capacity is None:
        return None, None
    both = (_lost(fit, runs, channel, fallen_by), _fading(channel, runs, np.array(numbers)))
    found = sorted((one for one in both if one is not None), key=lambda one: -one.proof.held_out_gain)
    if not found:
        return capacity, None
    best = found[0]
    alike = [
        one.hypothesis.id for one in found[1:] if one.proof.held_out_gain > ALIKE_IN_SIZE * best.proof.held_out_gain
    ]
    best = dataclasses.replace(best, rivals=tuple(dict.fromkeys([*best.rivals, *alike])))
    return dataclasses.replace(capacity, off=False), best


def _capacity(channel: _Channel, robot: Robot) -> Capacity | None:
    drawn = channel.base[:, 0]
    rate = float(drawn @ channel.target / (drawn @ drawn))
    if rate <= 0.0:
        return None
    error = float(standard_errors(channel.base, channel.target - rate * drawn, channel.block)[0])
    off = abs(rate - 1.0) > max(GAUGE_ERROR, float(norm.ppf(1.0 - CLEARLY_OFF / 2.0)) * error)
    ends = (robot.usable_energy_j / max(rate + sign * 1.96 * error, 1e-9) for sign in (1.0, -1.0))
    return Capacity(robot.usable_energy_j, robot.usable_energy_j / rate, (next(ends), next(ends)), off)


def _lost(fit: Refit, runs: Runs, channel: _Channel, fallen_by: Callable[[Array], Array]) -> Witnessed | None:
    """An effect of the battery that makes the gauge fall faster at some loads or temperatures than at others."""
    setting = Setting(runs, fit.parameters, fit.theta, WithEffects(), fit.predicted, runs.observed - fit.predicted)
    robot = fit.parameters.nominal
    tried = [
        (one, shape, fallen_by(_loss_w(one, shape, TINY, runs, robot) / TINY)) for one, shape in _of_battery(setting)
    ]
    shares = [channel.proof(added[:, None], [other[:, None] for _, _, other in tried]) for _, _, added in tried]
    best = max(
        (index for index, one in enumerate(shares) if one is not None),
        key=lambda index: shares[index].held_out_gain,  # type: ignore[union-attr]
        default=None,
    )
    if best is None:
        return None
    one, shape, _ = tried[best]
    proof, switch = shares[best], one.entry.switch
    assert proof is not None

    def design(size: float) -> Array:
        return np.asarray(channel.base + fallen_by(_loss_w(one, shape, size, runs, robot))[:, None])

    def left(size: float) -> float:
        return float(np.sum((channel.target - design(size) @ _fit(design(size), channel.target)) ** 2))

    # Sizes are often a small share of the largest: look up to some times what the response to a small size says.
    rate, per_size = _fit(np.column_stack([channel.base, tried[best][2]]), channel.target)
    most = float(np.clip(_SEARCHED * per_size / max(float(rate), 1e-9), TINY * switch.high, switch.high))
    size = float(minimize_scalar(left, bounds=(0.0, most), method="bounded").x)
    lost_w = _loss_w(one, shape, size, runs, robot)
    if float((lost_w * runs.duration_s).sum()) < MATTERS * float((runs.observed * runs.duration_s).sum()):
        return None
    step = 1e-3 * max(size, TINY) * (-1.0 if 1.001 * size > switch.high else 1.0)
    columns = np.column_stack([design(size), (design(size + step) - design(size)) / step])
    residual = channel.target - design(size) @ _fit(design(size), channel.target)
    wide = 1.96 * float(standard_errors(columns, residual, channel.block)[-1])
    value = Value(size, (max(size - wide, 0.0), size + wide), switch.unit)
    rivals = tuple(
        dict.fromkeys(
            other.id
            for (other, _, _), share in zip(tried, shares, strict=True)
            if other.id != one.id and share is not None and share.held_out_gain > ALIKE_BY_NATURE * proof.held_out_gain
        )
    )
    others = {name: Value(number, (number, number), _unit(one, name)) for name, number in shape.items()}
    return Witnessed(one, {switch.name: value, **others}, lost_w, proof, rivals,
                     "The state of charge falls faster than the energy drawn says where it is at work.")  # fmt: skip


def _of_battery(setting: Setting) -> Iterator[tuple[Hypothesis, Numbers]]:
    for one in CATALOGUE.values():
        if lost_inside(one.entry) and one.steady is not None and not one.missing(setting.runs):
            for shape in one.shapes(setting):
                yield one, shape


def _loss_w(one: Hypothesis, shape: Numbers, size: float, runs: Runs, robot: Robot) -> Array:
    """What an effect of this size adds to the recorded power, W, shape (windows,)."""
    with_it = dataclasses.replace(robot, effects={one.id: {**shape, one.entry.switch.name: size}})
    conditions = SimpleNamespace(temperature_c=runs.context.get("temperature_c", np.full(len(runs.observed), 20.0)))
    function = getattr(one.entry, "function")  # noqa: B009  an instrument has none
    parameters = with_it.record().view(np.recarray)[0]
    added = function(parameters, None, conditions, np.maximum(runs.observed, 0.0))
    return np.nan_to_num(np.asarray(added, dtype=np.float64))


def _unit(one: Hypothesis, name: str) -> str:
    return next(parameter.unit for parameter in one.entry.parameters if parameter.name == name)


def _fading(channel: _Channel, runs: Runs, numbers: Index) -> Witnessed | None:
    """A capacity that shrinks from run to run."""
    if len(numbers) < _FEWEST_RUNS:
        return None
    per_run = channel.base * (channel.run[:, None] == numbers)
    rate = _fit(per_run, channel.target)
    errors = standard_errors(per_run, channel.target - per_run @ rate, channel.block)
    shrinks = bool((np.diff(rate) >= -2.0 * (errors[1:] + errors[:-1])).all()) and rate[-1] > rate[0]
    proof = channel.proof(per_run[:, 1:]) if shrinks else None
    if proof is None:
        return None
    ends = 1.0 - 1.0 / np.maximum(rate[-1] + 1.96 * errors[-1] * np.array([-1.0, 1.0]), 1e-9)
    lost = np.zeros(len(runs.signals))
    lost[numbers] = np.clip(1.0 - 1.0 / np.maximum(rate, 1e-9), 0.0, None)
    last = Value(float(lost[numbers[-1]]), (max(float(ends[0]), 0.0), float(ends[1])), "1")
    of_window = lost[runs.run]
    return Witnessed(
        ageing.HYPOTHESIS,
        {ageing.HYPOTHESIS.entry.switch.name: last},
        np.maximum(runs.observed, 0.0) * of_window / (1.0 - of_window),
        proof,
        _in_step(rate, runs, numbers),
        "The battery fades from run to run, as the state of charge falls faster than the energy drawn says: in the "
        f"last run {last.value:.0%} of the usable energy is gone, which explains {proof.held_out_gain:.0%} of the "
        "gauge's held-out squared error.",
    )


def _in_step(rate: Array, runs: Runs, numbers: Index) -> tuple[str, ...]:
    """What else may have made the gauge fall faster: the cold, or a higher load, where it came in step."""
    found = []
    load = [float(np.mean(runs.observed[runs.run == one])) for one in numbers]
    if float(spearmanr(rate, load).statistic) > IN_STEP:
        found.append(ageing.IN_STEP_WITH_LOAD)
    air = runs.context.get("temperature_c")
    means = None if air is None else [float(np.nanmean(air[runs.run == one])) for one in numbers]
    if means is None or (np.ptp(means) > 0.0 and float(spearmanr(rate, means).statistic) < -IN_STEP):
        found.append(ageing.IN_STEP_WITH_COLD)
    return tuple(found)


# --- the odometer -------------------------------------------------------------------------------------------------


def _odometer(fit: Refit, runs: Runs) -> Witnessed | None:
    """Speeds that a recorded distance contradicts; they were set right where the runs were read."""
    scales = np.array([run.odometer_scale for run in runs.signals])
    if not scales.any():
        return None
    one = odometry_scale.HYPOTHESIS
    off = WithEffects(speed_factors=(1.0 + scales).tolist())
    added = fit.parameters.predict(runs, fit.theta, off) - fit.parameters.predict(runs, fit.theta)
    of = scales[scales != 0.0]
    value = Value(float(np.mean(of)), (float(of.min()), float(of.max())), one.entry.switch.unit)
    many = "all runs" if scales.all() else f"{len(of)} of {len(scales)} runs"
    return Witnessed(
        one, {one.entry.switch.name: value}, added, Proof(0.0, 0.0, 0.0), (),
        f"In {many} the speed adds up to {1.0 + value.value:.3g} times the recorded distance: it is set right by that.",
    )  # fmt: skip
