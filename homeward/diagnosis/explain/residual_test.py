"""Is anything left after the refit? A test of whether residuals depend on a channel, and on which values of it.

Under the hypothesis that nothing is missing, residuals have mean zero whatever the channels say, while they may be
autocorrelated and uneven. Flipping the signs of whole blocks keeps both, and the refit is repeated on each draw (wild
cluster bootstrap: Cameron, Gelbach & Miller, 2008). The smallest p-value over all channels is compared with its own
bootstrap distribution (Westfall & Young, 1993), so looking at many channels does not raise the false alarm rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from homeward.diagnosis.fit.doubt import doubted
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array
from homeward.diagnosis.rules import (
    FALSE_ALARM_RATE,
    SMALLEST_GAIN,
    SMALLEST_GAIN_IN_TIME,
    SMALLEST_SHARE,
    TIME_MUST_BEAT,
)
from homeward.physics import ancillary_power

_DRAWS = 8000
_BINS = 10
_FEWEST_BLOCKS_A_BIN = 5
_FEWEST_A_BIN = 8  # windows
_CUT_AT = 4.0  # a run is cut where its CUSUM is two standard errors off


@dataclass(frozen=True)
class Channel:
    """A channel that residuals are tested against: `magnitude` where only its size matters."""

    name: str
    label: str
    unit: str
    above: str  # phrase for values above a limit
    below: str
    magnitude: bool = False
    scales: bool = False  # may also change what driving costs


CHANNELS = (
    Channel("yaw_rate_radps", "turning rate", "rad/s", "turning faster than", "turning slower than", True),
    Channel("wheel_difference_mps", "wheel speed difference", "m/s", "wheel speeds further apart than",
            "wheel speeds closer together than", True),
    Channel("speed_mps", "speed", "m/s", "driving faster than", "driving slower than"),
    Channel("accel_mps2", "acceleration", "m/s^2", "acceleration above", "acceleration below"),
    Channel("grade_rad", "grade", "rad", "grade above", "grade below"),
    Channel("heading_rad", "heading", "rad", "heading above", "heading below", scales=True),
    Channel("sensing_hz", "sensing rate", "Hz", "sensing faster than", "sensing slower than"),
    Channel("temperature_c", "ambient temperature", "degC", "ambient above", "ambient below", scales=True),
    Channel("payload_kg", "payload mass", "kg", "payload above", "payload below", scales=True),
    Channel("soc", "state of charge", "", "state of charge above", "state of charge below", scales=True),
    Channel("base_distance_m", "distance from base", "m", "further from base than", "closer to base than"),
)  # fmt: skip
"""What residuals are tested against, beside time; a channel that no run has is left out.

