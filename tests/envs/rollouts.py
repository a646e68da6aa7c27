"""Environments with few decisions, commands for them and what they came to: shared by the tests of
the environments."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward import Robot
from homeward.envs import IDS
from homeward.envs.actions import flatten_actions
from homeward.envs.features import INDEX
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP

MISSIONS = tuple(IDS)
INFO_KEYS = ("energy_j", "reward_terms", "score", "cost", "position_m", "home", "stranded")
IN_PARTS = ("discrete", "continuous")
"""Types of actions that have three parts; flat ones are numbers of the discrete ones."""
SHORT_S = 300.0
"""Decision step with which the battery of the default robot lasts about twenty decisions."""


class Step(NamedTuple):
    observation: NDArray[np.float32]
    reward: float
    terminated: bool
    truncated: bool
    info: dict[str, Any]


def make(mission: str, **options: Any) -> HomewardEnv:
    return HomewardEnv(mission=mission, **{"decision_s": SHORT_S} | options)


def random_actions(
    rng: np.random.Generator, action_type: str, count: int, home: float = 0.06
) -> NDArray[Any]:
    """Any speed and sensing rate; mostly going, sometimes standing, and seldom turning home.

    Shape (count, 3), of flat ones (count,).
    """
    modes = rng.choice([STOP, GO, RETURN], count, p=[0.25, 0.75 - home, home])
    if action_type != "continuous":
        parts = np.column_stack((rng.integers(0, 5, (count, 2)), modes))
        return flatten_actions(parts) if action_type == "flat" else parts
    levels = rng.uniform(-1.0, 1.0, (count, 2))
    return np.column_stack(
        (levels, (modes - 1.0 + rng.uniform(-0.3, 0.3, count)) * 2.0 / 3.0)
    ).astype(np.float32)


def drive(env: HomewardEnv, actions: Any) -> Iterator[Step]:
    """Steps of one mission under actions in order, until it ends."""
    for action in actions:
        step = Step(*env.step(action))
        yield step
        if step.terminated or step.truncated:
            return


def mission(env: HomewardEnv) -> Any:
    """The mission record of a scalar environment."""
    return env.batch.records[0]


def feature(observation: NDArray[np.float32], name: str) -> float:
    return float(observation[INDEX[name]])


def route_file(folder: Path, text: str, name: str = "route.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def windy(robot: Robot) -> Robot:
    """A robot with effects of every kind that keep state or depend on the place."""
    return dataclasses.replace(
        robot,
        track_m=0.3,
        effects={
            "wind": {"exposure": 1.0},
            "turning": {"scrub": 0.3},
            "inertia": {"mass_factor": 1.1},
            "surface": {"gain": 0.5},
            "motor_heating": {"per_k": 0.004, "rise_k_per_w": 1.0, "time_constant_s": 600.0},
            "internal_resistance": {"ohm": 0.05},
        },
    )
