"""Test of whether the residuals of a refit depend on a channel, and on which values of it.

Under the null hypothesis that nothing is missing, residuals have mean zero at all values of the channels, while they
may be autocorrelated and heteroscedastic. Flipping the signs of whole blocks keeps both, and the refit is repeated on
each draw (wild cluster bootstrap: Cameron, Gelbach & Miller, 2008). The smallest p-value over all channels is compared
with its own bootstrap distribution (Westfall & Young, 1993), so that testing many channels does not raise the false
alarm rate.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.stats import rankdata

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.channel_errors import channel_error, meter_error
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.folds import FOLDS, cut_blocks, per_block
from homeward.diagnosis.fit.held_out import held_out
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Index
from homeward.physics import ancillary_power

_DRAWS = 8000  # chosen: a p-value of 0.01 then has a standard error of 0.001
_BINS = 10  # of a channel's values, and cuts of a run in time; chosen


@dataclass(frozen=True)
class ResidualChannel:
    """A channel that residuals are tested against: `magnitude` where only its size matters."""

    name: str
    label: str
    unit: str
    above: str  # phrase for values above a limit
    below: str
    magnitude: bool = False
    scales: bool = False  # may also scale the power of the drive


TESTED = (
    ResidualChannel("yaw_rate_radps", "turning rate", "rad/s", "turning faster than", "turning slower than", True),
    ResidualChannel("wheel_difference_mps", "wheel speed difference", "m/s", "wheel speeds further apart than",
            "wheel speeds closer together than", True),
    ResidualChannel("speed_mps", "speed", "m/s", "driving faster than", "driving slower than"),
    ResidualChannel("accel_mps2", "acceleration", "m/s^2", "acceleration above", "acceleration below"),
    ResidualChannel("grade_rad", "grade", "rad", "grade above", "grade below"),
    ResidualChannel("heading_rad", "heading", "rad", "heading above", "heading below", scales=True),
    ResidualChannel("sensing_hz", "sensing rate", "Hz", "sensing faster than", "sensing slower than"),
    ResidualChannel("temperature_c", "ambient temperature", "degC", "ambient above", "ambient below", scales=True),
    ResidualChannel("payload_kg", "payload mass", "kg", "payload above", "payload below", scales=True),
    ResidualChannel("soc", "state of charge", "", "state of charge above", "state of charge below", scales=True),
    ResidualChannel("base_distance_m", "distance from base", "m", "further from base than", "closer to base than"),
)  # fmt: skip
"""What residuals are tested against, beside time; a channel that no run has is left out.

