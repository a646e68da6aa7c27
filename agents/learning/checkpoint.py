"""Checkpoints of a training run: numbers only, in one safetensors file with JSON in its header;
nothing is unpickled.

Parameters and the averages of the optimiser are kept. Missions and random numbers restart at every
checkpoint, also in an uninterrupted run, so that a continued run ends with the same weights. All
numbers are checked before any is used, because a file may come from anywhere.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import safe_open
from safetensors.torch import save
from stable_baselines3 import PPO

from homeward.agents import thresholds
from homeward.agents.learning.network import layers_of
from homeward.agents.learning.settings import TrainingError
from homeward.agents.trained.policy_file import Layer
from homeward.agents.trained.run_folder import CHECKPOINT, PREVIOUS, write_checkpoint

SCHEMA = 3
"""Version of the format of checkpoints; one of another schema is refused."""
_HEADER = "homeward"
_MOST_HEADER_BYTES = 1_000_000  # chosen: names and shapes of some dozen tensors need kilobytes


@dataclass(frozen=True)
class Best:
    """The best policy on the missions of the learning curve so far: step, score, and layers."""

    steps: int
    score: float
    layers: list[Layer]


def save_checkpoint(model: PPO, best_policy: Best | None, folder: Path) -> None:
    """Write everything that is needed to continue a run.

    Raises:
        OSError: The folder cannot be written to; older checkpoints remain.
    """
    tensors = {f"policy.{name}": value for name, value in model.policy.state_dict().items()}
    for index, layer in enumerate(best_policy.layers if best_policy else ()):
        for name, value in zip(("weight", "bias"), layer, strict=True):
            tensors[f"best.{index}.{name}"] = torch.from_numpy(value)
    for index, state in model.policy.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{name}": value for name, value in state.items()}
    best_point = best_policy and {"steps": best_policy.steps, "score": best_policy.score}
    header = {"schema": SCHEMA, "steps": model.num_timesteps, "best": best_point}
    content = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    write_checkpoint(folder, save(content, {_HEADER: json.dumps(header)}))


def restore_checkpoint(model: PPO, folder: Path, most_steps: int) -> Best | None:
    """Continue from the latest checkpoint, or from the one before if that is damaged; return the
    best policy so far.

    Args:
        model: A learner with the same settings.
        folder: Folder of the run.
        most_steps: Total decisions of the run.

    Raises:
        TrainingError: No checkpoint can be read.
    """
    for name in (CHECKPOINT, PREVIOUS):
        if (folder / name).is_file():
            try:
                return _restore(model, folder / name, most_steps)
            except Exception as error:  # whatever damaged numbers lead to
                print(f"{folder / name} cannot be read ({type(error).__name__})", file=sys.stderr)
    raise TrainingError(
        f"{folder} holds no checkpoint that can be read: delete it, or choose another --out"
    )


def _restore(model: PPO, path: Path, most_steps: int) -> Best | None:
    with path.open("rb") as content:
        _expect(int.from_bytes(content.read(8), "little") <= _MOST_HEADER_BYTES, "header")
    with safe_open(path, framework="pt") as file:
        header = json.loads(file.metadata()[_HEADER])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
    _expect(header["schema"] == SCHEMA, "schema")
    steps = header["steps"]
    _expect(
        type(steps) is int
        and 0 <= steps <= most_steps
        and steps % (model.n_steps * model.n_envs) == 0,
        "steps",
    )
    weights = _part(tensors, "policy")
    _expect_like(weights, model.policy.state_dict())
    best_policy = _best(header["best"], _part(tensors, "best"), model, steps)
    averages = _averages(_part(tensors, "optimizer"), model)
    model.policy.load_state_dict(weights)
    model.policy.optimizer.load_state_dict(
        {**model.policy.optimizer.state_dict(), "state": averages}
    )
    model.num_timesteps = steps
    model._n_updates = steps // (model.n_steps * model.n_envs) * model.n_epochs
    return best_policy


def _expect(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(what)


def _expect_like(tensors: Mapping[str, torch.Tensor], expected: Mapping[str, torch.Tensor]) -> None:
    """Refuse tensors with other names, shapes or types, or with values that are not finite."""
    _expect(tensors.keys() == expected.keys(), "names")
    for name, tensor in tensors.items():
        _expect(tensor.shape == expected[name].shape and tensor.dtype == expected[name].dtype, name)
        _expect(bool((tensor.abs() <= thresholds.LARGEST_WEIGHT).all()), name)  # which nan is not


def _averages(
    tensors: Mapping[str, torch.Tensor], model: PPO
) -> dict[int, dict[str, torch.Tensor]]:
    """Adam's averages of each parameter that it has changed."""
    expected: dict[str, torch.Tensor] = {}
    no_steps = torch.tensor(0.0)
    for index, parameter in enumerate(model.policy.parameters()):
        if f"{index}.step" in tensors:
            expected |= {
                f"{index}.step": no_steps,
                f"{index}.exp_avg": parameter,
                f"{index}.exp_avg_sq": parameter,
            }
    _expect_like(tensors, expected)
    _expect(
        all(
            bool((value >= 0.0).all())
            for name, value in tensors.items()
            if not name.endswith("exp_avg")
        ),
        "averages",
    )
    numbers = sorted({int(name.split(".")[0]) for name in tensors})
    return {number: _part(tensors, str(number)) for number in numbers}


def _best(header: Any, tensors: Mapping[str, torch.Tensor], model: PPO, steps: int) -> Best | None:
    if header is None:
        return None
    _expect(type(header["steps"]) is int and 0 < header["steps"] <= steps, "best")
    _expect(type(header["score"]) is float and math.isfinite(header["score"]), "best")
    expected = {
        f"{index}.{name}": torch.from_numpy(value)
        for index, layer in enumerate(layers_of(model))
        for name, value in zip(("weight", "bias"), layer, strict=True)
    }
    _expect_like(tensors, expected)
    layers = [
        (tensors[f"{index}.weight"].numpy(), tensors[f"{index}.bias"].numpy())
        for index in range(len(expected) // 2)
    ]
    return Best(header["steps"], header["score"], layers)


def _part(tensors: Mapping[str, torch.Tensor], part: str) -> dict[str, torch.Tensor]:
    return {
        name.removeprefix(f"{part}."): value
        for name, value in tensors.items()
        if name.startswith(f"{part}.")
    }
