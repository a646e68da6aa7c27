"""A gauge that jumps, stays or maps the voltage is said and not believed, and one that is right
again is used again."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from homeward import load_robot
from homeward.companion import Advice, Companion, UncertainValue
from homeward.companion.gauge import FOLLOWS, GaugeTrust
from homeward.estimation import Prior
from homeward.physics.battery import charge_share, open_circuit_v
from tests.companion.robots import HUSKY, Driven

NMC = dataclasses.replace(
    load_robot("husky"), chemistry="nmc", cells_in_series=6, nominal_voltage_v=22.2
)
CAPACITY = 0.9  # of the rated energy, as the battery of the drives below has
OHM = 0.05
Gauge = Callable[[float, float, float], float]
"""Reading of a gauge: by the time, s, the true state of charge and the voltage under load, V."""


def drive(
    gauge: Gauge, *, until_turn: bool = True, seconds: int = 9000
) -> list[tuple[Advice, float]]:
    """Advice every 10 s of a drive straight out on level ground, and the energy that is truly left,
    J."""
    companion, rng = Companion(NMC, home=(0.0, 0.0)), np.random.default_rng(0)
    left_j = full_j = CAPACITY * NMC.usable_energy_j
    given: list[tuple[Advice, float]] = []
    for second in range(0, seconds, 10):
        power_w = 130.0 + 40.0 * rng.standard_normal()  # the load of a rough ground
        left_j -= 10.0 * power_w if second else 0.0
        charge = float(charge_share(NMC.curve, left_j / full_j))
        rest_v = float(open_circuit_v(NMC.curve, charge))
        volts = rest_v - OHM * power_w / rest_v
        advice = companion.update(
            float(second), speed_mps=0.8, power_w=power_w, voltage_v=volts, current_a=power_w / volts,
            soc=min(max(gauge(float(second), charge, volts), 0.0), 1.0), grade_rad=0.0, heading_rad=0.0,
            position=(0.8 * second, 0.0),
        )  # fmt: skip
        given.append((advice, left_j))
        if advice.turn_now and until_turn:
            break
    return given


def follows(second: float, charge: float, volts: float) -> float:
    return charge


def steps_up(second: float, charge: float, volts: float) -> float:
    return charge + (0.08 if second > 2500.0 else 0.0)


def is_reset_to_full(second: float, charge: float, volts: float) -> float:
    return charge if second < 2000.0 else 1.0 - 0.2 * (second - 2000.0) / 9000.0


def stays(second: float, charge: float, volts: float) -> float:
    return charge if second < 1500.0 else 0.87


def maps_the_voltage(second: float, charge: float, volts: float) -> float:
    """Linear from 3 to 4.2 V a cell."""
    return (volts / 6.0 - 3.0) / 1.2


def maps_in_pieces(second: float, charge: float, volts: float) -> float:
    """The six straight pieces of a driver of a robot with 10 cells (husarion_ugv_battery,
    battery.hpp)."""
    pack_v = volts / 6.0 * 10.0
    pieces = ((41.25, 8.665, -258.73), (37.0, 9.153, -278.861), (36.0, 19.8, -672.6), (35.0, 22.84, -782.04),
              (33.7, 10.538, -351.47), (-math.inf, 0.989, -29.669))  # fmt: skip
    slope, offset = next((slope, offset) for above_v, slope, offset in pieces if pack_v > above_v)
    return 0.01 * (slope * pack_v + offset)


def test_a_gauge_that_follows_the_charge_is_believed_and_narrows_the_energy_left() -> None:
    given = drive(follows)
    assert all(not advice.warnings for advice, _ in given)
    first, last = given[5][0].energy_left_j, given[-1][0].energy_left_j
    assert last.sd < 0.6 * first.sd
    assert last.low < given[-1][1] < last.high


@pytest.mark.parametrize(
    "gauge", [steps_up, is_reset_to_full, stays, maps_the_voltage, maps_in_pieces]
)
def test_one_that_does_not_is_said_and_strands_nobody(gauge: Gauge) -> None:
    given = drive(gauge)
    advice, left_j = given[-1]
    assert advice.turn_now
    assert left_j > 0.95 * (advice.energy_home_j.mean)
    said = [text for earlier, _ in given for text in earlier.warnings]
    assert any("power alone is used" in text for text in said)
    assert abs(advice.energy_left_j.mean - left_j) < 3.0 * advice.energy_left_j.sd


@pytest.mark.parametrize("gauge", [follows, steps_up, is_reset_to_full, stays, maps_in_pieces])
def test_the_energy_left_rises_only_within_what_was_said_before_and_says_so(gauge: Gauge) -> None:
    """Energy left falls as it is used; where a reading is believed anew, the mean stays within the
    last interval."""
    given = [advice for advice, _ in drive(gauge)]
    for before, after in itertools.pairwise(given[1:]):
        assert after.energy_left_j.mean < before.energy_left_j.high
        rises_j = after.energy_left_j.mean - before.energy_left_j.mean
        said = any(text.startswith("the energy left rises") for text in after.warnings)
        assert said or rises_j < 0.011 * NMC.usable_energy_j


def creeps_up(second: float) -> float:
    return min(0.3 + 0.7 * second / 900.0, 1.0)


@pytest.mark.parametrize("has_power", [False, True])
@pytest.mark.parametrize("window_s", [None, 10.0, 1.0])
def test_a_rise_of_the_energy_left_is_said_however_slow_it_is(
    has_power: bool, window_s: float | None
) -> None:
    """By less than a step of displays the mean rises unsaid, and stays within the interval at its
    lowest: without power, and where a gauge creeps up, over windows of any length."""
    companion = Companion(HUSKY, home=(0.0, 0.0), window_s=window_s)
    robot = Driven()
    lowest = UncertainValue(math.inf, 0.0)
    for _ in range(1000):
        read = {"soc": creeps_up(robot.time_s)} if has_power else {"power_w": None}
        advice = robot.drive(companion, 0.0, 1.0, **read)
        left = advice.energy_left_j
        is_said = any(text.startswith("the energy left rises") for text in advice.warnings)
        if is_said or left.mean < lowest.mean:
            lowest = left
        assert left.mean < lowest.mean + 0.01 * HUSKY.usable_energy_j
        assert left.mean < lowest.high


def test_shorter_windows_are_no_more_evidence() -> None:
    """What is left, and how sure that is, does not depend on how long readings are averaged: a gauge
    that creeps was believed over windows of a second, within 2 %."""
    left = {}
    for window_s in (None, 1.0):
        companion = Companion(HUSKY, home=(0.0, 0.0), window_s=window_s)
        robot = Driven()
        for _ in range(600):
            advice = robot.drive(companion, 0.0, 1.0, soc=creeps_up(robot.time_s))
        left[window_s] = advice
    usual, short = left[None], left[1.0]
    assert short.energy_left_j.mean == pytest.approx(usual.energy_left_j.mean, rel=0.05)
    assert short.energy_left_j.sd == pytest.approx(usual.energy_left_j.sd, rel=0.05)
    assert short.energy_home_j.sd == pytest.approx(usual.energy_home_j.sd, rel=0.15)


def test_what_was_read_of_a_battery_is_not_taken_for_one_that_replaces_it() -> None:
    """Also where a window has just ended, and the longer one of voltage and gauge has not."""
    companion = Companion(HUSKY, home=(0.0, 0.0), window_s=2.0)
    robot = Driven()
    robot.drive(companion, 0.0, 65.0, soc=0.3)
    companion.swap_battery()
    robot.drive(companion, 0.0, 60.0, soc=None)
    assert not companion._estimator.gauge.has_begun


def test_a_battery_that_is_believed_anew_recovers_nothing() -> None:
    """Where another meter begins, the capacity that was learned is dropped, and so the energy left
    rises."""
    companion, robot = Companion(HUSKY, home=(0.0, 0.0)), Driven(every_s=20.0, health=0.82)
    before = robot.drive(companion, 0.0, 4000.0)
    amperes = robot.power_w() / 24.0
    after = robot.drive(companion, 0.0, 20.0, power_w=None, voltage_v=24.0, current_a=amperes)
    assert after.energy_left_j.mean > before.energy_left_j.mean + 0.01 * HUSKY.usable_energy_j
    assert any(text.startswith("the energy left rises") for text in after.warnings)


def test_one_that_is_right_again_is_used_again() -> None:
    def wrong_for_a_while(second: float, charge: float, volts: float) -> float:
        return charge - (0.3 if 1000.0 < second < 1600.0 else 0.0)

    given = drive(wrong_for_a_while, until_turn=False, seconds=4500)
    said = [any("power alone is used" in text for text in advice.warnings) for advice, _ in given]
    assert any(said[110:160]) and not any(said[-30:])


def test_what_is_left_is_never_more_than_the_battery_holds() -> None:
    for gauge in (maps_the_voltage, is_reset_to_full):
        for advice, _ in drive(gauge):
            assert (
                0.0
                <= advice.energy_left_j.low
                <= advice.energy_left_j.mean
                <= advice.energy_left_j.high
            )
            assert advice.energy_left_j.high <= NMC.usable_energy_j


def test_a_charge_is_not_taken_for_energy() -> None:
    """With a constant voltage in the file, the same drive has more energy left than there is."""
    flat = dataclasses.replace(NMC, chemistry="flat", cells_in_series=0)
    ends = []
    for robot in (NMC, flat):
        companion, left_j = Companion(robot, home=(0.0, 0.0)), 0.9 * NMC.usable_energy_j
        for second in range(0, 5000, 10):
            left_j -= 1300.0 if second else 0.0
            soc = float(charge_share(NMC.curve, left_j / (0.9 * NMC.usable_energy_j)))
            advice = companion.update(
                float(second), speed_mps=0.8, power_w=130.0, soc=soc, position=(0.8 * second, 0.0)
            )
        ends.append(advice.energy_left_j.mean / left_j - 1.0)
    assert abs(ends[0]) < 0.02 < ends[1]


def trusted(drawn: float) -> tuple[GaugeTrust, np.ndarray]:
    """Trust in the gauge of one full battery, and the charge drawn since."""
    trust = GaugeTrust(np.ones(1), Prior(), np.ones(1), np.ones(1), np.zeros(1), 0.3)
    trust.see(1.0, np.zeros(1), np.zeros(1), np.ones(1))
    return trust, np.array([drawn])


def test_what_nobody_can_tell_apart_is_left_to_the_prior() -> None:
    """A reading that stays within the coarsest step of gauges is no evidence, nor is none."""
    trust, drawn = trusted(0.05)
    before = trust.probabilities.copy()
    trust.see(1.0, drawn, np.zeros(1), np.ones(1))
    trust.see(math.nan, drawn, np.zeros(1), np.ones(1))
    np.testing.assert_allclose(trust.probabilities, before, atol=0.02)


def test_one_outlier_does_not_end_the_belief_and_a_lasting_course_of_its_own_does() -> None:
    trust, _ = trusted(0.0)
    for step in range(1, 20):
        drawn = 0.01 * step
        shown = 1.0 - drawn - (0.3 if step == 12 else 0.0)
        trust.see(shown, np.array([drawn]), np.zeros(1), np.ones(1))
    assert trust.believed == FOLLOWS
    for step in range(20, 26):
        trust.see(0.4 + 0.02 * (-1) ** step, np.array([0.01 * step]), np.zeros(1), np.ones(1))
    assert trust.believed != FOLLOWS
    assert trust.joint.sum() == pytest.approx(1.0)