Battery voltage is not among them: it sags with the load, so that any peak of power would correlate with it.
"""

_TIME = ResidualChannel("time_s", "time in the run", "s", "after", "before")


@dataclass(frozen=True)
class Dependence:
    """How residuals depend on a channel; arrays of shape (bins,)."""

    channel: ResidualChannel
    scaled: bool  # the excess is a share of the drive's load, not an additive load
    p_value: float  # corrected for multiple testing; 1 where errors of the channels explain as much
    held_out_gain: float  # share of the held-out squared error that the dependence explains
    bin: Index  # (windows,), -1 where the channel is missing
    centre: Array
    effect: Array  # excess over the refit in each bin, W or A, times `weight`
    weight: Array  # (windows,), 1 or, if scaled, the drive's load over its mean

    @property
    def found(self) -> bool:
        """Whether the dependence is significant and its gain large enough."""
        least = thresholds.SMALLEST_GAIN_OF_THE_FLEXIBLE if self.channel is _TIME else thresholds.SMALLEST_GAIN
        return self.p_value <= thresholds.FALSE_ALARM_RATE and self.held_out_gain >= least


class _TestStatistic(NamedTuple):
    """One test statistic: sums of the weighted residual over sets of windows."""

    sums: Array  # (blocks, sets)
    columns: Array  # (sets, groups): the same sums over the Jacobian
    family: Index  # (sets,): of sets with one number, such as the cuts of one run, the largest counts


class _Test(NamedTuple):
    channel: ResidualChannel
    scaled: bool
    weight: Array  # (windows,)
    values: Array  # (windows,)
    bin: Index  # (windows,)
    statistics: tuple[_TestStatistic, ...]


@dataclass(frozen=True)
class Blocks:
    """Block of each window, shape (windows,): stretches that count as independent."""

    channels: Index  # for channels: longer than the autocorrelation of what no channel explains
    time: Index  # for time: the same for what neither a channel nor one change per run explains


def independent_blocks(fit: Fitted, runs: Runs) -> Blocks:
    """Cut blocks by the autocorrelation of the residual after every channel has explained what it can.

    The plain residual would include the autocorrelation of the missing physics, which lasts as long as its cause. A
    level that changes from run to run is autocorrelation in tests of channels, and the alternative in tests of time.
    """
    residual = runs.observed - fit.predicted
    design = np.column_stack([fit.jacobian, *(_indicators(number) for _, _, number in _binned(runs))])
    unexplained = residual - design @ _least_squares(design, residual)
    of_time = _by_time(fit, runs, unexplained, cut_blocks(runs.run))
    changes = (_indicators(test.bin, test.weight) for test in of_time)
    design = np.column_stack([design, *changes])
    steady = residual - design @ _least_squares(design, residual)
    return Blocks(cut_blocks(runs.run, unexplained), cut_blocks(runs.run, steady))


def dependences(fit: Fitted, runs: Runs, block: Blocks, fold: Index, rng: Generator) -> list[Dependence]:
    """Test the residuals of a refit against time and every channel: found ones first, the largest gain first."""
    residual = runs.observed - fit.predicted
    # Two families of tests, each with half of the false alarm rate. A change in one run does not predict another:
    # for time hold out stretches.
    of_channels = list(_by_channel(fit, runs, residual, block.channels))
    of_time = list(_by_time(fit, runs, residual, block.time))
    tested = [
        *_tested(fit, runs, of_channels, block.channels, fold, rng),
        *_tested(fit, runs, of_time, block.time, block.time % FOLDS, rng),
    ]
    gains_by_channel = [result.held_out_gain for result in tested if result.found and result.channel is not _TIME]
    best_by_channel = max(gains_by_channel, default=0.0)

    def rank(result: Dependence) -> tuple[bool, bool, float]:
        # Every intermittent cause also depends on time, and a level per stretch is more flexible.
        behind = result.channel is _TIME and result.held_out_gain < thresholds.TWICE * best_by_channel
        return not result.found, behind, -result.held_out_gain

    return sorted(tested, key=rank)


def _tested(
    fit: Fitted, runs: Runs, tests: Sequence[_Test], block: Index, fold: Index, rng: Generator
) -> Iterator[Dependence]:
    """One family of tests, with the share of the held-out squared error that a step per bin explains."""
    residual = runs.observed - fit.predicted
    total = max(float(residual @ residual), 1e-300)
    least = meter_error(runs)
    folds = bool(np.ptp(fold))
    before = residual
    if folds:
        before = runs.observed - held_out(lambda chosen: fit.fitted_to(chosen, runs.observed).predicted, fold)
    p_values = _family_p_values(fit, residual, block, tests, rng)
    for test, p_value in zip(tests, p_values.tolist(), strict=True):
        design = np.column_stack([fit.jacobian, _indicators(test.bin, test.weight)])
        gain = 0.0
        if folds and before.any():
            after = residual - _held_out_steps(design, residual, fold)
            gain = 1.0 - float(after @ after) / float(before @ before)
        beyond_instruments = gain * total > max(least, channel_error(fit, runs, test.channel.name))
        effect = _least_squares(design, residual)[fit.jacobian.shape[1] :]
        yield Dependence(
            channel=test.channel,
            scaled=test.scaled,
            p_value=min(1.0, 2.0 * p_value) if beyond_instruments else 1.0,
            held_out_gain=gain,
            bin=test.bin,
            centre=np.array([np.mean(test.values[test.bin == number]) for number in range(len(effect))]),
            effect=effect,
            weight=test.weight,
        )


def _held_out_steps(design: Array, residual: Array, fold: Index) -> Array:
    """Held-out prediction of the residual by the columns of a design, shape (windows,)."""
    return held_out(lambda rows: design @ _least_squares(design[rows], residual[rows]), fold)


def _weights(fit: Fitted, runs: Runs) -> list[tuple[bool, Array]]:
    """Weights of an additive excess and, where the robot file has a load of the drive, of one proportional to it."""
    problem, even = fit.parameters, np.ones(len(runs.observed))
    standing = ancillary_power(problem.nominal, runs.sensing_hz) if runs.unit == "W" else 0.0
    load = np.nan_to_num(np.maximum(problem.predict(runs, problem.start) - standing, 0.0))
    mean = float(load.mean())
    weights = [(False, even)]
    if float(load.std()) > thresholds.HARDLY_CHANGES * mean > 0.0:
        weights.append((True, load / mean))
    return weights


def _by_channel(fit: Fitted, runs: Runs, residual: Array, block: Index) -> Iterator[_Test]:
    """Bins that cover enough blocks, and a trend over the channel's centred rank: most effects are monotone."""
    weights = _weights(fit, runs)
    for channel, values, number in _binned(runs):
        known = np.isfinite(values)
        rank = np.zeros(len(values))
        rank[known] = rankdata(values[known]) / known.sum() - 0.5
        for scaled, weight in weights if channel.scales else weights[:1]:
            inside = known & (weight != 0.0)
            reached = np.unique(np.column_stack([number, block])[inside], axis=0)[:, 0]
            covered = np.bincount(reached, minlength=int(number.max()) + 1) >= thresholds.FEWEST_BLOCKS_A_BIN
            bins = _indicators(number, weight)[:, covered]
            slope = (weight * rank)[:, None]
            # Only the part that the refit cannot absorb is tested.
            slope = slope - fit.jacobian @ _least_squares(fit.jacobian, slope)
            statistics = (
                _TestStatistic(
                    sums=per_block(columns * residual[:, None], block),
                    columns=columns.T @ fit.jacobian,
                    family=np.arange(columns.shape[1]),
                )
                for columns in (bins, slope)
            )
            yield _Test(channel, scaled, weight, values, number, tuple(statistics))


