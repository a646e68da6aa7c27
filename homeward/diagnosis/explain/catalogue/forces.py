"""Effects on the force at the wheels: inertia, friction that grows with speed, wind, ground, load,
slope and slip."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from homeward.diagnosis.explain.hypothesis import (
    CHECKS,
    SMALL_STEP,
    Hypothesis,
    Numbers,
    Setting,
    Term,
    level_name,
)
from homeward.diagnosis.explain.menu import Drive
from homeward.diagnosis.fit.parameter_groups import DRAG, ROLLING
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.logs.channels import Array
from homeward.physics.effects import (
    air_temperature,
    hidden_grade,
    inertia,
    payload,
    slip,
    surface,
    viscous,
    wind,
)

_STORM_MPS = 40.0  # chosen: above the lower limit of a hurricane, 33 m/s on the Beaufort scale
_EXPOSED = {"exposure": 1.0}


def _rougher(hypothesis: Hypothesis, setting: Setting) -> Array:
    """Contribution per unit of relative rise of the rolling resistance, W or A, shape
    (windows,)."""
    theta = setting.theta.copy()
    theta[ROLLING] += SMALL_STEP * setting.rolling_kg
    return (
        setting.parameters.predict(setting.runs, theta, setting.present) - setting.predicted
    ) / SMALL_STEP


def _rougher_drive(hypothesis: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    rougher = drive.fit.theta.copy()
    rougher[ROLLING] *= 1.0 + max(size, -0.9)
    return drive.there(hypothesis.lies_in) * (drive.predict(rougher) - drive.plain)


def _from_one_direction(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """A steady wind, from ahead and from the left."""
    headings = _headings(setting.runs)
    if not headings:
        return
    from_ahead = _blowing(setting, [np.cos(heading) for heading in headings])
    from_left = _blowing(setting, [np.sin(heading) for heading in headings])
    low, high = hypothesis.limits(2)
    yield Term(hypothesis, np.column_stack([from_ahead, from_left]), low=low, high=high)


def _against_the_way(hypothesis: Hypothesis, setting: Setting) -> Array | None:
    """Without a heading, a wind that changes on the way."""
    runs = setting.runs
    if _headings(runs):
        return None
    return _blowing(setting, [np.ones(len(run.time_s)) for run in runs.signals])


def _headings(runs: Runs) -> list[Array]:
    """Heading of each run, rad; none where one lacks it, in part or altogether."""
    headings = [run.context["heading_rad"] for run in runs.signals if "heading_rad" in run.context]
    is_complete = len(headings) == len(runs.signals) and all(
        np.isfinite(heading).all() for heading in headings
    )
    return headings if is_complete else []


def _blowing(setting: Setting, along: Sequence[Array]) -> Array:
    """Contribution of a headwind of 1 m/s times its component `along` the way, an array per run."""
    theta = setting.theta.copy()
    # a refit without wind may underestimate it
    theta[DRAG] = max(theta[DRAG], setting.parameters.start[DRAG])
    wind_mps = 1e-3  # small: the contribution is linear in it
    windy = _blown(setting.present, [wind_mps * component for component in along])
    predicted = setting.parameters.predict(setting.runs, theta, windy)
    predicted_calm = setting.parameters.predict(setting.runs, theta, setting.present)
    return np.asarray((predicted - predicted_calm) / wind_mps)


def _blown(so_far: WithEffects, headwind_mps: Sequence[Array]) -> WithEffects:
    return replace(
        so_far, effects={**so_far.effects, wind.EFFECT.id: _EXPOSED}, headwind_mps=headwind_mps
    )


def _wind_names(term: Term) -> list[tuple[str, str]]:
    if term.axis == "steady":
        return [("from_ahead_mps", "m/s"), ("from_left_mps", "m/s")]
    sizes = term.columns.shape[1]
    return [(level_name("headwind_mps", size, sizes), "m/s") for size in range(sizes)]


def _in_the_wind(
    hypothesis: Hypothesis, so_far: WithEffects, numbers: Numbers, runs: Runs
) -> WithEffects:
    ahead_mps, left_mps = numbers.values()
    headwind_mps = []
    for heading in _headings(runs):
        headwind_mps.append(ahead_mps * np.cos(heading) + left_mps * np.sin(heading))
    return _blown(so_far, headwind_mps)


def _windy_drive(hypothesis: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    exposed = drive.fit.theta.copy()
    exposed[DRAG] = max(exposed[DRAG], drive.fit.parameters.start[DRAG])
    (run,) = drive.runs.signals
    windy = _blown(WithEffects(), [size * np.cos(run.context["heading_rad"])])
    return drive.predict(exposed, windy) - drive.predict(exposed)


HYPOTHESES = (
    Hypothesis(
        inertia.EFFECT,
        shown_by=("accel_mps2",),
        otherwise="when speeding up",
        check="let the robot coast to a stop on level ground and log its speed",
    ),
    Hypothesis(viscous.EFFECT, check=CHECKS["drive"]),
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
