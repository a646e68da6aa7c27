"""Hypotheses whose cause a recorded channel tells: what a unit of their size adds, at one size throughout.

What an effect adds comes from the kernel: the replay with the effect less the replay without it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from scipy.signal import lfilter

from homeward.diagnosis.hypotheses import CATALOGUE, STANDS_MPS, STORM_MPS, TINY, Setting, Term, missing_channels
from homeward.diagnosis.parameters import DRAG, WithEffects
from homeward.diagnosis.replay import Runs
from homeward.diagnosis.signals import Array, usual_step_s
from homeward.physics.effects import EFFECTS

_SAME_ODOMETER = 0.03
_FIX_S = 5.0
_TRACKS_M = (0.1, 0.2, 0.4, 0.8, 1.6)
_LAGS_S = tuple(sign * lag for lag in (0.2, 0.4, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0) for sign in (1.0, -1.0))

Shapes = Callable[[Runs], Iterator[dict[str, float]]]

ONLY_SCHEDULED = ("payload", "surface", "ageing", "standby", "intermittent_load", "sensor_offset", "sensor_gain")
"""Of these no channel tells when they are at work."""


def steady(effect: str, setting: Setting) -> Iterator[Term]:
    """Forms of an effect that recorded channels tell, at one size throughout.

    Args:
        effect: Its id.
        setting: What is known so far.
    """
    runs = setting.runs
    if effect in ONLY_SCHEDULED or missing_channels(effect, runs):
        return
    if effect == "wind":
        yield from _winds(setting)
    elif effect == "clock_lag":
        yield from _lags(setting)
    elif effect == "breakaway":
        yield from _starts(setting)
    elif effect == "odometry_scale":
        yield from _odometry(setting)
    elif effect in _SHAPES or effect in _PLAIN:
        yield from _responses(effect, setting)
        if effect == "heater":
            yield from _thermostat(setting)
        elif effect == "compute":
            yield from _on_the_move(setting)


def _responses(effect: str, setting: Setting) -> Iterator[Term]:
    """The effect at one size throughout, at each of a few values of its other parameters."""
    parameter = CATALOGUE[effect].parameters[0]
    size = TINY * max(abs(parameter.low), parameter.high)
    base = None
    if effect == "regeneration" and "inertia" not in setting.present.effects:
        # What brakes a robot on the level is its inertia: without it there is nothing to regenerate.
        present = setting.present
        base = WithEffects({**present.effects, "inertia": {"mass_factor": 1.0}}, present.headwind_mps, present.lag_s)
    shapes = list(_SHAPES[effect](setting.runs)) if effect in _SHAPES else [{}]
    if effect == "turning" and setting.parameters.nominal.track_m == 0.0:
        shapes = [{"track_m": track_m} for track_m in _TRACKS_M]
    for shape in shapes:
        column = setting.response(effect, size, shape, base)
        yield Term(effect, column[:, None], _bound(parameter.low), _bound(parameter.high), int(len(shapes) > 1), shape)


def _starts(setting: Setting) -> Iterator[Term]:
    """The energy of each start, drawn at once or over the first moments of the way."""
    parameter = CATALOGUE["breakaway"].parameters[0]
    at_once = setting.response("breakaway", TINY * parameter.high, {})
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
    moving = np.abs(setting.runs.context["speed_mps"]) > STANDS_MPS
    if moving.all():
        return
    for share in (1.0, 0.0):
        column = moving * setting.response("compute", TINY * parameter.high, {"base_share": share})
        yield Term(
            "compute", column[:, None], _bound(0.0), _bound(parameter.high), 1, {"base_share": share}, fixed=True
        )


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
    parts = [blowing(setting, [part(heading) for heading in headings]) for part in (np.cos, np.sin)]
    yield Term("wind", np.column_stack(parts), np.full(2, -STORM_MPS), np.full(2, STORM_MPS))


def blowing(setting: Setting, along: Sequence[Array]) -> Array:
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
    for lag_s in _LAGS_S:
        shifted = WithEffects(setting.present.effects, setting.present.headwind_mps, lag_s)
        change = setting.parameters.predict(setting.runs, setting.theta, shifted) - setting.predicted
        low, high = sorted((0.5 * lag_s, 1.5 * lag_s))
        yield Term("clock_lag", change[:, None] / lag_s, _bound(low), _bound(high), 1, {"lag_s": lag_s})


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
    if min(ratios) <= 0.0:
        return  # it moves without driving
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
