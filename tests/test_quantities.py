"""Quantities for people: few digits, a suitable unit, and no number that rounds past its unit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward import quantities


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (0.0, "0.0 m"),
        (-3.21, "-3.2 m"),
        (9.96, "10.0 m"),
        (84.2, "84 m"),
        (1230.0, "1.23 km"),
        (-5e4, "-50.0 km"),
    ],
)
def test_distances(metres: float, text: str) -> None:
    assert quantities.distance(metres) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 s"), (119.4, "119 s"), (120.0, "2 min"), (3569.0, "59 min"), (3570.1, "1 h 00 min"),
        (3660.0, "1 h 01 min"), (86400.0, "24 h 00 min"),
    ],
)  # fmt: skip
def test_durations(seconds: float, text: str) -> None:
    assert quantities.duration(seconds) == text


@pytest.mark.parametrize(
    ("joules", "text"),
    [
        (0.0, "0 J"),
        (999.4, "999 J"),
        (999.6, "1 kJ"),
        (-55440.0, "-55.4 kJ"),
        (999_400.0, "999 kJ"),
        (999_600.0, "1 MJ"),
    ],
)
def test_energies(joules: float, text: str) -> None:
    assert quantities.energy(joules) == text


@pytest.mark.parametrize(
    ("watts", "text"),
    [(0.0, "0 W"), (4.25, "4.25 W"), (999.4, "999 W"), (999.6, "1 kW"), (-9880.0, "-9.88 kW")],
)
def test_powers(watts: float, text: str) -> None:
    assert quantities.power(watts) == text


@pytest.mark.parametrize(
    ("number", "text"),
    [(3.14159, "3.14"), (99.96, "100"), (1234.5, "1,234"), (-2e6, "-2,000,000"), (0.0, "0")],
)
def test_counts(number: float, text: str) -> None:
    assert quantities.count(number) == text


@given(st.floats(1e-3, 1e9))
def test_a_text_is_the_number_to_its_digits(number: float) -> None:
    for text, sizes in (
        (quantities.energy(number), {"J": 1.0, "kJ": 1e3, "MJ": 1e6}),
        (quantities.power(number), {"W": 1.0, "kW": 1e3}),
    ):
        value, unit = text.split()
        assert float(value) * sizes[unit] == pytest.approx(number, rel=5.1e-3)
        assert float(value) < 1000.0 or unit in ("MJ", "kW")