def _by_time(fit: Fitted, runs: Runs, residual: Array, block: Index) -> Iterator[_Test]:
    """Sums from the start of a run to each of its blocks, and from there to its end: a CUSUM test for a change."""
    run_of_block = runs.run[np.unique(block, return_index=True)[1]]
    sets: list[tuple[int, Index]] = []
    for run in np.unique(runs.run).tolist():
        own = np.flatnonzero(run_of_block == run)
        for cut in np.unique(np.linspace(0, len(own), min(len(own), _BINS) + 1).astype(int))[1:]:
            sets += [(run, part) for part in (own[:cut], own[cut:]) if len(part) >= 2]
    every = np.arange(len(run_of_block))
    chosen = np.array([np.isin(every, part) for _, part in sets], np.float64).reshape(-1, len(every))
    for scaled, weight in _weights(fit, runs):
        sums = per_block((weight * residual)[:, None], block) * chosen.T
        columns = chosen @ per_block(weight[:, None] * fit.jacobian, block)
        statistic = _TestStatistic(sums, columns, np.array([run for run, _ in sets], dtype=np.intp))
        yield _Test(_TIME, scaled, weight, runs.time_s, _stretches(statistic, chosen, runs.run, block), (statistic,))


def _stretches(statistic: _TestStatistic, chosen: Array, run: Index, block: Index) -> Index:
    """Stretch of each window: a run is cut in two where the CUSUM departs most, if by enough."""
    departure = _studentised(statistic.sums.sum(axis=0)[None], statistic.sums)[0]
    cut = np.zeros(len(run), dtype=np.intp)
    for family in np.unique(statistic.family):
        largest = max(np.flatnonzero(statistic.family == family), key=lambda index: departure[index])
        if departure[largest] >= thresholds.CLEAR**2:
            cut += (chosen[largest] > 0.0)[block]
    return np.asarray(np.unique(2 * run + cut, return_inverse=True)[1])


