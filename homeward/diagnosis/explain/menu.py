"""The menu of test drives: a few manoeuvres that a roboticist can drive, each as a sentence and as a drive to simulate.

All have the same number of samples, so that none wins by being recorded for longer. Where a drive changes something
that no channel holds (what is switched on, what is carried, which ground it is), the drive says when.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.read.signals import Array, Signals, Unit
from homeward.physics import Robot

SAMPLES = 300
"""Samples of each drive: five minutes at 1 Hz, a longer drive at a lower rate."""

KNOWN_MASS = 0.2
"""Mass that is put on the robot in the drive with a known mass, over the robot's own."""

_COLD_C, _WARM_C = 0.0, 30.0
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
        """The drive in the form of recordings, one window a sample.

        Args:
            unit: What is recorded.
            usual_c: Temperature where the drive asks for none.
        """
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
    """One entry of the menu: what to do, in one plain sentence, and its drive for a robot."""

    id: str
    sentence: str
    course: Callable[[Robot], Course]


def _course(step_s: float | Array = 1.0, there: Mapping[str, Array] | None = None, **channels: float | Array) -> Course:
    steps = np.broadcast_to(step_s, (SAMPLES,))
    given = {"heading_rad": _ACROSS_RAD, "temperature_c": np.nan, "switched_on": 1.0} | channels
    names = [name for name in Course.__dataclass_fields__ if name not in ("time_s", "there")]
    arrays = {name: np.array(np.broadcast_to(given.get(name, 0.0), (SAMPLES,)), dtype=np.float64) for name in names}
    off_the_route = {"route": np.zeros(SAMPLES)}
    return Course(np.concatenate([[0.0], np.cumsum(steps[:-1])]), **arrays, there={**off_the_route, **(there or {})})


def _held(*levels: float, times: int = 1) -> Array:
    """Levels held in turn for equally long, the whole series some times over."""
    series = np.tile(levels, times)
    values: Array = series[np.arange(SAMPLES) * len(series) // SAMPLES].astype(np.float64)
    return values


def _quick_turn(robot: Robot) -> float:
    """Turning rate on the spot with the wheels at half of the top speed, rad/s."""
    return robot.max_speed_mps / robot.track_m if robot.track_m > 0.0 else 1.0


def _three_speeds(robot: Robot) -> Course:
    return _course(speed_mps=robot.max_speed_mps * _held(0.0, 0.35, 0.7, 1.0, times=3))


def _stop_and_go(robot: Robot) -> Course:
    pattern = np.array([0.0, 0.0, 0.5, 1.0, 1.0, 0.5])  # standing, speeding up and slowing down within two seconds
    return _course(speed_mps=robot.max_speed_mps * np.tile(pattern, SAMPLES // len(pattern)))


def _on_the_spot(robot: Robot) -> Course:
    return _course(yaw_rate_radps=_quick_turn(robot) * _held(0.0, 1.0, -1.0, 0.5, -0.5, times=3))


def _figure_eight(robot: Robot) -> Course:
    rate = 0.5 * _quick_turn(robot) * _held(1.0, -1.0, times=10)
    return _course(speed_mps=0.5 * robot.max_speed_mps, yaw_rate_radps=rate, heading_rad=_ACROSS_RAD + np.cumsum(rate))


def _slope(robot: Robot) -> Course:
    grade = _held(0.0, 0.05, -0.05, 0.1, -0.1, times=2)
    return _course(speed_mps=robot.max_speed_mps * _held(0.4, 0.7), grade_rad=grade)


def _both_ways(robot: Robot) -> Course:
    heading = np.pi * _held(0.0, 1.0, times=5)
    return _course(speed_mps=robot.max_speed_mps * _held(0.5, 1.0), heading_rad=heading)


def _on_and_off(robot: Robot) -> Course:
    on = _held(1.0, 0.0, times=3)
    return _course(sensing_hz=robot.max_sensing_hz * on, switched_on=on)


def _sweep(robot: Robot) -> Course:
    return _course(sensing_hz=robot.max_sensing_hz * _held(0.0, 0.25, 0.5, 0.75, 1.0, times=2))


def _known_mass(robot: Robot) -> Course:
    as_it_is, on_top = _held(1.0, 0.0, 0.0), KNOWN_MASS * _held(0.0, 0.0, 1.0)
    return _course(speed_mps=0.7 * robot.max_speed_mps, known_mass=on_top, there={"load": as_it_is})


def _full_load(robot: Robot) -> Course:
    return _course(3600.0 / SAMPLES, speed_mps=robot.max_speed_mps)


def _cold_and_warm(robot: Robot) -> Course:
    speed = robot.max_speed_mps * _held(0.0, 0.7, times=2)
    return _course(speed_mps=speed, temperature_c=_held(_COLD_C, _WARM_C))


def _long_pause(robot: Robot) -> Course:
    driving = _held(1.0, 0.0, 1.0)
    on_the_route = {"route": np.ones(SAMPLES)}
    return _course(12.0 + 24.0 * (1.0 - driving), on_the_route, speed_mps=robot.max_speed_mps * driving)


def _far_and_back(robot: Robot) -> Course:
    step_s, speed = 6.0, 0.7 * robot.max_speed_mps
    way = np.minimum(np.arange(SAMPLES), SAMPLES - 1 - np.arange(SAMPLES))
    return _course(
        step_s, {"route": np.ones(SAMPLES)}, speed_mps=speed, base_distance_m=speed * step_s * way,
        heading_rad=np.pi * _held(0.0, 1.0),
    )  # fmt: skip


def _other_ground(robot: Robot) -> Course:
    here = _held(1.0, 0.0)
    heading: Array = np.linspace(0.0, 10.0 * np.pi, SAMPLES)
    return _course(
        there={"ground": here, "route": here}, speed_mps=0.5 * robot.max_speed_mps, heading_rad=heading,
        yaw_rate_radps=10.0 * np.pi / SAMPLES,
    )  # fmt: skip


MENU = (
    Manoeuvre("three_speeds", "drive straight over level ground, slowly, at medium and at top speed, with stops",
              _three_speeds),
    Manoeuvre("stop_and_go", "stop and go: speed up and brake as hard as the robot can, again and again", _stop_and_go),
    Manoeuvre("on_the_spot", "turn on the spot, or as tightly as the robot can, both ways, slowly and fast",
              _on_the_spot),
    Manoeuvre("figure_eight", "drive figures of eight at half speed on level ground", _figure_eight),
    Manoeuvre("slope", "drive up and down slopes of known angle, a gentle one and a steep one, at two speeds", _slope),
    Manoeuvre("both_ways", "drive the same level straight both ways, into the wind and with it, at two speeds",
              _both_ways),
    Manoeuvre("on_and_off", "stand with everything switched on, then with everything off, a few times", _on_and_off),
    Manoeuvre("sweep", "stand and step the sensing rate from zero to its maximum", _sweep),
    Manoeuvre("known_mass", "drive the same straight as it is, then with all load off, then with a known mass on top",
              _known_mass),
    Manoeuvre("full_load", "drive at top speed for an hour, starting with cold motors", _full_load),
    Manoeuvre("cold_and_warm", "stand and drive the same way on a cold morning and at a warm noon", _cold_and_warm),
    Manoeuvre("long_pause", "drive the same route twice with a pause of an hour or more in between", _long_pause),
    Manoeuvre("far_and_back", "drive the same route far out from base and back", _far_and_back),
    Manoeuvre("other_ground", "drive the same loop here and then on other ground", _other_ground),
)  # fmt: skip
"""Everything that may be advised, quick ones first."""
