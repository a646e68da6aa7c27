"""What may be missing, one hypothesis an effect: what it would add to each window of these recordings.

What an effect adds comes from the kernel: the replay with the effect less the replay without it. Where the cause is in
no channel (who put a load on the robot, and when), the size of the effect follows a schedule that is found from the
residual, and how it may change tells the effects apart: a load is put on where the robot stands, the ground changes
while it moves, a battery ages between runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from homeward.diagnosis.instruments import INSTRUMENTS, Instrument
from homeward.diagnosis.refit import DRAG, ROLLING, Parameters, WithEffects
from homeward.diagnosis.replay import Runs
from homeward.diagnosis.schedules import Axis, Schedule, by_place, in_time, profile
from homeward.diagnosis.signals import Array, usual_step_s
from homeward.physics.effects import EFFECTS, Effect, Parameter

CATALOGUE: Mapping[str, Effect | Instrument] = {
    **{one.id: one for one in EFFECTS},
    **{one.id: one for one in INSTRUMENTS},
}
"""Everything that can be named, by id."""

PHYSICS = frozenset(one.id for one in EFFECTS)
"""Ids of the effects of the robot and its surroundings; the others are faults of instruments."""

_STANDS_MPS = 0.05
_STORM_MPS = 40.0
_SAME_ODOMETER = 0.03
_FIX_S = 5.0
_AROUND_S = 4.0  # a change that was found is taken to lie within this of the true one
_TINY = 1e-6  # of the largest size: the response is linear there
_COST_OF_A_CHANGE = 3  # parameters: a moment that was searched for (Zhang & Siegmund, 2007)
_TRACKS_M = (0.1, 0.2, 0.4, 0.8, 1.6)
_CLEARLY_APART = 4.0  # standard deviations
_ALWAYS_GIVEN = ("time_s", "power_w", "distance_m")
_LAGS_S = tuple(sign * lag for lag in (0.2, 0.4, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0) for sign in (1.0, -1.0))

Shapes = Callable[[Runs], Iterator[dict[str, float]]]
Changes = Literal["standing", "moving", "between runs", "once", "repeatedly"]

_MAY_CHANGE: Mapping[str, tuple[Changes, bool]] = {  # and whether below the usual size is possible
    "payload": ("standing", False),
    "surface": ("moving", True),
    "viscous": ("moving", False),
    "hidden_grade": ("moving", True),
    "wind": ("moving", True),
    "ageing": ("between runs", False),
    "standby": ("once", False),
    "intermittent_load": ("repeatedly", False),
    "internal_resistance": ("once", False),
    "sensor_offset": ("once", True),
    "sensor_gain": ("once", True),
}
"""How the size of an effect whose cause no channel holds changes.

A load is put on where the robot stands and the ground changes where it moves: mostly. So these two are a preference
between equals; the others are what the effect means.
"""

_SELDOM_CHANGES = ("internal_resistance",)  # but for a connector that works loose
_PREFERENCES = ("standing", "moving")
_BY_PLACE = ("surface", "hidden_grade", "viscous")
_ONLY_SCHEDULED = ("payload", "surface", "ageing", "standby", "intermittent_load", "sensor_offset", "sensor_gain")
OF_CURRENT = ("inertia", "viscous", "wind", "surface", "payload", "hidden_grade", "slip", "turning", "clock_lag")
"""What shows in motor current: forces at the wheels. Of the rest, a torque sensor sees nothing."""


@dataclass(frozen=True)
class Term:
    """One hypothesis about one effect: what a unit of its size adds, shape (windows, sizes), and bounds of the sizes.

    `hidden` counts what was searched for beside the sizes, for the comparison of models of different freedom.
    """

    effect: str
    columns: Array
    low: Array  # (sizes,)
    high: Array
    hidden: int = 0
    shape: Mapping[str, float] = field(default_factory=dict)
    axis: Axis | Literal["steady"] = "steady"  # what the size depends on
    schedule: Schedule | None = None
    spread: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # interval of what the schedule shows
    fixed: bool = False  # whether its columns are no response of the kernel
    natural: bool = True  # whether the size changes as the sizes of this effect do

    @property
    def linear(self) -> bool:
        """Whether its columns say all, so that no replay with other sizes is needed."""
        return self.axis != "steady" or self.fixed or self.effect not in PHYSICS | {"clock_lag"}


@dataclass(frozen=True)
class Setting:
    """What hypotheses are made from: the runs, the refit's parameters, what is already in the model, what is left."""

    runs: Runs
    parameters: Parameters
    theta: Array
    present: WithEffects  # effects that are already in the model
    predicted: Array  # (windows,)
    residual: Array  # (windows,)

    def response(self, effect: str, size: float, shape: Mapping[str, float], base: WithEffects | None = None) -> Array:
        """What an effect of this size adds, per unit of its size, shape (windows,)."""
        start = base or self.present
        name = CATALOGUE[effect].parameters[0].name
        added = WithEffects({**start.effects, effect: {**shape, name: size}}, start.headwind_mps, start.lag_s)
        without = self.predicted if base is None else self.parameters.predict(self.runs, self.theta, base)
        return (self.parameters.predict(self.runs, self.theta, added) - without) / size


