"""Energy of driving a metre: against the physics model, finite differences and integrals."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats

from homeward.estimation.drive import (
    Stretch,
    Vehicle,
    climbing,
    drag,
    misread_climb,
    modelled_driving,
    predict,
    rolling,
    vehicle_of,
)
from homeward.estimation.prior import (
    CLIMB,
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    ROLLED,
    ROLLING,
    STATES,
    WEIGHT,
    Prior,
)
from homeward.physics import ancillary_power, load_robot, optimal_speed
from homeward.physics.model import traction_force

ROBOT = load_robot("husky")
VEHICLE = vehicle_of(ROBOT, 25.0)
WEIGHT_N = 50.0 * 9.80665
LEVEL = Stretch(40.0, 0.0, 0.6, 0.8, 0.9, -1.0, 0.0, 0.5)


def states(**of: float) -> Any:
    x = np.zeros(STATES)
    x[[GAIN, ROLLING, WEIGHT]] = 1.0, 1.1, 1.05
    for name, value in of.items():
        x[
            {
                "east": EAST,
                "north": NORTH,
                "gust_east": GUST_EAST,
                "gust_north": GUST_NORTH,
                "rolled": ROLLED,
            }[name]
        ] = value
    return x


def predicted(
    x: Any, s: Stretch, p: Any = None, vehicle: Vehicle = VEHICLE, prior: Prior | None = None
) -> tuple[float, float, Any, Any]:
    """Energy, its variance beyond that of the states, its first derivatives and its second ones by
    the wind."""
    slope, bend, part = np.zeros(STATES), np.zeros(3), np.zeros(STATES)
    none = np.zeros((STATES, STATES))
    energy, variance = predict(
        vehicle, prior or Prior(), x, none if p is None else p, s, slope, bend, part
    )
    return energy, variance, slope, bend


def test_a_vehicle_is_the_robot_with_its_payload() -> None:
    laden = dataclasses.replace(ROBOT, effects={"payload": {"mass_kg": 12.0}})
    vehicle = vehicle_of(laden, 10.0, 0.7)
    assert vehicle.mass_kg == pytest.approx(62.0) and VEHICLE.mass_kg == pytest.approx(50.0)
    assert (vehicle.cruise_mps, vehicle.place_m) == (0.7, 10.0)
    assert VEHICLE.cruise_mps == pytest.approx(float(optimal_speed(ROBOT)))
    assert VEHICLE.idle_w == pytest.approx(float(ancillary_power(ROBOT, 0.0)))
    assert VEHICLE.per_efficiency == pytest.approx(1.0 / ((1.0 - 0.047) * (1.0 - 0.271)))


def test_the_parts_of_the_force_by_hand() -> None:
    """50 kg, C_rr 0.14, c 0.13 N s^2/m^2, up a 3-4-5 slope at 0.5 m/s against 1.5 m/s."""
    per = VEHICLE.per_efficiency
    assert rolling(VEHICLE, 0.6) == pytest.approx(0.14 * WEIGHT_N * 0.8 * per)
    assert climbing(VEHICLE, 0.6) == pytest.approx(0.6 * WEIGHT_N * per) == -climbing(VEHICLE, -0.6)
    assert drag(VEHICLE, 0.5, 1.5) == pytest.approx(0.13 * 4.0 * per)
    # a wind that is faster than the robot pushes it
    assert drag(VEHICLE, 0.5, -1.5) == pytest.approx(-0.13 * per)
    assert rolling(VEHICLE, 1.0) == 0.0


@pytest.mark.parametrize("grade_rad", [-0.3, -0.1, 0.0, 0.2])
@pytest.mark.parametrize("speed_mps", [0.3, 1.0])
def test_modelled_driving_is_that_of_the_model(grade_rad: float, speed_mps: float) -> None:
    force_n = float(traction_force(ROBOT, speed_mps, grade_rad))
    expected = max(force_n, 0.0) / ROBOT.traction_efficiency
    assert modelled_driving(VEHICLE, math.sin(grade_rad), speed_mps) == pytest.approx(expected)


@pytest.mark.parametrize(
    "stretch",
    [
        LEVEL,
        LEVEL._replace(sine=0.1, east=-0.6),
        LEVEL._replace(sine=0.1, rolled=1.3, climb_share=0.4),
        LEVEL._replace(rolled=0.0, gust_share=1.0),
    ],
)
@pytest.mark.parametrize("wind_mps", [(1.0, -0.5), (-4.0, 2.0)])
def test_derivatives_are_those_of_the_energy(
    stretch: Stretch, wind_mps: tuple[float, float]
) -> None:
    x = states(east=wind_mps[0], north=wind_mps[1], gust_east=0.4, gust_north=-0.2, rolled=0.9)
    energy, variance, slope, bend = predicted(x, stretch)
    assert energy > 0.0 == variance
    step = 1e-4

    def moved(*by: tuple[int, float]) -> float:
        changed = x.copy()
        for state, change in by:
            changed[state] += change
        return predicted(changed, stretch)[0]

    for state in range(CLIMB + 1):
        expected = (moved((state, step)) - moved((state, -step))) / (2.0 * step)
        assert slope[state] == pytest.approx(expected, rel=1e-6, abs=1e-12)
    one, both, other = (
        sum(a * b * moved((first, a * step), (second, b * step)) for a in (1, -1) for b in (1, -1))
        / (4.0 * step**2)
        for first, second in ((EAST, EAST), (EAST, NORTH), (NORTH, NORTH))
    )
    np.testing.assert_allclose(bend, [one, both, other], rtol=1e-3, atol=1e-9)


def test_energy_by_hand() -> None:
    """40 m at 0.9 m/s, rolling 1.1, weight 1.05, up 0.1, against a wind of 1 m/s along the way,
    gusts half."""
    x = states(east=0.6, north=0.8, gust_east=1.2, gust_north=1.6)
    energy, _, _, _ = predicted(x, LEVEL._replace(sine=0.1))
    force_n = (
        1.1 * 0.14 * WEIGHT_N * math.sqrt(0.99)
        + 1.05 * 0.1 * WEIGHT_N
        + 0.13 * (0.9 + 1.0 + 0.5 * 2.0) ** 2
    )
    assert energy == pytest.approx(force_n * 40.0 / (0.953 * 0.729) / 1728000.0)


def test_ground_that_was_driven_is_predicted_from_what_it_consumed() -> None:
    """The rolling between home and here is a state; a share of it, that of this stretch, is on the
    way home."""
    x = states(rolled=1.2)
    x[CLIMB] = 1e-4
    here = LEVEL._replace(rolled=0.9, climb_share=0.25)
    energy, _, slope, _ = predicted(x, here)
    roll = rolling(VEHICLE, 0.0) * 40.0 / VEHICLE.full_j
    air = drag(VEHICLE, 0.9, 0.0) * 40.0 / VEHICLE.full_j
    assert energy == pytest.approx(0.9 * roll * 1.2 + air - 0.25 * 0.05 * 1e-4)
    assert slope[ROLLING] == 0.0 and slope[ROLLED] == pytest.approx(0.9 * roll)


@pytest.mark.parametrize("sine", [-0.3, -0.16, -0.13, -0.1])
def test_a_descent_consumes_nothing_or_something_as_an_integral_has_it(sine: float) -> None:
    """The energy is normal but never below 0: mean, slope and variance of max(N, 0)."""
    p = np.zeros((STATES, STATES))
    p[ROLLING, ROLLING], p[WEIGHT, WEIGHT], p[ROLLING, WEIGHT] = 0.15**2, 0.06**2, 0.003
    p[WEIGHT, ROLLING] = p[ROLLING, WEIGHT]
    stretch = LEVEL._replace(sine=sine)
    energy, variance, slope, _ = predicted(states(), stretch, p)
    per_m = 40.0 / VEHICLE.full_j
    part = np.array([rolling(VEHICLE, sine), climbing(VEHICLE, sine)]) * per_m
    of = [ROLLING, WEIGHT]
    mean = float(part @ [1.1, 1.05]) + drag(VEHICLE, 0.9, 0.0) * per_m
    normal = stats.norm(mean, np.sqrt(part @ p[np.ix_(of, of)] @ part))
    end = max(mean, 0.0) + 12.0 * float(normal.std())
    first, second = (
        integrate.quad(
            lambda e, k=k: e**k * normal.pdf(e), 0.0, end, points=[max(mean, 0.0)], epsabs=1e-16
        )[0]
        for k in (1, 2)
    )
    above = normal.sf(0.0)
    assert energy == pytest.approx(first, rel=1e-6, abs=1e-12)
    np.testing.assert_allclose(slope[of], above * part, rtol=1e-9)
    # The variance of the slopes and the rest are together that of max(N, 0).
    total = second - first**2
    assert variance + above**2 * normal.var() == pytest.approx(
        max(total, above**2 * normal.var()), rel=1e-5
    )
    assert energy >= 0.0 <= variance


def test_slopes_that_the_modelled_energy_knows_are_not_misread_twice() -> None:
    x = states()
    assert misread_climb(Prior(model_knows_slopes=0.0), x) == pytest.approx(1.05)
    assert misread_climb(Prior(model_knows_slopes=1.0), x) == pytest.approx(0.05)
