"""What a recorded state of charge is worth: whether it follows the charge drawn, or the voltage under load.

A gauge that counts falls with the charge drawn, whatever the load, and never rises at rest. A map of the voltage falls
with the load and recovers at rest. The two are weighed by how well they predict the readings (BIC):

* a counter: a line over the charge drawn, one for each run, that may be set anew a few times, such as by a reset;
* a map of a recorded voltage: a curve of straight pieces that rises with the voltage, one for all runs;
* a map of a voltage that was not recorded: a line that also falls with the power drawn at the moment.

A reading is known to within a step, one at full or empty only from one side, and one that is held lies between itself
and the next: a coarse, late or stuck gauge is still a counter.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d
from scipy.optimize import Bounds, minimize, minimize_scalar

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import battery
from homeward.diagnosis.explain.channel_effects.charge import covered
from homeward.diagnosis.explain.channel_effects.inside import inside_w, matters
from homeward.diagnosis.explain.channel_effects.reading import Reading
from homeward.diagnosis.explain.channel_effects.shown import Capacity
from homeward.diagnosis.explain.hypothesis import TINY
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Followed, Gauge
from homeward.logs.autocorrelation import independent_windows
from homeward.logs.channels import Array, Index, Mask
from homeward.physics import Robot
from homeward.physics.battery import energy_share, open_circuit_v

_BIN_S = 10.0  # chosen: drivers average a voltage over as many readings, and loads change in it
_AVERAGED_BINS = (1, 3, 6)  # over which a map may average the voltage: 10, 30 and 60 s
_PIECE_BINS = 60  # of the counter's line where no voltage was recorded: in ten minutes its curve is straight
_RARE_BIC = 4.4  # 2 log 9: one gauge in ten is a map of the voltage (`OWN_COURSE` of `homeward.companion.thresholds`)
_CORNERS = 8  # of a map of the voltage; published ones have 4 to 11
_MOST_JUMPS = 12  # chosen: bounds time; a gauge is reset once a charge or less often


@dataclass(frozen=True)
class Readings:
    """The state of charge in bins of `_BIN_S`, which cross no gap and no end of a run; arrays of shape (bins,)."""

    shown: Array
    low: Array  # bounds of the state of charge by what was shown
    high: Array
    drawn: Array  # charge drawn so far, over that of a full battery by the robot's file
    power_w: Array
    voltage_v: Array  # NaN where it was not recorded
    run: Index
    stretch: Index
    last: Index  # window that is read, the last of a bin
    step: float  # of what the gauge shows

    @property
    def error(self) -> float:
        """Standard deviation of rounding."""
        return float(self.step / np.sqrt(12.0))

    def only(self, chosen: Mask) -> Readings:
        """These bins only."""
        kept: dict[str, Any] = {
            name: values[chosen] for name, values in vars(self).items() if isinstance(values, np.ndarray)
        }
        return dataclasses.replace(self, **kept)


@dataclass(frozen=True)
class Jump:
    """A reading that was set anew, between a bin and the one before."""

    bin: int
    size: float


@dataclass(frozen=True)
class Counter:
    """A counter's states of charge and how far they are out of the bounds of the readings, (bins,) each; its jumps."""

    fitted: Array
    left: Array
    jumps: tuple[Jump, ...]


