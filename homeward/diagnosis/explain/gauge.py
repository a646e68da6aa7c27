"""What a recorded state of charge is worth: whether it follows the charge drawn, or the voltage
under load.

A gauge that counts falls with the charge drawn, whatever the load, and never rises at rest. A map
of the voltage falls with the load and recovers at rest. The two are weighed by how well they
predict the readings (BIC):

* a counter: a line over the charge drawn, one for each run, that may be set anew a few times, such
  as by a reset;
* a map of a recorded voltage: a curve of straight pieces that rises with the voltage, one for all
  runs;
* a map of a voltage that was not recorded: a line that also falls with the power drawn at the
  moment.

A reading is known to within a step, one at full or empty only from one side, and one that is held
lies between itself and the next: a coarse, late or stuck gauge is still a counter.
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
# of the counter's line where no voltage was recorded: in ten minutes its curve is straight
_PIECE_BINS = 60
# 2 log 9: one gauge in ten is a map of the voltage (`OWN_COURSE` of
# `homeward.companion.thresholds`)
_RARE_BIC = 4.4
_CORNERS = 8  # of a map of the voltage; published ones have 4 to 11
_MOST_JUMPS = 12  # chosen: bounds time; a gauge is reset once a charge or less often


@dataclass(frozen=True)
class Readings:
    """The state of charge in bins of `_BIN_S`, which cross no gap and no end of a run; arrays of
    shape (bins,)."""

    shown: Array
    low: Array  # bounds of the state of charge by what was shown
    high: Array
    drawn: Array  # charge drawn so far, over that of a full battery by the robot's file
    power_w: Array
    voltage_v: Array  # NaN where it was not recorded
    run: Index
    stretch: Index
    window: Index  # that is read, the last of a bin
    step: float  # of what the gauge shows

    @property
    def error(self) -> float:
        """Standard deviation of rounding."""
        return float(self.step / np.sqrt(12.0))

    def only(self, bins: Mask) -> Readings:
        """These bins only."""
        arrays: dict[str, Any] = {
            name: values[bins]
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray)
        }
        return dataclasses.replace(self, **arrays)


@dataclass(frozen=True)
class Jump:
    """A reading that was set anew, between a bin and the one before."""

    bin: int
    size: float


@dataclass(frozen=True)
class Counter:
    """A counter's states of charge and how far they are out of the bounds of the readings, (bins,)
    each; its jumps."""

    fitted: Array
    beyond: Array
    jumps: tuple[Jump, ...]


def weigh_gauge(runs: Runs, robot: Robot) -> tuple[Runs, Gauge | None]:
    """What the recorded state of charge is worth, and the runs without what it is not.

    One that follows the voltage is left out. Of a counter, jumps are taken out, and readings that
    stay while charge is drawn. By a counter, a recorded `power_w` is that at the terminals or
    counts the battery's own losses.

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
    follows, reason = _followed(readings, counter)
    if follows != "charge":
        context = {name: values for name, values in runs.context.items() if name != "soc"}
        says = f"the state of charge {reason}: it is left out, and no capacity is drawn from it"
        return dataclasses.replace(runs, context=context), Gauge(follows, says, drawn_j, None)
    runs, notes = _mended(runs, readings, counter)
    runs, note_on_power = _settled(runs, robot)
    low, high = covered(runs.context["soc"], runs.run)
    if high - low < thresholds.HALF:
        notes.append(
            f"covers {high - low:.0%} of the battery, less than half, and {_energy(drawn_j)} were drawn in all: no "
            "capacity is drawn from it"
        )
    says = "; it ".join(["the state of charge follows the charge drawn", *notes])
    return runs, Gauge(follows, "; ".join(filter(None, (says, note_on_power))), drawn_j, high - low)


def _followed(readings: Readings, counter: Counter) -> tuple[Followed, str]:
    """What the readings follow, and where that is not the charge, the evidence in words."""
    by_voltage = evidence_for_voltage(readings)
    by_load, fall_per_w = evidence_for_load(readings, counter.jumps)
    gained = max(by_voltage, by_load)
    is_map = gained >= thresholds.STRONG_BIC + _RARE_BIC
    if is_map and by_voltage > 0.0:
        return (
            "voltage",
            f"follows the voltage under load, not the charge drawn (BIC lower by {gained:.0f})",
        )
    if is_map:
        return "load", (
            f"falls with the load, by {1e4 * fall_per_w:.2g} % for 100 W, and recovers at rest, as a map of the "
            f"voltage does and no count of charge (BIC lower by {gained:.0f})"
        )
    return "charge", ""


