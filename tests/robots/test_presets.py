"""The robots that ship with the project: sourced, and as plausible as their makers' run times let
one check."""

import dataclasses
import math
import re
import tomllib
from pathlib import Path

import pytest

from homeward import Robot, load_robot
from homeward.physics import ancillary_power, d_max, preset_names, traction_force

PRESETS = preset_names()
NUMBER = re.compile(r"^\s*\w+\s*=\s*[-+]?[\d.][\w.+-]*\s*(?P<comment>#.*)?$")


def preset_file(root: Path, name: str) -> Path:
    return root / "homeward" / "robots" / f"{name}.toml"


def hours(robot: Robot, speed_mps: float, duty: float = 1.0, sensing_hz: float = 0.0) -> float:
    return float(
        d_max(robot, speed_mps, duty=duty, sensing_hz=sensing_hz) / (speed_mps * duty) / 3600.0
    )


def standing_hours(robot: Robot) -> float:
    return float(robot.usable_energy_j / ancillary_power(robot, 0.0) / 3600.0)


def test_the_promised_presets_are_there() -> None:
    assert {"husky", "jackal", "rusti", "rusti_computer", "turtlebot3_burger"} <= set(PRESETS)


@pytest.mark.parametrize("name", PRESETS)
def test_preset_loads_under_its_own_name(name: str) -> None:
    robot = load_robot(name)
    assert robot.name == name
    assert robot.description.endswith(".")


@pytest.mark.parametrize("name", PRESETS)
def test_every_number_has_its_source_on_its_line(name: str, root: Path) -> None:
    text = preset_file(root, name).read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if NUMBER.match(line)]
    tables = [table for table in tomllib.loads(text).values() if isinstance(table, dict)]
    numbers = [value for table in tables for value in table.values() if not isinstance(value, str)]
    assert len(lines) == len(numbers), "a number is written in a way that this test cannot see"
    for line in lines:
        match = NUMBER.match(line)
        assert match and match["comment"] and len(match["comment"]) > 10, (
            f"no source beside: {line}"
        )


@pytest.mark.parametrize("name", PRESETS)
def test_a_robot_written_and_read_back_is_the_same(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    path = tmp_path / "robot.toml"
    path.write_text(robot.to_toml(), encoding="utf-8")
    assert load_robot(path) == robot


@pytest.mark.parametrize("name", PRESETS)
def test_battery_discharges_at_a_rate_that_it_survives(name: str) -> None:
    robot = load_robot(name)
    assert 0.2 < hours(robot, robot.max_speed_mps, sensing_hz=robot.max_sensing_hz) < 24.0


# those whose motor constant is known
@pytest.mark.parametrize("name", ["husky", "turtlebot3_burger"])
def test_motor_constant_agrees_with_the_top_speed(name: str) -> None:
    robot = load_robot(name)
    # N/A is V s/m: without load, a full battery (15 % above nominal) spins the wheels at the top
    # speed or faster.
    free_speed_mps = 1.15 * robot.nominal_voltage_v / robot.traction_n_per_a
    assert robot.max_speed_mps < free_speed_mps < 2.0 * robot.max_speed_mps


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_says_how_sure_it_is_with_a_source_or_why_it_does_not(
    name: str, root: Path
) -> None:
    sure, text = load_robot(name).uncertainty, preset_file(root, name).read_text(encoding="utf-8")
    assert (sure is None) == ("# No [uncertainty]: " in text)
    assert sure is None or len(sure.source) > 10


def test_rusti_is_as_sure_as_the_paper_says() -> None:
    sure = load_robot("rusti").uncertainty
    assert sure is not None
    least, most = 1.0 - 0.91, 1.0 - 0.66
    # The mean square of what is spread evenly between two limits.
    assert sure.between_runs == pytest.approx(
        math.sqrt((most**3 - least**3) / (3.0 * (most - least))), abs=0.005
    )


def test_rusti_computer_differs_from_rusti_in_the_computer_alone() -> None:
    rusti, computer = load_robot("rusti"), load_robot("rusti_computer")
    without = dataclasses.replace(
        computer, name=rusti.name, description=rusti.description, computer_w=0.0, computer_j_per_sample=0.0,
        uncertainty=rusti.uncertainty,
    )  # fmt: skip
    assert without == rusti


def test_husky_runs_as_long_as_its_maker_states() -> None:
    husky = load_robot("husky")
    assert hours(husky, 1.0) == pytest.approx(3.0, rel=0.05)
    assert standing_hours(husky) == pytest.approx(8.0, rel=0.02)


def test_husky_climbs_as_steep_as_its_maker_states() -> None:
    husky = load_robot("husky")
    # both motors at the driver's limit (the maker's troubleshooting page)
    peak_current_a = 2 * 26.0
    thrust_n = husky.traction_n_per_a * peak_current_a * (1.0 - husky.friction_loss)
    assert traction_force(husky, husky.min_speed_mps, math.radians(45.0)) < thrust_n


def test_jackal_runs_between_its_makers_heavy_and_basic_use() -> None:
    jackal = load_robot("jackal")
    # the maker's maximum payload
    loaded = dataclasses.replace(jackal, mass_kg=jackal.mass_kg + 20.0)
    assert hours(jackal, 0.5, duty=0.5) == pytest.approx(8.0, rel=0.1)
    assert (
        hours(loaded, jackal.max_speed_mps)
        < 2.0
        < hours(jackal, jackal.max_speed_mps, sensing_hz=50.0)
        < 2.5
    )
    assert standing_hours(jackal) > 8.0


def test_turtlebot3_runs_about_as_long_as_its_maker_states() -> None:
    burger = load_robot("turtlebot3_burger")
    computing = hours(burger, burger.max_speed_mps, sensing_hz=burger.max_sensing_hz)
    assert 1.9 < computing < 2.5 < hours(burger, burger.max_speed_mps) < 3.1