def weigh_gauge(runs: Runs, robot: Robot) -> tuple[Runs, Gauge | None]:
    """What the recorded state of charge is worth, and the runs without what it is not.

    One that follows the voltage is left out. Of a counter, jumps are taken out, and readings that stay while charge is
    drawn. By a counter, a recorded `power_w` is that at the terminals or counts the battery's own losses.

    Returns:
        The runs, and None without a state of charge that falls.
    """
    soc = runs.context.get("soc", np.empty(0))
    if runs.unit != "W" or not np.isfinite(soc).any():
        return runs, None
    readings = read_gauge(runs, robot)
    if len(readings.shown) < 2 * _CORNERS or np.ptp(readings.shown) < thresholds.LEAST_FALL:
        return runs, None
    drawn_j = float(runs.observed @ runs.duration_s)
    counter = as_counter(readings)
    by_voltage = evidence_for_voltage(readings)
    by_load, per_w = evidence_for_load(readings, counter.jumps)
    follows: Followed = "charge"
    gained = max(by_voltage, by_load)
    if gained >= thresholds.STRONG_BIC + _RARE_BIC and by_voltage > 0.0:
        follows = "voltage"
        reason = f"follows the voltage under load, not the charge drawn (BIC lower by {gained:.0f})"
    elif gained >= thresholds.STRONG_BIC + _RARE_BIC:
        follows = "load"
        reason = (
            f"falls with the load, by {1e4 * per_w:.2g} % for 100 W, and recovers at rest, as a map of the voltage "
            f"does and no count of charge (BIC lower by {gained:.0f})"
        )
    if follows != "charge":
        others = {name: values for name, values in runs.context.items() if name != "soc"}
        says = f"the state of charge {reason}: it is left out, and no capacity is drawn from it"
        return dataclasses.replace(runs, context=others), Gauge(follows, says, drawn_j, None)
    runs, notes = _mended(runs, readings, counter)
    runs, of_power = _settled(runs, robot)
    low, high = covered(runs.context["soc"], runs.run)
    if high - low < thresholds.HALF:
        notes.append(
            f"covers {high - low:.0%} of the battery, less than half, and {_energy(drawn_j)} were drawn in all: no "
            "capacity is drawn from it"
        )
    says = "; it ".join(["the state of charge follows the charge drawn", *notes])
    return runs, Gauge(follows, "; ".join(filter(None, (says, of_power))), drawn_j, high - low)


def capacity_question(capacity: Capacity | None, robot: Robot) -> str | None:
    """What is asked about a capacity above that of a new battery, as a counter shows it; None of others."""
    if capacity is None or not capacity.asked:
        return None
    low, high = (_energy(end) for end in capacity.ci95)
    return (
        f"the charge falls as in a battery of {_energy(capacity.fitted_j)} (95 %: {low} to {high}), above the "
        f"{_energy(robot.rated_energy_j)} that it is rated at, so that corrected.toml keeps the capacity: is it "
        "another battery, does the gauge not count, or does the meter read too much?"
    )


def _energy(amount_j: float) -> str:
    return f"{1e-6 * amount_j:.3g} MJ" if amount_j >= 1e6 else f"{1e-3 * amount_j:.3g} kJ"


def _mended(runs: Runs, readings: Readings, counter: Counter) -> tuple[Runs, list[str]]:
    """The runs without jumps of the gauge and without readings that stay while charge is drawn, and what was done."""
    soc, notes = runs.context["soc"].copy(), []
    for jump in counter.jumps:
        since = int(readings.last[jump.bin - 1])
        changes = np.abs(np.diff(np.nan_to_num(soc[since : readings.last[jump.bin] + 1])))
        first = since + 1 + int(np.argmax(changes))
        number = int(runs.run[first])
        soc[first : int(np.searchsorted(runs.run, number, side="right"))] -= jump.size
        where = f"{runs.time_s[first]:.0f} s of {PurePath(runs.signals[number].name).name}"
        notes.append(f"jumps by {jump.size:+.0%} at {where}, which is taken out")
    nearest = np.clip(counter.fitted, readings.low, readings.high)
    stays = np.abs(nearest - readings.shown) > readings.step  # only one that is held, full or empty has so wide bounds
    if stays.any():
        bin_of = np.searchsorted(readings.last, np.arange(len(soc)))
        left_out = stays[np.minimum(bin_of, len(stays) - 1)]
        soc[left_out] = np.nan
        notes.append(f"stays for {float(runs.duration_s[left_out].sum()) / 60.0:.0f} min while charge is drawn, which "
                     "are left out")  # fmt: skip
    return dataclasses.replace(runs, context={**runs.context, "soc": soc}), notes


