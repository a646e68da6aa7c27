"""Wind: by the heading a steady one, from ahead and from the left; without a heading one that changes on the way."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from homeward.diagnosis.explain.drive import Drive
from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting, Term, level_name
from homeward.diagnosis.fit.parameter_groups import DRAG, WithEffects
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array
from homeward.physics.effects.wind import EFFECT

_STORM_MPS = 40.0  # no wind is stronger
_EXPOSED = {"exposure": 1.0}


def _from_one_direction(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    headings = [run.context["heading_rad"] for run in setting.runs.signals]
    if all(np.isfinite(heading).all() for heading in headings):
        parts = [_blowing(setting, [part(heading) for heading in headings]) for part in (np.cos, np.sin)]
        yield Term(one, np.column_stack(parts), *one.limits(2))


def _against_the_way(one: Hypothesis, setting: Setting) -> Array | None:
    runs = setting.runs
    return (
        None if "heading_rad" in runs.context else _blowing(setting, [np.ones(len(run.time_s)) for run in runs.signals])
    )


def _blowing(setting: Setting, along: Sequence[Array]) -> Array:
    """What a wind of 1 m/s against the way adds, where `along` is its component, an array per run."""
    theta, present, predict = setting.theta.copy(), setting.present, setting.parameters.predict
    theta[DRAG] = max(theta[DRAG], setting.parameters.start[DRAG])  # what a refit without wind took away from it
    speed_mps = 1e-3
    windy = _blown(present, [speed_mps * one for one in along])
    change = predict(setting.runs, theta, windy) - predict(setting.runs, theta, present)
    return np.asarray(change / speed_mps)


def _blown(so_far: WithEffects, headwind_mps: Sequence[Array]) -> WithEffects:
    return replace(so_far, effects={**so_far.effects, EFFECT.id: _EXPOSED}, headwind_mps=headwind_mps)


def _names(term: Term) -> list[tuple[str, str]]:
    if term.axis == "steady":
        return [("from_ahead_mps", "m/s"), ("from_left_mps", "m/s")]
    sizes = term.columns.shape[1]
    return [(level_name("headwind_mps", size, sizes), "m/s") for size in range(sizes)]


def _within(one: Hypothesis, so_far: WithEffects, numbers: Mapping[str, float], runs: Runs) -> WithEffects:
    ahead, left = numbers.values()
    headings = [run.context["heading_rad"] for run in runs.signals]
    return _blown(so_far, [ahead * np.cos(heading) + left * np.sin(heading) for heading in headings])


def _on_drive(one: Hypothesis, drive: Drive, size: float, shape: Mapping[str, float]) -> Array:
    exposed = drive.fit.theta.copy()
    exposed[DRAG] = max(exposed[DRAG], drive.fit.parameters.start[DRAG])
    windy = _blown(WithEffects(), [size * np.cos(drive.course.heading_rad)])
    return drive.predict(exposed, windy) - drive.predict(exposed)


HYPOTHESIS = Hypothesis(
    EFFECT,
    steady=_from_one_direction,
    changes="moving",
    signed=True,
    load=_against_the_way,
    bounds=(-_STORM_MPS, _STORM_MPS),
    size_names=_names,
    within=_within,
    of_the_day=True,
    shown_by=("heading_rad",),
    check="measure the wind with an anemometer, or repeat the drive on a calm day",
    on_drive=_on_drive,
)