def capacity_question(capacity: Capacity | None, robot: Robot) -> str | None:
    """What is asked about a capacity above that of a new battery, as a counter shows it; None of
    others."""
    if capacity is None or not capacity.asked:
        return None
    low_j, high_j = capacity.ci95
    return (
        f"the charge falls as in a battery of {_energy(capacity.fitted_j)} (95 %: {_energy(low_j)} to "
        f"{_energy(high_j)}), above the {_energy(robot.rated_energy_j)} that it is rated at, so that corrected.toml "
        "keeps the capacity: is it another battery, does the gauge not count, or does the meter read too much?"
    )


def _energy(amount_j: float) -> str:
    if amount_j >= 1e6:
        return f"{1e-6 * amount_j:.3g} MJ"
    return f"{1e-3 * amount_j:.3g} kJ"


def _mended(runs: Runs, readings: Readings, counter: Counter) -> tuple[Runs, list[str]]:
    """The runs without jumps of the gauge and without readings that stay while charge is drawn, and
    what was done."""
    soc = runs.context["soc"].copy()
    notes = []
    for jump in counter.jumps:
        # The jump is between two readings: at the window where what is shown changes most.
        before = int(readings.window[jump.bin - 1])
        changes = np.abs(np.diff(np.nan_to_num(soc[before : readings.window[jump.bin] + 1])))
        jump_at = before + 1 + int(np.argmax(changes))
        run = int(runs.run[jump_at])
        end_of_run = int(np.searchsorted(runs.run, run, side="right"))
        soc[jump_at:end_of_run] -= jump.size
        moment = f"{runs.time_s[jump_at]:.0f} s of {PurePath(runs.signals[run].name).name}"
        notes.append(f"jumps by {jump.size:+.0%} at {moment}, which is taken out")
    nearest = np.clip(counter.fitted, readings.low, readings.high)
    # only one that is held, full or empty has so wide bounds
    stays = np.abs(nearest - readings.shown) > readings.step
    if stays.any():
        bin_of = np.searchsorted(readings.window, np.arange(len(soc)))
        left_out = stays[np.minimum(bin_of, len(stays) - 1)]
        soc[left_out] = np.nan
        minutes = float(runs.duration_s[left_out].sum()) / 60.0
        notes.append(f"stays for {minutes:.0f} min while charge is drawn, which are left out")
    return dataclasses.replace(runs, context={**runs.context, "soc": soc}), notes


def _settled(runs: Runs, robot: Robot) -> tuple[Runs, str]:
    """The runs with `power_w` as the charge shows it, at the terminals or with what is lost inside,
    and that in words; nothing where the file's battery loses nothing inside that matters."""
    lost_w = inside_w(robot, runs)
    # Where power is voltage times current, it is that at the terminals; of a recorded `power_w` it
    # is open.
    is_open = np.array([not run.at_terminals for run in runs.signals])[runs.run]
    if not is_open.any() or not matters(lost_w * is_open, runs):
        return runs, ""
    soc = np.where(is_open, runs.context["soc"], np.nan)
    runs_with_soc = runs.run[np.isfinite(soc)]
    if len(runs_with_soc) == 0:
        return runs, ""
    if battery.AGEING.in_file(robot)[0]:  # the file's age is that of the last run
        soc = np.where(runs.run == runs_with_soc[-1], soc, np.nan)
    channel = Reading(-energy_share(robot.curve, soc), runs, cut_blocks(runs.run))
    as_counted = _misfit(channel, runs.observed / robot.usable_energy_j)
    as_at_terminals = _misfit(channel, (runs.observed + lost_w) / robot.usable_energy_j)
    gained_by_terminals = as_counted - as_at_terminals
    share = float((lost_w * is_open) @ runs.duration_s) / float(runs.observed @ runs.duration_s)
    losses = f"what the file's battery loses inside, {share:.0%} of the energy"
    if gained_by_terminals >= thresholds.STRONG_BIC:
        signals = [dataclasses.replace(run, at_terminals=True) for run in runs.signals]
        return dataclasses.replace(runs, signals=signals), f"by it, power_w is without {losses}"
    if gained_by_terminals <= -thresholds.STRONG_BIC:
        return runs, f"by it, power_w counts {losses}"
    return runs, f"whether power_w counts {losses}, is undecided: it is taken to"