def _settled(runs: Runs, robot: Robot) -> tuple[Runs, str]:
    """The runs with `power_w` as the charge shows it, at the terminals or with what is lost inside, and that in words;
    nothing where the file's battery loses nothing inside that matters."""
    lost_w = inside_w(robot, runs)
    given = np.array([not run.at_terminals for run in runs.signals])[runs.run]
    if not given.any() or not matters(lost_w * given, runs):
        return runs, ""
    soc = np.where(given, runs.context["soc"], np.nan)
    known_runs = runs.run[np.isfinite(soc)]
    if len(known_runs) == 0:
        return runs, ""
    if battery.AGEING.in_file(robot)[0]:  # the file's age is that of the last run
        soc = np.where(runs.run == known_runs[-1], soc, np.nan)
    channel = Reading(-energy_share(robot.curve, soc), runs, cut_blocks(runs.run))

    def least(power_w: Array) -> float:
        """Twice the negative log posterior of a capacity near that of the file, for this power."""
        fallen = channel.summed(power_w / robot.usable_energy_j)

        def objective(rate: float) -> float:
            left = channel.target - rate * fallen
            independent = independent_windows(left, channel.run)
            return float(
                independent * np.log(max(float(left @ left), TINY)) + ((rate - 1.0) / thresholds.CAPACITY_SD) ** 2
            )

        return float(minimize_scalar(objective, bounds=(thresholds.HALF, 1.0 / thresholds.HALF), method="bounded").fun)

    gained = least(runs.observed) - least(runs.observed + lost_w)  # by a power at the terminals
    share = float((lost_w * given) @ runs.duration_s) / float(runs.observed @ runs.duration_s)
    losses = f"what the file's battery loses inside, {share:.0%} of the energy"
    if gained >= thresholds.STRONG_BIC:
        signals = [dataclasses.replace(run, at_terminals=True) for run in runs.signals]
        return dataclasses.replace(runs, signals=signals), f"by it, power_w is without {losses}"
    if gained <= -thresholds.STRONG_BIC:
        return runs, f"by it, power_w counts {losses}"
    return runs, f"whether power_w counts {losses}, is undecided: it is taken to"


def read_gauge(runs: Runs, robot: Robot) -> Readings:
    """The state of charge of all runs at the end of each bin, beside the charge drawn until then."""
    soc, curve = runs.context["soc"], robot.curve
    known = np.isfinite(soc)
    voltage_v = runs.context.get("voltage_v", np.full(len(soc), np.nan))
    voltage_v = np.where(voltage_v > 0.0, voltage_v, np.nan)
    filled = np.interp(np.arange(len(soc)), np.flatnonzero(known), soc[known])
    relative_v = open_circuit_v(curve, filled) / curve.mean_v if curve.mean_v > 0.0 else np.ones(len(soc))
    if np.isfinite(voltage_v).any():
        relative_v = np.where(np.isfinite(voltage_v), voltage_v / np.nanmean(voltage_v), relative_v)
    rate = runs.observed / (relative_v * robot.usable_energy_j)
    apart_s = np.diff(runs.time_s)
    follows = (np.diff(runs.run) == 0) & (apart_s <= np.maximum(_BIN_S, thresholds.HALF_AGAIN * runs.duration_s[1:]))
    stretch = np.concatenate([[0], np.cumsum(~follows)])
    began_s = runs.time_s[np.searchsorted(stretch, stretch)]
    within = np.floor((runs.time_s - began_s) / _BIN_S).astype(np.intp)
    bin_of = np.concatenate([[0], np.cumsum((np.diff(stretch) != 0) | (np.diff(within) != 0))])
    drawn = np.concatenate([[0.0], np.cumsum(np.where(follows, 0.5 * (rate[1:] + rate[:-1]) * apart_s, 0.0))])
    # What is read is that of one moment: a mean of readings that change would be none of them.
    shown_in, end = np.unique(bin_of[known][::-1], return_index=True)
    last = np.flatnonzero(known)[::-1][end]
    of_bin = pd.DataFrame({"power_w": runs.observed, "voltage_v": voltage_v}).groupby(bin_of).mean().iloc[shown_in]
    step = max(_step(runs), thresholds.GAUGE_STEP)
    low, high = _bounds(soc[last], stretch[last], step)
    power_w, volts = of_bin["power_w"].to_numpy(), of_bin["voltage_v"].to_numpy()
    return Readings(soc[last], low, high, drawn[last], power_w, volts, runs.run[last], stretch[last], last, step)