def terms(setting: Setting, leave_out: tuple[str, ...] = ()) -> list[Term]:
    """Every hypothesis that the channels of these runs allow.

    Args:
        setting: What is known so far.
        leave_out: Effects that are already in the model.
    """
    found: list[Term] = []
    for effect in CATALOGUE:
        if effect in leave_out or (setting.runs.unit == "A" and effect not in OF_CURRENT):
            continue
        found += [term for term in _terms_of(effect, setting) if np.isfinite(term.columns).all() and term.columns.any()]
    return found


def what_can_be_shown(absorbed: Mapping[str, float]) -> dict[str, float | None]:
    """For every effect the share that the refit would absorb, None where a channel lacks or nothing excites it."""
    return {effect: absorbed.get(effect) for effect in CATALOGUE}


def missing_channels(effect: str, runs: Runs) -> tuple[str, ...]:
    """Channels that an effect needs to be seen and that no run has."""
    given = {*runs.context, *_ALWAYS_GIVEN}
    if runs.unit == "W":
        given |= {"voltage_v", "current_a"}
    if "wheel_difference_mps" in given:
        given.add("yaw_rate_radps")
    needed = {"ageing": (), "rate_capacity": (), "odometry_scale": ("base_distance_m",)}
    return tuple(name for name in needed.get(effect, CATALOGUE[effect].needs) if name not in given)


def look_alike(one: str, other: str, runs: Runs) -> bool:
    """Whether two effects are known to look alike and no channel of these runs shows the difference."""
    known = other in CATALOGUE[one].confused_with or one in CATALOGUE[other].confused_with
    return known and bool({*CATALOGUE[one].needs, *CATALOGUE[other].needs} - {*runs.context, *_ALWAYS_GIVEN})


def _terms_of(effect: str, setting: Setting) -> Iterator[Term]:
    runs = setting.runs
    if effect not in _ONLY_SCHEDULED and not missing_channels(effect, runs):
        if effect == "wind":
            yield from _winds(setting)
        elif effect == "clock_lag":
            yield from _lags(setting)
        elif effect == "breakaway":
            yield from _starts(setting)
        elif effect == "odometry_scale":
            yield from _odometry(setting)
        elif effect in _SHAPES or effect in _PLAIN:
            yield from _steady(effect, setting)
            if effect == "heater":
                yield from _thermostat(setting)
            elif effect == "compute":
                yield from _on_the_move(setting)
    if effect in _MAY_CHANGE:
        yield from _scheduled(effect, setting)
    if effect == "sensor_offset":
        yield _drift(runs)


def _steady(effect: str, setting: Setting) -> Iterator[Term]:
    """The effect at one size throughout, at each of a few values of its other parameters."""
    parameter = CATALOGUE[effect].parameters[0]
    size = _TINY * max(abs(parameter.low), parameter.high)
    base = None
    if effect == "regeneration" and "inertia" not in setting.present.effects:
        # What brakes a robot on the level is its inertia: without it there is nothing to regenerate.
        present = setting.present
        base = WithEffects({**present.effects, "inertia": {"mass_factor": 1.0}}, present.headwind_mps, present.lag_s)
    shapes = list(_SHAPES[effect](setting.runs)) if effect in _SHAPES else [{}]
    if effect == "turning" and setting.parameters.nominal.track_m == 0.0:
        shapes = [{"track_m": track_m} for track_m in _TRACKS_M]
    best: tuple[float, Term] | None = None
    for shape in shapes:
        column = setting.response(effect, size, shape, base)
        power = float(column @ column)
        if power == 0.0:
            continue
        explained = float(column @ setting.residual) ** 2 / power
        term = Term(effect, column[:, None], _bound(parameter.low), _bound(parameter.high), int(len(shapes) > 1), shape)
        if best is None or explained > best[0]:
            best = explained, term
    if best is not None:
        yield best[1]


