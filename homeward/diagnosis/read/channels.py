"""The channels a recording may have: names, units, what is physically possible, and what a wrong unit looks like."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Channel:
    """One column of the recording schema.

    `low` and `high` are limits no ground robot or road vehicle exceeds; `mistaken` lists the units such a value is
    usually in when it does, each with the factor to SI.
    """

    name: str
    unit: str
    meaning: str
    low: float
    high: float
    mistaken: tuple[tuple[str, float], ...] = ()


_TO_RAD = 0.017453292519943295

CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel("time_s", "s", "time, increasing", -1e11, 1e11,
                (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))),
        Channel("speed_mps", "m/s", "ground speed, negative in reverse", -70.0, 70.0,
                (("km/h", 1 / 3.6), ("mm/s", 1e-3))),
        Channel("wheel_left_mps", "m/s", "speed of the left wheels", -70.0, 70.0,
                (("km/h", 1 / 3.6), ("mm/s", 1e-3))),
        Channel("wheel_right_mps", "m/s", "speed of the right wheels", -70.0, 70.0,
                (("km/h", 1 / 3.6), ("mm/s", 1e-3))),
        Channel("yaw_rate_radps", "rad/s", "turning rate, positive to the left", -20.0, 20.0,
                (("degrees per second", _TO_RAD),)),
        Channel("grade_rad", "rad", "slope angle along the way, positive uphill", -0.8, 0.8,
                (("degrees", _TO_RAD), ("per cent", 1e-2))),
        Channel("elevation_m", "m", "height above any datum", -500.0, 9000.0, (("millimetres", 1e-3),)),
        Channel("distance_m", "m", "distance driven since the start", -1e7, 1e7, (("millimetres", 1e-3),)),
        Channel("heading_rad", "rad", "heading, counter-clockwise, wrapped or not", -1e4, 1e4, (("degrees", _TO_RAD),)),
        Channel("power_w", "W", "power drawn from the battery", -5e5, 5e5, (("milliwatts", 1e-3),)),
        Channel("voltage_v", "V", "battery voltage", 0.0, 1500.0, (("millivolts", 1e-3),)),
        Channel("current_a", "A", "battery current, discharge positive", -1500.0, 1500.0, (("milliamperes", 1e-3),)),
        Channel("motor_left_a", "A", "current of the left motors", -1500.0, 1500.0, (("milliamperes", 1e-3),)),
        Channel("motor_right_a", "A", "current of the right motors", -1500.0, 1500.0, (("milliamperes", 1e-3),)),
        Channel("sensing_hz", "Hz", "samples per second of the sensors", 0.0, 1e5),
        Channel("soc", "1", "state of charge, 0 to 1", -0.05, 1.05, (("per cent", 1e-2),)),
        Channel("temperature_c", "degC", "ambient temperature", -70.0, 90.0),
        Channel("payload_kg", "kg", "mass carried beside the robot's own", 0.0, 1e5, (("grams", 1e-3),)),
        Channel("base_distance_m", "m", "distance from the base station", 0.0, 1e6, (("millimetres", 1e-3),)),
    )
}  # fmt: skip
"""The schema, by column name."""

MOTION = (("speed_mps",), ("wheel_left_mps", "wheel_right_mps"))
"""Sets of channels that say how the robot moved; one is needed."""

POWER = (("power_w",), ("voltage_v", "current_a"), ("motor_left_a", "motor_right_a"))
"""Sets of channels that say what it drew, the most telling first; one is needed."""