Battery voltage is not among them: it sags with the load, so every surge of power would seem to depend on it.
"""

_TIME = Channel("time_s", "time in the run", "s", "after", "before")


@dataclass(frozen=True)
class Dependence:
    """How residuals depend on a channel; arrays of shape (bins,)."""

    channel: Channel
    scaled: bool  # the excess is a share of the drive's load, not a load of its own
    p_value: float  # corrected for the number of looks
    held_out_gain: float  # share of the held-out squared error that the dependence explains
    bin: NDArray[np.intp]  # (windows,), -1 where the channel is missing
    edges: Array  # (bins + 1,), empty for time
    centre: Array
    effect: Array  # excess over the refit in each bin, W or A, times `weight`
    error: Array  # its standard error
    weight: Array  # (windows,), 1 or, if scaled, the drive's load over its mean

    @property
    def found(self) -> bool:
        """Whether the dependence is beyond chance and large enough to matter."""
        least = SMALLEST_GAIN_IN_TIME if self.channel is _TIME else SMALLEST_GAIN
        return self.p_value <= FALSE_ALARM_RATE and self.held_out_gain >= least


@dataclass(frozen=True)
class _Look:
    """One look at the residuals: sums of the weighted residual over sets of windows.

    `sums` has shape (blocks, sets), `columns` (sets, groups): the same sums over the Jacobian. `family` numbers the
    sets of which only the largest counts (the cuts of one run), all different where each counts.
    """

    sums: Array
    columns: Array
    family: NDArray[np.intp]


@dataclass(frozen=True)
class Blocks:
    """Block of each window, shape (windows,): stretches that count as independent."""

    channels: NDArray[np.intp]  # for dependence on channels: outlasts whatever no channel explains
    time: NDArray[np.intp]  # for changes in time: outlasts what neither a channel nor one change per run explains


def independent_blocks(fit: Fitted, runs: Runs) -> Blocks:
    """Cut blocks by the memory of what is left when every channel explains what it can.

    The memory of the plain residual would include that of the missing physics, which lasts as long as its cause. A
    level that changes from run to run is memory where channels are tested, and the thing in question where time is.
    """
    residual = runs.observed - fit.predicted
    design = np.column_stack([fit.jacobian, *(_indicators(number) for _, _, number, _ in _binned(runs))])
    unexplained = residual - design @ _least_squares(design, residual)
    pieces = cut_blocks(runs.run)
    changes = [
        _indicators(_stretches(_time_look(fit, unexplained, weight, runs.run, pieces), runs.run, pieces), weight)
        for weight in (np.ones(len(residual)), _drive_load(fit, runs))
        if weight is not None
    ]
    design = np.column_stack([design, *changes])
    steady = residual - design @ _least_squares(design, residual)
    return Blocks(cut_blocks(runs.run, unexplained), cut_blocks(runs.run, steady))


def dependences(fit: Fitted, runs: Runs, block: Blocks, fold: NDArray[np.intp], seed: int = 0) -> list[Dependence]:
    """Test the residuals of a refit against time and every channel: found ones first, the largest gain first."""
    candidates = [*_by_channel(fit, runs, block.channels), *_by_time(fit, runs, block.time)]
    found = []
    for of_time in (False, True):
        group = [one for one in candidates if (one.channel is _TIME) == of_time]
        blocks = block.time if of_time else block.channels
        p_values = _family_p_values(fit, runs, blocks, [one.looks for one in group], seed)
        # What happened in one run says nothing of another: for time hold out stretches.
        held_out = blocks % 5 if of_time else fold
        for one, p_value in zip(group, p_values, strict=True):
            # Two families of looks, each with half of the false alarm rate.
            found.append(_describe(one, min(1.0, 2.0 * p_value), fit, runs, blocks, held_out))
    total = max(float(np.sum((runs.observed - fit.predicted) ** 2)), 1e-300)
    least = SMALLEST_SHARE**2 * float(runs.observed @ runs.observed)
    doubt = {name: max(doubted(fit, runs, name), least) / total for name in {one.channel.name for one in found}}
    sure = [one if one.held_out_gain > doubt[one.channel.name] else replace(one, p_value=1.0) for one in found]
    return _ranked(sure)


@dataclass(frozen=True)
class _Candidate:
    channel: Channel
    scaled: bool
    values: Array  # (windows,)
    number: NDArray[np.intp]  # (windows,), bin
    edges: Array
    weight: Array  # (windows,)
    looks: tuple[_Look, ...]


def _by_channel(fit: Fitted, runs: Runs, block: NDArray[np.intp]) -> list[_Candidate]:
    residual = runs.observed - fit.predicted
    even, load = np.ones(len(residual)), _drive_load(fit, runs)
    result = []
    for channel, values, number, edges in _binned(runs):
        for scaled, weight in ((False, even), (True, load)):
            if weight is not None and (channel.scales or not scaled):
                looks = (
                    _bin_look(fit, residual, weight, number, block),
                    _trend_look(fit, residual, weight, values, block),
                )
                result.append(_Candidate(channel, scaled, values, number, edges, weight, looks))
    return result


def _by_time(fit: Fitted, runs: Runs, block: NDArray[np.intp]) -> list[_Candidate]:
    residual = runs.observed - fit.predicted
    result = []
    for scaled, weight in ((False, np.ones(len(residual))), (True, _drive_load(fit, runs))):
        if weight is not None:
            look = _time_look(fit, residual, weight, runs.run, block)
            number = _stretches(look, runs.run, block)
            result.append(_Candidate(_TIME, scaled, runs.time_s, number, np.zeros(0), weight, (look,)))
    return result


def _describe(
    one: _Candidate, p_value: float, fit: Fitted, runs: Runs, block: NDArray[np.intp], fold: NDArray[np.intp]
) -> Dependence:
    gain = _held_out_gain(fit, runs, one.number, one.weight, fold)
    effect, error = _effects(fit.jacobian, runs.observed - fit.predicted, one.number, one.weight, block)
    centre = np.array([np.mean(one.values[one.number == b]) for b in range(len(effect))])
    return Dependence(
        one.channel, one.scaled, float(p_value), gain, one.number, one.edges, centre, effect, error, one.weight
    )


def _ranked(found: list[Dependence]) -> list[Dependence]:
    """Found ones first, the largest gain first; time only where it explains far more than any other channel does.

    Every cause that comes and goes is also a matter of time, and a level per stretch is more flexible than a channel.
    """
    best = max((d.held_out_gain for d in found if d.found and d.channel is not _TIME), default=0.0)

    def rank(one: Dependence) -> tuple[bool, float]:
        behind = one.channel is _TIME and one.held_out_gain < TIME_MUST_BEAT * best
        return not one.found, -one.held_out_gain if not behind else 1.0 - one.held_out_gain

    return sorted(found, key=rank)


def _drive_load(fit: Fitted, runs: Runs) -> Array | None:
    """Load of the drive as the robot file has it, over its mean; None where it has none."""
    problem = fit.parameters
    standing = 0.0
    if runs.unit == "W":
        standing = ancillary_power(problem.nominal, runs.context.get("sensing_hz", np.zeros(1)))
    load = np.nan_to_num(np.maximum(problem.predict(runs, problem.start) - standing, 0.0))
    mean = float(load.mean())
    return load / mean if mean > 0.0 and float(load.std()) > 0.1 * mean else None


def _binned(runs: Runs) -> list[tuple[Channel, Array, NDArray[np.intp], Array]]:
    """Each channel with its values, the bin of each window and the edges of the bins."""
    result = []
    for channel in CHANNELS:
        values = runs.context.get(channel.name)
        if values is None or not np.isfinite(values).any():
            continue
        known = np.isfinite(values)
        grain = max(float(np.max(np.abs(values[known]))), 1e-300) * 1e-9  # means of equal values differ in the last bit
        values = np.round((np.abs(values) if channel.magnitude else values) / grain) * grain
        edges = _edges(values[known])
        if len(edges) < 3:
            continue
        number = np.full(len(values), -1, dtype=np.intp)
        number[known] = np.searchsorted(edges[1:-1], values[known], side="right")
        result.append((channel, values, number, edges))
    return result


def _edges(values: Array) -> Array:
    """Edges of bins with about equally many values; a value that is common gets a bin of its own."""
    distinct, counts = np.unique(values, return_counts=True)
    if len(distinct) <= _BINS:
        middle = (distinct[1:] + distinct[:-1]) / 2.0
        return np.concatenate(([distinct[0]], middle, [distinct[-1]]))
    common = distinct[counts > len(values) / _BINS]
    rest = values[~np.isin(values, common)]
    edges = np.quantile(rest, np.linspace(0.0, 1.0, _BINS + 1)) if len(rest) else values[[0, -1]]
    tight = [np.nextafter(common, np.inf), common] if len(common) else []
    edges = np.unique(np.concatenate([edges, *tight, [distinct[0], distinct[-1]]]))
    count = np.bincount(np.searchsorted(edges[1:-1], values, side="right"), minlength=len(edges) - 1)
    kept = [0]  # a bin with too few values joins the one before it, the first the one after it
    for k in range(1, len(count)):
        if count[k] >= _FEWEST_A_BIN and count[kept[-1] : k].sum() >= _FEWEST_A_BIN:
            kept.append(k)
    return np.concatenate((edges[kept], edges[-1:]))


def _indicators(number: NDArray[np.intp], weight: Array | float = 1.0) -> Array:
    design = np.zeros((len(number), int(number.max()) + 1))
    rows = np.flatnonzero(number >= 0)
    design[rows, number[rows]] = weight[rows] if isinstance(weight, np.ndarray) else weight
    return design


def _bin_look(fit: Fitted, residual: Array, weight: Array, number: NDArray[np.intp], block: NDArray[np.intp]) -> _Look:
    """Sums per bin, of the bins that enough blocks reach into."""
    bins, blocks = int(number.max()) + 1, int(block.max()) + 1
    inside = (number >= 0) & (weight != 0.0)
    pairs = np.unique(number[inside] * blocks + block[inside])
    covered = np.bincount(pairs // blocks, minlength=bins) >= _FEWEST_BLOCKS_A_BIN
    sums = np.zeros((blocks, bins))
    np.add.at(sums, (block[inside], number[inside]), (weight * residual)[inside])
    columns = np.zeros((bins, fit.jacobian.shape[1]))
    np.add.at(columns, number[inside], (weight[:, None] * fit.jacobian)[inside])
    return _Look(sums[:, covered], columns[covered], np.arange(int(covered.sum())))


def _trend_look(fit: Fitted, residual: Array, weight: Array, values: Array, block: NDArray[np.intp]) -> _Look:
    """Sum of the residual times the centred rank of the channel: few effects are not monotone."""
    known = np.isfinite(values)
    rank = np.zeros(len(values))
    rank[known] = rankdata(values[known]) / known.sum() - 0.5
    slope = weight * rank
    # Only what the refit cannot take up itself is left to say anything.
    slope = slope - fit.jacobian @ _least_squares(fit.jacobian, slope)
    sums = np.zeros((int(block.max()) + 1, 1))
    np.add.at(sums[:, 0], block, slope * residual)
    return _Look(sums, (slope @ fit.jacobian)[None], np.zeros(1, dtype=np.intp))


def _time_look(fit: Fitted, residual: Array, weight: Array, run: NDArray[np.intp], block: NDArray[np.intp]) -> _Look:
    """Sums from the start of a run to each of its blocks, and from there to its end: a CUSUM test for a change."""
    blocks = int(block.max()) + 1
    score = np.bincount(block, weight * residual)
    columns = np.zeros((blocks, fit.jacobian.shape[1]))
    np.add.at(columns, block, weight[:, None] * fit.jacobian)
    run_of_block = np.empty(blocks, dtype=np.intp)
    run_of_block[block] = run
    members, family = [], []
    for one in np.unique(run):
        own = np.flatnonzero(run_of_block == one)
        cuts = np.unique(np.linspace(0, len(own), min(len(own), _BINS) + 1).astype(int))
        for cut in cuts[1:]:
            for part in (own[:cut], own[cut:]):
                if len(part) >= 2:
                    members.append(np.isin(np.arange(blocks), part))
                    family.append(one)
    chosen = np.array(members, dtype=float).reshape(-1, blocks)
    return _Look(score[:, None] * chosen.T, chosen @ columns, np.array(family, dtype=np.intp))


def _stretches(look: _Look, run: NDArray[np.intp], block: NDArray[np.intp]) -> NDArray[np.intp]:
    """Stretch of each window: a run is cut in two where the CUSUM departs most, if it does at all."""
    number = np.empty(len(run), dtype=np.intp)
    following = 0
    departure = _studentised(look.sums.sum(axis=0)[None], look.sums)[0]
    for one in np.unique(run):
        inside = run == one
        number[inside] = following
        own = np.flatnonzero(look.family == one)
        if len(own):
            largest = own[np.argmax(departure[own])]
            part = inside & (look.sums[:, largest] != 0.0)[block]
            if departure[largest] >= _CUT_AT and part.sum() < inside.sum():
                number[part] = following + 1
                following += 1
        following += 1
    return number


def _studentised(draws: Array, sums: Array) -> Array:
    """Squared sums over their variance over blocks."""
    spread = np.sqrt((sums**2).sum(axis=0))
    squared: Array = (draws / np.where(spread > 0.0, spread, np.inf)) ** 2
    return squared


def _family_p_values(
    fit: Fitted, runs: Runs, block: NDArray[np.intp], candidates: Sequence[Sequence[_Look]], seed: int
) -> Array:
    """P-value of each candidate, corrected for all looks by the bootstrap distribution of the smallest."""
    residual = runs.observed - fit.predicted
    blocks = int(block.max()) + 1
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=(_DRAWS, blocks))
    signs[0] = 1.0  # what was recorded
    bread = np.linalg.pinv(fit.jacobian.T @ fit.jacobian, rcond=1e-12)
    scores = np.zeros((blocks, fit.jacobian.shape[1]))
    np.add.at(scores, block, fit.jacobian * residual[:, None])
    refitted = (signs @ scores) @ bread  # (draws, groups): what the refit would take up of each draw
    single = np.array([_smallest_p(signs, refitted, looks) for looks in candidates]).reshape(-1, _DRAWS)
    smallest = single.min(axis=0, initial=1.0)
    corrected: Array = np.array([(smallest <= p[0]).mean() for p in single])
    return corrected


def _smallest_p(signs: Array, refitted: Array, looks: Sequence[_Look]) -> Array:
    """Smallest p-value over looks for each draw, shape (draws,), each from the draws' own distribution."""
    best = np.ones(len(signs))
    for look in looks:
        squared = _studentised(signs @ look.sums - refitted @ look.columns.T, look.sums)
        statistic = np.zeros(len(signs))
        for one in np.unique(look.family):
            statistic += squared[:, look.family == one].max(axis=1)
        at_least = len(signs) - np.searchsorted(np.sort(statistic), statistic * (1.0 - 1e-9))
        best = np.minimum(best, at_least / len(signs))
    return best


