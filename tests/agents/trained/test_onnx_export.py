"""An exported policy commands on a robot what the original decides in the environment."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

from homeward.agents.trained.environment import setting_of  # noqa: E402
from homeward.agents.trained.inputs import COLUMNS, make_inputs  # noqa: E402
from homeward.agents.trained.onnx_export import Args, ExportError, check_equal, main  # noqa: E402
from homeward.agents.trained.onnx_graph import quantities, to_onnx  # noqa: E402
from homeward.agents.trained.onnx_policy import BELIEF, INPUT, OUTPUTS  # noqa: E402
from homeward.agents.trained.policy_file import ON_THE_GO, NetworkPolicy, PolicyFileError, load_policy, save_policy  # noqa: E402
from homeward.agents.trained.provenance import robot_hash  # noqa: E402
from homeward.envs.actions import action_space, encode_actions  # noqa: E402
from homeward.envs.features import INDEX, NAMES  # noqa: E402
from homeward.envs.options import Options, known_of  # noqa: E402
from homeward.envs.vector import HomewardVectorEnv  # noqa: E402


def save_drawn_policy(
    folder: Path, action_type: str = "discrete", beliefs: bool = False, **description: Any
) -> NetworkPolicy:
    """A network drawn at random, as if `train.py` had written it."""
    rng = np.random.default_rng(0)
    space = action_space(action_type == "discrete")
    outputs = 13 if action_type == "discrete" else 3
    known = known_of(Options("Survey", robot="husky", action_type=action_type))
    inputs = make_inputs(known) if beliefs else None
    columns = len(NAMES) + (len(COLUMNS) if beliefs else 0)
    layers = [
        (0.5 * rng.standard_normal((after, before)).astype(np.float32), np.zeros(after, np.float32))
        for before, after in ((columns, 16), (16 + columns, outputs))
    ]
    training = {"env": "homeward/Survey-v0", "robot": "husky", "action_type": action_type, "seed": 3}
    going = ON_THE_GO if beliefs else {}
    save_policy(folder, layers, space, {"training": training} | going | description, inputs)
    return load_policy(folder, known)


def open_session(content: bytes) -> Any:
    threads = onnxruntime.SessionOptions()
    threads.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(content, threads, providers=["CPUExecutionProvider"])


@pytest.mark.parametrize("beliefs", [False, True])
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_commands_are_those_of_the_original(action_type: str, beliefs: bool, tmp_path: Path) -> None:
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
            np.testing.assert_array_equal(commands["mode"], np.minimum((1.5 * (actions[:, 2] + 1.0)).astype(int), 2))
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
        np.testing.assert_allclose(physical[:, INDEX[name]], values, rtol=1e-5, atol=1e-5 * np.abs(values).max())


def test_the_file_says_what_goes_in_and_what_comes_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_drawn_policy(tmp_path)
    main(Args(tmp_path, tmp_path / "policy.onnx"))
    metadata = {one.key: one.value for one in onnx.load(tmp_path / "policy.onnx").metadata_props}
    assert [one["name"] for one in json.loads(metadata["inputs"])[INPUT]] == list(NAMES)
    assert list(json.loads(metadata["outputs"])) == list(OUTPUTS)
    assert (metadata["env"], metadata["robot"]) == ("homeward/Survey-v0", "husky")
    assert float(metadata["decision_s"]) == known_of(Options("Survey", robot="husky")).shared["decision_s"][0]
    printed = capsys.readouterr().out
    assert all(name in printed for name in (*NAMES, *OUTPUTS))


@pytest.mark.parametrize("beliefs", [False, True])
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_a_file_that_decides_otherwise_is_refused(action_type: str, beliefs: bool, tmp_path: Path) -> None:
    policy = save_drawn_policy(tmp_path, action_type, beliefs)
    options, known = setting_of(policy)
    check_equal(to_onnx(policy, options, known).SerializeToString(), policy, known)
    weight, bias = policy.layers[-1]
    other = NetworkPolicy((*policy.layers[:-1], (weight[::-1], bias)), policy.action_space, policy.description)
    with pytest.raises(ExportError, match=r"onnxruntime commands another \w+ than the policy in \d+ of 2000"):
        check_equal(to_onnx(other, options, known).SerializeToString(), policy, known)


def test_another_robot_than_the_trained_one_is_refused(tmp_path: Path) -> None:
    hashed = robot_hash(known_of(Options("Survey", robot="jackal")))
    policy = save_drawn_policy(tmp_path, made_with={"robot": hashed})
    with pytest.raises(
        PolicyFileError, match=r"robot 'husky' has other parameters .* give the file of that one with --robot"
    ):
        setting_of(policy)
    assert setting_of(policy, "jackal")[1].robot.name == "jackal"


@pytest.mark.parametrize("training", [None, {}, {"env": "homeward/Nothing-v0"}])
def test_a_policy_of_unknown_origin_is_refused(training: Any, tmp_path: Path) -> None:
    with pytest.raises(PolicyFileError, match="does not say which environment"):
        setting_of(save_drawn_policy(tmp_path, training=training))