def _binned(runs: Runs) -> Iterator[tuple[ResidualChannel, Array, Index]]:
    """Each channel that has several values, with these and the bin of each window."""
    for channel in TESTED:
        values = runs.context.get(channel.name)
        if values is None or not np.isfinite(values).any():
            continue
        known = np.isfinite(values)
        grain = max(float(np.max(np.abs(values[known]))), 1e-300) * 1e-9  # means of equal values differ in the last bit
        values = np.round((np.abs(values) if channel.magnitude else values) / grain) * grain
        edges = _edges(values[known])
        if len(edges):
            number = np.full(len(values), -1, dtype=np.intp)
            number[known] = np.searchsorted(edges, values[known], side="right")
            yield channel, values, number


def _edges(values: Array) -> Array:
    """Edges between bins with about equally many values; a value that is common gets a bin of its own."""
    distinct, counts = np.unique(values, return_counts=True)
    if len(distinct) <= _BINS:
        return (distinct[1:] + distinct[:-1]) / 2.0
    common = distinct[counts > len(values) / _BINS]
    rest = values[~np.isin(values, common)]
    edges = np.quantile(rest, np.linspace(0.0, 1.0, _BINS + 1)) if len(rest) else values[:0]
    edges = np.unique(np.concatenate([edges, common, np.nextafter(common, np.inf)]))
    edges = edges[(edges > distinct[0]) & ((edges < distinct[-1]) | np.isin(edges, common))]
    count = np.bincount(np.searchsorted(edges, values, side="right"), minlength=len(edges) + 1)
    kept = [0]  # a bin with too few values joins the one before it, the first the one after it
    for k in range(1, len(count)):
        if count[k] >= thresholds.FEWEST_VALUES and count[kept[-1] : k].sum() >= thresholds.FEWEST_VALUES:
            kept.append(k)
    return np.asarray(edges[np.array(kept[1:], np.intp) - 1])


def _indicators(number: Index, weight: Array | float = 1.0) -> Array:
    """A column for each number, the weight where it is met, shape (windows, numbers)."""
    return np.asarray((number[:, None] == np.arange(number.max() + 1)) * np.reshape(weight, (-1, 1)), np.float64)


def _studentised(draws: Array, sums: Array) -> Array:
    """Squared sums over their variance over blocks."""
    spread = np.sqrt((sums**2).sum(axis=0))
    return np.asarray((draws / np.where(spread > 0.0, spread, np.inf)) ** 2)


def _family_p_values(fit: Fitted, residual: Array, block: Index, tests: Sequence[_Test], rng: Generator) -> Array:
    """P-value of each candidate, corrected for all tests by the bootstrap distribution of the smallest."""
    signs = rng.choice([-1.0, 1.0], size=(_DRAWS, int(block.max()) + 1))
    signs[0] = 1.0  # the recorded residual
    bread = np.linalg.pinv(fit.jacobian.T @ fit.jacobian, rcond=1e-12)
    scores = per_block(fit.jacobian * residual[:, None], block)
    refitted = (signs @ scores) @ bread  # (draws, groups): what the refit would absorb of each draw
    single = np.array([
        np.min([_p_values(signs, refitted, statistic) for statistic in test.statistics], axis=0) for test in tests
    ]).reshape(-1, _DRAWS)  # fmt: skip
    smallest = single.min(axis=0, initial=1.0)
    return np.array([(smallest <= p[0]).mean() for p in single])


def _p_values(signs: Array, refitted: Array, statistic: _TestStatistic) -> Array:
    """P-value of each draw in one test, shape (draws,), from the draws' own distribution."""
    squared = _studentised(signs @ statistic.sums - refitted @ statistic.columns.T, statistic.sums)
    families = [squared[:, statistic.family == family].max(axis=1) for family in np.unique(statistic.family)]
    total = np.sum([np.zeros(len(signs)), *families], axis=0)
    at_least = len(signs) - np.searchsorted(np.sort(total), total * (1.0 - 1e-9))
    return np.asarray(at_least / len(signs))


def _least_squares(design: Array, target: Array) -> Array:
    norms = np.linalg.norm(design, axis=0)
    scaled = design / np.where(norms > 0.0, norms, 1.0)
    gram = scaled.T @ scaled
    weights = np.linalg.lstsq(gram + 1e-6 * np.eye(len(gram)), scaled.T @ target, rcond=None)[0]
    return np.asarray((weights.T / np.where(norms > 0.0, norms, 1.0)).T)