def _held_out_gain(fit: Fitted, runs: Runs, number: NDArray[np.intp], weight: Array, fold: NDArray[np.intp]) -> float:
    """Share of the refit's held-out squared error that a step per bin explains."""
    residual = runs.observed - fit.predicted
    design = np.column_stack([fit.jacobian, _indicators(number, weight)])
    plain = joint = 0.0
    for one in np.unique(fold):
        test = fold == one
        if test.all():
            return 0.0
        before = runs.observed[test] - fit.on(~test, runs.observed)[test]
        after = residual[test] - design[test] @ _least_squares(design[~test], residual[~test])
        plain += float(before @ before)
        joint += float(after @ after)
    return 1.0 - joint / plain if plain > 0.0 else 0.0


def _least_squares(design: Array, target: Array) -> Array:
    norms = np.linalg.norm(design, axis=0)
    scaled = design / np.where(norms > 0.0, norms, 1.0)
    gram = scaled.T @ scaled
    weights = np.linalg.lstsq(gram + 1e-6 * np.eye(len(gram)), scaled.T @ target, rcond=None)[0]
    return weights / np.where(norms > 0.0, norms, 1.0)


def _effects(
    jacobian: Array, residual: Array, number: NDArray[np.intp], weight: Array, block: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Excess in each bin, refitted together with the known physics, and its standard error clustered by block."""
    bins = _indicators(number, weight)
    design = np.column_stack([jacobian, bins])
    weights = _least_squares(design, residual)
    left = residual - design @ weights
    sums = np.zeros((int(block.max()) + 1, bins.shape[1]))
    inside = number >= 0
    np.add.at(sums, (block[inside], number[inside]), (weight * left)[inside])
    size = np.maximum((bins**2).sum(axis=0), 1e-12)
    return weights[jacobian.shape[1] :], np.sqrt((sums**2).sum(axis=0)) / size
