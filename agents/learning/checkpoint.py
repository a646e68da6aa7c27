"""Checkpoints of a training run: numbers alone, in one safetensors file with JSON in its header; nothing is unpickled.

What missions, guide and critic remember is not written: the missions are driven again from where they began. All
numbers are checked before any is used, as a file may come from anywhere: some would let NumPy read beyond its memory.
"""

from __future__ import annotations

import json
import math
import sys
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import safe_open
from safetensors.torch import save
from stable_baselines3 import PPO

from homeward.agents.learning.folder import CHECKPOINT, PREVIOUS, write_checkpoint
from homeward.agents.learning.network import layers_of
from homeward.agents.learning.policy_file import Layer
from homeward.agents.learning.sb3_adapter import MissionLog, SB3Adapter
from homeward.agents.learning.settings import TrainingError

SCHEMA = 1
_HEADER = "homeward"
_MOST_HEADER_BYTES = 16_000_000  # a hundred times that of 512 missions
_LARGEST = 1e6
"""Of a weight or a moment: far beyond any that training comes to, and not so large that its square is no number."""
_RECENT = 4  # return, length, time and success of a mission, for the log


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
    ends = zip(model.ep_info_buffer or (), model.ep_success_buffer or (), strict=True)
    recent = [(one["r"], one["l"], one["t"], success) for one, success in ends]
    tensors |= {
        "torch": torch.get_rng_state(),
        "numpy": torch.from_numpy(np.asarray(shuffle)),
        "recent": torch.tensor(recent, dtype=torch.float64).reshape(-1, _RECENT),
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
        "steps": model.num_timesteps,
        "numpy": rest,
        "generators": log.generators,
        "best": None if best is None else {"steps": best.steps, "score": best.score},
    }
    content = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    write_checkpoint(folder, save(content, {_HEADER: json.dumps(header)}))


def restore_checkpoint(model: PPO, folder: Path, most_steps: int) -> Best | None:
    """Continue from the latest checkpoint, or from the one before if that is damaged; return the best policy so far.

    Args:
        model: Of the same settings.
        folder: Of the run.
        most_steps: That the run is to take in all.

    Raises:
        TrainingError: No checkpoint can be read.
    """
    for name in (CHECKPOINT, PREVIOUS):
        if (folder / name).is_file():
            try:
                return _restore(model, folder / name, most_steps)
            except Exception as error:  # whatever damaged numbers lead to
                print(f"{folder / name} cannot be read ({type(error).__name__})", file=sys.stderr)
    raise TrainingError(f"{folder} holds no checkpoint that can be read: delete it, or choose another --out")


def _restore(model: PPO, path: Path, most_steps: int) -> Best | None:
    with path.open("rb") as content:
        _expect(int.from_bytes(content.read(8), "little") <= _MOST_HEADER_BYTES, "header")
    with safe_open(path, framework="pt") as file:
        header = json.loads(file.metadata()[_HEADER])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
    _expect(header["schema"] == SCHEMA, "schema")
    steps = header["steps"]
    _expect(type(steps) is int and 0 <= steps <= most_steps and steps % (model.n_steps * model.n_envs) == 0, "steps")
    weights, moments = _part(tensors, "policy"), _moments(model, _part(tensors, "optimizer"))
    _expect_like(weights, model.policy.state_dict())
    best = _best(header["best"], _part(tensors, "best"), model, steps)
    recent = tensors["recent"]
    _expect(
        recent.dtype == torch.float64 and recent.shape[1:] == (_RECENT,) and bool(recent.isfinite().all()), "recent"
    )
    shuffle = _shuffle(tensors["numpy"].numpy(), header["numpy"])
    log = MissionLog(
        [_generator(state) for state in header["generators"]],
        tensors["missions.lengths"].numpy(),
        tensors["missions.actions"].numpy(),
    )
    model._last_obs = _missions(model).relive(log)
    model._last_episode_starts = log.lengths == 0
    model.policy.load_state_dict(weights)
    optimizer = model.policy.optimizer
    optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
    model.num_timesteps, model._n_updates = steps, steps // (model.n_steps * model.n_envs) * model.n_epochs
    ends, most = recent.tolist()[-model._stats_window_size :], model._stats_window_size
    model.ep_info_buffer = deque(({"r": r, "l": int(length), "t": t} for r, length, t, _ in ends), most)
    model.ep_success_buffer = deque((bool(success) for *_, success in ends), most)
    np.random.set_state(shuffle)  # noqa: NPY002 - as above
    torch.set_rng_state(tensors["torch"])
    return best


