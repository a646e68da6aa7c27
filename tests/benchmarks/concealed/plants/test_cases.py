"""Cases: their recordings obey the format, and what is concealed is in them."""

import dataclasses
import itertools

import numpy as np
import pandas as pd
import pytest

from benchmarks.concealed.plants.cases import (
    BATTERY_LAWS,
    NEEDS,
    PARTS,
    Part,
    go_together,
    missed_share,
    misset,
)
from benchmarks.concealed.plants.chain import rollout
from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.plants.effects import EFFECTS, INSTRUMENTS
from benchmarks.concealed.plants.instruments import FAULTS, NOISES, Logging, record
from benchmarks.concealed.plants.motion import make_drives, make_route
from benchmarks.concealed.plants.outside import OUTSIDE, make_outside
from benchmarks.concealed.plants.vehicles import SCOUT

ALLOWED = {
    "time_s", "speed_mps", "wheel_left_mps", "wheel_right_mps", "yaw_rate_radps", "grade_rad", "elevation_m",
    "distance_m", "heading_rad", "power_w", "voltage_v", "current_a", "sensing_hz", "soc", "temperature_c",
    "base_distance_m",
}  # fmt: skip
WITHOUT_REPLAY: tuple[Part, ...] = tuple(
    part for part in PARTS if part != "coverage" and part not in NEEDS
)  # which compiles kernels or needs simulators


@pytest.mark.parametrize("part", WITHOUT_REPLAY)
def test_recordings_obey_the_format(part: Part) -> None:
    for number in range(3):
        for frame in make_case(part, 1, number, short=True).recordings:
            assert set(frame) <= ALLOWED
            assert np.all(np.diff(frame["time_s"]) > 0.0)
            assert np.isfinite(frame.to_numpy()).all()
            assert "power_w" in frame or {"voltage_v", "current_a"} <= set(frame)
            assert "speed_mps" in frame or {"wheel_left_mps", "wheel_right_mps"} <= set(frame)


def test_every_mechanism_and_fault_changes_what_is_recorded() -> None:
    rng = np.random.default_rng(1)
    drives = make_drives(
        SCOUT, [make_route(SCOUT, rng) for _ in range(2)], rng, 5, -4.0, short=True
    )
    hidden = {name: draw(SCOUT, rng, 5) for name, draw in EFFECTS.items()}
    hidden |= {name: make_outside(name, SCOUT, rng, 5)[0] for name in OUTSIDE}

    def written(*names: str) -> pd.DataFrame:
        works = [
            rollout(SCOUT, run, [hidden[n] for n in names], np.random.default_rng(2), "terminals")
            for run in drives
        ]
        noise = NOISES["low"]
        return pd.concat(
            [record(work, noise, Logging(), np.random.default_rng(3)) for work in works]
        )

    clean = written()
    # which want steeper hills and hotter air than these
    for name in set(hidden) - {"regeneration", "cooler"}:
        assert not written(name).equals(clean), name
    work = rollout(SCOUT, drives[0], [], rng)
    frame = record(work, NOISES["low"], Logging(), rng)
    for name, fault in FAULTS.items():
        assert not fault(frame, work, 0.5, rng).equals(frame), name


def test_a_misset_file_is_off_within_limits_and_never_in_mass_and_rolling_at_once() -> None:
    names = ("rolling_resistance", "controller_w", "sensing_j_per_sample", "mass_kg")
    wrong = set()
    for seed in range(60):
        robot = misset(SCOUT.robot, np.random.default_rng(seed), 0.1, 0.4)
        errors = {name: getattr(robot, name) / getattr(SCOUT.robot, name) - 1.0 for name in names}
        off = {name for name, error in errors.items() if error != 0.0}
        assert all(0.1 - 1e-9 <= abs(errors[name]) <= 0.4 + 1e-9 for name in off)
        assert ("mass_kg" in off) != ("rolling_resistance" in off)
        assert (
            dataclasses.replace(robot, **{name: getattr(SCOUT.robot, name) for name in names})
            == SCOUT.robot
        )
        wrong |= off
    assert wrong == set(names)


def test_a_refit_misses_nothing_of_the_papers_model_and_what_no_parameter_makes_up_for() -> None:
    rng = np.random.default_rng(0)
    drives = make_drives(SCOUT, [make_route(SCOUT, rng)], rng, 3, 15.0, short=True)

    def missed(*effects: str) -> float:
        some = [EFFECTS[name](SCOUT, np.random.default_rng(1), len(drives)) for name in effects]
        return missed_share(
            [rollout(SCOUT, run, some, np.random.default_rng(2), "gauge") for run in drives]
        )

    assert missed() < 0.01 < 0.03 < missed("turning")


def test_two_faults_of_instruments_two_laws_of_a_battery_and_heat_and_cold_are_not_hidden_together() -> (
    None
):
    apart = {(one, other) for one in EFFECTS for other in EFFECTS if not go_together(one, other)}
    alike = [(name, name) for name in EFFECTS]
    weather = [
        pair for cold in ("heater", "cold_battery") for pair in ((cold, "cooler"), ("cooler", cold))
    ]
    of_kind = (itertools.product(kind, repeat=2) for kind in (INSTRUMENTS, BATTERY_LAWS))
    assert apart == {*alike, *weather, *itertools.chain(*of_kind)}


def test_an_effect_is_visible_from_three_per_cent() -> None:
    case = make_case("singles", 1, 0, short=True)
    shares = dataclasses.replace(case, refit_misses={"slip": 0.031, "radio": 0.029})
    assert shares.visible == {"slip": True, "radio": False}
