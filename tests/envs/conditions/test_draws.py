"""Random numbers that follow from a key, a decision and a channel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.envs.conditions import draws
from homeward.envs.conditions.draws import FORECAST_INTEREST, SOC, normal
from homeward.physics.jit import compiled

MANY = 200_000


def keys(count: int = MANY, seed: int = 0) -> NDArray[np.uint64]:
    """Keys as missions draw them."""
    return (2.0**53 * np.random.default_rng(seed).random(count)).astype(np.uint64)


@compiled
def by_kernel(keys: Any, numbers: Any, channel: int) -> Any:
    """Numbers as the environments draw them, one after another."""
    drawn = np.empty(len(keys))
    for i in range(len(keys)):
        drawn[i] = normal(keys[i], numbers[i], channel)
    return drawn


@pytest.mark.parametrize(
    "numbers", ["one key, many decisions", "many keys, one decision", "keys in a row"]
)
def test_they_are_normal_numbers(numbers: str) -> None:
    """A sum of four uniform ones: excess kurtosis -0.3, nothing beyond 3.47."""
    decisions, key = np.full(MANY, 7), keys()
    if numbers == "one key, many decisions":
        key, decisions = np.full(MANY, key[0]), np.arange(MANY)
    elif numbers == "keys in a row":
        key = np.arange(MANY, dtype=np.uint64)
    drawn = normal(key, decisions, SOC)
    error = 4.0 / np.sqrt(MANY)
    assert drawn.mean() == pytest.approx(0.0, abs=error)
    assert drawn.std() == pytest.approx(1.0, abs=error)
    assert (drawn**3).mean() == pytest.approx(0.0, abs=4.0 * error)
    assert (drawn**4).mean() == pytest.approx(2.7, abs=8.0 * error)
    assert 3.0 < np.abs(drawn).max() < 3.4642
    assert (np.abs(drawn) < 1.0).mean() == pytest.approx(0.6827, abs=0.02)


def test_decisions_and_channels_know_nothing_of_each_other() -> None:
    key, error = keys(), 4.0 / np.sqrt(MANY)
    channels = np.array(
        [normal(key, np.full(MANY, 3), channel) for channel in range(FORECAST_INTEREST + 1)]
    )
    decisions = np.array([normal(key, np.full(MANY, decision), SOC) for decision in range(8)])
    both = np.concatenate((channels, decisions[:3], decisions[4:]))
    off = np.corrcoef(both) - np.eye(len(both))
    assert np.abs(off).max() < 1.3 * error
    one = normal(np.full(MANY, key[0]), np.arange(MANY), SOC)
    for lag in (1, 2, 16):
        assert (one[lag:] * one[:-lag]).mean() == pytest.approx(0.0, abs=error)


def test_channels_have_names_of_their_own() -> None:
    names = (
        "SOC",
        "POWER",
        "SPEED",
        "GRADE",
        "GUST_EAST",
        "GUST_NORTH",
        "FORECAST_GRADE",
        "FORECAST_INTEREST",
    )
    assert sorted(getattr(draws, name) for name in names) == list(range(len(names)))


def test_compiled_and_plain_code_draw_the_same() -> None:
    key, decisions = keys(1000), np.random.default_rng(1).integers(0, 20_000, 1000)
    np.testing.assert_array_equal(by_kernel(key, decisions, SOC), normal(key, decisions, SOC))
    np.testing.assert_array_equal(normal(key, decisions, SOC), normal(key, decisions, SOC))
