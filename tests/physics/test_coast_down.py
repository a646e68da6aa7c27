"""A coast-down test and a weighed mass give a robot file its numbers, and narrow what is believed
of them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from homeward import Robot, RobotError, load_robot
from homeward.envs.routes import Route
from homeward.physics import ancillary_power, leg, thresholds, traction_force
from homeward.physics.coast_down import from_table

HUSKY = load_robot("husky")
TABLE = """
[coast_down]
source = "eight runs on asphalt, and a scale"
a_n = 30.0
a_sd_n = 0.6
b_ns_per_m = 4.0
b_sd_ns_per_m = 1.0
c_ns2_per_m2 = 0.5
c_sd_ns2_per_m2 = 0.1
mass_sd_kg = 0.5
"""


def written(folder: Path, table: str = TABLE, keep: tuple[str, ...] = ()) -> Path:
    """The file of a Husky with the table, and without the numbers that it gives."""
    given = [name for name in ("rolling_resistance", "drag_ns2_per_m2") if name not in keep]
    lines = [line for line in HUSKY.to_toml().splitlines() if not line.startswith(tuple(given))]
    path = folder / "robot.toml"
    path.write_text("\n".join(lines) + "\n" + table)
    return path


def test_the_robot_rolls_out_as_it_was_measured(tmp_path: Path) -> None:
    robot = load_robot(written(tmp_path))
    speed_mps = np.array([0.0, 0.5, 1.0])
    drag_ns_per_m = robot.effects["viscous"]["drag_ns_per_m"]
    force_n = traction_force(robot, speed_mps, 0.0) + drag_ns_per_m * speed_mps
    np.testing.assert_allclose(force_n, 30.0 + 4.0 * speed_mps + 0.5 * speed_mps**2)
    sure = robot.uncertainty
    assert (
        sure is not None
        and sure.of == "force"
        and sure.source == "eight runs on asphalt, and a scale"
    )
    for name, share in {
        "rolling": 0.02,
        "viscous.drag_ns_per_m": 0.25,
        "drag": 0.2,
        "mass": 0.01,
    }.items():
        assert sure.variance(name) == pytest.approx(share**2)
    assert np.count_nonzero(sure.covariance) == 4
    again = tmp_path / "again.toml"
    again.write_text(robot.to_toml())
    assert load_robot(again).to_toml() == robot.to_toml() and 'of = "force"' in robot.to_toml()


def test_what_was_measured_narrows_the_energy_of_a_leg(tmp_path: Path) -> None:
    flat = np.zeros(40)
    hill = Route(
        place_m=50.0,
        grade_rad=np.repeat((0.05, -0.05), 20),
        roughness=flat,
        interest=flat,
        heading_rad=flat,
    )

    def sd_j(robot: Robot) -> float:
        return leg(robot, hill, speed_mps=0.8).sd_j

    measured = load_robot(written(tmp_path))
    unknown = sd_j(dataclasses.replace(measured, uncertainty=None))
    weighed = sd_j(
        load_robot(
            written(
                tmp_path,
                "[coast_down]\nmass_sd_kg = 0.5\n",
                ("rolling_resistance", "drag_ns2_per_m2"),
            )
        )
    )
    # The power at rest is as unsure as before: 2 km at 0.8 m/s last 2,500 s.
    at_rest_j = thresholds.GENERIC_IDLE_SD * float(ancillary_power(measured, 0.0)) * 2500.0
    assert sd_j(measured) ** 2 - at_rest_j**2 < 0.5 * (unknown**2 - at_rest_j**2)
    assert sd_j(measured) < weighed < sd_j(HUSKY)
    unsure = TABLE.replace("a_sd_n = 0.6", "a_sd_n = 9.0")
    assert sd_j(load_robot(written(tmp_path, unsure))) > unknown


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (
            "a_n = 0.6\nmas_sd_kg = 1.0",
            r"coast_down\.mas_sd_kg is not a known field; known: source, a_n",
        ),
        (
            "b_ns_per_m = -0.4",
            r"b_ns_per_m = -0\.4 is not allowed; .* fit F = a \+ c v\^2 without b",
        ),
        ("a_n = 'much'", "a_n = 'much' is not allowed"),
        ("a_n = 30.0\na_sd_n = 0", r"a_sd_n = 0 is not allowed; give a number in \(0, "),
        ("a_sd_n = 0.5", "a_sd_n needs a_n above 0; give both, or neither"),
        ("source = 3", "source = 3 is not a text"),
        ("a_n = 900.0", r"body\.rolling_resistance = 1\.8\d* is not allowed"),
    ],
)
def test_bad_input_takes_one_line(table: str, said: str, tmp_path: Path) -> None:
    given = ("rolling_resistance",) if table.startswith("a_n") else ()
    keep = tuple({"rolling_resistance", "drag_ns2_per_m2"} - set(given))
    path = written(tmp_path, f"[coast_down]\n{table}\n", keep)
    with pytest.raises(RobotError, match=said) as error:
        load_robot(path)
    assert "\n" not in str(error.value)


def test_what_stands_twice_is_refused(tmp_path: Path) -> None:
    twice = (
        TABLE
        + '\n[uncertainty]\nsource = "a diagnosis"\n\n[effects.viscous]\ndrag_ns_per_m = 1.0\n'
    )
    said = "gives body.rolling_resistance, effects.viscous, uncertainty too; remove one of them"
    with pytest.raises(RobotError, match=said):
        load_robot(written(tmp_path, twice, ("rolling_resistance",)))
    path = tmp_path / "number.toml"
    path.write_text("coast_down = 3\n" + HUSKY.to_toml())
    with pytest.raises(RobotError, match="coast_down = 3 is not a table"):
        load_robot(path)
    assert from_table({"a_n": 3.0}, 1.0).uncertainty is None
