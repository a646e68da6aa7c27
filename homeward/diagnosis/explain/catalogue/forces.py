"""Effects on the force at the wheels: inertia, friction that grows with speed, wind, ground, load, slope and slip."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from homeward.diagnosis.explain.hypothesis import CHECKS, SMALL_STEP, Hypothesis, Numbers, Setting, Term, level_name
from homeward.diagnosis.explain.menu import Drive
from homeward.diagnosis.fit.parameter_groups import DRAG, ROLLING
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.logs.channels import Array
from homeward.physics.effects import air_temperature, hidden_grade, inertia, payload, slip, surface, viscous, wind

_STORM_MPS = 40.0  # chosen: above the lower limit of a hurricane, 33 m/s on the Beaufort scale
_EXPOSED = {"exposure": 1.0}


def _rougher(hypothesis: Hypothesis, setting: Setting) -> Array:
    """Contribution per unit of relative rise of the rolling resistance, W or A, shape (windows,)."""
    theta = setting.theta.copy()
    theta[ROLLING] += SMALL_STEP * setting.rolling_kg
    return (setting.parameters.predict(setting.runs, theta, setting.present) - setting.predicted) / SMALL_STEP


def _rougher_drive(hypothesis: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    rougher = drive.fit.theta.copy()
    rougher[ROLLING] *= 1.0 + max(size, -0.9)
    return drive.there(hypothesis.lies_in) * (drive.predict(rougher) - drive.plain)


def _from_one_direction(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """A steady wind, from ahead and from the left."""
    if headings := _headings(setting.runs):
        parts = [_blowing(setting, [part(heading) for heading in headings]) for part in (np.cos, np.sin)]
        yield Term(hypothesis, np.column_stack(parts), *hypothesis.limits(2))


def _against_the_way(hypothesis: Hypothesis, setting: Setting) -> Array | None:
    """Without a heading, a wind that changes on the way."""
    runs = setting.runs
    if _headings(runs):
        return None
    return _blowing(setting, [np.ones(len(run.time_s)) for run in runs.signals])


def _headings(runs: Runs) -> list[Array]:
    """Heading of each run, rad; none where one lacks it, in part or altogether."""
    headings = [run.context["heading_rad"] for run in runs.signals if "heading_rad" in run.context]
    whole = len(headings) == len(runs.signals) and all(np.isfinite(heading).all() for heading in headings)
    return headings if whole else []


def _blowing(setting: Setting, along: Sequence[Array]) -> Array:
    """Contribution of a headwind of 1 m/s times its component `along` the way, an array per run."""
    theta, present, predict = setting.theta.copy(), setting.present, setting.parameters.predict
    theta[DRAG] = max(theta[DRAG], setting.parameters.start[DRAG])  # a refit without wind may underestimate it
    speed_mps = 1e-3
    windy = _blown(present, [speed_mps * one for one in along])
    change = predict(setting.runs, theta, windy) - predict(setting.runs, theta, present)
    return np.asarray(change / speed_mps)


def _blown(so_far: WithEffects, headwind_mps: Sequence[Array]) -> WithEffects:
    return replace(so_far, effects={**so_far.effects, wind.EFFECT.id: _EXPOSED}, headwind_mps=headwind_mps)


def _wind_names(term: Term) -> list[tuple[str, str]]:
    if term.axis == "steady":
        return [("from_ahead_mps", "m/s"), ("from_left_mps", "m/s")]
    sizes = term.columns.shape[1]
    return [(level_name("headwind_mps", size, sizes), "m/s") for size in range(sizes)]


def _in_the_wind(hypothesis: Hypothesis, so_far: WithEffects, numbers: Numbers, runs: Runs) -> WithEffects:
    ahead, left = numbers.values()
    return _blown(so_far, [ahead * np.cos(heading) + left * np.sin(heading) for heading in _headings(runs)])


def _windy_drive(hypothesis: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    exposed = drive.fit.theta.copy()
    exposed[DRAG] = max(exposed[DRAG], drive.fit.parameters.start[DRAG])
    windy = _blown(WithEffects(), [size * np.cos(drive.runs.signals[0].context["heading_rad"])])
    return drive.predict(exposed, windy) - drive.predict(exposed)


HYPOTHESES = (
    Hypothesis(
        inertia.EFFECT,
        shown_by=("accel_mps2",),
        otherwise="when speeding up",
        check="let the robot coast to a stop on level ground and log its speed",
    ),
    # Of the bearings, or of ground that changes on the way.
    Hypothesis(viscous.EFFECT, changes="moving", by_place=True, check=CHECKS["drive"]),
    Hypothesis(
        wind.EFFECT,
        steady=_from_one_direction,
        changes="moving",
        signed=True,
        load=_against_the_way,
        bounds=(-_STORM_MPS, _STORM_MPS),
        size_names=_wind_names,
        within=_in_the_wind,
        is_weather=True,
        shown_by=("heading_rad",),
        check="measure the wind with an anemometer, or repeat the drive on a calm day",
        on_drive=_windy_drive,
    ),
    # Ground with a higher or lower rolling resistance from some place or moment on: a share of it.
    Hypothesis(
        surface.EFFECT,
        steady=None,
        changes="moving",
        signed=True,
        by_place=True,
        map_channel="grade_rad",
        of_rolling=True,
        load=_rougher,
        shown_by=("base_distance_m",),
        lies_in="ground",
        on_drive=_rougher_drive,
    ),
    Hypothesis(
        air_temperature.EFFECT,
        shown_by=("temperature_c",),
        otherwise="in the cold",
        check="let the robot coast to a stop on level ground on a cold and on a warm day",
    ),
    # A load is typically added at standstill.
    Hypothesis(
        payload.EFFECT,
        steady=None,
        changes="standing",
        shown_by=(),
        check="weigh the robot as it drove",
        lies_in="load",
    ),
    # A slope that the map lacks: on the route where it was found, and not on chosen level ground.
    Hypothesis(
        hidden_grade.EFFECT,
        changes="moving",
        signed=True,
        by_place=True,
        most_changes=0,
        map_channel="grade_rad",
        shown_by=("base_distance_m",),
        check="survey the slope of the route with a level",
        lies_in="route",
    ),
    Hypothesis(
        slip.EFFECT,
        shown_by=("grade_rad", "accel_mps2"),
        otherwise="at high load",
        check="compare wheel revolutions with the distance along a tape measure on a slope",
    ),
)
