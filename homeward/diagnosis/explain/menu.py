"""The menu of test drives: a few manoeuvres that a roboticist can drive, each as a sentence and as a drive to simulate.

All have the same number of samples, so that none wins by being recorded for longer. Where a drive changes something
that no channel holds (what is switched on, what is carried, which ground it is), the drive says when.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.read.signals import Array, Signals, Unit
from homeward.physics import Robot

SAMPLES = 300
"""Samples of each drive: five minutes at 1 Hz, a longer drive at a lower rate."""

KNOWN_MASS = 0.2
"""Mass that is put on the robot in the drive with a known mass, over the robot's own."""

_ACROSS_RAD = np.pi / 2.0  # heading across the wind, which then neither pushes nor holds


@dataclass(frozen=True)
class Course:
    """What a drive does and meets, arrays of shape (SAMPLES,); headings count from where the wind comes from.

    Where a drive does not ask for warm or cold air the temperature is NaN: as in the recordings at hand.
    `there` says how much of the load, the ground and the route of the recordings is there, 1 if not listed: a hidden
    slope is on the route where it was met, and not on level ground that one chooses.
    """

    time_s: Array
    speed_mps: Array
    yaw_rate_radps: Array
    grade_rad: Array
    heading_rad: Array
    sensing_hz: Array
    temperature_c: Array
    base_distance_m: Array
    switched_on: Array  # 0: everything is off, 1: as usual
    known_mass: Array  # carried on top, over the robot's own mass
    there: Mapping[str, Array] = field(default_factory=dict)

    def runs(self, unit: Unit, usual_c: float) -> Runs:
        """The drive in the form of recordings, one window a sample, in `usual_c` where it asks for no temperature."""
        temperature_c = np.where(np.isnan(self.temperature_c), usual_c, self.temperature_c)
        accel = np.gradient(self.speed_mps, self.time_s)
        context = {"speed_mps": self.speed_mps, "sensing_hz": self.sensing_hz}
        signals = Signals(
            "menu", unit, self.time_s, self.speed_mps, accel, self.grade_rad, self.sensing_hz, self.yaw_rate_radps,
            temperature_c, self.base_distance_m, np.ones(SAMPLES), np.zeros(SAMPLES), context,
        )  # fmt: skip
        return average([signals])


@dataclass(frozen=True)
class Manoeuvre:
    """One entry of the menu: what to do, in one plain sentence, and its drive, each level constant or of (SAMPLES,)."""

    id: str
    sentence: str
    speed: Array | float = 0.0  # over the top speed
    turning: Array | float = 0.0  # over that of turning on the spot with the wheels at half of the top speed
    yaw_rate_radps: float = 0.0  # beside it
    heading_rad: Array | None = None  # None: first across the wind, and then as the robot turns
    grade_rad: Array | float = 0.0
    sensing: Array | float = 0.0  # over the fastest
    temperature_c: Array | float = np.nan
    base_distance_s: Array | float = 0.0  # at top speed
    switched_on: Array | float = 1.0
    known_mass: Array | float = 0.0
    step_s: Array | float = 1.0
    there: Mapping[str, Array | float] = field(default_factory=dict)

    def course(self, robot: Robot) -> Course:
        """The drive of a robot."""
        fastest = robot.max_speed_mps
        steps_s, turning = _each(self.step_s), _each(self.turning)
        turning = turning * (fastest / robot.track_m if robot.track_m > 0.0 else 1.0)
        return Course(
            time_s=np.concatenate([[0.0], np.cumsum(steps_s[:-1])]),
            speed_mps=fastest * _each(self.speed),
            yaw_rate_radps=turning + self.yaw_rate_radps,
            grade_rad=_each(self.grade_rad),
            heading_rad=_ACROSS_RAD + np.cumsum(turning * steps_s) if self.heading_rad is None else self.heading_rad,
            sensing_hz=robot.max_sensing_hz * _each(self.sensing),
            temperature_c=_each(self.temperature_c),
            base_distance_m=fastest * _each(self.base_distance_s),
            switched_on=_each(self.switched_on),
            known_mass=_each(self.known_mass),
            there={what: _each(share) for what, share in {"route": 0.0, **self.there}.items()},
        )


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