def _step(runs: Runs) -> float:
    """Least change between values that the gauge holds; 0 where it holds none."""
    least = [0.0]
    for run in runs.signals:
        soc = run.context.get("soc", np.empty(0))
        soc = soc[np.isfinite(soc)]
        held = np.flatnonzero(np.diff(soc) == 0.0)
        if len(held) < thresholds.HALF * len(soc):
            continue
        changes = np.abs(np.diff(soc[held]))
        least += changes[changes > 1e-9].tolist()
    return min(least[1:], default=0.0)


def _bounds(shown: Array, stretch: Index, step: float) -> tuple[Array, Array]:
    """Bounds of the state of charge: within half a step, and from one that is held down to the next; open at full and
    empty, and downwards where it is held to the end of its stretch."""
    begins = np.flatnonzero(np.concatenate([[True], (np.diff(shown) != 0.0) | (np.diff(stretch) != 0)]))
    value, of_stretch, length = shown[begins], stretch[begins], np.diff(np.append(begins, len(shown)))
    following = np.where(np.append(np.diff(of_stretch) == 0, False), np.append(value[1:], 0.0), -np.inf)
    least = np.where(length > 1, np.minimum(value, following), value)
    low, high = np.repeat(least, length) - 0.5 * step, shown + 0.5 * step
    return np.where(shown <= 0.5 * step, -np.inf, low), np.where(shown >= 1.0 - 0.5 * step, np.inf, high)


