"""Distributions of the hidden variables."""

from __future__ import annotations

import math

import numpy as np
import pytest

from homeward import load_robot
from homeward.envs.conditions.difficulty import DIFFICULTIES, DIFFICULTY, DRAWN, Uniform
from homeward.envs.conditions.instruments import INSTRUMENTS
from homeward.envs.options import Options, known_of
from homeward.envs.vector import HomewardVectorEnv

MANY = 3000


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_robots_are_drawn_from_the_table(difficulty: str) -> None:
    """The same table that agents have as their prior."""
    envs = HomewardVectorEnv(MANY, difficulty=difficulty)
    envs.reset(seed=0)
    file, robots, table = load_robot("rusti_computer"), envs.batch.robots, DIFFICULTY[difficulty]
    assert envs.batch.known.difficulty is table
    drawn = {
        "health": envs.batch.records["capacity_j"] / file.usable_energy_j,
        "rolling": robots["rolling_resistance"] / file.rolling_resistance,
        "payload": (robots["payload_mass_kg"] - file.record()["payload_mass_kg"][0]) / file.mass_kg,
        "surface": robots["surface_gain"],
    }
    assert tuple(drawn) == DRAWN
    for name, values in drawn.items():
        prior: Uniform = getattr(table, name)
        if prior.low == prior.high:
            np.testing.assert_allclose(values, prior.low, atol=1e-12)
            continue
        assert prior.low <= values.min() and values.max() <= prior.high
        span = prior.high - prior.low
        assert (values.min(), values.max()) == pytest.approx(
            (prior.low, prior.high), abs=0.01 * span
        )
        assert values.mean() == pytest.approx(
            prior.mean, abs=4.0 * prior.deviation / math.sqrt(MANY)
        )
        assert values.std() == pytest.approx(prior.deviation, rel=0.05)
    moving = [values for name, values in drawn.items() if values.std() > 1e-9]
    if len(moving) > 1:
        assert np.abs(np.corrcoef(moving) - np.eye(len(moving))).max() < 4.0 / math.sqrt(MANY)
    np.testing.assert_array_equal(envs.batch.records["energy_j"], envs.batch.records["capacity_j"])


def test_each_difficulty_has_its_instruments() -> None:
    for difficulty, name in zip(DIFFICULTIES, ("exact", "meter", "any_gauge"), strict=True):
        assert DIFFICULTY[difficulty].instruments == name
        assert known_of(Options("Survey", difficulty=difficulty)).instruments is INSTRUMENTS[name]
        other = known_of(Options("Survey", difficulty=difficulty, instruments="gauge"))
        assert (
            other.instruments is INSTRUMENTS["gauge"] and other.difficulty is DIFFICULTY[difficulty]
        )


def test_what_is_known_of_the_route_and_the_weather() -> None:
    for difficulty in DIFFICULTIES:
        row = DIFFICULTY[difficulty]
        known = difficulty == "known"
        assert row.route_is_known == known and row.weather_changes == (not known)
        assert (
            bool(known_of(Options("Survey", difficulty=difficulty)).shared["route_is_known"][0])
            == known
        )
    assert DIFFICULTY["harsh"].surface.low > 0.0 == DIFFICULTY["uncertain"].surface.high


def test_a_uniform_number_has_a_mean_and_a_deviation() -> None:
    values = np.random.default_rng(0).uniform(0.8, 1.3, 100_000)
    assert Uniform(0.8, 1.3).mean == pytest.approx(values.mean(), abs=2e-3)
    assert Uniform(0.8, 1.3).deviation == pytest.approx(values.std(), abs=2e-3)
    assert Uniform(2.0, 2.0).deviation == 0.0
