"""A recording and the channels it may have: names, units, what is physically possible, what a wrong
unit looks like."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward import thresholds as shared

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Sets = tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Recording:
    """One run of one robot.

    `channels` maps names of the schema to float64 arrays of shape (n,) in SI units; values that
    were not recorded are NaN. `notes` lists what was left out. `time_s` plus `start_s` is the time
    since 1970, s; `start_s` is 0 if that is unknown.
    """

    name: str
    sha256: str
    channels: Mapping[str, Array]
    notes: tuple[str, ...] = ()
    start_s: float = 0.0

    def __len__(self) -> int:
        return len(self.channels["time_s"])

    @property
    def duration_s(self) -> float:
        """Time between the first and the last sample, s."""
        time_s = self.channels["time_s"]
        return float(time_s[-1] - time_s[0])


@dataclass(frozen=True)
class Channel:
    """One column of the recording schema.

    `low` and `high` are limits no ground robot or road vehicle exceeds; `mistaken` lists the likely
    units of a value beyond them, each with the factor to SI.
    """

    name: str
    unit: str
    meaning: str
    low: float
    high: float
    mistaken: tuple[tuple[str, float], ...] = ()

    def impossible(self, values: Array) -> Mask:
        """Values beyond the limits."""
        return (values < self.low) | (values > self.high)


_SPEED = ("km/h", 1 / 3.6), ("mm/s", 1e-3)
_DEGREES = ("degrees", 0.017453292519943295)
_PER_CENT = ("per cent", 1e-2)
_MM = (("millimetres", 1e-3),)
_MA = (("milliamperes", 1e-3),)
_SMALLER_S = ("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)

_SLOPES = -shared.STEEPEST_RAD, shared.STEEPEST_RAD
_CURRENTS = -shared.MOST_CURRENT_A, shared.MOST_CURRENT_A

# Limits are chosen: wider than any ground robot or road vehicle reaches, narrow enough to detect
# most wrong units.
CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel("time_s", "s", "time, increasing", -1e11, 1e11, _SMALLER_S),
        Channel("speed_mps", "m/s", "ground speed, negative in reverse", -70.0, 70.0, _SPEED),
        Channel("wheel_left_mps", "m/s", "speed of the left wheels", -70.0, 70.0, _SPEED),
        Channel("wheel_right_mps", "m/s", "speed of the right wheels", -70.0, 70.0, _SPEED),
        Channel("yaw_rate_radps", "rad/s", "turning rate, positive to the left", -20.0, 20.0,
                (("degrees per second", _DEGREES[1]),)),
        Channel("grade_rad", "rad", "slope angle along the way, positive uphill", *_SLOPES, (_DEGREES, _PER_CENT)),
        Channel("elevation_m", "m", "height above any datum", -500.0, 9000.0, _MM),
        Channel("distance_m", "m", "distance driven since the start", -1e7, 1e7, _MM),
        Channel("heading_rad", "rad", "heading, counter-clockwise, wrapped or not", -1e4, 1e4, (_DEGREES,)),
        Channel("power_w", "W", "power drawn from the battery", -5e5, 5e5, (("milliwatts", 1e-3),)),
        Channel("voltage_v", "V", "battery voltage", 0.0, shared.MOST_VOLTAGE_V, (("millivolts", 1e-3),)),
        Channel("current_a", "A", "battery current, discharge positive", *_CURRENTS, _MA),
        Channel("motor_left_a", "A", "current of the left motors", *_CURRENTS, _MA),
        Channel("motor_right_a", "A", "current of the right motors", *_CURRENTS, _MA),
        Channel("sensing_hz", "Hz", "samples per second of the sensors", 0.0, shared.MOST_SENSING_HZ),
        Channel("soc", "1", "state of charge, 0 to 1", -0.05, 1.05, (_PER_CENT,)),
        Channel("temperature_c", "degC", "ambient temperature", -70.0, 90.0),
        Channel("payload_kg", "kg", "mass carried beside the robot's own", 0.0, 1e5, (("grams", 1e-3),)),
        Channel("base_distance_m", "m", "distance from the base station", 0.0, 1e6, _MM),
    )
}  # fmt: skip
"""The schema, by column name."""

MOTION: Sets = (("speed_mps",), ("wheel_left_mps", "wheel_right_mps"))
"""Sets of channels that measure motion; one is needed."""

POWER: Sets = (("power_w",), ("voltage_v", "current_a"), ("motor_left_a", "motor_right_a"))
"""Sets of channels that measure power or current, the most informative first; one is needed."""


def first_set(sets: Sets, present: Collection[str]) -> tuple[str, ...]:
    """The first complete set of channels, () if there is none."""
    return next((names for names in sets if all(name in present for name in names)), ())


def lacking(present: Collection[str]) -> str | None:
    """The missing channels of motion or power, such as "motion channel (speed_mps or ...)", or
    None."""
    for what, sets in (("motion", MOTION), ("power", POWER)):
        if not first_set(sets, present):
            alternatives = [" + ".join(names) for names in sets]
            return f"{what} channel ({' or '.join(alternatives)})"
    return None
