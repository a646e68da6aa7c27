"""The open-circuit curve: a share of charge is a share of energy by the integral of the voltage."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from homeward.physics import Robot, RobotError, load_robot
from homeward.physics.battery import (
    CHEMISTRIES,
    FLAT,
    MOST_KNOTS,
    charge_share,
    curve_of,
    energy_share,
    open_circuit_v,
    share_at,
    square_v2,
    squares_of,
)

SHARES = st.floats(0.0, 1.0)


@st.composite
def curves(draw: st.DrawFn) -> list[tuple[float, float]]:
    """Points of a pack whose voltage rises with its charge."""
    between = draw(
        st.lists(
            st.floats(0.01, 0.99), max_size=MOST_KNOTS - 2, unique_by=lambda share: round(share, 3)
        )
    )
    charge = [0.0, *sorted(between), 1.0]
    volts = sorted(draw(st.lists(st.floats(2.0, 60.0), min_size=len(charge), max_size=len(charge))))
    return list(zip(charge, volts, strict=True))


@given(curves(), SHARES)
def test_the_energy_of_a_charge_is_the_integral_of_the_voltage(
    points: list[tuple[float, float]], share: float
) -> None:
    curve = curve_of(points)
    charge, volts = np.transpose(points)
    below, _ = quad(np.interp, 0.0, share, args=(charge, volts), points=charge, limit=200)
    full, _ = quad(np.interp, 0.0, 1.0, args=(charge, volts), points=charge, limit=200)
    assert energy_share(curve, share) == pytest.approx(below / full, abs=1e-7)
    assert curve.mean_v == pytest.approx(full, rel=1e-7)


@given(curves(), SHARES)
def test_charge_and_energy_are_inverses(points: list[tuple[float, float]], share: float) -> None:
    curve = curve_of(points)
    assert charge_share(curve, energy_share(curve, share)) == pytest.approx(share, abs=1e-9)


@given(SHARES)
def test_of_a_constant_voltage_both_are_equal_to_the_last_digit(share: float) -> None:
    flat = load_robot("rusti").curve
    assert energy_share(flat, share) == share
    assert charge_share(flat, share) == share
    assert flat.mean_v == 0.0


@pytest.mark.parametrize("chemistry", CHEMISTRIES)
def test_a_charge_near_full_has_more_energy_than_one_near_empty(chemistry: str) -> None:
    charge, volts = np.transpose(CHEMISTRIES[chemistry])
    assert (
        (np.diff(charge) > 0.0).all()
        and (np.diff(volts) > 0.0).all()
        and charge[0] == 0.0
        and charge[-1] == 1.0
    )
    curve = curve_of(CHEMISTRIES[chemistry])
    shares = np.linspace(0.05, 0.95, 19)
    assert (energy_share(curve, shares) < shares).all()
    np.testing.assert_allclose(open_circuit_v(curve, charge), volts)


def test_compiled_code_and_arrays_agree() -> None:
    curve, shares = curve_of(CHEMISTRIES["nmc"]), np.linspace(0.0, 1.0, 101)

    @numba.njit
    def there_and_back(curve: Any, shares: Any) -> Any:
        return np.array([charge_share(curve, energy_share(curve, share)) for share in shares])

    np.testing.assert_allclose(there_and_back(curve, shares), shares, atol=1e-12)
    assert np.isnan(energy_share(curve, np.nan))


def with_battery(**changes: Any) -> Robot:
    flat: dict[str, Any] = {"chemistry": FLAT, "cells_in_series": 0}
    return dataclasses.replace(load_robot("turtlebot3_burger"), **flat | changes)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"chemistry": "zinc", "cells_in_series": 3}, "choose flat, nmc, lipo, lfp, lead_acid"),
        ({"chemistry": "lipo"}, "give how many cells are in series"),
        ({"chemistry": "lipo", "cells_in_series": 6}, "have 19.8 to 25 V, but battery.nominal_voltage_v = 11.1"),
        ({"cells_in_series": 3}, "needs a chemistry"),
        ({"chemistry": "lipo", "cells_in_series": 3, "open_circuit_v": ((0.0, 10.0), (1.0, 12.0))}, "keep one"),
        ({"open_circuit_v": ((0.1, 10.0), (1.0, 12.0))}, "from 0 (empty) to 1 (full)"),
        ({"open_circuit_v": ((0.0, 10.0),)}, "from 0 (empty) to 1 (full)"),
        ({"open_circuit_v": ((0.0, 12.0), (1.0, 10.0))}, "does not rise"),
        ({"open_circuit_v": ((0.0, 10.0), (0.5, 11.0), (0.5, 11.5), (1.0, 12.0))}, "does not rise"),
        ({"open_circuit_v": ((0.0, float("nan")), (1.0, 12.0))}, "is not allowed"),
        ({"open_circuit_v": ((0.0, 10.0, 3.0), (1.0, 12.0))}, "give [share of charge, V of the pack]"),
        ({"open_circuit_v": "12 V"}, "no list of"),
        ({"open_circuit_v": 12.0}, "no list of"),
    ],
)  # fmt: skip
def test_a_battery_that_cannot_be_is_refused_in_a_line(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(RobotError) as refused:
        with_battery(**changes)
    assert says in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"chemistry": "lipo", "cells_in_series": 3},
        {"open_circuit_v": ((0.0, 9.9), (0.4, 11.3), (1.0, 12.5))},
    ],
)
def test_a_file_keeps_its_battery(changes: dict[str, Any], tmp_path: Any) -> None:
    robot = with_battery(**changes)
    (tmp_path / "mine.toml").write_text(robot.to_toml())
    again = load_robot(tmp_path / "mine.toml")
    assert again == robot
    for mine, read in itertools.zip_longest(robot.curve, again.curve):
        np.testing.assert_array_equal(mine, read)
    assert ("chemistry" in robot.to_toml()) == (robot.chemistry != FLAT)


@given(points=curves(), share=SHARES)
def test_a_voltage_is_found_at_its_share_of_the_energy(
    points: list[tuple[float, float]], share: float
) -> None:
    squares_v2 = squares_of(curve_of(points))
    wanted_v2 = float(square_v2(squares_v2, share))
    found = share_at(squares_v2, wanted_v2)
    # Where the voltage is constant, it is that of several shares.
    assert float(square_v2(squares_v2, found)) == pytest.approx(wanted_v2, rel=1e-6)
    assert share_at(squares_v2, 0.99 * float(squares_v2[0])) == 0.0
    assert share_at(squares_v2, 1.01 * float(squares_v2[-1])) == 1.0
