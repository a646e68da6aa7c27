"""Settings of a training run: defaults by start, and what is not allowed says what is."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from homeward.agents.learning.settings import (
    DMAX,
    SCRATCH,
    STARTS,
    PPOSettings,
    TrainingError,
    check_seed,
)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"start": "planner"}, "start = 'planner' is not allowed; choose from scratch, dmax"),
        ({"n_envs": 0}, "n_envs = 0 is not allowed; give a whole number of at least 1"),
        ({"n_steps": -1}, "n_steps = -1 is not allowed"),
        ({"epochs": 0}, "epochs = 0 is not allowed"),
        ({"hidden": 0}, "hidden = 0 is not allowed"),
        ({"hidden": 4097}, "hidden = 4097 is not allowed; give at most 4096"),
        ({"discount": 1.5}, "discount = 1.5 is not allowed; give a number in (0, 1]"),
        ({"discount": 0.0}, "discount = 0.0 is not allowed"),
        ({"gae_lambda": -0.1}, "gae_lambda = -0.1 is not allowed"),
        ({"clip": float("nan")}, "clip = nan is not allowed"),
        ({"learning_rate": 0.0}, "learning_rate = 0.0 is not allowed; give a number in (0, 1]"),
        ({"learning_rate": float("inf")}, "learning_rate = inf is not allowed"),
        ({"entropy": -1e-9}, "entropy = -1e-09 is not allowed; give a number in [0, 1]"),
        (
            {"stranding_cost": 100.1},
            "stranding_cost = 100.1 is not allowed; give a number in [0, 100]",
        ),
        ({"stranding_cost": float("nan")}, "stranding_cost = nan is not allowed"),
        (
            {"n_envs": 2**12, "n_steps": 2**12 + 1},
            "n_envs * n_steps = 16781312 is not allowed; give at most 16,777,216",
        ),
        (
            {"batch_size": 1},
            "batch_size = 1 does not divide n_envs * n_steps = 32768 into whole batches",
        ),
        ({"batch_size": 1000}, "batch_size = 1000 does not divide"),
        ({"batch_size": 65536}, "batch_size = 65536 does not divide"),
    ],
)
def test_what_is_not_allowed_says_what_is(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(TrainingError) as caught:
        PPOSettings(**changes)
    assert str(caught.value).startswith(says) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"entropy": 0.0},
        {"discount": 1.0, "gae_lambda": 1.0, "clip": 1.0, "learning_rate": 1.0, "entropy": 1.0},
        {"stranding_cost": 0.0},
        {"stranding_cost": 100.0},
        {"hidden": 4096},
        {"n_envs": 2**12, "n_steps": 2**12, "batch_size": 2**12},
        {"n_envs": 1, "n_steps": 2, "batch_size": 2},
    ],
)
def test_the_ends_of_what_is_allowed_are_allowed(changes: dict[str, Any]) -> None:
    assert dataclasses.asdict(PPOSettings(**changes)).items() >= changes.items()


def test_a_rollout_is_a_decision_of_every_mission_at_every_step() -> None:
    assert PPOSettings(n_envs=6, n_steps=7, batch_size=21).rollout == 42


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("given", [{}, {"learning_rate": 0.5}, {"entropy": 0.0}, {"entropy": 0.25}])
def test_what_is_given_stays_and_the_rest_follows_the_start(
    start: str, given: dict[str, float]
) -> None:
    assert PPOSettings(start=start, **given).by_start == PPOSettings(start=start).by_start | given  # type: ignore[arg-type]


def test_only_a_start_from_the_rule_keeps_exploring_by_a_bonus() -> None:
    from_dmax, from_scratch = (PPOSettings(start=start).by_start for start in (DMAX, SCRATCH))
    assert from_scratch["entropy"] == 0.0 < from_dmax["entropy"]
    assert from_dmax["learning_rate"] < from_scratch["learning_rate"]


@pytest.mark.parametrize("seed", [0, 2**32 - 1])
def test_seeds_of_32_bits_are_allowed(seed: int) -> None:
    check_seed(seed)


@pytest.mark.parametrize("seed", [-1, 2**32])
def test_other_seeds_are_refused(seed: int) -> None:
    with pytest.raises(
        TrainingError,
        match=f"^seed = {seed} is not allowed; give a whole number from 0 to 4294967295$",
    ):
        check_seed(seed)
