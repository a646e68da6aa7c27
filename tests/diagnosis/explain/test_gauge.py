"""A gauge that counts is believed, one that follows the voltage is not, and nothing is drawn from
too little."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from homeward import Robot, load_robot
from homeward.diagnosis import Diagnosis, Recording, analyse
from homeward.diagnosis.explain.channel_effects.find import find_effects
from homeward.diagnosis.explain.gauge import weigh_gauge
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.read.signals import signals
from homeward.diagnosis.result import Gauge
from homeward.physics.battery import charge_share, open_circuit_v
from tests.diagnosis.explain.test_channel_effects import drawn_faster, with_charge

Drive = Callable[..., list[Recording]]
Array = NDArray[np.float64]
# what a gauge shows of the charge left and of the voltage of a cell
Shows = Callable[[Array, Array], Array]

OHM = 0.07  # loses 1 to 2 % of the energy of a Husky, less than would be named
STEPS_IN_10_S = 100


def counter(charge: Array, cell_v: Array) -> Array:
    """A smart battery: whole per cents."""
    return np.asarray(np.round(charge, 2))


def rough_counter(charge: Array, cell_v: Array) -> Array:
    """Noise of half a per cent, shown in steps of five."""
    noise = 0.005 * np.random.default_rng(len(charge)).standard_normal(len(charge))
    return np.asarray(np.round((charge + noise) / 0.05) * 0.05)


def reset_counter(charge: Array, cell_v: Array) -> Array:
    """Set 8 % up in mid-run, as on a restart of a Nissan Leaf's battery monitor."""
    return np.asarray(
        np.round(charge - 0.1 + 0.08 * (np.arange(len(charge)) > len(charge) // 2), 2)
    )


def stuck_counter(charge: Array, cell_v: Array) -> Array:
    """One that stays from mid-run on."""
    return np.round(charge[np.minimum(np.arange(len(charge)), len(charge) // 2)], 2)


def map_of(empty_v: float, full_v: float) -> Shows:
    """A percentage that a driver computes from the mean voltage of ten seconds, with volts of a
    cell at 0 and 100 %."""

    def shows(charge: Array, cell_v: Array) -> Array:
        mean_v = uniform_filter1d(
            cell_v, STEPS_IN_10_S, mode="nearest", origin=(STEPS_IN_10_S - 1) // 2
        )
        return np.round(np.interp(mean_v, [empty_v, full_v], [0.0, 1.0]), 2)

    return shows


# of Husarion's Panther; cut-off, and rest after charging
HUSARION, LFP_MAP = map_of(3.2, 4.14), map_of(2.8, 3.4)


def with_battery(
    runs: Sequence[Recording], robot: Robot, shows: Shows, with_voltage: bool = True
) -> list[Recording]:
    """The runs with gauge and voltage of a robot's battery as it empties from 95 %, behind a
    resistance."""
    recordings = []
    for seed, run in enumerate(runs):
        of = dict(run.channels)
        power_w = of.pop("power_w")
        drawn_j = np.concatenate(([0.0], np.cumsum(power_w[:-1] * np.diff(of["time_s"]))))
        charge = charge_share(robot.curve, np.maximum(0.95 - drawn_j / robot.usable_energy_j, 0.0))
        inside_v = open_circuit_v(robot.curve, charge)
        current_a = 2.0 * power_w / (inside_v + np.sqrt(inside_v**2 - 4.0 * OHM * power_w))
        volts = (
            inside_v
            - OHM * current_a
            + 0.01 * np.random.default_rng(seed).standard_normal(len(power_w))
        )
        electric = (
            {"voltage_v": volts, "current_a": current_a} if with_voltage else {"power_w": power_w}
        )
        of |= electric | {"soc": shows(charge, volts / robot.cells_in_series)}
        recordings.append(dataclasses.replace(run, channels=of))
    return recordings


def judged(runs: Sequence[Recording], robot: Robot) -> Gauge:
    gauge = weigh_gauge(average([signals(run, robot) for run in runs]), robot)[1]
    assert gauge is not None
    return gauge


@pytest.fixture(scope="module")
def nmc() -> Robot:
    """A Husky with cells of which a drive of two minutes uses more than half."""
    husky = load_robot("husky")
    return dataclasses.replace(husky, rated_energy_j=2.4e4, chemistry="nmc", cells_in_series=7)


@pytest.fixture(scope="module")
def larger(nmc: Robot) -> Robot:
    """One with ten times the cells."""
    return dataclasses.replace(nmc, rated_energy_j=2.4e5)


@pytest.mark.parametrize("with_voltage", [True, False])
@pytest.mark.parametrize(
    ("shows", "words"),
    [
        (counter, ""),
        (rough_counter, ""),
        (reset_counter, "jumps by +8%"),
        (stuck_counter, "stays for"),
    ],
)
def test_a_counter_is_believed_whatever_it_shows_of_the_charge(
    shows: Shows, words: str, with_voltage: bool, short_drive: Drive, nmc: Robot
) -> None:
    gauge = judged(with_battery(short_drive(nmc), nmc, shows, with_voltage), nmc)
    assert gauge.follows == "charge"
    assert words in gauge.says
    assert ("jumps" in gauge.says, "stays" in gauge.says) == ("jumps" in words, "stays" in words)


@pytest.mark.parametrize(("with_voltage", "follows"), [(True, "voltage"), (False, "load")])
@pytest.mark.parametrize(
    ("chemistry", "cells", "shows"), [("nmc", 7, HUSARION), ("lfp", 8, LFP_MAP)]
)
def test_a_map_of_the_voltage_is_not(
    chemistry: str,
    cells: int,
    shows: Shows,
    with_voltage: bool,
    follows: str,
    short_drive: Drive,
    larger: Robot,
) -> None:
    robot = dataclasses.replace(larger, chemistry=chemistry, cells_in_series=cells)
    gauge = judged(with_battery(short_drive(robot), robot, shows, with_voltage), robot)
    assert gauge.follows == follows
    assert "no capacity" in gauge.says and gauge.covered is None


def test_a_distrusted_gauge_is_said_and_changes_nothing(short_drive: Drive, larger: Robot) -> None:
    """The robot is equal to its file, only its gauge is a map of the voltage."""
    analysis = analyse(with_battery(short_drive(larger), larger, HUSARION), larger)
    diagnosis = analysis.diagnosis
    assert diagnosis.verdict == "no_mismatch"
    assert "state of charge follows the voltage under load" in diagnosis.summary
    assert analysis.corrected.rated_energy_j == larger.rated_energy_j
    assert any("follows the voltage" in finding.text for finding in analysis.findings)
    assert diagnosis.gauge is not None and diagnosis.gauge.drawn_j == pytest.approx(5.8e4, rel=0.05)
    assert Diagnosis.from_json(diagnosis.to_json()) == diagnosis


def test_a_capacity_above_the_rated_one_is_asked_about_and_not_written(
    short_drive: Drive, nmc: Robot
) -> None:
    rated_less = dataclasses.replace(nmc, rated_energy_j=nmc.rated_energy_j / 1.4)
    analysis = analyse(with_battery(short_drive(nmc), nmc, counter), rated_less)
    diagnosis = analysis.diagnosis
    assert diagnosis.verdict == "no_mismatch" and diagnosis.parameters_off == ()
    assert diagnosis.gauge is not None and diagnosis.gauge.question is not None
    assert "is it another battery" in diagnosis.summary
    assert analysis.corrected.rated_energy_j == rated_less.rated_energy_j


@pytest.mark.parametrize("share", [0.45, 0.1])
def test_of_a_part_of_a_battery_only_the_energy_drawn_is_stated(
    share: float, short_drive: Drive, nmc: Robot
) -> None:
    """Its gauge falls 40 % too fast, by less than half of its charge."""
    robot = dataclasses.replace(
        nmc, rated_energy_j=1.77e4 * 1.4 / share, chemistry="flat", cells_in_series=0
    )
    runs, gauge = weigh_gauge(
        average(
            [
                signals(run, robot)
                for run in with_charge(short_drive(robot), robot, [1.0 - 1.0 / 1.4] * 4)
            ]
        ),
        robot,
    )
    assert gauge is not None and gauge.covered == pytest.approx(share, abs=0.02)
    assert "58 kJ were drawn in all: no capacity" in gauge.says
    fitted = refit(runs, robot)
    assert find_effects(fitted, runs, cut_blocks(runs.run), np.random.default_rng(0))[0] is None


PEUKERT = {"rate_capacity": {"excess": 0.3, "reference_w": 80.0}}
FADED = {"ageing": {"lost_share": 0.08}}


@pytest.mark.parametrize(
    ("effects", "counted", "words"),
    [
        (PEUKERT, True, "by it, power_w counts what"),
        (PEUKERT, False, "by it, power_w is without what"),
        # a gauge and a battery's capacity may be off by as much
        (FADED, True, "whether power_w counts what"),
    ],
)
def test_the_charge_decides_whether_power_counts_what_the_battery_loses(
    effects: dict[str, dict[str, float]],
    counted: bool,
    words: str,
    short_drive: Drive,
    husky: Robot,
) -> None:
    small = dataclasses.replace(husky, rated_energy_j=1.2e5)
    holding = dataclasses.replace(small, effects=effects)
    if counted:
        runs = with_charge(short_drive(holding), small, [0.0] * 4)
    else:
        runs = drawn_faster(short_drive(small), small, **effects["rate_capacity"])
    assert words in judged(runs, holding).says