def _misfit(channel: Reading, drawn_per_s: Array) -> float:
    """Twice the negative log posterior of a capacity near that of the file, where charge is drawn
    at these rates, over that of a full battery, shape (windows,)."""
    drawn = channel.summed(drawn_per_s)

    def objective(rate: float) -> float:
        """For a battery whose charge falls `rate` times as fast as that of the file."""
        residual = channel.target - rate * drawn
        independent = independent_windows(residual, channel.run)
        squared = max(float(residual @ residual), TINY)
        return float(independent * np.log(squared) + ((rate - 1.0) / thresholds.CAPACITY_SD) ** 2)

    return float(
        minimize_scalar(
            objective, bounds=(thresholds.HALF, 1.0 / thresholds.HALF), method="bounded"
        ).fun
    )


def read_gauge(runs: Runs, robot: Robot) -> Readings:
    """The state of charge of all runs at the end of each bin, beside the charge drawn until
    then."""
    soc = runs.context["soc"]
    is_shown = np.isfinite(soc)
    voltage_v = runs.context.get("voltage_v", np.full(len(soc), np.nan))
    voltage_v = np.where(voltage_v > 0.0, voltage_v, np.nan)
    # A count of charge integrates the current: power over voltage.
    rate = runs.observed / (_relative_voltage(soc, voltage_v, robot) * robot.usable_energy_j)
    apart_s = np.diff(runs.time_s)
    no_gap = apart_s <= np.maximum(_BIN_S, thresholds.HALF_AGAIN * runs.duration_s[1:])
    follows = (np.diff(runs.run) == 0) & no_gap
    stretch = np.concatenate([[0], np.cumsum(~follows)])
    bin_of = _bin_of(stretch, runs.time_s)
    # by the trapezoidal rule
    drawn_between = np.where(follows, 0.5 * (rate[1:] + rate[:-1]) * apart_s, 0.0)
    drawn = np.concatenate([[0.0], np.cumsum(drawn_between)])
    # What is read is that of one moment: a mean of readings that change would be none of them.
    shown_in, place_from_end = np.unique(bin_of[is_shown][::-1], return_index=True)
    window = np.flatnonzero(is_shown)[::-1][place_from_end]
    recorded = pd.DataFrame({"power_w": runs.observed, "voltage_v": voltage_v})
    mean_of_bin = recorded.groupby(bin_of).mean().iloc[shown_in]
    step = max(_step(runs), thresholds.GAUGE_STEP)
    low, high = _bounds(soc[window], stretch[window], step)
    return Readings(
        shown=soc[window],
        low=low,
        high=high,
        drawn=drawn[window],
        power_w=mean_of_bin["power_w"].to_numpy(),
        voltage_v=mean_of_bin["voltage_v"].to_numpy(),
        run=runs.run[window],
        stretch=stretch[window],
        window=window,
        step=step,
    )


def _relative_voltage(soc: Array, voltage_v: Array, robot: Robot) -> Array:
    """Voltage over its mean, shape (windows,): the recorded one, else the file's open-circuit
    curve, else constant."""
    relative_voltage = np.ones(len(soc))
    curve = robot.curve
    if curve.mean_v > 0.0:
        is_shown = np.isfinite(soc)
        filled = np.interp(np.arange(len(soc)), np.flatnonzero(is_shown), soc[is_shown])
        relative_voltage = open_circuit_v(curve, filled) / curve.mean_v
    if np.isfinite(voltage_v).any():
        relative_voltage = np.where(
            np.isfinite(voltage_v), voltage_v / np.nanmean(voltage_v), relative_voltage
        )
    return relative_voltage


def _bin_of(stretch: Index, time_s: Array) -> Index:
    """Number of the bin of each window, shape (windows,): bins of `_BIN_S` that begin anew with
    each stretch."""
    began_s = time_s[np.searchsorted(stretch, stretch)]
    number_in_stretch = np.floor((time_s - began_s) / _BIN_S).astype(np.intp)
    begins = (np.diff(stretch) != 0) | (np.diff(number_in_stretch) != 0)
    return np.concatenate([[0], np.cumsum(begins)])


def _step(runs: Runs) -> float:
    """Least change between values that the gauge holds; 0 where it holds none."""
    steps: list[float] = []
    for run in runs.signals:
        soc = run.context.get("soc", np.empty(0))
        soc = soc[np.isfinite(soc)]
        repeated = np.flatnonzero(np.diff(soc) == 0.0)
        if len(repeated) < thresholds.HALF * len(soc):
            continue
        changes = np.abs(np.diff(soc[repeated]))
        steps += changes[changes > 1e-9].tolist()
    return min(steps, default=0.0)


