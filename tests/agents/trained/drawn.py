"""Networks drawn at random, as if they were trained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from homeward.agents.trained.inputs import COLUMNS, make_inputs
from homeward.agents.trained.policy_file import ON_THE_GO, NetworkPolicy, load_policy, save_policy
from homeward.envs.actions import action_space
from homeward.envs.features import NAMES
from homeward.envs.options import Options, known_of


def save_drawn_policy(
    folder: Path, action_type: str = "discrete", beliefs: bool = False, **description: Any
) -> NetworkPolicy:
    """A network drawn at random, as if `train.py` had written it."""
    rng = np.random.default_rng(0)
    space = action_space(action_type == "discrete")
    outputs = 13 if action_type == "discrete" else 3
    known = known_of(Options("Survey", robot="husky", action_type=action_type))
    inputs = make_inputs(known) if beliefs else None
    columns = len(NAMES) + (len(COLUMNS) if beliefs else 0)
    layers = [
        (0.5 * rng.standard_normal((after, before)).astype(np.float32), np.zeros(after, np.float32))
        for before, after in ((columns, 16), (16 + columns, outputs))
    ]
    training = {
        "env": "homeward/Survey-v0",
        "robot": "husky",
        "action_type": action_type,
        "seed": 3,
    }
    going = ON_THE_GO if beliefs else {}
    save_policy(folder, layers, space, {"training": training} | going | description, inputs)
    return load_policy(folder, known)