def _starts(setting: Setting) -> Iterator[Term]:
    """The energy of each start, drawn at once or over the first moments of the way."""
    parameter = CATALOGUE["breakaway"].parameters[0]
    at_once = setting.response("breakaway", _TINY * parameter.high, {})
    for windows in (0.01, 1.0, 2.0, 4.0):
        column = _worn_off(at_once, windows, setting.runs)
        searched = int(windows > 1.0)
        yield Term("breakaway", column[:, None], _bound(0.0), _bound(parameter.high), searched, fixed=True)


def _thermostat(setting: Setting) -> Iterator[Term]:
    """A heater that is on at full power below a temperature: of the same mean power as the proportional one."""
    parameter = CATALOGUE["heater"].parameters[0]
    temperature_c = setting.runs.context["temperature_c"]
    known = temperature_c[np.isfinite(temperature_c)]
    for below_c in np.unique(np.round(np.quantile(known, np.linspace(0.1, 0.9, 17)), 1)):
        on = temperature_c < below_c
        if 0 < on.sum() < len(on):
            column = on * float(np.mean(below_c - temperature_c[on]))
            shape = {"on_below_c": float(below_c)}
            yield Term("heater", column[:, None], _bound(0.0), _bound(parameter.high), 2, shape, fixed=True)


def _on_the_move(setting: Setting) -> Iterator[Term]:
    """Computing that rests while the robot stands, as mapping does: the same at any sensing rate, or with the rate."""
    parameter = CATALOGUE["compute"].parameters[0]
    moving = np.abs(setting.runs.context["speed_mps"]) > _STANDS_MPS
    if moving.all():
        return
    for share in (1.0, 0.0):
        column = moving * setting.response("compute", _TINY * parameter.high, {"base_share": share})
        yield Term(
            "compute", column[:, None], _bound(0.0), _bound(parameter.high), 1, {"base_share": share}, fixed=True
        )


def _drift(runs: Runs) -> Term:
    """A zero that creeps through all runs, taken in their order: per unit of what it comes to in the end."""
    parameter = CATALOGUE["sensor_offset"].parameters[0]
    passed = np.cumsum(runs.duration_s)
    column = (passed / passed[-1])[:, None]
    return Term("sensor_offset", column, _bound(parameter.low), _bound(parameter.high), fixed=True)


def _worn_off(column: Array, windows: float, runs: Runs) -> Array:
    """The energy of each start spread over the windows after it."""
    kept = float(np.exp(-1.0 / windows))
    spread = np.empty_like(column)
    for run in np.unique(runs.run):
        here = runs.run == run
        spread[here] = lfilter([1.0 - kept], [1.0, -kept], column[here])
    return spread


def _bound(value: float) -> Array:
    return np.array([value])


def _temperatures(name: str) -> Shapes:
    def shapes(runs: Runs) -> Iterator[dict[str, float]]:
        parameter = next(p for e in EFFECTS for p in e.parameters if p.name == name)
        temperature = runs.context["temperature_c"]
        known = temperature[np.isfinite(temperature)]
        quantiles = np.round(np.quantile(known, [0.3, 0.5, 0.7, 0.85]), 1).tolist() if len(known) else []
        for value in dict.fromkeys([*quantiles, float(np.max(known, initial=-100.0)) + 0.1, 20.0]):
            if parameter.low <= value <= parameter.high:
                yield {name: float(value)}

    return shapes


def _references(runs: Runs) -> Iterator[dict[str, float]]:
    drawn = runs.observed[runs.observed > 0.0]
    for value in np.unique(np.quantile(drawn, [0.02, 0.5])) if len(drawn) else []:
        yield {"reference_w": float(value)}


def _time_constants(runs: Runs) -> Iterator[dict[str, float]]:
    work_w = float(np.mean(np.maximum(runs.observed, 0.0)))
    longest_s = max(float(np.ptp(run.time_s)) for run in runs.signals)
    for constant_s in (60.0, 200.0, 600.0, 1800.0):
        if constant_s <= 2.0 * longest_s:
            # Rise and change per kelvin enter as a product: at mean load a winding 40 K above the air is usual.
            yield {"time_constant_s": constant_s, "rise_k_per_w": 40.0 / max(work_w, 1e-6)}


