"""Test of whether the residuals of a refit depend on a channel, and on which values of it.

Under the null hypothesis that nothing is missing, residuals have mean zero at all values of the
channels, while they may be autocorrelated and heteroscedastic. Flipping the signs of whole blocks
keeps both, and the refit is repeated on each draw (wild cluster bootstrap: Cameron, Gelbach &
Miller, 2008). The smallest p-value over all channels is compared with its own bootstrap
distribution (Westfall & Young, 1993), so that testing many channels does not raise the false alarm
rate.
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
from homeward.logs.channels import Array, Index, Mask
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
    ResidualChannel("yaw_rate_radps", "turning rate", "rad/s", "turning faster than", "turning slower than",
            magnitude=True),
    ResidualChannel("wheel_difference_mps", "wheel speed difference", "m/s", "wheel speeds further apart than",
            "wheel speeds closer together than", magnitude=True),
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

Battery voltage is not among them: it sags with the load, so that any peak of power would correlate
with it.
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
        smallest_gain = thresholds.SMALLEST_GAIN
        if self.channel is _TIME:
            smallest_gain = thresholds.SMALLEST_GAIN_OF_THE_FLEXIBLE
        return self.p_value <= thresholds.FALSE_ALARM_RATE and self.held_out_gain >= smallest_gain


class _TestStatistic(NamedTuple):
    """One test statistic: sums of the weighted residual over sets of windows."""

    sums: Array  # (blocks, sets)
    columns: Array  # (sets, groups): the same sums over the Jacobian
    # (sets,): of sets with one number, such as the cuts of one run, the largest counts
    family: Index


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
    """Cut blocks by the autocorrelation of the residual after every channel has explained what it
    can.

    The plain residual would include the autocorrelation of the missing physics, which lasts as long
    as its cause. A level that changes from run to run is autocorrelation in tests of channels, and
    the alternative in tests of time.
    """
    residual = runs.observed - fit.predicted
    by_channels = [_indicators(number) for _, _, number in _binned(runs)]
    design = np.column_stack([fit.jacobian, *by_channels])
    unexplained = residual - design @ _least_squares(design, residual)
    tests_of_time = _by_time(fit, runs, unexplained, cut_blocks(runs.run))
    by_changes = [_indicators(test.bin, test.weight) for test in tests_of_time]
    design = np.column_stack([design, *by_changes])
    steady = residual - design @ _least_squares(design, residual)
    return Blocks(channels=cut_blocks(runs.run, unexplained), time=cut_blocks(runs.run, steady))


def dependences(
    fit: Fitted, runs: Runs, block: Blocks, fold: Index, rng: Generator
) -> list[Dependence]:
    """Test the residuals of a refit against time and every channel: found ones first, the largest
    gain first."""
    residual = runs.observed - fit.predicted
    # Two families of tests, each with half of the false alarm rate. A change in one run does not
    # predict another: for time hold out stretches.
    tests_of_channels = list(_by_channel(fit, runs, residual, block.channels))
    tests_of_time = list(_by_time(fit, runs, residual, block.time))
    tested = [
        *_tested(fit, runs, tests_of_channels, block.channels, fold, rng),
        *_tested(fit, runs, tests_of_time, block.time, block.time % FOLDS, rng),
    ]
    gains_by_channel = [
        result.held_out_gain for result in tested if result.found and result.channel is not _TIME
    ]
    largest_by_channel = max(gains_by_channel, default=0.0)

    def rank(result: Dependence) -> tuple[bool, bool, float]:
        # Every intermittent cause also depends on time, and a level per stretch is more flexible.
        is_flexible = (
            result.channel is _TIME and result.held_out_gain < thresholds.TWICE * largest_by_channel
        )
        return not result.found, is_flexible, -result.held_out_gain

    return sorted(tested, key=rank)


def _tested(
    fit: Fitted, runs: Runs, tests: Sequence[_Test], block: Index, fold: Index, rng: Generator
) -> Iterator[Dependence]:
    """One family of tests, with the share of the held-out squared error that a step per bin
    explains."""
    residual = runs.observed - fit.predicted
    total = max(float(residual @ residual), 1e-300)
    error_of_meter = meter_error(runs)
    has_folds = bool(np.ptp(fold))
    refit_residual = residual  # held out
    if has_folds:
        refitted = held_out(lambda training: fit.fitted_to(training, runs.observed).predicted, fold)
        refit_residual = runs.observed - refitted
    p_values = _family_p_values(fit, residual, block, tests, rng)
    for test, p_value_in_family in zip(tests, p_values.tolist(), strict=True):
        design = np.column_stack([fit.jacobian, _indicators(test.bin, test.weight)])
        gain = 0.0
        if has_folds and refit_residual.any():
            steps_residual = residual - _held_out_steps(design, residual, fold)
            gain = 1.0 - float(steps_residual @ steps_residual) / float(
                refit_residual @ refit_residual
            )
        error_of_instruments = max(error_of_meter, channel_error(fit, runs, test.channel.name))
        p_value = 1.0
        if gain * total > error_of_instruments:
            p_value = min(1.0, 2.0 * p_value_in_family)  # of two families
        effect = _least_squares(design, residual)[fit.jacobian.shape[1] :]
        yield Dependence(
            channel=test.channel,
            scaled=test.scaled,
            p_value=p_value,
            held_out_gain=gain,
            bin=test.bin,
            centre=np.array(
                [np.mean(test.values[test.bin == number]) for number in range(len(effect))]
            ),
            effect=effect,
            weight=test.weight,
        )


def _held_out_steps(design: Array, residual: Array, fold: Index) -> Array:
    """Held-out prediction of the residual by the columns of a design, shape (windows,)."""
    return held_out(lambda rows: design @ _least_squares(design[rows], residual[rows]), fold)


def _weights(fit: Fitted, runs: Runs) -> list[tuple[bool, Array]]:
    """Weights of an additive excess and, where the robot file has a load of the drive, of one
    proportional to it."""
    problem = fit.parameters
    weights = [(False, np.ones(len(runs.observed)))]
    ancillary_w = 0.0
    if runs.unit == "W":
        ancillary_w = ancillary_power(problem.nominal, runs.sensing_hz)
    load = np.nan_to_num(np.maximum(problem.predict(runs, problem.start) - ancillary_w, 0.0))
    mean_load = float(load.mean())
    if float(load.std()) > thresholds.HARDLY_CHANGES * mean_load > 0.0:
        weights.append((True, load / mean_load))
    return weights


def _by_channel(fit: Fitted, runs: Runs, residual: Array, block: Index) -> Iterator[_Test]:
    """Bins that cover enough blocks, and a trend over the channel's centred rank: most effects are
    monotone."""
    weights = _weights(fit, runs)
    for channel, values, number in _binned(runs):
        is_known = np.isfinite(values)
        rank = np.zeros(len(values))
        rank[is_known] = rankdata(values[is_known]) / is_known.sum() - 0.5
        for scaled, weight in weights:
            if scaled and not channel.scales:
                continue
            bins = _indicators(number, weight)[
                :, _covered(number, block, is_known & (weight != 0.0))
            ]
            slope = (weight * rank)[:, None]
            # Only the part that the refit cannot absorb is tested.
            slope = slope - fit.jacobian @ _least_squares(fit.jacobian, slope)
            statistics = (
                _statistic(bins, fit, residual, block),
                _statistic(slope, fit, residual, block),
            )
            yield _Test(
                channel=channel,
                scaled=scaled,
                weight=weight,
                values=values,
                bin=number,
                statistics=statistics,
            )


def _covered(number: Index, block: Index, inside: Mask) -> Mask:
    """Whether each bin has windows inside of enough blocks, shape (bins,)."""
    bin_and_block = np.unique(np.column_stack([number, block])[inside], axis=0)
    blocks_of_bin = np.bincount(bin_and_block[:, 0], minlength=int(number.max()) + 1)
    return np.asarray(blocks_of_bin >= thresholds.FEWEST_BLOCKS_A_BIN)


def _statistic(columns: Array, fit: Fitted, residual: Array, block: Index) -> _TestStatistic:
    """The residual weighted by each of some columns, shape (windows, columns), each a family of its
    own."""
    return _TestStatistic(
        sums=per_block(columns * residual[:, None], block),
        columns=columns.T @ fit.jacobian,
        family=np.arange(columns.shape[1]),
    )


def _by_time(fit: Fitted, runs: Runs, residual: Array, block: Index) -> Iterator[_Test]:
    """Sums from the start of a run to each of its blocks, and from there to its end: a CUSUM test
    for a change."""
    run_of_block = runs.run[np.unique(block, return_index=True)[1]]
    sets: list[Index] = []  # of blocks
    run_of_set: list[int] = []
    for run in np.unique(runs.run).tolist():
        blocks = np.flatnonzero(run_of_block == run)
        cuts = np.unique(np.linspace(0, len(blocks), min(len(blocks), _BINS) + 1).astype(int))
        for cut in cuts[1:]:
            for part in (blocks[:cut], blocks[cut:]):
                if len(part) >= 2:
                    sets.append(part)
                    run_of_set.append(run)
    all_blocks = np.arange(len(run_of_block))
    in_set = np.array([np.isin(all_blocks, part) for part in sets], np.float64).reshape(
        -1, len(all_blocks)
    )
    for scaled, weight in _weights(fit, runs):
        statistic = _TestStatistic(
            sums=per_block((weight * residual)[:, None], block) * in_set.T,
            columns=in_set @ per_block(weight[:, None] * fit.jacobian, block),
            family=np.array(run_of_set, dtype=np.intp),
        )
        yield _Test(
            channel=_TIME,
            scaled=scaled,
            weight=weight,
            values=runs.time_s,
            bin=_stretches(statistic, in_set, runs.run, block),
            statistics=(statistic,),
        )


def _stretches(statistic: _TestStatistic, in_set: Array, run: Index, block: Index) -> Index:
    """Stretch of each window: a run is cut in two where the CUSUM departs most, if by enough.

    `in_set`, shape (sets, blocks), is 1 for the blocks of each set of the statistic and 0 for
    others.
    """
    departure = _studentised(statistic.sums.sum(axis=0)[None], statistic.sums)[0]
    cut = np.zeros(len(run), dtype=np.intp)
    for family in np.unique(statistic.family):
        largest = max(
            np.flatnonzero(statistic.family == family), key=lambda index: departure[index]
        )
        if departure[largest] >= thresholds.CLEAR**2:
            cut += (in_set[largest] > 0.0)[block]
    return np.asarray(np.unique(2 * run + cut, return_inverse=True)[1])


def _binned(runs: Runs) -> Iterator[tuple[ResidualChannel, Array, Index]]:
    """Each channel that has several values, with these and the bin of each window."""
    for channel in TESTED:
        values = runs.context.get(channel.name)
        if values is None or not np.isfinite(values).any():
            continue
        is_known = np.isfinite(values)
        if channel.magnitude:
            values = np.abs(values)
        largest = max(float(np.max(np.abs(values[is_known]))), 1e-300)
        grain = largest * 1e-9  # means of equal values differ in the last bit
        values = np.round(values / grain) * grain
        edges = _edges(values[is_known])
        if len(edges):
            number = np.full(len(values), -1, dtype=np.intp)
            number[is_known] = np.searchsorted(edges, values[is_known], side="right")
            yield channel, values, number


def _edges(values: Array) -> Array:
    """Edges between bins with about equally many values; a value that is common gets a bin of its
    own."""
    distinct, counts = np.unique(values, return_counts=True)
    if len(distinct) <= _BINS:
        return (distinct[1:] + distinct[:-1]) / 2.0
    common = distinct[counts > len(values) / _BINS]
    uncommon = values[~np.isin(values, common)]
    quantiles = values[:0]
    if len(uncommon):
        quantiles = np.quantile(uncommon, np.linspace(0.0, 1.0, _BINS + 1))
    edges = np.unique(np.concatenate([quantiles, common, np.nextafter(common, np.inf)]))
    above_lowest = edges > distinct[0]
    # At the highest value an edge is needed only where that is common.
    below_highest = (edges < distinct[-1]) | np.isin(edges, common)
    edges = edges[above_lowest & below_highest]
    count = np.bincount(np.searchsorted(edges, values, side="right"), minlength=len(edges) + 1)
    begins = [0]  # a bin with too few values joins the one before it, the first the one after it
    for number in range(1, len(count)):
        enough_before = count[begins[-1] : number].sum() >= thresholds.FEWEST_VALUES
        if count[number] >= thresholds.FEWEST_VALUES and enough_before:
            begins.append(number)
    return np.asarray(edges[np.array(begins[1:], np.intp) - 1])


def _indicators(number: Index, weight: Array | float = 1.0) -> Array:
    """A column for each number, the weight where it is met, shape (windows, numbers)."""
    is_met = number[:, None] == np.arange(number.max() + 1)
    return np.asarray(is_met * np.reshape(weight, (-1, 1)), np.float64)


def _studentised(draws: Array, sums: Array) -> Array:
    """Squared sums over their variance over blocks."""
    spread = np.sqrt((sums**2).sum(axis=0))
    return np.asarray((draws / np.where(spread > 0.0, spread, np.inf)) ** 2)


def _family_p_values(
    fit: Fitted, residual: Array, block: Index, tests: Sequence[_Test], rng: Generator
) -> Array:
    """P-value of each candidate, corrected for all tests by the bootstrap distribution of the
    smallest."""
    signs = rng.choice([-1.0, 1.0], size=(_DRAWS, int(block.max()) + 1))
    signs[0] = 1.0  # the recorded residual
    bread = np.linalg.pinv(fit.jacobian.T @ fit.jacobian, rcond=1e-12)
    scores = per_block(fit.jacobian * residual[:, None], block)
    refitted = (signs @ scores) @ bread  # (draws, groups): what the refit would absorb of each draw
    p_values_of_tests = []  # each of shape (draws,)
    for test in tests:
        of_statistics = [_p_values(signs, refitted, statistic) for statistic in test.statistics]
        p_values_of_tests.append(np.min(of_statistics, axis=0))
    p_values = np.array(p_values_of_tests).reshape(-1, _DRAWS)
    smallest = p_values.min(axis=0, initial=1.0)
    return np.array([(smallest <= recorded).mean() for recorded in p_values[:, 0]])


def _p_values(signs: Array, refitted: Array, statistic: _TestStatistic) -> Array:
    """P-value of each draw in one test, shape (draws,), from the draws' own distribution."""
    squared = _studentised(signs @ statistic.sums - refitted @ statistic.columns.T, statistic.sums)
    families = [
        squared[:, statistic.family == family].max(axis=1) for family in np.unique(statistic.family)
    ]
    total = np.sum([np.zeros(len(signs)), *families], axis=0)
    # Draws whose total is at least as large, itself included; the factor forgives rounding.
    as_large = len(signs) - np.searchsorted(np.sort(total), total * (1.0 - 1e-9))
    return np.asarray(as_large / len(signs))


def _least_squares(design: Array, target: Array) -> Array:
    norms = np.linalg.norm(design, axis=0)
    scale = np.where(norms > 0.0, norms, 1.0)
    scaled = design / scale
    gram = scaled.T @ scaled
    ridge = 1e-6 * np.eye(len(gram))  # of columns of norm 1: collinear ones share a weight
    weights = np.linalg.lstsq(gram + ridge, scaled.T @ target, rcond=None)[0]
    return np.asarray((weights.T / scale).T)
