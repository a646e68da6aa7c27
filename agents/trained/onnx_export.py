"""A trained policy for the robot itself: physical units in, physical commands out, as one ONNX
file.

`python -m homeward.agents.trained.onnx_export POLICY_FOLDER policy.onnx` writes the network with
the scaling of the observation before it and the decoding of the action behind it, compares it with
the original in onnxruntime, and prints inputs and outputs. The file's metadata contain the same.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro
from gymnasium import spaces
from numpy.random import Generator
from numpy.typing import NDArray
from rich import box
from rich.table import Table

from homeward import cli
from homeward.agents import thresholds
from homeward.agents.trained.environment import setting_of
from homeward.agents.trained.inputs import COLUMNS
from homeward.agents.trained.onnx_policy import BELIEF, INPUT, OUTPUTS
from homeward.agents.trained.policy_file import NetworkPolicy, PolicyFileError, load_policy
from homeward.envs.actions import limits, thirds
from homeward.envs.features import FEATURES
from homeward.envs.options import Known, OptionError
from homeward.envs.routes import RouteError
from homeward.files import write_whole
from homeward.installed import advice
from homeward.physics import RobotError

if TYPE_CHECKING:
    import onnx

_CHECKED = 2000
"""Random observations on which the exported network must act as the policy does: what is wrong in
0.15 % of them is found with a probability of 95 % (rule of three: Hanley & Lippman-Hand, 1983)."""


class ExportError(ValueError):
    """A policy that cannot be exported; the message says why and what to do."""


@dataclass(frozen=True)
class Args:
    """Which policy to export, and where to."""

    policy: Annotated[Path, tyro.conf.Positional]
    """Folder that train.py wrote."""
    out: Annotated[Path, tyro.conf.Positional]
    """File to write, such as policy.onnx."""
    robot: str | None = None
    """Robot file of the policy's training, if it has moved."""


def check_equal(content: bytes, policy: NetworkPolicy, known: Known, rng: Generator) -> None:
    """Compare a file with its policy on random observations.

    Args:
        content: Content of the file.
        policy: The original.
        known: Constants of its environment.
        rng: Draws the observations.

    Raises:
        ExportError: onnxruntime gives another command.
    """
    import onnxruntime

    from homeward.agents.trained.onnx_graph import decode, quantities, sees_beliefs

    columns = quantities(known)
    size = np.array([quantity.size for quantity in columns], np.float32)
    zero = np.array([quantity.zero for quantity in columns], np.float32)
    physical = zero + size * rng.uniform(-1.5, 1.5, (_CHECKED, len(columns))).astype(np.float32)
    feed = {INPUT: physical}
    seen = (physical - zero) / size
    if sees_beliefs(policy):
        feed[BELIEF] = rng.uniform(-1.0, 1.0, (_CHECKED, len(COLUMNS))).astype(np.float32)
        seen = np.concatenate((seen, feed[BELIEF]), axis=1)
    threads = onnxruntime.SessionOptions()
    threads.intra_op_num_threads = 1  # more would only wait for each other
    session = onnxruntime.InferenceSession(content, threads, providers=["CPUExecutionProvider"])
    commands = np.stack(
        [output.astype(np.float64) for output in session.run(list(OUTPUTS), feed)], axis=1
    )
    outputs = policy.outputs(seen)
    actions = policy.choose(outputs)
    (_, fastest_mps), (_, most_hz) = limits(known)
    largest = np.array([fastest_mps, most_hz, 1.0])
    wrong = np.abs(commands - decode(actions, known)) > thresholds.SAME_OUTPUT * largest
    wrong &= ~_undecided(policy, outputs, actions)
    if wrong.any():
        row, part = np.argwhere(wrong)[0]
        raise ExportError(
            f"onnxruntime commands another {OUTPUTS[part]} than the policy in {wrong.any(axis=1).sum()} of {_CHECKED} "
            f"observations, {commands[row, part]:g} in number {row}: use another version of onnxruntime"
        )


def _undecided(
    policy: NetworkPolicy, outputs: NDArray[np.float32], actions: NDArray[Any]
) -> NDArray[np.bool_]:
    """Where rounding decides, shape (n, 3): two levels have equal outputs, or a mode is at a
    border."""
    undecided = np.zeros((len(outputs), 3), np.bool_)
    if isinstance(policy.action_space, spaces.MultiDiscrete):
        parts = np.split(outputs, np.cumsum(policy.action_space.nvec)[:-1], axis=1)
        ordered = [np.sort(part, axis=1) for part in parts]
        undecided = np.stack(
            [part[:, -2] >= part[:, -1] - thresholds.SAME_OUTPUT for part in ordered], axis=1
        )
    else:
        borders = thirds(actions)
        undecided[:, 2] = np.abs(borders - np.rint(borders)) < thresholds.SAME_OUTPUT
    undecided[:, 1] |= undecided[:, 2]  # without go there is no sensing
    return undecided


def main(args: Args) -> onnx.ModelProto:
    """Export, check and print inputs and outputs.

    Raises:
        ExportError, PolicyFileError, OptionError, RobotError, RouteError: The policy cannot be
            exported.
        OSError: The file cannot be written.
    """
    try:
        import onnxruntime  # noqa: F401 - found missing before anything is done

        from homeward.agents.trained.onnx_graph import to_onnx
    except ModuleNotFoundError as error:
        raise ExportError(
            f"exporting needs {error.name}: {advice('onnx', str(error.name))}"
        ) from None
    policy = load_policy(args.policy)
    options, known = setting_of(policy, args.robot)
    if options.docks:
        raise ExportError(
            f"{args.policy}: was trained with docks, whose features no robot reads yet; train without"
        )
    model = to_onnx(policy, options, known)
    content = model.SerializeToString()
    check_equal(content, policy, known, np.random.default_rng(0))
    write_whole(args.out, content)
    _print(model, known, args.out)
    return model


def _print(model: onnx.ModelProto, known: Known, out: Path) -> None:
    from homeward.agents.trained.onnx_graph import quantities

    table = Table(
        title=f"columns of {INPUT}, float32 (missions, {len(FEATURES)})", box=box.SIMPLE_HEAD
    )
    for heading in ("", "name", "unit", "meaning"):
        table.add_column(heading, overflow="fold")
    for index, quantity in enumerate(quantities(known)):
        table.add_row(str(index), quantity.name, quantity.unit, quantity.meaning)
    console = cli.Terminal()
    console.print(table)
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    if BELIEF in json.loads(metadata["inputs"]):
        console.print(
            f"{BELIEF}, float32 (missions, {len(COLUMNS)}): the columns behind the features of what "
            "homeward.agents.trained.inputs.BeliefInputs answers on the robot; homeward.agents.onboard "
            "runs both",
            highlight=False, soft_wrap=True,
        )  # fmt: skip
    for name, meaning in json.loads(metadata["outputs"]).items():
        console.print(f"{name}: {meaning}", soft_wrap=True)
    console.print(
        f"Ask every {float(metadata['decision_s']):g} s. Equal to the original in onnxruntime. Written to {out}",
        markup=False, soft_wrap=True,
    )  # fmt: skip


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    refused = (ExportError, PolicyFileError, OptionError, RobotError, RouteError)
    return cli.run(main, Args, __doc__, refused)


if __name__ == "__main__":
    sys.exit(run())
