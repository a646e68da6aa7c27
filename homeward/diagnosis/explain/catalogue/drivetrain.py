"""Effects on the power of the drive: turning, regeneration, losses of the windings, and motors that
warm up."""

from collections.abc import Iterator

import numpy as np

from homeward.diagnosis.explain.hypothesis import (
    TINY,
    Hypothesis,
    Numbers,
    Setting,
    Term,
    responses,
)
from homeward.physics.effects import (
    Parameter,
    copper_loss,
    inertia,
    motor_heating,
    regeneration,
    turning,
)

# tried where a file has no track; chosen: by factors of two, refined afterwards
_TRACKS_M = (0.1, 0.2, 0.4, 0.8, 1.6)
_TRACK = Parameter(
    name="track_m", unit="m", low=0.02, high=5.0, meaning="distance between left and right wheels"
)
# tried; chosen: a minute to half an hour, about threefold each
_TIME_CONSTANTS_S = (60.0, 200.0, 600.0, 1800.0)
# of a winding at mean load; chosen: only its product with per_k is estimated
_TYPICAL_RISE_K = 40.0
# of the braking power, tried as its largest; chosen: refined afterwards
_LIMIT_QUANTILES = (0.25, 0.5, 0.75)
_UP_TO_W = regeneration.EFFECT.parameters[1]
_HEATING = {parameter.name: parameter for parameter in motor_heating.EFFECT.parameters}


def _also_at_a_slip_angle(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Cornering drag of steered wheels, F_y^2 / C_alpha (Gillespie, Fundamentals of Vehicle
    Dynamics, ch. 6), W."""
    yield from responses(hypothesis, setting)
    speed_mps = setting.runs.context.get("speed_mps")
    rate_radps = setting.runs.context.get("yaw_rate_radps")
    if speed_mps is None or rate_radps is None:
        return
    # W but for a factor: the lateral force is m v w
    drag = np.abs(speed_mps) * (speed_mps * rate_radps) ** 2
    column = drag[:, None] / max(float(np.max(drag)), 1e-300)
    largest_w = float(np.max(np.abs(setting.runs.observed)))
    yield Term(
        hypothesis, column, low=np.zeros(1), high=np.array([largest_w]), fixed=True, flexible=True
    )


def _time_constants(setting: Setting) -> Iterator[Numbers]:
    """Time constants of the motors' warmth that the runs are long enough to show."""
    load_w = float(np.mean(np.maximum(setting.runs.observed, 0.0)))
    if load_w <= _TYPICAL_RISE_K / _HEATING["rise_k_per_w"].high:
        return  # hardly any power: wrong signs, or a robot at rest
    longest_s = max(float(np.ptp(run.time_s)) for run in setting.runs.signals)
    for time_constant_s in _TIME_CONSTANTS_S:
        if time_constant_s <= 2.0 * longest_s:
            # Rise and change per kelvin enter as a product, so that one of them can be fixed.
            yield {"time_constant_s": time_constant_s, "rise_k_per_w": _TYPICAL_RISE_K / load_w}


def _limits(setting: Setting) -> Iterator[Numbers]:
    """Braking powers from which friction brakes take over: none, and some that are reached."""
    yield {}
    braking_w = -setting.response(REGENERATION, TINY, {})
    braking_w = braking_w[braking_w > TINY * np.max(braking_w)]
    if len(braking_w) == 0:
        return
    for limit_w in np.unique(np.quantile(braking_w, _LIMIT_QUANTILES)):
        yield {_UP_TO_W.name: float(np.clip(limit_w, _UP_TO_W.low, _UP_TO_W.high))}


def _tracks(setting: Setting) -> Iterator[Numbers]:
    """Track widths that are tried: only its own where the robot file has one."""
    if setting.parameters.nominal.track_m > 0.0:
        yield {}
        return
    for track_m in _TRACKS_M:
        yield {_TRACK.name: track_m}


# On the level only inertia gives braking energy: without it nothing is regenerated.
REGENERATION = Hypothesis(
    regeneration.EFFECT,
    beside={inertia.EFFECT.id: {inertia.EFFECT.switch.name: 1.0}},
    shapes=_limits,
    searched=(_UP_TO_W,),
    times_efficiency=True,
    shown_by=("accel_mps2", "grade_rad"),
    check="put a clamp meter on the battery lead while braking",
)

HYPOTHESES = (
    Hypothesis(
        turning.EFFECT,
        shapes=_tracks,
        steady=_also_at_a_slip_angle,
        rises_with="yaw_rate_radps",
        searched=(_TRACK,),
        shown_by=("yaw_rate_radps", "wheel_difference_mps"),
        otherwise="in turns",
        check="tow the robot sideways with a spring balance",
        at_wheels=True,
    ),
    REGENERATION,
    Hypothesis(
        copper_loss.EFFECT,
        shown_by=("grade_rad", "accel_mps2"),
        otherwise="at high load",
        check="measure the resistance of the motor windings",
    ),
    Hypothesis(
        motor_heating.EFFECT,
        shapes=_time_constants,
        searched=(_HEATING["time_constant_s"],),
        shown_by=(),
        otherwise="as the motors warm up",
        check="put a thermometer on a motor for the length of a drive",
    ),
)
