"""Trained policies as files: `policy.safetensors` for the weights, `policy.json` for the rest;
reading runs no code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from homeward.agents.base import Observations, Policy
from homeward.agents.trained.inputs import COLUMNS, BeliefInputs, inputs_from
from homeward.envs.actions import modes, silenced
from homeward.envs.features import NAMES, names_of
from homeward.envs.options import Known
from homeward.envs.state import GO
from homeward.files import read_bytes, read_json, write_whole

WEIGHTS = "policy.safetensors"
DESCRIPTION = "policy.json"
SCHEMA = 2
"""Version of the format of policy.json; one of another schema is refused."""
MOST_BYTES = 100_000_000
"""Limit of a policy's file. Chosen: 2,500 times those of the shipped policies (40 kB), and it fits
in memory."""
_OBSERVED = [list(names_of(docks)) for docks in (False, True)]
"""Features of policies, without and with docks."""
_MOST_LAYERS = 100  # chosen: far more than a policy needs
ON_THE_GO = {"senses": "on the go"}
"""Entry of a description: the policy was trained with `sensing_on_the_go`."""
_ROWS = 64
"""Missions at a time: larger products are spread over threads, which wait for each other. With 32
the shipped policies take 1.6 times as long, with 128 three times (4096 missions on two busy
cores)."""

Layer = tuple[NDArray[np.float32], NDArray[np.float32]]  # weight (outputs, inputs), bias (outputs,)


class PolicyFileError(ValueError):
    """A policy file that cannot be used; the message says which and why."""


def sensing_on_the_go(actions: NDArray[Any]) -> NDArray[Any]:
    """Actions, shape (n, 3), without sensing for robots that stop or head home: they pass no new
    ground.

    Speed, sensing and mode are sampled independently. Without this, exploring a stop would waste
    sensing energy, and training would learn to avoid stops.
    """
    return silenced(actions, modes(actions) != GO)


@final
@dataclass(frozen=True)
class NetworkPolicy(Policy):
    """A network with tanh between its layers; it takes the most likely action, or the mean one in a
    continuous space.

    Attributes:
        layers: Weight (outputs, inputs) and bias (outputs,) of each layer, float32. Of several, the
            last one also takes the network's inputs, after the outputs of the layer before.
        action_space: Space of one action: `MultiDiscrete` or `Box`.
        description: Content of `policy.json`: environment, options, spaces, training, versions.
        inputs: Computes the network's inputs from observations, if they are not the observations.
    """

    layers: tuple[Layer, ...]
    action_space: spaces.Space[Any]
    description: Mapping[str, Any]
    inputs: BeliefInputs | None = None

    @property
    def senses_on_the_go(self) -> bool:
        """Whether it was trained not to sense where it stops or heads home."""
        return ON_THE_GO.items() <= self.description.items()

    @property
    def features(self) -> list[str]:
        """Names of the features that it observes."""
        return list(self.description.get("observation_space", {}).get("features", NAMES))

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission: int64 levels, or float32 within the box, shape (n,
        3).

        Raises:
            PolicyFileError: The policy needs a belief and was loaded without an environment's
                constants.
        """
        return self.choose(self.outputs(self.seen(observations, begun)))

    def seen(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[np.float32]:
        """The network's inputs, shape (n, inputs); arguments as in `act`.

        Raises:
            PolicyFileError: As `act`.
        """
        if self.inputs is not None:
            return self.inputs(observations, begun)
        if "inputs" in self.description:
            raise PolicyFileError(
                "the policy needs a belief: load it with known=, the constants of an environment"
            )
        return observations

    def outputs(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Outputs of the last layer, shape (n, outputs): logits of all levels, or the mean
        action."""
        return np.concatenate(
            [self._outputs(values[i : i + _ROWS]) for i in range(0, len(values), _ROWS)]
        )

    def _outputs(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        # As in training, the last layer sees the inputs beside the hidden units.
        hidden = values
        for weight, bias in self.layers[:-1]:
            hidden = np.tanh(hidden @ weight.T + bias)
        weight, bias = self.layers[-1]
        if len(self.layers) > 1:
            hidden = np.concatenate((hidden, values), axis=1)
        return hidden @ weight.T + bias

    def choose(self, outputs: NDArray[np.float32]) -> NDArray[Any]:
        """The most likely action by the outputs of the last layer, or the mean one."""
        actions: NDArray[Any]
        if isinstance(self.action_space, spaces.Box):
            actions = np.clip(outputs, self.action_space.low, self.action_space.high)
        else:
            assert isinstance(self.action_space, spaces.MultiDiscrete)
            parts = np.split(outputs, np.cumsum(self.action_space.nvec)[:-1], axis=1)
            actions = np.stack([part.argmax(axis=1) for part in parts], axis=1)
        if self.senses_on_the_go:
            return sensing_on_the_go(actions)
        return actions

    def check_spaces(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """Check that the policy fits an environment.

        Raises:
            PolicyFileError: Its spaces are different.
        """
        if observation_space.shape != (len(self.features),):
            raise PolicyFileError(
                f"the policy observes {len(self.features)} features, the environment {observation_space.shape}: "
                "with docks there are more, for policies that were trained with docks"
            )
        if action_space != self.action_space:
            raise PolicyFileError(
                f"the policy acts in {self.action_space}, the environment in {action_space}: "
                "choose the action_type that it was trained with"
            )


def save_policy(
    folder: str | Path,
    layers: Sequence[Layer],
    action_space: spaces.Space[Any],
    details: Mapping[str, Any],
    inputs: BeliefInputs | None = None,
    features: Sequence[str] = NAMES,
) -> None:
    """Write a policy into a folder, each file completely or not at all.

    Args:
        folder: Where `policy.safetensors` and `policy.json` go.
        layers: Weight (outputs, inputs) and bias (outputs,) of each layer.
        action_space: `MultiDiscrete` or `Box` of one action.
        details: Additions to the description, such as the environment and the training.
        inputs: Computes the network's inputs, if they are not the observation.
        features: Names of the observed features, those of docks included.

    Raises:
        OSError: The folder cannot be written to.
    """
    folder = Path(folder)
    tensors: dict[str, NDArray[np.float32]] = {}
    for index, (weight, bias) in enumerate(layers):
        tensors[f"layers.{index}.weight"] = np.ascontiguousarray(weight, np.float32)
        tensors[f"layers.{index}.bias"] = np.ascontiguousarray(bias, np.float32)
    weights = save(tensors)
    description: dict[str, Any] = {
        "schema": SCHEMA,
        "observation_space": {"type": "Box", "features": list(features)},
        "action_space": _describe(action_space),
        "network": {"layers": len(layers), "activation": "tanh"},
        "weights_sha256": hashlib.sha256(weights).hexdigest(),
    }
    if inputs is not None:
        description["inputs"] = inputs.description
    description |= details
    write_whole(folder / WEIGHTS, weights)
    write_whole(folder / DESCRIPTION, json.dumps(description, indent=2) + "\n")


def load_policy(path: str | Path, known: Known | None = None) -> NetworkPolicy:
    """Read a policy.

    Args:
        path: Folder that training wrote, or one of the two files in it.
        known: Constants of the environment that it acts in; required for a policy with a belief.

    Raises:
        PolicyFileError: A file is missing, truncated, or not a policy of this version of the
            observations.
    """
    path = Path(path)
    folder = path
    if path.name in (WEIGHTS, DESCRIPTION):
        folder = path.parent
    description = _read_description(folder / DESCRIPTION)
    weights = _read(folder / WEIGHTS)
    if hashlib.sha256(weights).hexdigest() != description["weights_sha256"]:
        raise PolicyFileError(
            f"{folder / WEIGHTS} is truncated or not the one of {DESCRIPTION}: train again"
        )
    try:
        tensors = load(weights)
    # of shapes that numpy refuses
    except (SafetensorError, ValueError, OverflowError, KeyError, TypeError) as error:
        raise PolicyFileError(f"{folder / WEIGHTS} is not a safetensors file: {error}") from None
    try:
        action_space = _action_space(description["action_space"])
        layers = tuple(
            (tensors[f"layers.{index}.weight"], tensors[f"layers.{index}.bias"])
            for index in range(_layers(description["network"]["layers"]))
        )
    except (KeyError, TypeError, ValueError, OverflowError, AssertionError) as error:
        raise PolicyFileError(
            f"{folder / DESCRIPTION} does not describe {WEIGHTS}: {error!r}"
        ) from None
    width = len(description["observation_space"]["features"])
    if "inputs" in description:
        width += len(COLUMNS)
    _check_layers(folder / WEIGHTS, layers, action_space, width)
    inputs = None
    if "inputs" in description and known is not None:
        try:
            inputs = inputs_from(description["inputs"], known)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise PolicyFileError(
                f"{folder / DESCRIPTION} names other inputs than this version has, train again: {error!r}"
            ) from None
    return NetworkPolicy(layers, action_space, description, inputs)


def _read(path: Path) -> bytes:
    try:
        return read_bytes(path, MOST_BYTES)
    except ValueError as error:
        raise PolicyFileError(f"{path} is {error}: it is not a policy of homeward") from None
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> PolicyFileError:
    return PolicyFileError(
        f"cannot read {path}: {error.strerror}; give the folder that `homeward train` wrote"
    )


def _read_description(path: Path) -> dict[str, Any]:
    try:
        description = read_json(path)
    except ValueError:
        raise PolicyFileError(f"{path} is truncated or not JSON: train again") from None
    except OSError as error:
        raise _unreadable(path, error) from None
    needed = ("observation_space", "action_space", "network", "weights_sha256")
    if not isinstance(description, dict) or not all(name in description for name in needed):
        raise PolicyFileError(f"{path} does not describe a policy of homeward")
    if description.get("schema") != SCHEMA:
        raise PolicyFileError(
            f"{path} has schema {description.get('schema')!r}, this version reads {SCHEMA}: train again"
        )
    observed = description["observation_space"]
    if not isinstance(observed, dict) or observed.get("features") not in _OBSERVED:
        raise PolicyFileError(
            f"{path}: the policy observes other features than this version's environments: train again"
        )
    return description


def _describe(space: spaces.Space[Any]) -> dict[str, Any]:
    if isinstance(space, spaces.MultiDiscrete):
        return {"type": "MultiDiscrete", "nvec": space.nvec.tolist()}
    assert isinstance(space, spaces.Box)
    return {"type": "Box", "low": space.low.tolist(), "high": space.high.tolist()}


def _action_space(described: Mapping[str, Any]) -> spaces.Space[Any]:
    if described["type"] == "MultiDiscrete":
        return spaces.MultiDiscrete(described["nvec"])
    if described["type"] == "Box":
        return spaces.Box(
            np.array(described["low"], np.float32), np.array(described["high"], np.float32)
        )
    raise ValueError(f"action space {described['type']!r}")


def _layers(count: Any) -> int:
    if not isinstance(count, int) or not 0 <= count <= _MOST_LAYERS:
        raise ValueError(f"layers = {count!r}")
    return count


def _check_layers(
    path: Path, layers: Sequence[Layer], action_space: spaces.Space[Any], inputs: int
) -> None:
    if isinstance(action_space, spaces.MultiDiscrete):
        outputs = int(action_space.nvec.sum())
    else:
        outputs = int(np.prod(action_space.shape or ()))
    widths = [inputs, *(_width(bias) for _, bias in layers)]
    if len(layers) > 1:
        widths[-2] += inputs  # before the last layer
    for width, (weight, bias) in zip(widths[:-1], layers, strict=True):
        if (
            weight.dtype != np.float32
            or bias.dtype != np.float32
            or weight.shape != (_width(bias), width)
        ):
            raise PolicyFileError(
                f"{path}: a layer of shape {weight.shape} and {bias.shape} does not fit the one before"
            )
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise PolicyFileError(f"{path}: a weight is not a finite number")
    if widths[-1] != outputs or len(layers) == 0:
        raise PolicyFileError(
            f"{path}: {len(layers)} layers with {widths[-1]} outputs do not fit {action_space}"
        )


def _width(bias: NDArray[np.float32]) -> int:
    """Outputs of a layer; -1, which fits nothing, if its bias is no vector."""
    if bias.ndim == 1:
        return len(bias)
    return -1
