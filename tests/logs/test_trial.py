"""Proposals are tried on physics: what another column contradicts is not certain, and may show the
unit."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.logs.guess import SURE
from homeward.logs.propose import propose

T = np.arange(600) / 5.0
SPEED = 0.5 + 0.4 * np.sin(T / 8.0)
WAY = np.cumsum(SPEED) / 5.0
VOLTAGE, CURRENT = 25.0 + np.sin(T / 18.0), 4.0 + np.sin(T / 8.0)
BASE = {"time_s": T, "speed_mps": SPEED, "voltage_v": VOLTAGE, "current_a": CURRENT}


def proposed(folder: Path, **columns: object) -> dict[str, tuple[float, str, str]]:
    """Factor, confidence and reason of each channel."""
    path = folder / "run.csv"
    pd.DataFrame({name.replace("__", " "): values for name, values in columns.items()}).to_csv(
        path, index=False
    )
    guesses = propose(path).guesses
    return {guess.channel: (guess.factor, SURE[guess.sure], guess.why) for guess in guesses}


@pytest.mark.parametrize(
    ("names", "column", "values", "doubted"),
    [
        ({}, "distance_m", WAY / 3.6, ("speed_mps", "distance_m")),
        ({}, "power_w", 3.0 * VOLTAGE * CURRENT, ("power_w", "voltage_v", "current_a")),
    ],
)
def test_what_physics_contradicts_is_not_certain(
    tmp_path: Path, names: dict[str, object], column: str, values: object, doubted: tuple[str, ...]
) -> None:
    guesses = proposed(tmp_path, **BASE, **{column: values})
    assert {name for name, (_, sure, _) in guesses.items() if sure == "a guess"} == {*doubted}
    assert "one has another unit" in guesses[column][2]


def test_what_agrees_stays_certain_and_says_so(tmp_path: Path) -> None:
    guesses = proposed(tmp_path, **BASE, distance_m=WAY, power_w=VOLTAGE * CURRENT)
    assert {sure for _, sure, _ in guesses.values()} == {"certain"}
    assert (
        "agrees with distance_m" in guesses["speed_mps"][2]
        and "agrees with" in guesses["power_w"][2]
    )


def test_the_way_shows_a_unit_that_the_name_lacks(tmp_path: Path) -> None:
    by_speed = proposed(
        tmp_path, **{**BASE, "speed_mps": None, "velocity": 3.6 * SPEED}, distance_m=WAY
    )
    assert round(by_speed["speed_mps"][0], 4) == 0.2778 and by_speed["speed_mps"][1] == "likely"
    fast = {
        "t": 200.0 * np.arange(600),
        "speed_mps": SPEED,
        "voltage_v": VOLTAGE,
        "current_a": CURRENT,
    }
    assert proposed(tmp_path, **fast, distance_m=WAY)["time_s"][0] == 1e-3
    slow = {**fast, "t": 5.0 * np.arange(600)}
    assert proposed(tmp_path, **slow, distance_m=25.0 * WAY)["time_s"][:2] == (1.0, "likely")


def test_seconds_are_no_milliseconds_where_no_wheel_has_such_grip(tmp_path: Path) -> None:
    stop_and_go = np.where(np.arange(600) % 2, 1.0, 0.2)
    slow = {
        "t": 5.0 * np.arange(600),
        "speed_mps": stop_and_go,
        "voltage_v": VOLTAGE,
        "current_a": CURRENT,
    }
    factor, sure, why = proposed(tmp_path, **slow)["time_s"]
    assert (factor, sure) == (1.0, "likely") and "the speed would change by 160 m/s2" in why
    smooth = proposed(tmp_path, **{**slow, "speed_mps": SPEED})["time_s"]
    assert smooth[1] == "a guess" and "or seconds with a sample every 5 s" in smooth[2]


def test_the_charge_used_is_no_charge_left(tmp_path: Path) -> None:
    assert proposed(tmp_path, **BASE, battery__level__used=T / 400.0)["soc"][:2] == (
        -1.0,
        "a guess",
    )
    factor, sure, why = proposed(tmp_path, **BASE, soc=T / 400.0)["soc"]
    assert (factor, sure) == (1.0, "a guess") and "is it the charge used?" in why
