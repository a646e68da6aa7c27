"""Checkpoints of a training run, in Stable-Baselines3's own format: for resuming on the same machine."""

from __future__ import annotations

import io
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.save_util import load_from_zip_file, save_to_zip_file

from homeward.agents.policy_file import Layer
from homeward.agents.ppo_folder import CHECKPOINT, PREVIOUS, write_checkpoint
from homeward.agents.ppo_settings import TrainingError

_PROGRESS = (
    "num_timesteps",
    "_n_updates",
    "_current_progress_remaining",
    "_last_obs",
    "_last_episode_starts",
    "ep_info_buffer",
    "ep_success_buffer",
)
"""Attributes of the algorithm that change between updates, beside its parameters."""


@dataclass(frozen=True)
class Best:
    """The policy that did best on the missions of the learning curve so far: when, how well, and its layers."""

    steps: int
    score: float
    layers: list[Layer]


def save_checkpoint(model: PPO, best: Best | None, folder: Path) -> None:
    """Write all that a run needs to go on as if it had not stopped: parameters, progress, missions, random states.

    Raises:
        OSError: The folder cannot be written to; the older checkpoints are still there.
    """
    data = {name: getattr(model, name) for name in _PROGRESS} | {
        "env": model.env,
        "numpy": np.random.get_state(),  # noqa: NPY002 - what Stable-Baselines3 shuffles with
        "torch": torch.get_rng_state(),
        "best": best,
    }
    buffer = io.BytesIO()
    save_to_zip_file(buffer, data, params=model.get_parameters())
    write_checkpoint(folder, buffer.getvalue())


def restore_checkpoint(model: PPO, folder: Path) -> Best | None:
    """Continue from the latest checkpoint, or from the one before if that is damaged; return the best policy so far.

    Raises:
        TrainingError: No checkpoint can be read.
    """
    for name in (CHECKPOINT, PREVIOUS):
        if (folder / name).is_file():
            try:
                data, parameters, _ = load_from_zip_file(folder / name, device=model.device)
                assert data is not None
                _restore(model, data, parameters)
            except Exception as error:  # a damaged pickle raises anything
                print(f"{folder / name} cannot be read ({type(error).__name__})", file=sys.stderr)
            else:
                best: Best | None = data["best"]
                return best
    raise TrainingError(f"{folder} holds no checkpoint that can be read: delete it, or choose another --out")


def _restore(model: PPO, data: dict[str, Any], parameters: dict[str, Any]) -> None:
    model.set_parameters(parameters, exact_match=True, device=model.device)
    model.set_env(data["env"], force_reset=False)
    for name in _PROGRESS:
        setattr(model, name, data[name])
    np.random.set_state(data["numpy"])  # noqa: NPY002 - as above
    torch.set_rng_state(data["torch"])
