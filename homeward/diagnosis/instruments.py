"""What is wrong with the reading and not with the robot: faults of instruments, said to be no physics.

They correct the reading of recordings only; no robot file takes them.
"""

from __future__ import annotations

from dataclasses import dataclass

from homeward.physics.effects import Parameter


@dataclass(frozen=True)
class Instrument:
    """One fault of an instrument; the fields mean what those of a physical effect mean."""

    id: str
    parameters: tuple[Parameter, ...]
    sentence: str
    equation: str
    source: str
    needs: tuple[str, ...]
    confused_with: tuple[str, ...] = ()


INSTRUMENTS = (
    Instrument(
        "sensor_offset",
        (Parameter("offset", "W", -10000.0, 10000.0, "added to every reading"),),
        "The power reading is shifted by a constant from some moment on: an instrument, not physics.",
        "reading = power + offset",
        "zero drift of a current sensor",
        ("power_w",),
        ("standby", "intermittent_load"),
    ),
    Instrument(
        "sensor_gain",
        (Parameter("gain", "1", -0.9, 10.0, "relative error of every reading"),),
        "The power reading is scaled by a constant factor from some moment on: an instrument, not physics.",
        "reading = (1 + gain) power",
        "scale error of a current or voltage sensor",
        ("power_w",),
        ("ageing",),
    ),
    Instrument(
        "clock_lag",
        (Parameter("lag_s", "s", -5.0, 5.0, "time by which the power reading is late"),),
        "The clocks of power and motion disagree: an instrument, not physics.",
        "reading(t) = power(t - lag)",
        "unsynchronised loggers",
        ("time_s",),
        ("inertia",),
    ),
    Instrument(
        "odometry_scale",
        (Parameter("scale", "1", -0.5, 1.0, "relative error of the speed reading"),),
        "The odometer reads too much or too little: an instrument, not physics.",
        "speed reading = (1 + scale) speed",
        "worn or swapped wheels",
        ("speed_mps", "base_distance_m"),
        ("viscous",),
    ),
)
"""Every instrument fault of the fixed vocabulary."""
