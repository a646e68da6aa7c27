"""A policy from an ONNX file, with its environment and the inputs that it needs, from the file's
metadata."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, Policy
from homeward.agents.trained.inputs import BeliefInputs, inputs_from, number
from homeward.agents.trained.policy_file import MOST_BYTES, PolicyFileError
from homeward.envs.actions import encode_actions
from homeward.envs.features import NAMES
from homeward.envs.options import Known, OptionError, Options, known_of
from homeward.envs.routes import RouteError
from homeward.files import read_bytes
from homeward.installed import advice
from homeward.physics import Robot, RobotError, load_robot

INPUT = "observation"
BELIEF = "belief"
OUTPUTS = ("speed_mps", "sensing_hz", "mode")

OPERATIONS = frozenset({
    "Add", "ArgMax", "Cast", "Clip", "Concat", "Div", "Gather", "Gemm", "Min", "Mul", "Slice", "Sub", "Tanh",
})  # fmt: skip
"""Operations of an exported network, all of which end."""
MOST_VALUES = 1_000_000
"""Most values that an operation computes for a mission. Chosen: layers of trained policies have
some hundred."""


@final
class OnnxPolicy(Policy):
    """Runs an exported network in onnxruntime, with the estimator beside it.

    Args:
        session: An `onnxruntime.InferenceSession`.
        trained: Constants of the environment of the training, for which the network returns its
            commands.
        size: Physical size of a feature of 1, shape (features,).
        zero: Physical value of a feature of 0, shape (features,).
        inputs: Computes the belief, if the network needs it.
    """

    def __init__(
        self,
        session: Any,
        trained: Known,
        size: NDArray[np.float64],
        zero: NDArray[np.float64],
        inputs: BeliefInputs | None = None,
    ) -> None:
        self._session = session
        self._trained = trained
        self._size = size
        self._zero = zero
        self.inputs = inputs

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `homeward.agents.base.Policy.act`."""
        feed = {INPUT: (self._zero + self._size * observations).astype(np.float32)}
        if self.inputs is not None:
            feed[BELIEF] = self.inputs(observations, begun)[:, len(NAMES) :]
        return encode_actions(self._trained, *self._session.run(list(OUTPUTS), feed))


def load_onnx(path: str | Path, **keywords: Any) -> tuple[OnnxPolicy, Known]:
    """Read a file that `homeward.agents.trained.onnx_export` wrote: the policy and its environment.

    Args:
        path: Path of the file.
        **keywords: Keywords of the environment to use instead of those of the training, such as
            `robot` or `route`.

    Raises:
        PolicyFileError: The file cannot be read, or was not written by this version, or onnxruntime
            is not installed.
        OptionError, RobotError, RouteError: A keyword is invalid.
    """
    session = _open(Path(path))
    try:
        metadata = session.get_modelmeta().custom_metadata_map
        columns = json.loads(metadata["inputs"])[INPUT]
        setting = json.loads(metadata["setting"])
        if [column["name"] for column in columns] != list(NAMES):
            raise PolicyFileError(
                f"{path} needs other features than this version has: export it again"
            )
        setting["robot"] = _robot(metadata["robot_file"])
        trained = known_of(Options(**setting))
        known = known_of(Options(**setting | keywords))
        inputs = None
        if "beliefs" in metadata:
            inputs = inputs_from(json.loads(metadata["beliefs"]), known)
        size = np.array([number(column["size"]) for column in columns])
        zero = np.array([number(column["zero"]) for column in columns])
    except (PolicyFileError, OptionError, RobotError, RouteError):
        raise
    except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise PolicyFileError(
            f"{path} does not contain its environment: export it again ({error!r})"
        ) from None
    return OnnxPolicy(session, trained, size, zero, inputs), known


def _open(path: Path) -> Any:
    """A session of a file."""
    try:
        import onnx
        import onnxruntime
    except ModuleNotFoundError as error:
        raise PolicyFileError(
            f"{path} needs {error.name}: {advice('onnx', str(error.name))}"
        ) from None
    threads = onnxruntime.SessionOptions()
    threads.intra_op_num_threads = 1  # for one mission, more would only wait for each other
    try:
        content = read_bytes(path, MOST_BYTES)
        _refuse_foreign(
            path, onnx.shape_inference.infer_shapes(onnx.load_model_from_string(content))
        )
        return onnxruntime.InferenceSession(content, threads, providers=["CPUExecutionProvider"])
    except PolicyFileError:
        raise
    except OSError as error:
        raise PolicyFileError(
            f"cannot read {path}: {error.strerror}; give a file that onnx_export wrote"
        ) from None
    except Exception as error:  # onnxruntime has no class of its own for them
        raise PolicyFileError(f"{path} is not a network that onnxruntime reads: {error}") from None


def _refuse_foreign(path: Path, model: Any) -> None:
    """Refuse a network that no export writes: it may loop for ever, read other files or make values
    of any size.

    Raises:
        PolicyFileError: It is not.
    """
    foreign = {node.op_type for node in model.graph.node} - OPERATIONS
    if foreign or model.functions:
        names = ", ".join(sorted(foreign)) or "functions"
        raise PolicyFileError(
            f"{path} computes with {names[:100]}, which no export does: export it again"
        )
    if any(constant.external_data for constant in model.graph.initializer):
        raise PolicyFileError(
            f"{path} has weights in another file, which no export has: export it again"
        )
    for value in (*model.graph.value_info, *model.graph.output):
        size = math.prod(
            max(dimension.dim_value, 1) for dimension in value.type.tensor_type.shape.dim
        )
        if size > MOST_VALUES:
            raise PolicyFileError(
                f"{path} computes {size:.3g} values at once, which no export does: export it again"
            )


def _robot(text: str) -> Robot:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.toml"
        path.write_text(text, "utf-8")
        return load_robot(path)