def _expect(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(what)


def _expect_like(given: Mapping[str, torch.Tensor], wanted: Mapping[str, torch.Tensor]) -> None:
    """Refuse tensors that are not of the names, shapes and types of others, or hold numbers that are none."""
    _expect(given.keys() == wanted.keys(), "names")
    for name, tensor in given.items():
        _expect(tensor.shape == wanted[name].shape and tensor.dtype == wanted[name].dtype, name)
        _expect(bool((tensor.abs() <= _LARGEST).all()), name)  # which nan is not


def _moments(model: PPO, tensors: Mapping[str, torch.Tensor]) -> dict[int, dict[str, torch.Tensor]]:
    """State of Adam: mean and mean square of each parameter's gradients, and how many steps it took."""
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for name, tensor in tensors.items():
        index, _, moment = name.partition(".")
        moments.setdefault(int(index), {})[moment] = tensor
    parameters = list(model.policy.parameters())
    _expect(sorted(moments) in ([], list(range(len(parameters)))), "moments")
    for number, named in moments.items():
        step, parameter = named["step"], parameters[number]
        _expect(step.dtype == torch.float32 and step.shape == () and 1.0 <= float(step) < 2.0**24, "step")
        like = {"step": torch.ones(()), "exp_avg": parameter, "exp_avg_sq": parameter}
        _expect_like(named | {"step": like["step"]}, like)
        _expect(bool((named["exp_avg_sq"] >= 0.0).all()), "mean square")
    return moments


def _shuffle(key: NDArray[Any], rest: Any) -> tuple[str, NDArray[np.uint32], int, int, float]:
    """State of NumPy's own random numbers (MT19937), which are read at its position whatever that is."""
    position, has_gauss, gauss = rest
    _expect(key.dtype == np.uint32 and key.shape == (624,), "numpy")
    _expect(type(position) is int and 0 <= position <= 624 and has_gauss in (0, 1), "numpy")
    _expect(type(gauss) is float and math.isfinite(gauss), "numpy")
    return "MT19937", key, position, has_gauss, gauss


def _generator(state: Any) -> dict[str, Any]:
    """State of a mission's generator (PCG64): with an even increment it would give the same number for ever."""
    number, increment = (state["state"][name] for name in ("state", "inc"))
    _expect(state["bit_generator"] == "PCG64" and type(number) is int and type(increment) is int, "generator")
    _expect(0 <= number < 2**128 and 0 <= increment < 2**128 and increment % 2 == 1, "generator")
    _expect(state["has_uint32"] in (0, 1) and type(state["uinteger"]) is int, "generator")
    _expect(0 <= state["uinteger"] < 2**32, "generator")
    return dict(state)


def _best(header: Any, tensors: Mapping[str, torch.Tensor], model: PPO, steps: int) -> Best | None:
    if header is None:
        return None
    _expect(type(header["steps"]) is int and 0 < header["steps"] <= steps, "best")
    _expect(type(header["score"]) is float and math.isfinite(header["score"]), "best")
    like = {
        f"{index}.{name}": torch.from_numpy(value)
        for index, layer in enumerate(layers_of(model))
        for name, value in zip(("weight", "bias"), layer, strict=True)
    }
    _expect_like(tensors, like)
    layers = [(tensors[f"{index}.weight"].numpy(), tensors[f"{index}.bias"].numpy()) for index in range(len(like) // 2)]
    return Best(header["steps"], header["score"], layers)


def _part(tensors: Mapping[str, torch.Tensor], part: str) -> dict[str, torch.Tensor]:
    return {name.removeprefix(f"{part}."): value for name, value in tensors.items() if name.startswith(f"{part}.")}


def _missions(model: PPO) -> SB3Adapter:
    assert isinstance(model.env, SB3Adapter)
    return model.env