def _bounds(shown: Array, stretch: Index, step: float) -> tuple[Array, Array]:
    """Bounds of the state of charge: within half a step, and from one that is held down to the
    next; open at full and empty, and downwards where it is held to the end of its stretch."""
    changes = (np.diff(shown) != 0.0) | (np.diff(stretch) != 0)
    # A level lasts for the bins of one stretch that show the same.
    begins = np.flatnonzero(np.concatenate([[True], changes]))
    level = shown[begins]
    length = np.diff(np.append(begins, len(shown)))
    has_next = np.append(np.diff(stretch[begins]) == 0, False)
    next_level = np.where(has_next, np.append(level[1:], 0.0), -np.inf)
    lowest = np.where(length > 1, np.minimum(level, next_level), level)
    half_step = 0.5 * step
    low = np.repeat(lowest, length) - half_step
    high = shown + half_step
    is_empty = shown <= half_step
    is_full = shown >= 1.0 - half_step
    return np.where(is_empty, -np.inf, low), np.where(is_full, np.inf, high)


def _within_bounds(
    columns: Array, readings: Readings, lowest: float = -np.inf
) -> tuple[Array, Array, Array]:
    """Weights of columns, shape (bins, columns), that come nearest to the bounds of the readings,
    with the states of charge that they make and how far these are out of the bounds, (bins,) each;
    no weight is below the `lowest`."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit = columns / scale

    def beyond_bounds(fitted: Array) -> Array:
        return np.asarray(fitted - np.clip(fitted, readings.low, readings.high))

    def half_square_and_gradient(weights: Array) -> tuple[float, Array]:
        beyond = beyond_bounds(unit @ weights)
        return 0.5 * float(beyond @ beyond), unit.T @ beyond

    start = np.maximum(np.linalg.lstsq(unit, readings.shown, rcond=None)[0], lowest)
    nearest = minimize(
        half_square_and_gradient, start, jac=True, method="L-BFGS-B", bounds=Bounds(lowest, np.inf),
        options={"maxiter": 300, "ftol": 1e-12, "gtol": 1e-9},  # more change no digit that is shown
    )  # fmt: skip
    fitted = unit @ nearest.x
    return nearest.x / scale, fitted, beyond_bounds(fitted)


def _bic_gain(residual: Array, residual_with: Array, readings: Readings, freedom: float) -> float:
    """Reduction of BIC from one residual beyond rounding to another, (bins,) each, by `freedom`
    more parameters."""
    rounding = len(residual_with) * readings.error**2
    independent = min(
        independent_windows(residual_with, readings.stretch), float(len(residual_with))
    )
    squared = float(residual @ residual) + rounding
    squared_with = float(residual_with @ residual_with) + rounding
    return float(independent * np.log(squared / squared_with) - freedom * np.log(independent))


def _per_stretch(stretch: Index, column: Array) -> Array:
    """A column of its own for each stretch, shape (bins, stretches)."""
    return np.asarray(column[:, None] * (stretch[:, None] == np.unique(stretch)))


def _set_anew(readings: Readings, from_bin: int) -> Array:
    """A column that begins with a bin and lasts to the end of its stretch, shape (bins, 1)."""
    is_later = np.arange(len(readings.shown)) >= from_bin
    in_stretch = readings.stretch == readings.stretch[from_bin]
    return np.asarray((is_later & in_stretch)[:, None], np.float64)


def _counter_columns(readings: Readings) -> Array:
    """A start for each stretch, and a charge of a full battery for each run: it depends on cold and
    age."""
    starts = _per_stretch(readings.stretch, np.ones(len(readings.shown)))
    return np.column_stack([starts, _per_stretch(readings.run, readings.drawn)])


def as_counter(readings: Readings) -> Counter:
    """The counter that comes nearest to the readings, set anew where that explains more than
    chance."""
    columns = _counter_columns(readings)
    weights, fitted, beyond_without = _within_bounds(columns, readings)
    # It may have been set anew where readings move most against the counter.
    in_stretch = np.diff(readings.stretch) == 0
    moved = np.where(in_stretch, np.abs(np.diff(readings.shown - fitted)), 0.0)
    largest = np.argsort(-moved, kind="stable")[:_MOST_JUMPS]
    is_jump = moved[largest] > 1.5 * readings.step  # more than a reading that is one step off
    candidates = (largest[is_jump] + 1).tolist()
    likeliest = Counter(fitted, beyond_without, ())
    gained_by_likeliest = thresholds.STRONG_BIC
    first_jump = columns.shape[1]  # among the weights
    for count, from_bin in enumerate(candidates, start=1):
        columns = np.column_stack([columns, _set_anew(readings, from_bin)])
        weights, fitted, beyond = _within_bounds(columns, readings)
        gained = _bic_gain(beyond_without, beyond, readings, thresholds.COST_OF_A_CHANGE * count)
        if gained >= gained_by_likeliest:
            sizes = weights[first_jump:].tolist()
            jumps = tuple(Jump(*jump) for jump in zip(candidates[:count], sizes, strict=True))
            likeliest = Counter(fitted, beyond, jumps)
            gained_by_likeliest = gained
    return likeliest


def _averaged(values: Array, stretch: Index, bins: int) -> Array:
    """Mean of the last so many bins of a stretch."""
    parts = np.split(values, np.flatnonzero(np.diff(stretch)) + 1)
    return np.concatenate(
        [uniform_filter1d(part, bins, mode="nearest", origin=(bins - 1) // 2) for part in parts]
    )


def evidence_for_voltage(readings: Readings) -> float:
    """Reduction of BIC by a map of the recorded voltage over a counter; none without voltage."""
    readings = readings.only(np.isfinite(readings.voltage_v))
    if len(readings.shown) < 2 * _CORNERS:
        return -np.inf
    counter = as_counter(readings)
    by_maps = []
    for bins in _AVERAGED_BINS:
        volts = _averaged(readings.voltage_v, readings.stretch, bins)
        *_, beyond = _within_bounds(_rising_with(volts), readings, lowest=0.0)
        by_maps.append(beyond)
    by_map = min(by_maps, key=lambda beyond: float(beyond @ beyond))
    by_counter = counter.beyond
    # One start and one charge count, however many runs there are: a counter does not lose to a map
    # by their number.
    freedom_of_counter = 2 + thresholds.COST_OF_A_CHANGE * len(counter.jumps)
    freedom_of_map = _CORNERS + 1  # its corners and the time over which it averages
    more_freedom = freedom_of_map - freedom_of_counter
    if float(by_map @ by_map) < float(by_counter @ by_counter):
        return _bic_gain(by_counter, by_map, readings, more_freedom)
    return -_bic_gain(by_map, by_counter, readings, -more_freedom)


def _rising_with(volts: Array) -> Array:
    """Columns of which a sum with weights from 0 up rises with the voltage in straight pieces,
    (bins, corners + 1)."""
    corners = np.unique(np.quantile(volts, np.linspace(0.0, 1.0, _CORNERS)))
    hats = np.column_stack(
        [np.interp(volts, corners, at_corner) for at_corner in np.eye(len(corners))]
    )
    # each column rises from 0 to 1 between two corners
    rises = np.cumsum(hats[:, ::-1], axis=1)[:, ::-1]
    return np.column_stack([rises, -rises[:, 0]])  # the level of the lowest corner has any sign


def evidence_for_load(readings: Readings, jumps: Sequence[Jump]) -> tuple[float, float]:
    """Reduction of BIC by a fall with the power drawn, beside a counter that is straight over some
    minutes, and that fall for a watt."""
    piece = _pieces(readings.stretch)
    straight = np.column_stack(
        [_per_stretch(piece, np.ones(len(piece))), _per_stretch(piece, readings.drawn)]
    )
    steps = [_set_anew(readings, jump.bin) * (piece == piece[jump.bin])[:, None] for jump in jumps]
    *_, beyond_without = _within_bounds(np.column_stack([straight, *steps]), readings)
    # what looks like jumps of a counter may be all loads of a map
    step_sets: list[list[Array]] = [[]]
    if steps:
        step_sets.append(steps)
    most_gained = -np.inf
    fall_per_w = 0.0
    for with_steps in step_sets:
        # Its size, and the time over which it averages.
        freedom = 2.0 + thresholds.COST_OF_A_CHANGE * (len(with_steps) - len(steps))
        for bins in _AVERAGED_BINS:
            load = -_averaged(readings.power_w, readings.stretch, bins)
            weights, _, beyond = _within_bounds(
                np.column_stack([straight, *with_steps, load]), readings
            )
            gained = _bic_gain(beyond_without, beyond, readings, freedom)
            if weights[-1] > 0.0 and gained > most_gained:
                most_gained = gained
                fall_per_w = float(weights[-1])
    return most_gained, fall_per_w


def _pieces(stretch: Index) -> Index:
    """Number of the piece of each bin, shape (bins,): up to `_PIECE_BINS` of one stretch."""
    began = np.searchsorted(stretch, stretch)
    number_in_stretch = (np.arange(len(began)) - began) // _PIECE_BINS
    pieces = np.column_stack([stretch, number_in_stretch])
    return np.asarray(np.unique(pieces, axis=0, return_inverse=True)[1])
