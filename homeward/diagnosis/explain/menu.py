"""The menu of test drives: a few manoeuvres that a roboticist can drive, each as a sentence and as a drive to simulate.

All have the same number of samples, so that none gains information by its length. Where a drive changes something that
no channel records (devices switched on, load, ground), the drive gives its times.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import WithEffects, average
from homeward.diagnosis.read.signals import Signals, Unit
from homeward.logs.channels import Array
from homeward.physics import Robot

SAMPLES = 300
"""Samples of each drive: five minutes at 1 Hz, a longer drive at a lower rate. Chosen."""

KNOWN_MASS = 0.2
"""Mass that is put on the robot in the drive with a known mass, over its own. Chosen: the largest at `uncertain`."""

_ACROSS_RAD = np.pi / 2.0  # heading across the wind, which then has no component along the way


@dataclass(frozen=True)
class Manoeuvre:
    """One entry of the menu: its instruction in one sentence, and its drive, each level constant or of (SAMPLES,)."""

    id: str
    sentence: str
    speed: Array | float = 0.0  # over the top speed
    turning: Array | float = 0.0  # over that of turning on the spot with the wheels at half of the top speed
    yaw_rate_radps: float = 0.0  # beside it
    heading_rad: Array | None = None  # None: first across the wind, and then as the robot turns
    grade_rad: Array | float = 0.0
    sensing: Array | float = 0.0  # over the fastest
    temperature_c: Array | None = None  # None: as in the recordings at hand
    base_distance_s: Array | float = 0.0  # at top speed
    switched_on: Array | float = 1.0  # 0: everything is off
    known_mass: Array | float = 0.0  # carried on top, over the robot's own
    step_s: Array | float = 1.0
    there: Mapping[str, Array | float] = field(default_factory=dict)  # share of the recordings' load, ground, route

    def signals(self, robot: Robot, unit: Unit, mean_c: float) -> Signals:
        """The drive of a robot as a recording; headings count from where the wind comes from."""
        fastest, steps_s = robot.max_speed_mps, _each(self.step_s)
        time_s = np.concatenate([[0.0], np.cumsum(steps_s[:-1])])
        speed, sensing_hz = fastest * _each(self.speed), robot.max_sensing_hz * _each(self.sensing)
        turning = _each(self.turning) * (fastest / robot.track_m if robot.track_m > 0.0 else 1.0)
        heading = _ACROSS_RAD + np.cumsum(turning * steps_s) if self.heading_rad is None else self.heading_rad
        return Signals(
            "menu", unit, time_s, speed, np.gradient(speed, time_s), _each(self.grade_rad), sensing_hz,
            turning + self.yaw_rate_radps, _each(mean_c if self.temperature_c is None else self.temperature_c),
            fastest * _each(self.base_distance_s), np.ones(SAMPLES), np.zeros(SAMPLES),
            {"speed_mps": speed, "sensing_hz": sensing_hz, "heading_rad": heading},
        )  # fmt: skip


class Drive:
    """A manoeuvre of the refitted robot: its simulated recording, without any effect and with some."""

    def __init__(self, fit: Refit, manoeuvre: Manoeuvre, unit: Unit, mean_c: float) -> None:
        self.fit, self.manoeuvre = fit, manoeuvre
        self.runs = average([manoeuvre.signals(fit.parameters.nominal, unit, mean_c)])
        self.plain = self.predict(fit.theta)

    def there(self, what: str | None) -> Array | float:
        """Share of the load, the ground or the route of the recordings that is present, shape (samples,).

        A hidden slope is on the route where it was found, and not on chosen level ground.
        """
        return 1.0 if what is None else {"route": 0.0, **self.manoeuvre.there}.get(what, 1.0)

    def predict(self, theta: Array, extra: WithEffects | None = None) -> Array:
        """Simulated power, W, or current, A, shape (samples,); zero where everything is off."""
        predict = self.fit.parameters.predict
        power, on_top = predict(self.runs, theta, extra), self.manoeuvre.known_mass
        if np.any(on_top):
            loaded, on_top_kg = theta.copy(), KNOWN_MASS * self.fit.parameters.nominal.mass_kg
            loaded[ROLLING] *= 1.0 + on_top_kg / theta[MASS]
            loaded[MASS] += on_top_kg
            power = np.where(np.greater(on_top, 0.0), predict(self.runs, loaded, extra), power)
        return power * self.manoeuvre.switched_on


def _each(level: Array | float) -> Array:
    return np.full(SAMPLES, level, dtype=np.float64)


def _held(*levels: float, times: int = 1) -> Array:
    """Levels held in turn for equally long, the whole series some times over."""
    series = np.tile(levels, times)
    return np.asarray(series[np.arange(SAMPLES) * len(series) // SAMPLES], dtype=np.float64)


_STOP_AND_GO = np.tile([0.0, 0.0, 0.5, 1.0, 1.0, 0.5], SAMPLES // 6)  # speeding up and slowing down within two seconds
_OUT_AND_BACK = np.minimum(np.arange(SAMPLES), SAMPLES - 1 - np.arange(SAMPLES))

MENU = (
    Manoeuvre("three_speeds", "drive straight over level ground, slowly, at medium and at top speed, with stops",
              speed=_held(0.0, 0.35, 0.7, 1.0, times=3)),
    Manoeuvre("stop_and_go", "stop and go: speed up and brake as hard as the robot can, again and again",
              speed=_STOP_AND_GO),
    Manoeuvre("on_the_spot", "turn on the spot, or as tightly as the robot can, both ways, slowly and fast",
              turning=_held(0.0, 1.0, -1.0, 0.5, -0.5, times=3)),
    Manoeuvre("figure_eight", "drive figures of eight at half speed on level ground",
              speed=0.5, turning=_held(0.5, -0.5, times=10)),
    Manoeuvre("slope", "drive up and down slopes of known angle, a gentle one and a steep one, at two speeds",
              speed=_held(0.4, 0.7), grade_rad=_held(0.0, 0.05, -0.05, 0.1, -0.1, times=2)),
    Manoeuvre("both_ways", "drive the same level straight both ways, into the wind and with it, at two speeds",
              speed=_held(0.5, 1.0), heading_rad=_held(0.0, np.pi, times=5)),
    Manoeuvre("on_and_off", "stand with everything switched on, then with everything off, a few times",
              sensing=_held(1.0, 0.0, times=3), switched_on=_held(1.0, 0.0, times=3)),
    Manoeuvre("sweep", "stand and step the sensing rate from zero to its maximum",
              sensing=_held(0.0, 0.25, 0.5, 0.75, 1.0, times=2)),
    Manoeuvre("known_mass", "drive the same straight as it is, then with all load off, then with a known mass on top",
              speed=0.7, known_mass=_held(0.0, 0.0, KNOWN_MASS), there={"load": _held(1.0, 0.0, 0.0)}),
    Manoeuvre("full_load", "drive at top speed for an hour, starting with cold motors",
              speed=1.0, step_s=3600.0 / SAMPLES),
    Manoeuvre("cold_and_warm", "stand and drive the same way on a cold morning and at a warm noon",
              speed=_held(0.0, 0.7, times=2), temperature_c=_held(0.0, 30.0)),
    Manoeuvre("long_pause", "drive the same route twice with a pause of an hour or more in between",
              speed=_held(1.0, 0.0, 1.0), step_s=_held(12.0, 36.0, 12.0), there={"route": 1.0}),
    Manoeuvre("far_and_back", "drive the same route far out from base and back",
              speed=0.7, step_s=6.0, base_distance_s=0.7 * 6.0 * _OUT_AND_BACK, heading_rad=_held(0.0, np.pi),
              there={"route": 1.0}),
    Manoeuvre("other_ground", "drive the same loop here and then on other ground",
              speed=0.5, yaw_rate_radps=10.0 * np.pi / SAMPLES, heading_rad=np.linspace(0.0, 10.0 * np.pi, SAMPLES),
              there={"ground": _held(1.0, 0.0), "route": _held(1.0, 0.0)}),
)  # fmt: skip
"""Everything that may be advised, quick ones first."""