_SHAPES: Mapping[str, Shapes] = {
    "heater": _temperatures("on_below_c"),
    "cold_battery": _temperatures("warm_c"),
    "rate_capacity": _references,
    "motor_heating": _time_constants,
    "compute": lambda runs: iter([{"base_share": 1.0}]),
}
_PLAIN = (
    "inertia", "viscous", "slip", "turning", "regeneration", "copper_loss", "no_load", "radio", "internal_resistance",
    "hidden_grade",
)  # fmt: skip


def _winds(setting: Setting) -> Iterator[Term]:
    """A steady wind from one direction, by the heading: its strength and where it comes from."""
    headings = [run.context["heading_rad"] for run in setting.runs.signals]
    if not all(np.isfinite(heading).all() for heading in headings):
        return
    parts = [_blowing(setting, [part(heading) for heading in headings]) for part in (np.cos, np.sin)]
    yield Term("wind", np.column_stack(parts), np.full(2, -_STORM_MPS), np.full(2, _STORM_MPS))


def _blowing(setting: Setting, along: Sequence[Array]) -> Array:
    """What a wind of 1 m/s against the way adds, where `along` is its component, an array per run."""
    theta, present = setting.theta.copy(), setting.present
    theta[DRAG] = max(theta[DRAG], setting.parameters.start[DRAG])  # what a refit without wind took away from it
    speed_mps = 1e-3
    windy = WithEffects(
        {**present.effects, "wind": {"exposure": 1.0}}, [speed_mps * one for one in along], present.lag_s
    )
    predict = setting.parameters.predict
    change = predict(setting.runs, theta, windy) - predict(setting.runs, theta, present)
    return np.asarray(change / speed_mps)


def _lags(setting: Setting) -> Iterator[Term]:
    """A power clock that is late by each of a few lags."""
    best: tuple[float, Term] | None = None
    for lag_s in _LAGS_S:
        shifted = WithEffects(setting.present.effects, setting.present.headwind_mps, lag_s)
        change = setting.parameters.predict(setting.runs, setting.theta, shifted) - setting.predicted
        left = setting.residual - change
        error = float(left @ left)
        if best is None or error < best[0]:
            best = error, Term("clock_lag", change[:, None] / lag_s, _bound(-5.0), _bound(5.0), 1, {"lag_s": lag_s})
    if best is not None:
        lag_s = best[1].shape["lag_s"]
        around = sorted((0.5 * lag_s, 1.5 * lag_s))
        yield Term("clock_lag", best[1].columns, _bound(around[0]), _bound(around[1]), 1, best[1].shape)


def _odometry(setting: Setting) -> Iterator[Term]:
    """A speed reading that a position fix contradicts, run by run: its scale follows from the fix, not the power."""
    runs = setting.runs
    ratios = []
    for run in runs.signals:
        # Over some seconds: the noise of a position would add up to a way of its own.
        every = max(1, round(_FIX_S / usual_step_s(run.time_s)))
        path_m = np.concatenate(([0.0], np.cumsum(np.abs(run.speed_mps[:-1]) * np.diff(run.time_s))))[::every]
        straight = np.abs(np.diff(run.base_distance_m[::every]))
        away = straight > 0.5 * np.diff(path_m)  # not round a bend, where the distance from base says little
        covered_m = float(straight[away].sum())
        ratios.append(float(np.diff(path_m)[away].sum()) / covered_m if covered_m > 0.0 else 1.0)
    scale = np.array(ratios) / min(ratios, key=lambda ratio: abs(ratio - 1.0)) - 1.0
    scale[np.abs(scale) < _SAME_ODOMETER] = 0.0
    if not scale.any() or (scale <= -1.0).any():
        return
    off = WithEffects(
        setting.present.effects, setting.present.headwind_mps, setting.present.lag_s, (1.0 / (1.0 + scale)).tolist()
    )
    change = setting.parameters.predict(runs, setting.theta, off) - setting.predicted
    usual = float(np.mean(scale[scale != 0.0]))
    around = sorted((0.7 * usual, 1.3 * usual))
    yield Term("odometry_scale", change[:, None] / usual, _bound(around[0]), _bound(around[1]))


