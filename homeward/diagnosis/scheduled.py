"""Hypotheses whose cause no channel tells: who put a load on the robot, and when.

The size of such an effect follows a schedule that is found from the residual, and how it may change tells the effects
apart: a load is put on where the robot stands, the ground changes while it moves, a battery ages between runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.hypotheses import CATALOGUE, STANDS_MPS, STORM_MPS, TINY, Setting, Term
from homeward.diagnosis.parameters import ROLLING, WithEffects
from homeward.diagnosis.replay import Runs
from homeward.diagnosis.schedules import Axis, Schedule, by_place, in_time, profiles
from homeward.diagnosis.signals import Array
from homeward.diagnosis.steady import blowing
from homeward.physics.effects import Parameter

_AROUND_S = 4.0  # a change that was found is taken to lie within this of the true one
_COST_OF_A_CHANGE = 3  # parameters: a moment that was searched for (Zhang & Siegmund, 2007)
_CLEARLY_APART = 4.0  # standard deviations

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


def scheduled(effect: str, setting: Setting) -> Iterator[Term]:
    """Forms of an effect whose size changes at moments or places that its residual shows.

    Args:
        effect: Its id.
        setting: What is known so far.
    """
    if effect not in _MAY_CHANGE:
        return
    runs = setting.runs
    how, signed = _MAY_CHANGE[effect]
    if effect == "wind" and "heading_rad" in runs.context:
        return
    parameter = CATALOGUE[effect].parameters[0]
    shape = _shape_in_time(effect, setting, parameter)
    if shape is None:
        return
    rolling_kg = float(setting.theta[ROLLING]) if effect == "surface" else None
    everywhere = np.ones(len(shape), np.bool_)
    axes: tuple[Axis, ...] = ("time", "place") if effect in _BY_PLACE else ("time",)
    for axis in axes:
        for schedule in schedules_of(effect, axis, shape, setting.residual, runs, everywhere):
            natural = axis == "place" or _possible(how, schedule, runs)
            if not natural and how not in _PREFERENCES:
                continue
            natural = natural and effect not in _SELDOM_CHANGES
            rhythm, spread = _rhythm(effect, schedule, runs)
            low, high = _limits(effect, parameter, signed, schedule.levels - 1)
            # Noise with memory has no gaps between its levels, however many changes follow it.
            cost = 1 if schedule.apart > _CLEARLY_APART else _COST_OF_A_CHANGE
            hidden = cost * schedule.changes + int(not natural)
            at_work = schedule.at_work()
            yield Term(effect, shape[:, None] * at_work, low, high, hidden, rhythm, axis, schedule, spread, natural,
                       of_rolling_kg=rolling_kg, load=shape, at_work=at_work)  # fmt: skip
    if effect == "sensor_offset":
        yield _drift(runs)
    if effect in _BY_PLACE:
        for hats in profiles(runs):
            yield Term(effect, shape[:, None] * hats, *_limits(effect, parameter, True, hats.shape[1]), axis="place",
                       of_rolling_kg=rolling_kg, load=shape, at_work=hats)  # fmt: skip


def schedules_of(
    effect: str, axis: Axis, load: Array, residual: Array, runs: Runs, told: NDArray[np.bool_]
) -> list[Schedule]:
    """Schedules that a search in some of the windows finds, of few changes to many.

    Args:
        effect: Id of the effect.
        axis: What its size depends on.
        load: What a unit of its size adds where it is at work, shape (windows,).
        residual: What is to be explained.
        runs: The runs.
        told: Windows that the search may look at; the others have the level of those before them.
    """
    find = in_time if axis == "time" else by_place
    return find(load * told, residual * told, runs, signed=_MAY_CHANGE[effect][1])


def changes_repeatedly(effect: str) -> bool:
    """Whether an effect comes and goes, rather than once."""
    return _MAY_CHANGE[effect][0] == "repeatedly"


def _drift(runs: Runs) -> Term:
    """A zero that creeps through all runs, taken in their order: per unit of what it comes to in the end."""
    parameter = CATALOGUE["sensor_offset"].parameters[0]
    passed = np.cumsum(runs.duration_s)
    column = (passed / passed[-1])[:, None]
    return Term("sensor_offset", column, np.array([parameter.low]), np.array([parameter.high]), axis="time")


def _limits(effect: str, parameter: Parameter, signed: bool, sizes: int) -> tuple[Array, Array]:
    if effect == "wind":
        return np.full(sizes, -STORM_MPS), np.full(sizes, STORM_MPS)
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
        return blowing(setting, [np.ones(len(run.time_s)) for run in runs.signals])
    return setting.response(effect, TINY * parameter.high, {})


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
            stood.append(bool((speeds[near] < STANDS_MPS).any()))
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
