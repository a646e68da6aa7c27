"""The battery beside the drive: whether its gauge falls as the energy drawn says, and faster from run to run.

Power at the terminals cannot show that a battery holds less than its file says, but a recorded state of charge can: it
falls by the energy drawn over what a full battery holds. One capacity for all runs is a parameter, to be refitted like
the others. A capacity that shrinks from run to run is ageing, held to the same proof as any effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, spearmanr

from homeward.diagnosis.explain.hypotheses import ageing
from homeward.diagnosis.explain.proof import FOLDS
from homeward.diagnosis.fit.folds import correlation_windows
from homeward.diagnosis.fit.held_out import gain, held_out
from homeward.diagnosis.fit.refit import standard_errors
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array
from homeward.diagnosis.result import Value
from homeward.diagnosis.rules import CLEARLY_OFF, GAUGE_ERROR, IN_STEP, LEAST_FALL, MUST_PAY, PLACEBOS, SMALLEST_GAIN
from homeward.physics import Robot

USABLE_ENERGY = "usable energy"
"""Name of the parameter that the state of charge determines."""

_FEWEST_RUNS = 3
_GAP = 1.5  # windows


@dataclass(frozen=True)
class Fading:
    """A capacity that shrinks from run to run, and what speaks for it."""

    lost_share: Value  # in the last run, of what the robot file says
    lost_of_run: Array  # (runs,), 0 where no charge was recorded
    delta_bic: float  # against one capacity for all runs
    held_out_gain: float  # share of the squared held-out error of the charge
    p_value: float  # share of placebos that do as well
    rivals: tuple[str, ...]  # effects whose cause changed in step with the capacity, or may have


@dataclass(frozen=True)
class Charge:
    """What a recorded state of charge says of the battery's capacity."""

    assumed_j: float  # of a full battery, by the robot file
    fitted_j: float  # one for all runs
    ci95: tuple[float, float]
    off: bool  # clearly another than assumed, and the same in all runs
    fading: Fading | None

    def wasted(self, runs: Runs) -> Array:
        """Power, W, by which the gauge of a fading battery falls faster than the file says, shape (windows,)."""
        if self.fading is None:
            return np.zeros(len(runs.observed))
        lost = self.fading.lost_of_run[runs.run]
        return np.asarray(np.maximum(runs.observed, 0.0) * lost / (1.0 - lost))


def weigh_charge(runs: Runs, robot: Robot, block: NDArray[np.intp], seed: int) -> Charge | None:
    """Compare the gauge with the energy drawn; None where no charge was recorded or it hardly fell.

    Args:
        runs: The runs.
        robot: The robot file.
        block: Stretches that count as independent, shape (windows,).
        seed: Seed of intervals and placebos.
    """
    soc = runs.context.get("soc")
    if soc is None or runs.unit != "W":
        return None
    known = np.isfinite(soc)
    drawn = _drawn(runs) / robot.usable_energy_j
    numbers = [one for one in np.unique(runs.run) if known[runs.run == one].any()]
    if not numbers or sum(float(np.ptp(soc[known & (runs.run == one)])) for one in numbers) < LEAST_FALL:
        return None
    stretch = _stretches(runs)[known]
    fallen, drawn = _within(-soc[known], stretch), _within(drawn[known], stretch)
    run, block = runs.run[known], block[known]
    rate = float(drawn @ fallen / (drawn @ drawn))
    error = float(standard_errors(drawn[:, None], fallen - rate * drawn, block)[0])
    if rate <= 0.0:
        return None
    wide = float(norm.ppf(1.0 - CLEARLY_OFF / 2.0)) * error
    off = abs(rate - 1.0) > max(GAUGE_ERROR, wide)
    usual = 1.96 * error
    ends = robot.usable_energy_j / (rate + usual), robot.usable_energy_j / max(rate - usual, 1e-9)
    fading = _fading(_Gauge(drawn, fallen, run, block), runs, np.array(numbers), seed)
    return Charge(robot.usable_energy_j, robot.usable_energy_j / rate, ends, off and fading is None, fading)


def _stretches(runs: Runs) -> NDArray[np.intp]:
    """Number of the stretch that each window is in, shape (windows,): what was drawn in a gap is not known."""
    follows = (np.diff(runs.run) == 0) & (np.diff(runs.time_s) < _GAP * runs.duration_s[1:])
    return np.concatenate([[0], np.cumsum(~follows)])


