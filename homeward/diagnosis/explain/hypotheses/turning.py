"""Turning: of a robot whose file has no track, several are tried."""

from collections.abc import Iterator

from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting
from homeward.physics.effects import Parameter
from homeward.physics.effects.turning import EFFECT

_TRACKS_M = (0.1, 0.2, 0.4, 0.8, 1.6)


def _tracks(setting: Setting) -> Iterator[dict[str, float]]:
    if setting.parameters.nominal.track_m > 0.0:
        yield {}
    else:
        yield from ({"track_m": track_m} for track_m in _TRACKS_M)


HYPOTHESIS = Hypothesis(
    EFFECT,
    shapes=_tracks,
    searched=(Parameter("track_m", "m", 0.02, 5.0, "distance between left and right wheels"),),
    shown_by=("yaw_rate_radps", "wheel_difference_mps"),
    otherwise="in turns",
    check="tow the robot sideways with a spring balance",
    at_wheels=True,
)
