"""What is believed of the battery: bounds of age and cold, what was drawn, the voltage, and a
counter that errs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from homeward.companion.battery import BatteryBelief, Conditions, Start, Witnesses
from homeward.estimation import Prior
from homeward.physics import Robot
from homeward.physics.battery import charge_share, open_circuit_v
from homeward.physics.cells import cells_of
from tests.companion.robots import HUSKY

NMC = dataclasses.replace(HUSKY, chemistry="nmc", cells_in_series=7)
LFP = dataclasses.replace(HUSKY, chemistry="lfp", cells_in_series=8)
LEAD = dataclasses.replace(HUSKY, chemistry="lead_acid", cells_in_series=12)
PRIOR = Prior(soc_step=1e-3, soc_error=5e-3)
RATE_PER_H = 0.3
NOTHING = math.nan


def belief(
    robot: Robot, *, temperature_c: float = NOTHING, cutoff_v: float | None = None
) -> BatteryBelief:
    battery = BatteryBelief(cells_of(robot), PRIOR, False, cutoff_v)
    battery.begin(Start(), Conditions(temperature_c=temperature_c, rate_per_h=RATE_PER_H))
    return battery


def discharge(
    battery: BatteryBelief,
    robot: Robot,
    capacity: float,
    to: float,
    *,
    ohm: float = 0.0,
    learned: float | None = None,
) -> float:
    """Draw from a full battery of a capacity, 1 % a window; returns the energy left.

    With `ohm`, voltage and current are read; with `learned`, a counter that takes this for a full
    charge.
    """
    curve, used = robot.curve, 0.0
    for used in np.arange(0.01, to, 0.01):
        charge = float(charge_share(curve, 1.0 - used / capacity))
        volts = float(open_circuit_v(curve, charge))
        current_a = (
            RATE_PER_H * (1.0 + 0.5 * math.sin(40.0 * used)) * cells_of(robot).rated_as / 3600.0
        )
        shown = NOTHING if learned is None else 1.0 - (1.0 - charge) * capacity / learned
        read = (
            (volts - ohm * current_a, current_a, current_a)
            if ohm
            else (NOTHING, NOTHING, -math.inf)
        )
        battery.see(Witnesses(float(used), 0.0, *read, shown))
    return capacity - float(used)


def test_the_capacity_is_within_the_range_of_age_and_what_was_drawn_excludes_less() -> None:
    battery = belief(HUSKY)
    assert 0.72 < battery.totals[0] < 0.83 and battery.totals[-1] < 1.02
    discharge(battery, HUSKY, 1.0, 0.9)
    assert battery.total > 0.92 and battery.totals[0] > 0.87


def test_more_than_the_prior_allows_leaves_it_as_unsure_as_it_was_wrong() -> None:
    battery = belief(HUSKY)
    at_start_sd = battery.total_sd
    discharge(battery, HUSKY, 1.0, 0.97)
    assert not battery.is_overdrawn and battery.total_sd < 0.3 * at_start_sd
    discharge(battery, HUSKY, 1.3, 1.2)
    assert battery.is_overdrawn
    assert battery.total == pytest.approx(1.19)  # nothing is left on average
    assert battery.total_sd > 1.19 - 0.92  # half of the possible batteries hold less than this
    battery.recharge(1.0)
    assert not battery.is_overdrawn
    battery.begin(Start(), Conditions(rate_per_h=RATE_PER_H))
    assert battery.total_sd == pytest.approx(at_start_sd)


def test_a_charge_says_nothing_of_the_capacity_and_loses_nothing_that_is_known() -> None:
    battery = belief(NMC)
    discharge(battery, NMC, 0.85, 0.6, ohm=0.15, learned=0.85)
    mean, resistance, explanations = battery.total, battery.resistance, battery.trust.probabilities
    sd = battery.total_sd
    battery.recharge(1.0)
    assert battery.charge == pytest.approx(1.0, abs=0.03) and battery.start.told
    assert battery.total == pytest.approx(mean, rel=0.04) and battery.total_sd < 1.5 * sd
    assert battery.resistance == pytest.approx(resistance, rel=1e-6)
    follows, jumped, own = battery.trust.probabilities
    assert jumped == 0.0 and follows > 0.9 and own == pytest.approx(explanations[2])
    assert battery.total_sd < 0.6 * belief(NMC).total_sd
    battery.recharge(0.5)
    assert battery.total == pytest.approx(0.5 * mean, rel=0.1)


@pytest.mark.parametrize("temperature_c", [20.0, -10.0])
def test_cold_batteries_hold_less(temperature_c: float) -> None:
    warm, here = belief(LEAD), belief(LEAD, temperature_c=temperature_c)
    # Beside the charge, what a resistance takes that is larger in the cold.
    assert here.total == pytest.approx(
        warm.total * (1.0 - 0.008 * (25.0 - temperature_c)), rel=0.05
    )


def test_the_voltage_tells_resistance_and_charge() -> None:
    without, read = belief(NMC), belief(NMC)
    discharge(without, NMC, 0.83, 0.6)
    left = discharge(read, NMC, 0.83, 0.6, ohm=0.1)
    assert read.total_sd < 0.8 * without.total_sd
    assert abs(read.total - 0.59 - left) < 2.0 * read.total_sd
    rated_ah = cells_of(NMC).rated_as / 3600.0
    assert read.resistance == pytest.approx(0.1 * rated_ah / NMC.curve.mean_v, rel=0.25)


def test_a_cut_off_under_load_keeps_more_in_a_battery_of_higher_resistance() -> None:
    kept = []
    for ohm in (0.02, 0.3):
        battery = belief(NMC, cutoff_v=22.5)
        discharge(battery, NMC, 0.9, 0.4, ohm=ohm)
        kept.append(0.9 - battery.total)
    assert 0.0 < kept[0] < kept[1] - 0.03


@pytest.mark.parametrize(("robot", "volts"), [(LFP, (26.2, 21.0)), (HUSKY, (24.0, 20.0))])
def test_a_battery_whose_voltage_under_load_is_near_its_cut_off_may_be_empty_at_once(
    robot: Robot, volts: tuple[float, float]
) -> None:
    """A cold one of either file: its charge is hardly touched, but half of the voltage above the
    cut-off is sag."""
    safe, near = (
        belief(robot, temperature_c=-5.0, cutoff_v=15.0),
        belief(robot, temperature_c=-5.0, cutoff_v=20.0),
    )
    rest_v, loaded_v = volts
    current_a = 2.0 * cells_of(robot).rated_as / 3600.0
    for battery in (safe, near):
        for minute in range(1, 10):
            battery.see(
                Witnesses(
                    0.003 * minute,
                    0.0,
                    0.5 * (rest_v + loaded_v),
                    0.5 * current_a,
                    -math.inf,
                    NOTHING,
                )
            )
            battery.see(
                Witnesses(0.003 * minute + 0.001, 0.0, loaded_v, current_a, current_a, NOTHING)
            )
    assert safe.totals[1] > 0.4
    assert near.totals[1] < 0.1


def test_what_the_robots_own_model_loses_in_the_cold_is_not_lost_twice() -> None:
    battery = BatteryBelief(cells_of(HUSKY), PRIOR, False, None)
    cold = Conditions(temperature_c=-10.0, rate_per_h=RATE_PER_H, models_cold=True)
    battery.begin(Start(), cold)
    assert battery.total == pytest.approx(belief(HUSKY).total)
    assert battery.total > 1.1 * belief(HUSKY, temperature_c=-10.0).total


@pytest.mark.parametrize("capacity", [0.6, 0.75, 0.85])
def test_a_counter_that_may_not_know_rate_and_cold_does_not_tell_the_capacity(
    capacity: float,
) -> None:
    """It has learned the charge of slow discharges in the warm."""
    battery = belief(LEAD, temperature_c=5.0)
    left = discharge(battery, LEAD, capacity, 0.35, learned=0.9)
    assert abs(battery.total - 0.34 - left) < 2.5 * battery.total_sd


def test_a_battery_at_its_cut_off_is_empty_whatever_was_drawn() -> None:
    battery = belief(NMC, cutoff_v=21.0)
    discharge(battery, NMC, 1.3, 1.1)
    battery.see(Witnesses(1.1, 0.0, 20.9, 5.0, 5.0, NOTHING))
    assert battery.is_overdrawn
    assert battery.total_sd < 0.01


def test_a_battery_at_its_cut_off_is_empty_whatever_its_gauge_shows() -> None:
    battery = belief(HUSKY, cutoff_v=22.0)
    battery.see(Witnesses(0.1, 0.0, 21.9, 5.0, 5.0, 0.95))
    assert battery.total == pytest.approx(0.1, abs=1e-9)
