"""A policy as a graph: physical units in, and out the commands of the original."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

from homeward.agents.trained.environment import setting_of  # noqa: E402
from homeward.agents.trained.inputs import COLUMNS  # noqa: E402
from homeward.agents.trained.onnx_graph import decode, quantities, to_onnx  # noqa: E402
from homeward.agents.trained.onnx_policy import BELIEF, INPUT, OUTPUTS  # noqa: E402
from homeward.agents.trained.policy_file import NetworkPolicy  # noqa: E402
from homeward.envs.actions import LEVELS, action_space, at_level, encode_actions, limits  # noqa: E402
from homeward.envs.features import FEATURES, INDEX, LIMIT, NAMES  # noqa: E402
from homeward.envs.missions import MISSIONS  # noqa: E402
from homeward.envs.options import Options, known_of  # noqa: E402
from homeward.envs.vector import HomewardVectorEnv  # noqa: E402
from homeward.physics import load_robot  # noqa: E402
from tests.agents.trained.drawn import save_drawn_policy  # noqa: E402


def open_session(content: bytes) -> Any:
    threads = onnxruntime.SessionOptions()
    threads.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(content, threads, providers=["CPUExecutionProvider"])


@pytest.mark.parametrize("beliefs", [False, True])
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_commands_are_those_of_the_original(
    action_type: str, beliefs: bool, tmp_path: Path
) -> None:
    policy = save_drawn_policy(tmp_path, action_type, beliefs)
    options, known = setting_of(policy)
    session = open_session(to_onnx(policy, options, known).SerializeToString())
    size, zero = np.array([(one.size, one.zero) for one in quantities(known)]).T
    env = HomewardVectorEnv(64, **vars(options))
    observations, _ = env.reset(seed=0)
    modes = set()
    for decision in range(100):
        seen = policy.seen(observations, np.full(64, decision == 0))
        actions = policy.choose(policy.outputs(seen))
        feed = {INPUT: (observations * size + zero).astype(np.float32)}
        if beliefs:
            feed[BELIEF] = seen[:, len(NAMES) :]
        commands = dict(zip(OUTPUTS, session.run(list(OUTPUTS), feed), strict=True))
        encoded = encode_actions(known, **commands)
        if action_type == "discrete":
            np.testing.assert_array_equal(encoded, actions)
        else:
            np.testing.assert_allclose(encoded[:, :2], actions[:, :2], atol=1e-4)
            np.testing.assert_array_equal(
                commands["mode"], np.minimum((1.5 * (actions[:, 2] + 1.0)).astype(int), 2)
            )
        modes |= set(commands["mode"].tolist())
        observations, *_ = env.step(actions)
    assert modes <= {0, 1, 2}


def test_columns_are_the_physical_quantities(tmp_path: Path) -> None:
    policy = save_drawn_policy(tmp_path)
    options, known = setting_of(policy)
    size, zero = np.array([(one.size, one.zero) for one in quantities(known)]).T
    env = HomewardVectorEnv(32, **vars(options) | {"difficulty": "known"})
    observations, _ = env.reset(seed=0)
    for _ in range(60):
        before_j = env.batch.records["energy_j"].copy()
        observations, *_ = env.step(env.action_space.sample() // [1, 1, 2])  # none returns
    physical = observations * size + zero
    truth = env.batch.records
    recorded = {
        "energy": truth["energy_j"],
        "distance": truth["position_m"],
        "metered": truth["energy_j"],
        "power": (before_j - truth["energy_j"]) / known.shared["decision_s"][0],
        "modelled": truth["modelled_j"],
        "speed": truth["speed_mps"],
        "sensing": truth["sensing_hz"],
        "grade_mean": truth["mean_grade"],
        "interest": truth["here"]["interest"],
        "backlog": truth["backlog"],
        "temperature": truth["temperature_c"],
        "score": truth["score"],
        "time": truth["decisions"],
    }
    for name, values in recorded.items():
        assert np.ptp(values) > 0.0 or name == "time"
        np.testing.assert_allclose(
            physical[:, INDEX[name]], values, rtol=1e-5, atol=1e-5 * np.abs(values).max()
        )


def test_sizes_are_those_of_the_robot_and_the_mission() -> None:
    known = known_of(Options("Survey", robot="husky"))
    robot, s = load_robot("husky"), known.shared[0]
    by_name = {one.name: one for one in quantities(known)}
    assert list(by_name) == [name for name, _, _ in FEATURES]
    expected: dict[str, tuple[str, float, float]] = {
        "energy": ("J", robot.usable_energy_j, 0.0),
        "speed": ("m/s", robot.max_speed_mps, 0.0),
        "temperature": ("degree C", 20.0, 10.0),
        "grade_mean": ("sine of the angle", 0.1, 0.0),
        "time": ("decisions", float(s["max_decisions"]), 0.0),
        "outbound": ("1", 1.0, 0.0),
    }
    for name, (unit, size, zero) in expected.items():
        assert (by_name[name].unit, by_name[name].zero) == (unit, zero)
        assert by_name[name].size == pytest.approx(size)


@pytest.mark.parametrize("mission", MISSIONS)
def test_no_quantity_is_without_a_size(mission: str) -> None:
    assert all(
        one.size > 0.0 and np.isfinite(one.size) for one in quantities(known_of(Options(mission)))
    )


def test_inputs_beyond_the_observation_space_are_clipped_to_it() -> None:
    """Speed is linear in one feature, so that a limit shows."""
    weight = np.zeros((3, len(NAMES)), np.float32)
    weight[0, INDEX["temperature"]] = 0.5 / LIMIT
    policy = NetworkPolicy(((weight, np.zeros(3, np.float32)),), action_space(False), {})
    options = Options("Survey", robot="husky", action_type="continuous")
    known = known_of(options)
    session = open_session(to_onnx(policy, options, known).SerializeToString())
    shown = np.zeros((5, len(NAMES)))
    shown[:, INDEX["temperature"]] = LIMIT * np.array([-9.0, -1.0, 0.5, 1.0, 9.0])
    size, zero = np.array([(one.size, one.zero) for one in quantities(known)]).T
    speed_mps, *_ = session.run(list(OUTPUTS), {INPUT: (shown * size + zero).astype(np.float32)})
    (slowest, fastest), _ = limits(known)
    assert speed_mps == pytest.approx(
        slowest + (fastest - slowest) * np.array([0.25, 0.25, 0.625, 0.75, 0.75])
    )


@pytest.mark.parametrize("beliefs", [False, True])
def test_metadata_makes_the_policy_again_without_any_other_file(
    tmp_path: Path, beliefs: bool
) -> None:
    policy = save_drawn_policy(tmp_path, beliefs=beliefs)
    model = to_onnx(policy, *setting_of(policy))
    metadata = {one.key: one.value for one in model.metadata_props}
    (tmp_path / "robot.toml").write_text(metadata["robot_file"])
    assert load_robot(tmp_path / "robot.toml") == load_robot("husky")
    setting = json.loads(metadata["setting"])
    assert setting["mission"] == "Survey" and setting.keys().isdisjoint({"robot", "true_robot"})
    assert metadata["weights_sha256"] == policy.description["weights_sha256"]
    assert list(json.loads(metadata["inputs"])) == ([INPUT, BELIEF] if beliefs else [INPUT])
    assert ("beliefs" in metadata) == beliefs
    if beliefs:
        assert [one["name"] for one in json.loads(metadata["inputs"])[BELIEF]] == [
            name for name, _ in COLUMNS
        ]


def test_decoded_actions_are_commands_in_columns() -> None:
    known = known_of(Options("Survey", robot="husky"))
    (slowest, fastest), (fewest, most) = limits(known)
    commands = decode(np.array([[0, LEVELS - 1, 0], [LEVELS - 1, 0, 2], [1, 1, 1]]), known)
    assert commands[:2].tolist() == [[slowest, most, 0.0], [fastest, fewest, 2.0]]
    assert commands[2] == pytest.approx(
        [at_level(1, slowest, fastest), at_level(1, fewest, most), 1.0]
    )
