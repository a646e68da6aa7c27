"""A policy as an ONNX graph: physical units in, physical commands out."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray
from onnx import TensorProto, helper, numpy_helper

import homeward
from homeward.agents.trained.inputs import COLUMNS
from homeward.agents.trained.onnx_policy import BELIEF, INPUT, OUTPUTS
from homeward.agents.trained.policy_file import NetworkPolicy
from homeward.envs import IDS
from homeward.envs.actions import LEVELS, MODES, at_level, decode_actions, limits
from homeward.envs.features import FEATURES, INTEREST_UNIT, LIMIT, SINE_UNIT, WIND_UNIT_MPS
from homeward.envs.options import Known, Options
from homeward.envs.state import GO

_SENSING_IF_IT_GOES = "sensing_if_it_goes"
# in a text of its own, hidden from a robot, and none in what is exported
_ELSEWHERE = ("robot", "true_robot", "docks")
_OPSET = 17
_IR_VERSION = 8
"""Opset of 2022, so that the runtimes of older robots read the file."""


@dataclass(frozen=True)
class PhysicalInput:
    """One column of the input: physical value = zero + size * feature."""

    name: str
    unit: str
    size: float
    zero: float
    meaning: str


def quantities(known: Known) -> list[PhysicalInput]:
    """Physical units of the input's columns, in the order of `homeward.envs.features.FEATURES`.

    Args:
        known: Constants of the environment that the policy was trained in.
    """
    s = known.shared[0]
    units = {  # of the observation: physical unit, size of one, zero
        "1": ("1", 1.0, 0.0),
        "-1 to 1": ("1", 1.0, 0.0),
        "2": ("1", INTEREST_UNIT, 0.0),
        "usable energy": ("J", s["usable_j"], 0.0),
        "cruise power": ("W", s["cruise_w"], 0.0),
        "reach": ("m", s["reach_m"], 0.0),
        "top speed": ("m/s", s["max_speed_mps"], 0.0),
        "top rate": ("Hz", s["max_sensing_hz"], 0.0),
        "sine 0.1": ("sine of the angle", SINE_UNIT, 0.0),
        "memory": ("samples", s["backlog_limit"], 0.0),
        "10 m/s": ("m/s", WIND_UNIT_MPS, 0.0),
        "20 K": ("degree C", 20.0, 10.0),
        "good score": ("score", s["score_scale"], 0.0),
        "time limit": ("decisions", s["max_decisions"], 0.0),
        "decision": ("s", s["decision_s"], 0.0),
    }
    columns = []
    for name, unit, meaning in FEATURES:
        physical, size, zero = units[unit]
        columns.append(
            PhysicalInput(
                name, physical, float(size), zero, meaning.removesuffix(f" above {zero:g} C")
            )
        )
    return columns


def to_onnx(policy: NetworkPolicy, options: Options, known: Known) -> onnx.ModelProto:
    """The policy as a graph.

    Input `observation`, float32 (missions, features) in the units of `quantities`. Policies with a
    belief also have `belief`, float32 (missions, columns): the columns behind the features that
    `homeward.agents.trained.inputs.BeliefInputs` returns, an estimator with a state that a graph
    cannot contain. `load_onnx` of `homeward.agents.trained.onnx_policy` runs both. Outputs
    `speed_mps` and `sensing_hz`, float32 (missions,), and `mode`, int64 (missions,): 0 stop, 1 go,
    2 return.

    Args:
        policy: The policy.
        options: Keywords of its environment.
        known: Constants of its environment.
    """
    graph = _Graph()
    columns = quantities(known)
    offset = graph.apply(
        "Sub", INPUT, graph.constant("zero", [quantity.zero for quantity in columns])
    )
    scaled = graph.apply(
        "Div", offset, graph.constant("size", [quantity.size for quantity in columns])
    )
    values = graph.apply(
        "Clip", scaled, graph.constant("lowest", -LIMIT), graph.constant("highest", LIMIT)
    )
    inputs = [helper.make_tensor_value_info(INPUT, TensorProto.FLOAT, ["missions", len(columns)])]
    if sees_beliefs(policy):
        inputs.append(
            helper.make_tensor_value_info(BELIEF, TensorProto.FLOAT, ["missions", len(COLUMNS)])
        )
        values = graph.apply("Concat", values, BELIEF, axis=1)
    seen = values
    for index, (weight, bias) in enumerate(policy.layers):
        if index:
            values = graph.apply("Tanh", values)
        if index and index == len(policy.layers) - 1:
            values = graph.apply("Concat", values, seen, axis=1)
        parameters = (
            graph.constant(f"weight_{index}", weight),
            graph.constant(f"bias_{index}", bias),
        )
        values = graph.apply("Gemm", values, *parameters, transB=1)
    decode = (
        _decode_levels if isinstance(policy.action_space, spaces.MultiDiscrete) else _decode_box
    )
    decode(graph, values, known)
    # Without go there is no sensing, see `homeward.agents.trained.policy_file.sensing_on_the_go`.
    senses = [mode == GO or not policy.senses_on_the_go for mode in range(len(MODES))]
    allowed = graph.apply("Gather", graph.constant("modes_that_sense", senses), "mode")
    graph.apply("Mul", _SENSING_IF_IT_GOES, allowed, into="sensing_hz")
    types = (TensorProto.FLOAT, TensorProto.FLOAT, TensorProto.INT64)
    model = helper.make_model(
        helper.make_graph(
            graph.nodes,
            "policy",
            inputs,
            [
                helper.make_tensor_value_info(*output, ["missions"])
                for output in zip(OUTPUTS, types, strict=True)
            ],
            graph.constants,
        ),
        producer_name="homeward",
        producer_version=homeward.__version__,
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        doc_string=__doc__,
    )
    helper.set_model_props(model, _metadata(policy, options, known))
    onnx.checker.check_model(model, full_check=True)
    return model


def sees_beliefs(policy: NetworkPolicy) -> bool:
    """Whether a policy needs `belief` too."""
    return "inputs" in policy.description


class _Graph:
    """Nodes and constants, as they are added."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, name: str, values: ArrayLike, dtype: Any = np.float32) -> str:
        self.constants.append(numpy_helper.from_array(np.asarray(values, dtype), name))
        return name

    def apply(self, operator: str, *inputs: str, into: str | None = None, **attributes: Any) -> str:
        output = into or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [output], **attributes))
        return output


