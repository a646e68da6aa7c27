"""A robot file says how sure it is: what it may say is checked, written and read back."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward.physics import RobotError, load_robot
from homeward.physics.uncertainty import Uncertainty

SURE = Uncertainty(
    "two drives", ("rolling", "turning.scrub"), ((0.01, -0.002), (-0.002, 0.04)), 0.03, 0.2, 5.0,
    (("power_noise", 0.01), ("soc_step", 0.01)),
)  # fmt: skip


def test_it_is_written_and_read_back(tmp_path: Path) -> None:
    robot = dataclasses.replace(load_robot("husky"), uncertainty=SURE)
    (tmp_path / "robot.toml").write_text(robot.to_toml())
    assert load_robot(tmp_path / "robot.toml") == robot
    assert load_robot("husky").uncertainty is None


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("uncertainty = 3", "uncertainty = 3 is not a table"),
        ("[uncertainty]\nsize = 1.0", "size is not a known field; known: source"),
        (
            '[uncertainty]\nfitted = ["mass"]\ncovariance = []',
            "covariance is not a table of 1 x 1 numbers",
        ),
        (
            '[uncertainty]\nfitted = ["mass"]\ncovariance = [["much"]]',
            "covariance is not a table of 1 x 1 numbers",
        ),
        ('[uncertainty]\nfitted = ["mass"]\ncovariance = [[-1.0]]', "negative eigenvalue"),
        (
            '[uncertainty]\nfitted = ["mass", "drag"]\ncovariance = [[1.0, 0.5], [0.0, 1.0]]',
            "not symmetric",
        ),
        (
            '[uncertainty]\nfitted = ["mass", "mass"]\ncovariance = [[1.0, 0.0], [0.0, 1.0]]',
            "each once",
        ),
        (
            '[uncertainty]\nfitted = [[1], "drag"]\ncovariance = [[1.0, 0.0], [0.0, 1.0]]',
            "fitted = [[1], 'drag']; give",
        ),
        (
            f"[uncertainty]\nfitted = ['mass']\ncovariance = [[1{'0' * 400}]]",
            "not a table of 1 x 1 numbers",
        ),
        (
            "[uncertainty]\nunexplained = -0.1",
            "unexplained = -0.1 is not allowed; give a number in [0, 100]",
        ),
        ("[uncertainty]\nbetween_runs = true", "between_runs = True is not allowed"),
        ("[uncertainty.instruments]\npower = 1.0", "instruments.power = 1.0 is not a known field"),
        ("[uncertainty.instruments]\nsoc_step = 5.0", "instruments.soc_step = 5.0 is not allowed"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(tmp_path: Path, table: str, said: str) -> None:
    text = load_robot("husky").to_toml()
    first = text.index("[body]")
    whole = table + "\n" + text if table.startswith("uncertainty =") else text + "\n" + table + "\n"
    assert first > 0
    (tmp_path / "robot.toml").write_text(whole)
    with pytest.raises(RobotError) as caught:
        load_robot(tmp_path / "robot.toml")
    assert said in str(caught.value) and "\n" not in str(caught.value)


@given(st.floats(0.1, 1e4), st.floats(0.1, 1e3))
def test_what_nothing_explains_averages_out_over_a_way(way_m: float, length_m: float) -> None:
    one = Uncertainty(unexplained=0.4, unexplained_m=length_m)
    error = one.unexplained_over(way_m)
    assert 0.0 < error <= 0.4 * (1.0 + 1e-9)
    assert one.unexplained_over(2.0 * way_m) < error


def test_it_is_the_error_of_the_mean_of_a_correlated_process() -> None:
    rng, step_m, length_m, count = np.random.default_rng(0), 0.5, 4.0, 60
    kept = np.exp(-step_m / length_m)
    values: Any = np.empty((4000, count))
    values[:, 0] = rng.normal(size=4000)
    for k in range(1, count):
        values[:, k] = kept * values[:, k - 1] + np.sqrt(1.0 - kept**2) * rng.normal(size=4000)
    expected = Uncertainty(unexplained=1.0, unexplained_m=length_m).unexplained_over(step_m * count)
    assert values.mean(axis=1).std() == pytest.approx(expected, rel=0.05)