def _scheduled(effect: str, setting: Setting) -> Iterator[Term]:
    runs = setting.runs
    how, signed = _MAY_CHANGE[effect]
    if effect == "wind" and "heading_rad" in runs.context:
        return
    parameter = CATALOGUE[effect].parameters[0]
    shape = _shape_in_time(effect, setting, parameter)
    if shape is None:
        return
    axes: tuple[Axis, ...] = ("time", "place") if effect in _BY_PLACE else ("time",)
    for axis in axes:
        find = in_time if axis == "time" else by_place
        for schedule in find(shape, setting.residual, runs, signed=signed):
            natural = axis == "place" or _possible(how, schedule, runs)
            if not natural and how not in _PREFERENCES:
                continue
            natural = natural and effect not in _SELDOM_CHANGES
            rhythm, spread = _rhythm(effect, schedule, runs)
            low, high = _limits(effect, parameter, signed, schedule.levels - 1)
            # Noise with memory has no gaps between its levels, however many changes follow it.
            cost = 1 if schedule.apart > _CLEARLY_APART else _COST_OF_A_CHANGE
            hidden = cost * schedule.changes + int(not natural)
            yield Term(effect, schedule.columns(shape), low, high, hidden, rhythm, axis, schedule, spread, natural)
    if effect in _BY_PLACE:
        for columns in profile(shape, runs):
            yield Term(effect, columns, *_limits(effect, parameter, True, columns.shape[1]), axis="place")


def _limits(effect: str, parameter: Parameter, signed: bool, sizes: int) -> tuple[Array, Array]:
    if effect == "wind":
        return np.full(sizes, -_STORM_MPS), np.full(sizes, _STORM_MPS)
    return np.full(sizes, parameter.low if signed else 0.0), np.full(sizes, parameter.high)


def _shape_in_time(effect: str, setting: Setting, parameter: Parameter) -> Array | None:
    """What a unit of the size would add if the effect were at work all the time."""
    runs = setting.runs
    if effect in ("standby", "intermittent_load", "sensor_offset"):
        return np.ones(len(runs.observed))
    if effect == "sensor_gain":
        return setting.predicted
    if effect == "ageing":
        return np.maximum(setting.predicted, 0.0)
    if effect == "surface":
        added = WithEffects(setting.present.effects, setting.present.headwind_mps, setting.present.lag_s)
        change = 1e-3
        theta = setting.theta.copy()
        theta[ROLLING] *= 1.0 + change
        return (setting.parameters.predict(runs, theta, added) - setting.predicted) / change
    if effect == "wind":
        return _blowing(setting, [np.ones(len(run.time_s)) for run in runs.signals])
    return setting.response(effect, _TINY * parameter.high, {})


def _possible(how: Changes, schedule: Schedule, runs: Runs) -> bool:
    """Whether the size of an effect may change as a schedule says it does."""
    per_run = [schedule.level[runs.run == run] for run in np.unique(runs.run)]
    within = [np.flatnonzero(np.diff(level)) for level in per_run]
    if how == "between runs":
        return all(len(changes) == 0 for changes in within)
    if how == "once":
        return all(len(changes) <= 1 for changes in within)
    if how == "repeatedly":
        return any(len(changes) >= 2 for changes in within)
    speeds = np.abs(runs.context["speed_mps"])
    stood = []
    for run, changes in zip(np.unique(runs.run), within, strict=True):
        here = np.flatnonzero(runs.run == run)
        for change in changes:
            near = here[np.abs(runs.time_s[here] - runs.time_s[here[change]]) <= _AROUND_S]
            stood.append(bool((speeds[near] < _STANDS_MPS).any()))
    if how == "standing":
        return all(stood)
    return not stood or not all(stood)


def _rhythm(effect: str, schedule: Schedule, runs: Runs) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Mean period and share of time of what switches on and off, and their intervals over the cycles."""
    if effect != "intermittent_load":
        return {}, {}
    on = schedule.level > 0
    periods, duties = [], []
    for run in np.unique(runs.run):
        here = runs.run == run
        starts = np.flatnonzero(np.diff(on[here].astype(int)) > 0) + 1
        periods += np.diff(runs.time_s[here][starts]).tolist()
        duties += [float(on[here][a:b].mean()) for a, b in pairwise(starts)]
    if not periods:
        periods, duties = [2.0 * float(runs.duration_s.sum()) / max(schedule.changes, 1)], [float(on.mean())]
    found, spread = {}, {}
    for name, values, low, high in (("period_s", periods, 1.0, 1e5), ("duty", duties, 0.01, 0.99)):
        mean, wide = float(np.mean(values)), 2.0 * float(np.std(values)) / np.sqrt(len(values))
        found[name] = float(np.clip(mean, low, high))
        spread[name] = (max(mean - wide, low), min(mean + wide, high))
    return found, spread