def _limits(known: Known) -> dict[str, tuple[float, float]]:
    return dict(zip(OUTPUTS, limits(known), strict=False))


def _before_mode(output: str) -> str:
    """Name of a command before the mode is known."""
    return _SENSING_IF_IT_GOES if output == "sensing_hz" else output


def _decode_levels(graph: _Graph, values: str, known: Known) -> None:
    """The most likely level of each part, as a command."""
    starts = np.cumsum([0, LEVELS, LEVELS, len(MODES)])
    for part, output in enumerate(OUTPUTS):
        start = graph.constant(f"{output}_from", [starts[part]], np.int64)
        end = graph.constant(f"{output}_to", [starts[part + 1]], np.int64)
        axis = graph.constant(f"{output}_axis", [1], np.int64)
        scores = graph.apply("Slice", values, start, end, axis)
        if output == "mode":
            graph.apply("ArgMax", scores, axis=1, keepdims=0, into=output)
        else:
            level = graph.apply("ArgMax", scores, axis=1, keepdims=0)
            low, high = _limits(known)[output]
            commands = graph.constant(f"{output}_levels", at_level(np.arange(LEVELS), low, high))
            graph.apply("Gather", commands, level, into=_before_mode(output))


def _decode_box(graph: _Graph, values: str, known: Known) -> None:
    """The mean action, clipped to the box, as a command."""
    unit = graph.constant("one", 1.0)
    clipped = graph.apply("Clip", values, graph.constant("minus_one", -1.0), unit)
    shares = graph.apply("Add", clipped, unit)  # 0 to 2
    for part, output in enumerate(OUTPUTS):
        share = graph.apply(
            "Gather", shares, graph.constant(f"{output}_column", part, np.int64), axis=1
        )
        if output == "mode":
            thirds = graph.apply("Mul", share, graph.constant("thirds", len(MODES) / 2.0))
            thirds_number = graph.apply("Cast", thirds, to=TensorProto.INT64)
            graph.apply(
                "Min",
                thirds_number,
                graph.constant("last_mode", len(MODES) - 1, np.int64),
                into=output,
            )
        else:
            low, high = _limits(known)[output]
            above = graph.apply(
                "Mul", share, graph.constant(f"{output}_per_share", (high - low) / 2.0)
            )
            graph.apply(
                "Add", above, graph.constant(f"{output}_least", low), into=_before_mode(output)
            )


def _metadata(policy: NetworkPolicy, options: Options, known: Known) -> dict[str, str]:
    inputs: dict[str, Any] = {
        INPUT: [dataclasses.asdict(quantity) for quantity in quantities(known)]
    }
    if sees_beliefs(policy):
        inputs[BELIEF] = [{"name": name, "meaning": meaning} for name, meaning in COLUMNS]
    outputs = {
        name: f"command until the next decision, {low:g} to {high:g}"
        for name, (low, high) in _limits(known).items()
    }
    modes = ", ".join(f"{index} {mode}" for index, mode in enumerate(MODES))
    outputs["mode"] = f"{modes}; a return is final: once begun, go on home whatever is output later"
    described = {
        "env": IDS[options.mission],
        "robot": known.robot.name,
        "difficulty": options.difficulty,
        "decision_s": float(known.shared["decision_s"][0]),
        "inputs": inputs,
        "outputs": outputs,
        "weights_sha256": policy.description.get("weights_sha256"),
        # From these `homeward.agents.trained.onnx_policy.load_onnx` makes the policy and its
        # inputs.
        "setting": {
            name: _plain(value) for name, value in vars(options).items() if name not in _ELSEWHERE
        },
        "robot_file": known.robot.to_toml(),
    }
    if sees_beliefs(policy):
        described["beliefs"] = policy.description["inputs"]
    return {name: _text(value) for name, value in described.items()}


def _text(value: Any) -> str:
    """A text as it is, and all else as JSON: metadata are texts."""
    if isinstance(value, str):
        return value
    return json.dumps(value)


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, str | float | int):
        return value
    return str(value)


def decode(actions: NDArray[Any], known: Known) -> NDArray[np.float64]:
    """Commands of actions: speed (m/s), sensing rate (Hz) and mode, shape (n, 3)."""
    commands = decode_actions(known, actions)
    return np.column_stack([commands.speed_mps, commands.sensing_hz, commands.mode])
