"""Effects on the power of the drive: turning, regeneration, losses of the windings, and motors that warm up."""

from collections.abc import Iterator

import numpy as np

from homeward.diagnosis.explain.hypothesis import TINY, Hypothesis, Numbers, Setting, Term, responses
from homeward.physics.effects import Parameter, copper_loss, inertia, motor_heating, regeneration, turning

_TRACKS_M = (0.1, 0.2, 0.4, 0.8, 1.6)  # tried where a file has no track; chosen: by factors of two, refined afterwards
_CONSTANTS_S = (60.0, 200.0, 600.0, 1800.0)  # tried; chosen: a minute to half an hour, about threefold each
_TYPICAL_RISE_K = 40.0  # of a winding at mean load; chosen: only its product with per_k is estimated
_LIMITS = (0.25, 0.5, 0.75)  # quantiles of the braking power, tried as its largest; chosen: refined afterwards
_UP_TO_W = regeneration.EFFECT.parameters[1]
_HEATING = {parameter.name: parameter for parameter in motor_heating.EFFECT.parameters}


def _also_at_a_slip_angle(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Cornering drag of steered wheels, F_y^2 / C_alpha (Gillespie, Fundamentals of Vehicle Dynamics, ch. 6), W."""
    yield from responses(hypothesis, setting)
    speed, rate = (setting.runs.context.get(name) for name in ("speed_mps", "yaw_rate_radps"))
    if speed is not None and rate is not None:
        drag_w = np.abs(speed) * (speed * rate) ** 2
        most_w = float(np.max(np.abs(setting.runs.observed)))
        column = drag_w[:, None] / max(float(np.max(drag_w)), 1e-300)
        yield Term(hypothesis, column, np.zeros(1), np.array([most_w]), fixed=True, flexible=True)


def _time_constants(setting: Setting) -> Iterator[Numbers]:
    work_w = float(np.mean(np.maximum(setting.runs.observed, 0.0)))
    if work_w <= _TYPICAL_RISE_K / _HEATING["rise_k_per_w"].high:
        return  # hardly any power: wrong signs, or a robot at rest
    longest_s = max(float(np.ptp(run.time_s)) for run in setting.runs.signals)
    for constant_s in _CONSTANTS_S:
        if constant_s <= 2.0 * longest_s:
            # Rise and change per kelvin enter as a product, so that one of them can be fixed.
            yield {"time_constant_s": constant_s, "rise_k_per_w": _TYPICAL_RISE_K / work_w}


def _limits(setting: Setting) -> Iterator[Numbers]:
    """Braking powers from which friction brakes take over: none, and some that are reached."""
    yield {}
    braking_w = -setting.response(REGENERATION, TINY, {})
    braking_w = braking_w[braking_w > TINY * np.max(braking_w)]
    for value in np.unique(np.quantile(braking_w, _LIMITS)) if len(braking_w) else []:
        yield {_UP_TO_W.name: float(np.clip(value, _UP_TO_W.low, _UP_TO_W.high))}


# On the level only inertia gives braking energy: without it nothing is regenerated.
REGENERATION = Hypothesis(
    regeneration.EFFECT,
    beside={inertia.EFFECT.id: {inertia.EFFECT.switch.name: 1.0}},
    shapes=_limits,
    searched=(_UP_TO_W,),
    shown_by=("accel_mps2", "grade_rad"),
    check="put a clamp meter on the battery lead while braking",
)

HYPOTHESES = (
    Hypothesis(
        turning.EFFECT,
        shapes=lambda setting: iter(
            [{}] if setting.parameters.nominal.track_m > 0.0 else [{"track_m": one} for one in _TRACKS_M]
        ),
        steady=_also_at_a_slip_angle,
        rises_with="yaw_rate_radps",
        searched=(Parameter("track_m", "m", 0.02, 5.0, "distance between left and right wheels"),),
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
