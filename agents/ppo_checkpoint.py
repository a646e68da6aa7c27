"""Checkpoints of a training run: numbers alone, in one safetensors file with JSON in its header; nothing is unpickled.

What missions, guide and critic remember is not written: the missions are driven again from where they began.
"""

from __future__ import annotations

import json
import sys
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save
from stable_baselines3 import PPO

from homeward.agents.policy_file import Layer
from homeward.agents.ppo_folder import CHECKPOINT, PREVIOUS, write_checkpoint
from homeward.agents.ppo_settings import TrainingError
from homeward.agents.sb3_adapter import MissionLog, SB3Adapter

SCHEMA = 1
_HEADER = "homeward"
_COUNTERS = ("num_timesteps", "_n_updates")
"""Numbers of the algorithm that change between updates, beside its parameters; the learning rate follows from them."""
_RECENT = ("ep_info_buffer", "ep_success_buffer")
"""What the last missions came to, for the log."""


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
    log = _missions(model).log
    _, shuffle, *rest = np.random.get_state()  # noqa: NPY002 - what Stable-Baselines3 shuffles with
    tensors = {f"policy.{name}": value for name, value in model.policy.state_dict().items()}
    for index, moments in model.policy.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{name}": value for name, value in moments.items()}
    tensors |= {
        "torch": torch.get_rng_state(),
        "numpy": torch.from_numpy(np.asarray(shuffle)),
        "missions.actions": torch.from_numpy(log.actions),
        "missions.lengths": torch.from_numpy(log.lengths),
    }
    for index, layer in enumerate(best.layers if best else ()):
        tensors |= {
            f"best.{index}.{name}": torch.from_numpy(value)
            for name, value in zip(("weight", "bias"), layer, strict=True)
        }
    header = {
        "schema": SCHEMA,
        "counters": {name: getattr(model, name) for name in _COUNTERS},
        "recent": {name: list(getattr(model, name)) for name in _RECENT},
        "numpy": rest,
        "generators": log.generators,
        "best": None if best is None else {"steps": best.steps, "score": best.score},
    }
    content = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    write_checkpoint(folder, save(content, {_HEADER: json.dumps(header)}))


def restore_checkpoint(model: PPO, folder: Path) -> Best | None:
    """Continue from the latest checkpoint, or from the one before if that is damaged; return the best policy so far.

    Raises:
        TrainingError: No checkpoint can be read.
    """
    for name in (CHECKPOINT, PREVIOUS):
        if (folder / name).is_file():
            try:
                return _restore(model, folder / name)
            except Exception as error:  # whatever damaged numbers lead to
                print(f"{folder / name} cannot be read ({type(error).__name__})", file=sys.stderr)
    raise TrainingError(f"{folder} holds no checkpoint that can be read: delete it, or choose another --out")


def _restore(model: PPO, path: Path) -> Best | None:
    with safe_open(path, framework="pt") as file:
        header = json.loads(file.metadata()[_HEADER])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
    if header["schema"] != SCHEMA:
        raise ValueError(f"schema {header['schema']}")
    for name, tensor in tensors.items():
        if tensor.is_floating_point() and not tensor.isfinite().all():
            raise ValueError(f"{name} is not finite")
    model.policy.load_state_dict(_part(tensors, "policy"))
    optimizer = model.policy.optimizer
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for name, tensor in _part(tensors, "optimizer").items():
        index, _, moment = name.partition(".")
        moments.setdefault(int(index), {})[moment] = tensor
    _check_moments(model, moments)
    optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
    log = MissionLog(header["generators"], tensors["missions.lengths"].numpy(), tensors["missions.actions"].numpy())
    model._last_obs = _missions(model).relive(log)
    model._last_episode_starts = log.lengths == 0
    for name in _COUNTERS:
        setattr(model, name, int(header["counters"][name]))
    for name in _RECENT:
        setattr(model, name, deque(header["recent"][name], maxlen=model._stats_window_size))
    np.random.set_state(("MT19937", tensors["numpy"].numpy(), *header["numpy"]))  # noqa: NPY002 - as above
    torch.set_rng_state(tensors["torch"])
    return _best(header["best"], _part(tensors, "best"))


def _check_moments(model: PPO, moments: Mapping[int, Mapping[str, torch.Tensor]]) -> None:
    parameters = list(model.policy.parameters())
    for index, named in moments.items():
        shapes = {name: named[name].shape for name in ("exp_avg", "exp_avg_sq")}
        if set(shapes.values()) != {parameters[index].shape}:
            raise ValueError(f"moments of shapes {shapes} for a parameter of {parameters[index].shape}")


def _best(header: Mapping[str, Any] | None, tensors: Mapping[str, torch.Tensor]) -> Best | None:
    if header is None:
        return None
    layers = [
        (tensors[f"{index}.weight"].numpy(), tensors[f"{index}.bias"].numpy()) for index in range(len(tensors) // 2)
    ]
    return Best(int(header["steps"]), float(header["score"]), layers)


def _part(tensors: Mapping[str, torch.Tensor], part: str) -> dict[str, torch.Tensor]:
    return {name.removeprefix(f"{part}."): value for name, value in tensors.items() if name.startswith(f"{part}.")}


def _missions(model: PPO) -> SB3Adapter:
    assert isinstance(model.env, SB3Adapter)
    return model.env