def _within_bounds(columns: Array, readings: Readings, least: float = -np.inf) -> tuple[Array, Array, Array]:
    """Weights of columns, shape (bins, columns), that come nearest to the bounds of the readings, with the states of
    charge that they make and how far these are out of the bounds, (bins,) each; no weight is below the `least`."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit = columns / scale

    def out_of_bounds(weights: Array) -> tuple[float, Array]:
        fitted = unit @ weights
        beyond = fitted - np.clip(fitted, readings.low, readings.high)
        return 0.5 * float(beyond @ beyond), unit.T @ beyond

    start = np.maximum(np.linalg.lstsq(unit, readings.shown, rcond=None)[0], least)
    nearest = minimize(
        out_of_bounds, start, jac=True, method="L-BFGS-B", bounds=Bounds(least, np.inf),
        options={"maxiter": 300, "ftol": 1e-12, "gtol": 1e-9},  # more change no digit that is shown
    )  # fmt: skip
    fitted = unit @ nearest.x
    return nearest.x / scale, fitted, fitted - np.clip(fitted, readings.low, readings.high)


def _bic_gain(before: Array, after: Array, readings: Readings, freedom: float) -> float:
    """Reduction of BIC from one residual beyond rounding to another, (bins,) each, by `freedom` more parameters."""
    rounding = len(after) * readings.error**2
    independent = min(independent_windows(after, readings.stretch), float(len(after)))
    ratio = (float(before @ before) + rounding) / (float(after @ after) + rounding)
    return float(independent * np.log(ratio) - freedom * np.log(independent))


def _own(stretch: Index, column: Array) -> Array:
    """A column of its own for each stretch, shape (bins, stretches)."""
    return np.asarray(column[:, None] * (stretch[:, None] == np.unique(stretch)))


def _set_anew(readings: Readings, at: int) -> Array:
    """A column that begins with a bin and lasts to the end of its stretch, shape (bins, 1)."""
    after = (np.arange(len(readings.shown)) >= at) & (readings.stretch == readings.stretch[at])
    return np.asarray(after[:, None], np.float64)


def _counter_columns(readings: Readings) -> Array:
    """A start for each stretch, and a charge of a full battery for each run: it depends on cold and age."""
    starts = _own(readings.stretch, np.ones(len(readings.shown)))
    return np.column_stack([starts, _own(readings.run, readings.drawn)])


def as_counter(readings: Readings) -> Counter:
    """The counter that comes nearest to the readings, set anew where that explains more than chance."""
    columns = _counter_columns(readings)
    weights, fitted, plain = _within_bounds(columns, readings)
    moved = np.where(np.diff(readings.stretch) == 0, np.abs(np.diff(readings.shown - fitted)), 0.0)
    largest = np.argsort(-moved, kind="stable")[:_MOST_JUMPS]
    # More than a reading that is one step off.
    candidates = (largest[moved[largest] > 1.5 * readings.step] + 1).tolist()
    likeliest = Counter(fitted, plain, ())
    most = thresholds.STRONG_BIC
    starts = columns.shape[1]
    for count, at in enumerate(candidates, start=1):
        columns = np.column_stack([columns, _set_anew(readings, at)])
        weights, fitted, left = _within_bounds(columns, readings)
        gained = _bic_gain(plain, left, readings, thresholds.COST_OF_A_CHANGE * count)
        if gained >= most:
            sizes = weights[starts:].tolist()
            jumps = tuple(Jump(*jump) for jump in zip(candidates[:count], sizes, strict=True))
            likeliest = Counter(fitted, left, jumps)
            most = gained
    return likeliest


def _averaged(values: Array, stretch: Index, bins: int) -> Array:
    """Mean of the last so many bins of a stretch."""
    parts = np.split(values, np.flatnonzero(np.diff(stretch)) + 1)
    return np.concatenate([uniform_filter1d(part, bins, mode="nearest", origin=(bins - 1) // 2) for part in parts])


def evidence_for_voltage(readings: Readings) -> float:
    """Reduction of BIC by a map of the recorded voltage over a counter; none without voltage."""
    readings = readings.only(np.isfinite(readings.voltage_v))
    if len(readings.shown) < 2 * _CORNERS:
        return -np.inf
    counter = as_counter(readings)
    # One start and one charge count, however many runs there are: a counter does not lose to a map by their number.
    left, of_counter = counter.left, 2 + thresholds.COST_OF_A_CHANGE * len(counter.jumps)
    of_map: Array | None = None
    for bins in _AVERAGED_BINS:
        volts = _averaged(readings.voltage_v, readings.stretch, bins)
        corners = np.unique(np.quantile(volts, np.linspace(0.0, 1.0, _CORNERS)))
        hats = np.column_stack([np.interp(volts, corners, at_corner) for at_corner in np.eye(len(corners))])
        rises = np.cumsum(hats[:, ::-1], axis=1)[:, ::-1]  # each column rises from 0 to 1 between two corners
        design = np.column_stack([rises, -rises[:, 0]])  # the level of the lowest corner has any sign
        *_, left_so = _within_bounds(design, readings, least=0.0)
        if of_map is None or left_so @ left_so < of_map @ of_map:
            of_map = left_so
    assert of_map is not None
    freedom = _CORNERS + 1 - of_counter  # its corners and the time over which it averages
    if float(of_map @ of_map) < float(left @ left):
        return _bic_gain(left, of_map, readings, freedom)
    return -_bic_gain(of_map, left, readings, -freedom)


def evidence_for_load(readings: Readings, jumps: Sequence[Jump]) -> tuple[float, float]:
    """Reduction of BIC by a fall with the power drawn, beside a counter that is straight over some minutes, and that
    fall for a watt."""
    began = np.searchsorted(readings.stretch, readings.stretch)
    piece = (np.arange(len(began)) - began) // _PIECE_BINS
    _, piece = np.unique(np.column_stack([readings.stretch, piece]), axis=0, return_inverse=True)
    straight = np.column_stack([_own(piece, np.ones(len(piece))), _own(piece, readings.drawn)])
    steps = [_set_anew(readings, jump.bin) * (piece == piece[jump.bin])[:, None] for jump in jumps]
    *_, left = _within_bounds(np.column_stack([straight, *steps]), readings)
    best, fall = -np.inf, 0.0
    # What looks like jumps of a counter may be all loads of a map.
    for beside in [[], steps] if steps else [[]]:
        # Its size, and the time over which it averages.
        freedom = 2.0 + thresholds.COST_OF_A_CHANGE * (len(beside) - len(steps))
        for bins in _AVERAGED_BINS:
            load = -_averaged(readings.power_w, readings.stretch, bins)
            weights, _, left_so = _within_bounds(np.column_stack([straight, *beside, load]), readings)
            gained = _bic_gain(left, left_so, readings, freedom)
            if weights[-1] > 0.0 and gained > best:
                best, fall = gained, float(weights[-1])
    return best, fall
