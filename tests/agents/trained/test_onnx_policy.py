"""An exported file alone, on a robot without the project's checkout, decides what the policy
decides."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

from homeward.agents.onboard import load_onboard  # noqa: E402
from homeward.agents.registry import shipped  # noqa: E402
from homeward.agents.trained.environment import setting_of  # noqa: E402
from homeward.agents.trained.onnx_graph import to_onnx  # noqa: E402
from homeward.agents.trained.onnx_policy import load_onnx  # noqa: E402
from homeward.agents.trained.policy_file import PolicyFileError, load_policy  # noqa: E402
from homeward.envs.missions import MISSIONS  # noqa: E402
from homeward.envs.vector import HomewardVectorEnv  # noqa: E402
from homeward.physics import RobotError  # noqa: E402


def exported(mission: str, start: str, folder: Path) -> Path:
    policy = load_policy(shipped(mission, start))
    path = folder / "policy.onnx"
    path.write_bytes(to_onnx(policy, *setting_of(policy)).SerializeToString())
    return path


@pytest.mark.parametrize("start", ["dmax", "scratch"])
@pytest.mark.parametrize("mission", MISSIONS)
def test_a_file_alone_decides_what_the_policy_decides(
    mission: str, start: str, tmp_path: Path
) -> None:
    ours, known = load_onnx(exported(mission, start, tmp_path))
    policy = load_policy(shipped(mission, start), known)
    assert known.shared.tobytes() == setting_of(policy)[1].shared.tobytes()
    env = HomewardVectorEnv(16, mission=mission)
    observations, _ = env.reset(seed=8_000_001)
    decided = set()
    for decision in range(170):
        begun = np.full(16, decision == 0)
        actions = policy.act(observations, begun)
        np.testing.assert_array_equal(ours.act(observations, begun), actions)
        observations, *_ = env.step(actions)
        decided |= set(map(tuple, actions.tolist()))
    assert {mode for _, _, mode in decided} >= {1, 2}


def test_another_robot_gets_its_own_speeds(tmp_path: Path) -> None:
    onboard = load_onboard(exported("OutAndBack", "dmax", tmp_path), robot="jackal")
    assert onboard.robot.name == "jackal" and onboard.decision_s > 30.0
    original = load_onboard("ppo", "OutAndBack", robot="jackal")
    assert onboard.update(0.0, 0.0, soc=1.0) == original.update(0.0, 0.0, soc=1.0)


def test_files_that_cannot_be_used_are_refused_in_one_line(tmp_path: Path) -> None:
    path = exported("Patrol", "scratch", tmp_path)
    model = onnx.load(path)
    del model.metadata_props[:]
    (tmp_path / "mute.onnx").write_bytes(model.SerializeToString())
    (tmp_path / "nonsense.onnx").write_bytes(b"nonsense")
    # of Latin-1, no UTF-8
    foreign_letter = path.read_bytes().replace(b'"energy"', b'"\xe7nergy"', 1)
    (tmp_path / "latin.onnx").write_bytes(foreign_letter)
    for name, said in (
        ("mute", "does not contain its environment"), ("latin", "does not contain its environment"),
        ("nonsense", "is not a network that onnxruntime reads"),
        ("none", "cannot read .*none.onnx: No such file"),
    ):  # fmt: skip
        with pytest.raises(PolicyFileError, match=said) as caught:
            load_onboard(tmp_path / f"{name}.onnx")
        assert "\n" not in str(caught.value)


def test_networks_that_no_export_writes_are_refused(tmp_path: Path) -> None:
    """A loop may never end, values may grow to any size, and weights may be those of another
    file."""
    path = exported("Patrol", "scratch", tmp_path)

    def refused(change: Callable[[Any], None], said: str) -> None:
        model = onnx.load(path)
        change(model)
        (tmp_path / "changed.onnx").write_bytes(model.SerializeToString())
        with pytest.raises(PolicyFileError, match=said):
            load_onnx(tmp_path / "changed.onnx")

    def loops(model: Any) -> None:
        body = onnx.helper.make_graph([], "body", [], [])
        model.graph.node.append(onnx.helper.make_node("Loop", ["", ""], ["x"], body=body))

    def grows(model: Any) -> None:
        names = ["observation", *(f"twice_{i}" for i in range(40))]
        for before, after in itertools.pairwise(names):
            model.graph.node.append(
                onnx.helper.make_node("Concat", [before, before], [after], axis=1)
            )

    def reads(model: Any) -> None:
        model.graph.initializer[0].external_data.add(key="location", value="/etc/passwd")

    refused(loops, "computes with Loop, which no export does")
    refused(grows, "computes .* values at once")
    refused(reads, "has weights in another file")


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ("inputs", "[" * 100_000), ("inputs", '{"observation": [1]}'), ("beliefs", '{"columns": []}'),
        ("beliefs", "9" * 400), ("setting", "null"), ("robot_file", "[[[["), ("size", "1" + "0" * 400), ("size", '"x"'),
    ],
)  # fmt: skip
def test_metadata_that_is_none_is_refused(tmp_path: Path, entry: str, text: str) -> None:
    path = exported("Survey", "dmax", tmp_path)
    model = onnx.load(path)
    for one in model.metadata_props:
        if one.key == entry:
            one.value = text
        elif one.key == "inputs" and entry == "size":
            one.value = re.sub(r'"size": [^,]*', f'"size": {text}', one.value)
    path.write_bytes(model.SerializeToString())
    with pytest.raises((PolicyFileError, RobotError)):
        load_onnx(path)
