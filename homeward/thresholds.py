"""Thresholds that several packages share, each defined once and with its origin; the others are in
each package.

Values beyond these have another unit or come from a broken instrument. All are chosen: wider than
any ground robot or road vehicle reaches, narrow enough to detect most wrong units.
"""

STEEPEST_RAD = 0.8
"""Steepest slope, rad, that is read, recorded or in a route: 46 degrees. Beyond it are degrees or
per cent."""

MOST_VOLTAGE_V, MOST_CURRENT_A = 1500.0, 1500.0
"""Highest voltage of a battery, V, and largest current, A, either way. Beyond them are mV and
mA."""

MOST_SENSING_HZ = 1e5
"""Fastest sensing rate, Hz: samples a second of any sensor of a robot."""

MOST_HEADING_RAD = 1e3
"""Largest heading, rad, either way, wrapped or not: 159 turns. Beyond it are degrees."""

MOST_TEMPERATURE_C = 60.0
"""Highest air temperature, degC, and lowest below zero. Beyond it are kelvin."""

MOST_INTEREST = 1e6
"""Largest interest of the ground, a weight over that of average ground."""

MOST_WIND_MPS = 60.0
"""Strongest wind, m/s: nearly twice the lower limit of a hurricane, 33 m/s on the Beaufort scale.
Beyond it are km/h."""

POSITION_M = 5.0
"""Error of a position, m: the accuracy of a receiver of satellites under open sky, 4.9 m (van
Diggelen and Enge, Proceedings of ION GNSS+ 2015). Positions nearer to each other differ by
noise."""
