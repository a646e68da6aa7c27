"""Gauges: each shows what its entry says, a mission has one of them, and a robot only those that it
can have."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward import load_robot
from homeward.envs.conditions.gauges import (
    COUNTER,
    GAUGES,
    LOST,
    MOST_POINTS,
    RISE,
    pack_map,
    rms_error,
    suits,
)
from homeward.envs.conditions.instruments import INSTRUMENTS, Instruments
from homeward.envs.options import OptionError, Options, known_of
from homeward.envs.state import GO
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import Robot
from homeward.physics.battery import CHEMISTRIES, FLAT, charge_share, open_circuit_v
from tests.envs.conditions.test_instruments import Readings
from tests.envs.rollouts import make

BURGER = dataclasses.replace(
    load_robot("turtlebot3_burger"), chemistry="lipo", cells_in_series=3,
    effects={"internal_resistance": {"ohm": 0.1}},
)  # fmt: skip
OWN = dataclasses.replace(
    BURGER, chemistry=FLAT, cells_in_series=0, open_circuit_v=((0.0, 10.0), (1.0, 12.6))
)
COUNTED = Instruments(soc_noise=1e-9)


@pytest.fixture(scope="module")
def readings() -> Readings:
    """Many missions, each with any gauge, whose errors are its own alone."""
    return Readings(
        dataclasses.replace(COUNTED, gauges=tuple(GAUGES)), robot=BURGER, difficulty="harsh"
    )


def shown_and_true(readings: Readings, name: str) -> Any:
    """What the missions with a gauge show and what is left, shares of charge, shape (decisions,
    missions)."""
    has = readings.start["gauge"] == list(GAUGES).index(name)
    share = charge_share(BURGER.curve, np.stack((readings.states["soc"], readings.charge)))
    return share[..., has], readings.power_w[:, has]


def test_all_gauges_are_equally_likely_and_belong_to_the_mission(readings: Readings) -> None:
    count = np.bincount(readings.start["gauge"], minlength=len(GAUGES))
    assert np.abs(count - count.mean()).max() < 4.0 * np.sqrt(count.mean())
    assert (readings.states["gauge"] == readings.start["gauge"]).all()


def test_counters_show_the_charge_in_their_steps(readings: Readings) -> None:
    (shown, true), _ = shown_and_true(readings, COUNTER)
    np.testing.assert_allclose(shown, true, atol=1e-7)
    (shown, true), _ = shown_and_true(readings, "coarse")
    np.testing.assert_allclose(20.0 * shown, np.rint(20.0 * shown), atol=1e-6)
    assert np.abs(shown - true).max() < 0.025 + 1e-6


def test_a_late_one_shows_the_charge_of_before(readings: Readings) -> None:
    (shown, true), _ = shown_and_true(readings, "late")
    rate = (1.0 - true[-1]) / len(true)
    behind = np.mean((shown - true)[20:] / rate) * float(readings.shared["decision_s"])
    assert behind == pytest.approx(GAUGES["late"].lag_s, rel=0.05)


@pytest.mark.parametrize("name", ["linear_voltage", "pieces_voltage"])
def test_a_map_shows_the_voltage_under_load(readings: Readings, name: str) -> None:
    (shown, true), power_w = shown_and_true(readings, name)
    rest_v = open_circuit_v(BURGER.curve, true)
    volts = rest_v - 0.1 * power_w / rest_v
    cell_v, share = np.transpose(GAUGES[name].map["lipo"])
    np.testing.assert_allclose(shown, np.interp(volts / 3.0, cell_v, share), atol=0.005 + 1e-6)
    assert np.abs(shown - np.interp(rest_v / 3.0, cell_v, share)).max() > 0.005, "a load lowers it"


@pytest.mark.parametrize("name", ["reset_full", "reset_voltage"])
def test_one_that_is_reset_counts_on_from_there(readings: Readings, name: str) -> None:
    (shown, true), power_w = shown_and_true(readings, name)
    jumps = np.abs(np.diff(shown - true, axis=0)) > 0.005
    assert jumps.sum(axis=0).max() == 1 and jumps.any(axis=0).mean() > 0.3
    decision, which = np.nonzero(jumps)
    assert GAUGES[name].reset_left[0] - 0.02 < true[decision + 1, which].min()
    assert true[decision + 1, which].max() < GAUGES[name].reset_left[1]
    set_to = np.ones(len(which))
    if name == "reset_voltage":
        rest_v = open_circuit_v(BURGER.curve, true[decision + 1, which])
        volts = rest_v - 0.1 * power_w[decision + 1, which] / rest_v
        set_to = np.interp(volts, *np.transpose(pack_map(GAUGES[name], BURGER)))
    np.testing.assert_allclose(shown[decision + 1, which], set_to, atol=1e-6)


def test_a_robot_of_constant_voltage_has_no_map_of_it() -> None:
    rusti, name = load_robot("rusti_computer"), "linear_voltage"
    assert {gauge for gauge in GAUGES if suits(GAUGES[gauge], rusti)} == {
        COUNTER,
        "coarse",
        "late",
        "reset_full",
    }
    assert known_of(Options("Survey", difficulty="harsh")).shared["gauge_count"][0] == 4
    with pytest.raises(
        OptionError, match="'rusti_computer' has a constant voltage; give its chemistry"
    ):
        make("Survey", instruments=Instruments(gauges=(name,)))


@pytest.mark.parametrize("given", ["late", [], ["late", "early"], [3], None])
def test_gauges_that_are_none_say_what_there_is(given: Any) -> None:
    with pytest.raises(
        ValueError, match=r"gauges = .* is not allowed; give a list of counter, linear_voltage"
    ):
        Instruments(gauges=given)


def test_the_gauge_changes_nothing_else_of_a_mission() -> None:
    """The other conditions of a seed, and a mission whose gauge is the counter, are those of
    `gauge`."""
    envs = [
        HomewardVectorEnv(40, mission="Survey", difficulty="harsh", instruments=name)
        for name in ("any_gauge", "gauge")
    ]
    for env in envs:
        env.reset(seed=5)
    ours, theirs = (env.batch.records for env in envs)
    for name in (
        "capacity_j",
        "key",
        "meter_gain",
        "meter_offset_w",
        "gust_keeps",
        "temperature_c",
    ):
        np.testing.assert_array_equal(ours[name], theirs[name])
    for _ in range(60):
        for env in envs:
            env.step(np.full((40, 3), (4, 2, 1)))
    counts = ours["gauge"] == 0
    np.testing.assert_array_equal(ours["soc"][counts], theirs["soc"][counts])
    assert (ours["soc"] != theirs["soc"])[~counts].mean() > 0.5


@pytest.mark.parametrize("robot", [BURGER, OWN])
def test_what_agents_know_of_its_error_is_its_error(robot: Robot) -> None:
    """Over an even discharge from full to empty of a robot whose instruments have no other
    error."""
    count = 20
    drive_on = np.full((count, 3), (4, 0, GO))
    for name, gauge in GAUGES.items():
        instruments = dataclasses.replace(COUNTED, gauges=(name,))
        envs = HomewardVectorEnv(
            count, mission="OutAndBack", robot=robot, difficulty="known", instruments=instruments
        )
        envs.reset(seed=0)
        m, squares = envs.batch.records, []
        while not m["over"].any():
            energy_share: NDArray[np.float64] = m["energy_j"] / m["capacity_j"]
            shown, true = charge_share(robot.curve, np.stack((m["soc"], energy_share)))
            squares.append((shown - true) ** 2)
            envs.step(drive_on)
        lasts_s = robot.usable_energy_j / float(envs.batch.known.shared["cruise_w"][0])
        assert np.sqrt(np.mean(squares)) == pytest.approx(
            rms_error(gauge, robot, lasts_s), rel=0.35, abs=1e-6
        )


def test_a_gauge_that_rises_is_believed_no_more() -> None:
    """By the meter, which goes on with what it has learned: a reset to full does not fill the
    battery."""
    instruments = dataclasses.replace(INSTRUMENTS["gauge"], gauges=("reset_full",))
    found = Readings(instruments, 200, difficulty="harsh")
    reset = (found.states["gauge_shift"] > RISE + 0.03).any(axis=0)
    assert 0.2 < reset.mean() < 0.9
    assert (found.states["soc_lowest"][-1] == LOST)[reset].all()
    off = (found.states["metered"] - found.charge)[-1]
    shown = (found.states["soc"] - found.charge)[-1]
    assert np.abs(off[reset]).max() < 0.05 < shown[reset].min()
    counted = Readings("gauge", 200, difficulty="harsh")
    assert (counted.states["soc_lowest"] != LOST).all()


def test_maps_rise_within_their_records() -> None:
    for name, gauge in GAUGES.items():
        for chemistry in CHEMISTRIES if gauge.map else ():
            volts, shares = np.transpose(gauge.map[chemistry])
            assert 2 <= len(volts) <= MOST_POINTS, name
            assert (
                (np.diff(volts) > 0.0).all()
                and (np.diff(shares) > 0.0).all()
                and shares[[0, -1]].tolist() == [0, 1]
            )
