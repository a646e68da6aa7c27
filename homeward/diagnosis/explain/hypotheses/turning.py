"""Turning: scrub, where a robot's file has no track for several, the drag of steered wheels at their slip angle, or any
power that rises with the rate."""

from collections.abc import Iterator

import numpy as np

from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting, Term, responses
from homeward.physics.effects import Parameter
from homeward.physics.effects.turning import EFFECT

_TRACKS_M = (0.1, 0.2, 0.4, 0.8, 1.6)


def _tracks(setting: Setting) -> Iterator[dict[str, float]]:
    if setting.parameters.nominal.track_m > 0.0:
        yield {}
    else:
        yield from ({"track_m": track_m} for track_m in _TRACKS_M)


def _also_at_a_slip_angle(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Cornering drag of steered wheels, F_y^2 / C_alpha (Gillespie, Fundamentals of Vehicle Dynamics, ch. 6), W."""
    yield from responses(one, setting)
    speed, rate = (setting.runs.context.get(name) for name in ("speed_mps", "yaw_rate_radps"))
    if speed is not None and rate is not None:
        drag_w = np.abs(speed) * (speed * rate) ** 2
        most_w = float(np.max(np.abs(setting.runs.observed)))
        column = drag_w[:, None] / max(float(np.max(drag_w)), 1e-300)
        yield Term(one, column, np.zeros(1), np.array([most_w]), fixed=True, flexible=True)


HYPOTHESIS = Hypothesis(
    EFFECT,
    shapes=_tracks,
    steady=_also_at_a_slip_angle,
    rises_with="yaw_rate_radps",
    searched=(Parameter("track_m", "m", 0.02, 5.0, "distance between left and right wheels"),),
    shown_by=("yaw_rate_radps", "wheel_difference_mps"),
    otherwise="in turns",
    check="tow the robot sideways with a spring balance",
    at_wheels=True,
)