def _within(values: Array, stretch: NDArray[np.intp]) -> Array:
    """The values less their mean over each stretch."""
    return np.asarray(values - (np.bincount(stretch, values) / np.maximum(np.bincount(stretch), 1))[stretch])


def _drawn(runs: Runs) -> Array:
    """Energy drawn since the start of each run, at the middle of each window, J."""
    energy_j = runs.observed * runs.duration_s
    passed = np.cumsum(energy_j) - 0.5 * energy_j
    first = np.searchsorted(runs.run, runs.run)
    return np.asarray(passed - (np.cumsum(energy_j) - energy_j)[first])


@dataclass(frozen=True)
class _Gauge:
    """The charge that is gone against the energy drawn over the file's capacity; arrays of shape (windows,)."""

    drawn: Array  # these two less their means over stretches without a gap
    fallen: Array
    run: NDArray[np.intp]
    block: NDArray[np.intp]

    def per_run(self, group: NDArray[np.intp]) -> Array:
        """A rate for each group of windows, or run."""
        return np.asarray(self.drawn[:, None] * (group[:, None] == np.unique(self.run)))

    def predicted(self, design: Array) -> Array:
        """What a design predicts of stretches held out."""
        predict: Callable[[NDArray[np.bool_]], Array]
        predict = lambda chosen: design @ _fit(design[chosen], self.fallen[chosen])  # noqa: E731
        return held_out(predict, self.block % FOLDS)

    def squared_error(self, predicted: Array) -> float:
        """Sum of squared errors."""
        return float(((self.fallen - predicted) ** 2).sum())


def _fading(gauge: _Gauge, runs: Runs, numbers: NDArray[np.intp], seed: int) -> Fading | None:
    """Whether the capacity shrinks from run to run, by the proof that every effect is held to."""
    if len(numbers) < _FEWEST_RUNS:
        return None
    design = gauge.per_run(gauge.run)
    before, after = gauge.predicted(gauge.drawn[:, None]), gauge.predicted(design)
    gained = gain(gauge.fallen, before, after, gauge.block, seed)
    independent = max(len(after) / correlation_windows(gauge.fallen - after, gauge.run), 2.0)
    ratio = -np.log(max(1.0 - gained.share, 1e-300))
    delta_bic = float(independent * ratio - (len(numbers) - 1) * np.log(independent))
    rate = _fit(design, gauge.fallen)
    errors = standard_errors(design, gauge.fallen - design @ rate, gauge.block)
    shrinks = bool((np.diff(rate) >= -2.0 * (errors[1:] + errors[:-1])).all()) and rate[-1] > rate[0]
    if not shrinks or delta_bic < MUST_PAY or gained.share < SMALLEST_GAIN or gained.ci95[0] <= 0.0:
        return None
    p_value = _placebo_p_value(gauge, gauge.squared_error(after), seed)
    if p_value > 1.0 / (PLACEBOS + 1):
        return None
    ends = 1.0 - 1.0 / np.maximum(rate[-1] + 1.96 * errors[-1] * np.array([-1.0, 1.0]), 1e-9)
    lost = np.zeros(len(runs.signals))
    lost[numbers] = np.clip(1.0 - 1.0 / np.maximum(rate, 1e-9), 0.0, None)
    last = Value(float(lost[numbers[-1]]), (max(float(ends[0]), 0.0), float(ends[1])), "1")
    return Fading(last, lost, delta_bic, gained.share, p_value, _rivals(rate, runs, numbers))


def _placebo_p_value(gauge: _Gauge, error: float, seed: int) -> float:
    """Share of placebos that do as well: rates that differ between groups of stretches, but not by run."""
    rng = np.random.default_rng(seed)
    blocks = int(gauge.block.max()) + 1
    own = np.empty(blocks, dtype=np.intp)
    own[gauge.block] = gauge.run
    as_good = 1
    for _ in range(PLACEBOS):
        design = gauge.per_run(rng.permutation(own)[gauge.block])
        as_good += gauge.squared_error(gauge.predicted(design)) <= error
    return as_good / (PLACEBOS + 1)


def _rivals(rate: Array, runs: Runs, numbers: NDArray[np.intp]) -> tuple[str, ...]:
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


def _fit(design: Array, target: Array) -> Array:
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0])
