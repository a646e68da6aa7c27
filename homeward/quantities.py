"""Quantities for people: a number with few digits and a suitable unit."""

from __future__ import annotations


def distance(metres: float) -> str:
    """A distance in metres or kilometres.

    >>> distance(84.2), distance(1230.0), distance(52100.0)
    ('84 m', '1.23 km', '52.1 km')
    """
    if abs(metres) < 10.0:
        return f"{metres:.1f} m"
    if abs(metres) < 1000.0:
        return f"{metres:.0f} m"
    if abs(metres) < 1e4:
        return f"{metres / 1000.0:.2f} km"
    return f"{metres / 1000.0:.1f} km"


def duration(seconds: float) -> str:
    """A time in seconds, or in hours and minutes.

    >>> duration(42.0), duration(600.0), duration(8280.0)
    ('42 s', '10 min', '2 h 18 min')
    """
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60.0), 60)
    if not hours:
        return f"{minutes} min"
    return f"{hours} h {minutes:02d} min"


def energy(joules: float) -> str:
    """An energy in joules, kilojoules or megajoules.

    >>> energy(512.0), energy(55440.0), energy(1.73e6)
    ('512 J', '55.4 kJ', '1.73 MJ')
    """
    for unit, size in (("MJ", 1e6), ("kJ", 1e3)):
        if abs(joules) >= 0.9995 * size:
            return f"{joules / size:.3g} {unit}"
    return f"{joules:.3g} J"


def power(watts: float) -> str:
    """A power in watts or kilowatts.

    >>> power(4.2), power(9880.0)
    ('4.2 W', '9.88 kW')
    """
    if abs(watts) >= 999.5:  # three digits would round it to 1000 W
        return f"{watts / 1000.0:.3g} kW"
    return f"{watts:.3g} W"


def count(number: float) -> str:
    """A number without a unit: whole and grouped where it is large.

    >>> count(1234.5), count(3.14159)
    ('1,234', '3.14')
    """
    if abs(number) >= 100.0:
        return f"{number:,.0f}"
    return f"{number:.3g}"
