"""The menu of test drives: a few manoeuvres that a roboticist can drive, each as a sentence and as
a drive to simulate.

All have the same number of samples, so that none gains information by its length. Where a drive
changes something that no channel records (devices switched on, load, ground), the drive gives its
times.
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
"""Mass that is put on the robot in the drive with a known mass, over its own. Chosen: the largest
at `uncertain`."""

_ACROSS_RAD = np.pi / 2.0  # heading across the wind, which then has no component along the way


@dataclass(frozen=True)
class Manoeuvre:
    """One entry of the menu: its instruction in one sentence, and its drive, each level constant or
    of (SAMPLES,)."""

    id: str
    sentence: str
    speed: Array | float = 0.0  # over the top speed
    # over that of turning on the spot with the wheels at half of the top speed
    turning: Array | float = 0.0
    yaw_rate_radps: float = 0.0  # beside it
    heading_rad: Array | None = None  # None: first across the wind, and then as the robot turns
    grade_rad: Array | float = 0.0
    sensing: Array | float = 0.0  # over the fastest
    temperature_c: Array | None = None  # None: as in the recordings at hand
    base_distance_s: Array | float = 0.0  # at top speed
    switched_on: Array | float = 1.0  # 0: everything is off
    known_mass: Array | float = 0.0  # carried on top, over the robot's own
    step_s: Array | float = 1.0
    # share of the recordings' load, ground, route
    present: Mapping[str, Array | float] = field(default_factory=dict)

    def signals(self, robot: Robot, unit: Unit, mean_c: float) -> Signals:
        """The drive of a robot as a recording; headings count from where the wind comes from."""
        step_s = _per_sample(self.step_s)
        time_s = np.concatenate([[0.0], np.cumsum(step_s[:-1])])
        speed_mps = robot.max_speed_mps * _per_sample(self.speed)
        sensing_hz = robot.max_sensing_hz * _per_sample(self.sensing)
        # Wheels at half of the top speed, in opposite directions; without a track width a rate of
        # its own.
        fastest_turn_radps = robot.max_speed_mps / robot.track_m if robot.track_m > 0.0 else 1.0
        turning_radps = _per_sample(self.turning) * fastest_turn_radps
        heading_rad = self.heading_rad
        if heading_rad is None:
            heading_rad = _ACROSS_RAD + np.cumsum(turning_radps * step_s)
        temperature_c = mean_c if self.temperature_c is None else self.temperature_c
        return Signals(
            name="menu",
            unit=unit,
            time_s=time_s,
            speed_mps=speed_mps,
            accel_mps2=np.gradient(speed_mps, time_s),
            grade_rad=_per_sample(self.grade_rad),
            sensing_hz=sensing_hz,
            yaw_rate_radps=turning_radps + self.yaw_rate_radps,
            temperature_c=_per_sample(temperature_c),
            base_distance_m=robot.max_speed_mps * _per_sample(self.base_distance_s),
            direction=np.ones(SAMPLES),
            observed=np.zeros(SAMPLES),
            context={"speed_mps": speed_mps, "sensing_hz": sensing_hz, "heading_rad": heading_rad},
        )


class Drive:
    """A manoeuvre of the refitted robot: its simulated recording, without any effect and with
    some."""

    def __init__(self, fit: Refit, manoeuvre: Manoeuvre, unit: Unit, mean_c: float) -> None:
        self.fit = fit
        self.manoeuvre = manoeuvre
        self.runs = average([manoeuvre.signals(fit.parameters.nominal, unit, mean_c)])
        self.plain = self.predict(fit.theta)

    def there(self, what: str | None) -> Array | float:
        """Share of the load, the ground or the route of the recordings that is present, shape
        (samples,).

        A hidden slope is on the route where it was found, and not on chosen level ground.
        """
        if what is None:
            return 1.0
        present = {"route": 0.0, **self.manoeuvre.present}
        return present.get(what, 1.0)

    def predict(self, theta: Array, extra: WithEffects | None = None) -> Array:
        """Simulated power, W, or current, A, shape (samples,); zero where everything is off."""
        parameters = self.fit.parameters
        power = parameters.predict(self.runs, theta, extra)
        is_loaded = np.greater(self.manoeuvre.known_mass, 0.0)
        if np.any(is_loaded):
            on_top_kg = KNOWN_MASS * parameters.nominal.mass_kg
            loaded_theta = theta.copy()
            loaded_theta[ROLLING] *= 1.0 + on_top_kg / theta[MASS]  # C_rr stays as it is
            loaded_theta[MASS] += on_top_kg
            power = np.where(is_loaded, parameters.predict(self.runs, loaded_theta, extra), power)
        return power * self.manoeuvre.switched_on


def _per_sample(level: Array | float) -> Array:
    return np.full(SAMPLES, level, dtype=np.float64)


def _in_turn(*levels: float, times: int = 1) -> Array:
    """Levels in turn, each for equally long, the whole series some times over."""
    series = np.tile(levels, times)
    index = np.arange(SAMPLES) * len(series) // SAMPLES
    return np.asarray(series[index], dtype=np.float64)


# speeding up and slowing down within two seconds
_STOP_AND_GO = np.tile([0.0, 0.0, 0.5, 1.0, 1.0, 0.5], SAMPLES // 6)
_OUT_AND_BACK = np.minimum(np.arange(SAMPLES), SAMPLES - 1 - np.arange(SAMPLES))

MENU = (
    Manoeuvre(
        id="three_speeds",
        sentence="drive straight over level ground, slowly, at medium and at top speed, with stops",
        speed=_in_turn(0.0, 0.35, 0.7, 1.0, times=3),
    ),
    Manoeuvre(
        id="stop_and_go",
        sentence="stop and go: speed up and brake as hard as the robot can, again and again",
        speed=_STOP_AND_GO,
    ),
    Manoeuvre(
        id="on_the_spot",
        sentence="turn on the spot, or as tightly as the robot can, both ways, slowly and fast",
        turning=_in_turn(0.0, 1.0, -1.0, 0.5, -0.5, times=3),
    ),
    Manoeuvre(
        id="figure_eight",
        sentence="drive figures of eight at half speed on level ground",
        speed=0.5,
        turning=_in_turn(0.5, -0.5, times=10),
    ),
    Manoeuvre(
        id="slope",
        sentence="drive up and down slopes of known angle, a gentle one and a steep one, at two speeds",
        speed=_in_turn(0.4, 0.7),
        grade_rad=_in_turn(0.0, 0.05, -0.05, 0.1, -0.1, times=2),
    ),
    Manoeuvre(
        id="both_ways",
        sentence="drive the same level straight both ways, into the wind and with it, at two speeds",
        speed=_in_turn(0.5, 1.0),
        heading_rad=_in_turn(0.0, np.pi, times=5),
    ),
    Manoeuvre(
        id="on_and_off",
        sentence="stand with everything switched on, then with everything off, a few times",
        sensing=_in_turn(1.0, 0.0, times=3),
        switched_on=_in_turn(1.0, 0.0, times=3),
    ),
    Manoeuvre(
        id="sweep",
        sentence="stand and step the sensing rate from zero to its maximum",
        sensing=_in_turn(0.0, 0.25, 0.5, 0.75, 1.0, times=2),
    ),
    Manoeuvre(
        id="known_mass",
        sentence="drive the same straight as it is, then with all load off, then with a known mass on top",
        speed=0.7,
        known_mass=_in_turn(0.0, 0.0, KNOWN_MASS),
        present={"load": _in_turn(1.0, 0.0, 0.0)},
    ),
    Manoeuvre(
        id="full_load",
        sentence="drive at top speed for an hour, starting with cold motors",
        speed=1.0,
        step_s=3600.0 / SAMPLES,
    ),
    Manoeuvre(
        id="cold_and_warm",
        sentence="stand and drive the same way on a cold morning and at a warm noon",
        speed=_in_turn(0.0, 0.7, times=2),
        temperature_c=_in_turn(0.0, 30.0),
    ),
    Manoeuvre(
        id="long_pause",
        sentence="drive the same route twice with a pause of an hour or more in between",
        speed=_in_turn(1.0, 0.0, 1.0),
        step_s=_in_turn(12.0, 36.0, 12.0),
        present={"route": 1.0},
    ),
    Manoeuvre(
        id="far_and_back",
        sentence="drive the same route far out from base and back",
        speed=0.7,
        step_s=6.0,
        base_distance_s=0.7 * 6.0 * _OUT_AND_BACK,
        heading_rad=_in_turn(0.0, np.pi),
        present={"route": 1.0},
    ),
    Manoeuvre(
        id="other_ground",
        sentence="drive the same loop here and then on other ground",
        speed=0.5,
        yaw_rate_radps=10.0 * np.pi / SAMPLES,
        heading_rad=np.linspace(0.0, 10.0 * np.pi, SAMPLES),
        present={"ground": _in_turn(1.0, 0.0), "route": _in_turn(1.0, 0.0)},
    ),
)
"""Everything that may be advised, quick ones first."""
