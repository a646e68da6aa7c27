"""Policies as files: what is written is what is read, no code runs, and whatever is wrong with a
file is said."""

import hashlib
import itertools
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from safetensors.numpy import save

import homeward  # noqa: F401 - registers the environments
from homeward.agents import AgentError, make_policy
from homeward.agents.trained.inputs import COLUMNS, first_policy, make_inputs, valued
from homeward.agents.trained.policy_file import (
    DESCRIPTION,
    ON_THE_GO,
    WEIGHTS,
    Layer,
    PolicyFileError,
    load_policy,
    save_policy,
    sensing_on_the_go,
)
from homeward.envs.actions import decode_actions, encode_actions
from homeward.envs.features import DOCK_NAMES, NAMES, names_of
from homeward.envs.options import Options, known_of
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv

DISCRETE = spaces.MultiDiscrete([5, 5, 3])
CONTINUOUS = spaces.Box(-1.0, 1.0, (3,), np.float32)


def draw_layers(*widths: int) -> list[Layer]:
    """Layers of some widths; of several, the last also takes what the first takes."""
    rng = np.random.default_rng(0)
    pairs = [list(pair) for pair in itertools.pairwise(widths)]
    if len(pairs) > 1:
        pairs[-1][0] += widths[0]
    return [
        (
            rng.standard_normal((outputs, inputs)).astype(np.float32),
            rng.standard_normal(outputs).astype(np.float32),
        )
        for inputs, outputs in pairs
    ]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_policy(tmp_path, draw_layers(len(NAMES), 8, 13), DISCRETE, {"env": "homeward/Survey-v0"})
    return tmp_path


@pytest.mark.parametrize("path", ["", WEIGHTS, DESCRIPTION])
def test_what_is_read_is_what_was_written(folder: Path, path: str) -> None:
    policy = load_policy(folder / path)
    assert policy.action_space == DISCRETE
    assert policy.description["env"] == "homeward/Survey-v0"
    for (weight, bias), (written_weight, written_bias) in zip(
        policy.layers, draw_layers(len(NAMES), 8, 13), strict=True
    ):
        np.testing.assert_array_equal(weight, written_weight)
        np.testing.assert_array_equal(bias, written_bias)
    assert sorted(entry.name for entry in folder.iterdir()) == [DESCRIPTION, WEIGHTS]


@pytest.mark.parametrize("going", [False, True])
@pytest.mark.parametrize("start", ["scratch", "dmax"])
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_actions_are_those_of_the_trained_network(
    tmp_path: Path, action_type: str, start: str, going: bool
) -> None:
    from homeward.agents.learning.network import layers_of
    from homeward.agents.learning.ppo import inputs_of, make_model
    from homeward.agents.learning.settings import PPOSettings

    settings = PPOSettings(n_envs=16, n_steps=8, batch_size=64, epochs=1, hidden=16, start=start)
    options = Options("Survey", action_type=action_type)
    model, known = make_model(options, settings, seed=0), known_of(options)
    model.learn(settings.rollout)
    details = ON_THE_GO if going else {}
    save_policy(tmp_path, layers_of(model), model.action_space, details, inputs_of(settings, known))
    policy = load_policy(tmp_path, known)
    begun = np.ones(500, np.bool_)
    observations = np.random.default_rng(0).uniform(0.0, 1.0, (500, len(NAMES))).astype(np.float32)
    twin = inputs_of(settings, known)
    expected, _ = model.predict(
        observations if twin is None else twin(observations, begun), deterministic=True
    )
    actions = policy.act(observations, begun)
    assert actions.dtype == (np.int64 if action_type == "discrete" else np.float32)
    np.testing.assert_allclose(
        actions, sensing_on_the_go(expected) if going else expected, atol=1e-5
    )


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_nothing_is_sensed_but_on_the_go(action_type: str) -> None:
    known = known_of(Options("Survey", action_type=action_type))
    modes = np.array([STOP, GO, RETURN])
    actions = encode_actions(known, [0.3, 0.5, 1.0], 50.0, modes)
    kept = decode_actions(known, sensing_on_the_go(actions))
    assert kept.sensing_hz.tolist() == [0.0, 50.0, 0.0]
    assert kept.mode.tolist() == modes.tolist()
    np.testing.assert_array_equal(kept.speed_mps, decode_actions(known, actions).speed_mps)


def test_a_continuous_policy_stays_within_the_box(tmp_path: Path) -> None:
    save_policy(tmp_path, draw_layers(len(NAMES), 3), CONTINUOUS, {})
    policy = load_policy(tmp_path)
    actions = policy.act(np.full((4, len(NAMES)), 5.0, np.float32), np.ones(4, np.bool_))
    assert actions.shape == (4, 3)
    assert policy.action_space.contains(actions[0])
    assert np.abs(actions).max() == 1.0


def test_an_agent_is_made_from_the_folder(folder: Path) -> None:
    env = gym.make_vec("homeward/Survey-v0", num_envs=3, vectorization_mode="vector_entry_point")
    observations, _ = env.reset(seed=0)
    env.step(make_policy("ppo", env, folder).act(observations, np.ones(3, np.bool_)))
    other = gym.make_vec(
        "homeward/Survey-v0",
        num_envs=3,
        vectorization_mode="vector_entry_point",
        action_type="continuous",
    )
    with pytest.raises(AgentError, match=r"acts in MultiDiscrete.*choose the action_type"):
        make_policy("ppo", other, folder)


def test_reading_needs_no_torch(folder: Path) -> None:
    code = "import sys, pathlib; from homeward.agents.trained.policy_file import load_policy\n"
    code += "load_policy(pathlib.Path(sys.argv[1])); print('torch' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code, folder], capture_output=True, text=True)
    assert (run.returncode, run.stdout.strip()) == (0, "False"), run.stderr


def rewrite(folder: Path, weights: bytes | None = None, **changes: Any) -> None:
    """Change what the description says, and the weights with a matching checksum."""
    description = json.loads((folder / DESCRIPTION).read_text())
    if weights is not None:
        (folder / WEIGHTS).write_bytes(weights)
        changes["weights_sha256"] = hashlib.sha256(weights).hexdigest()
    (folder / DESCRIPTION).write_text(json.dumps(description | changes))


def test_a_pickle_is_not_run(folder: Path) -> None:
    class Trap:
        def __reduce__(self) -> Any:
            return (Path.touch, (folder / "run",))

    rewrite(folder, pickle.dumps(Trap()))
    with pytest.raises(PolicyFileError, match="is not a safetensors file"):
        load_policy(folder)
    assert not (folder / "run").exists()


@pytest.mark.parametrize("name", [WEIGHTS, DESCRIPTION])
@pytest.mark.parametrize("kept", [0.0, 0.5, 0.999])
def test_a_truncated_file_is_refused(folder: Path, name: str, kept: float) -> None:
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(
        content[: int(kept * len(content)) - 2 if kept == 0.999 else int(kept * len(content))]
    )
    with pytest.raises(PolicyFileError, match=f"{name} is truncated"):
        load_policy(folder)


@pytest.mark.parametrize("name", [WEIGHTS, DESCRIPTION])
def test_a_missing_file_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(
        PolicyFileError, match=f"cannot read .*{name}: No such file.*homeward train` wrote"
    ):
        load_policy(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": 1}, "schema 1, this version reads 2"),
        ({"observation_space": {"features": ["speed"]}}, "observes other features"),
        ({"observation_space": []}, "observes other features"),
        ({"action_space": {"type": "Discrete"}}, "does not describe"),
        ({"action_space": {"type": "MultiDiscrete", "nvec": [5]}}, "do not fit"),
        ({"action_space": 3}, "does not describe"),
        ({"network": {"layers": 9}}, "does not describe"),
        ({"network": {"layers": 0}}, "do not fit"),
        ({"network": {}}, "does not describe"),
    ],
)
def test_a_foreign_description_is_refused(
    folder: Path, changes: dict[str, Any], message: str
) -> None:
    rewrite(folder, **changes)
    with pytest.raises(PolicyFileError, match=message):
        load_policy(folder)


def test_a_policy_that_observed_otherwise_says_so_in_one_line(tmp_path: Path) -> None:
    """As those that were trained before instruments and forecasts were observed: 26 features,
    others in part."""
    save_policy(tmp_path, draw_layers(26, 8, 13), DISCRETE, {"env": "homeward/Survey-v0"})
    before = ["energy", "distance", "grade_near", "grade_far", *NAMES[:22]]
    rewrite(tmp_path, observation_space={"type": "Box", "features": before})
    env = gym.make_vec("homeward/Survey-v0", num_envs=3, vectorization_mode="vector_entry_point")
    with pytest.raises(
        AgentError, match=f"{DESCRIPTION}: the policy observes other features than .*: train again$"
    ):
        make_policy("ppo", env, tmp_path)


@pytest.mark.parametrize("content", ["[]", "{}", '"policy"', "null"])
def test_foreign_json_is_refused(folder: Path, content: str) -> None:
    (folder / DESCRIPTION).write_text(content)
    with pytest.raises(PolicyFileError, match="does not describe a policy"):
        load_policy(folder)


def weights_of(layers: list[Layer]) -> bytes:
    return save(
        {
            f"layers.{i}.{name}": a
            for i, pair in enumerate(layers)
            for name, a in zip(("weight", "bias"), pair, strict=True)
        }
    )


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (save({"other": np.zeros(3, np.float32)}), "does not describe"),
        (
            weights_of([*draw_layers(len(NAMES), 8), *draw_layers(8, 13)]),
            "does not fit the one before",
        ),
        (weights_of(draw_layers(len(NAMES) - 1, 8, 13)), "does not fit the one before"),
        (weights_of(draw_layers(len(NAMES), 8, 12)), "12 outputs do not fit"),
        (
            weights_of([(w * np.float32(np.nan), b) for w, b in draw_layers(len(NAMES), 8, 13)]),
            "not a finite number",
        ),
        (
            weights_of([(w.astype(np.float64), b) for w, b in draw_layers(len(NAMES), 8, 13)]),
            "does not fit",
        ),
        (weights_of([(w[0], b) for w, b in draw_layers(len(NAMES), 8, 13)]), "does not fit"),
        (weights_of([(w, b[None]) for w, b in draw_layers(len(NAMES), 8, 13)]), "does not fit"),
        (
            weights_of([(w, np.array(b[0])) for w, b in draw_layers(len(NAMES), 8, 13)]),
            "does not fit",
        ),
    ],
)
def test_foreign_weights_are_refused(folder: Path, weights: bytes, message: str) -> None:
    rewrite(folder, weights)
    with pytest.raises(PolicyFileError, match=message):
        load_policy(folder)


@pytest.fixture
def believing(tmp_path: Path) -> Path:
    inputs = make_inputs(known_of(Options("Survey")))
    save_policy(tmp_path, draw_layers(len(NAMES) + len(COLUMNS), 8, 13), DISCRETE, {}, inputs)
    return tmp_path


def test_a_policy_that_sees_beliefs_acts_only_with_what_is_known(believing: Path) -> None:
    observations, begun = np.zeros((2, len(NAMES)), np.float32), np.ones(2, np.bool_)
    assert load_policy(believing, known_of(Options("Survey"))).act(observations, begun).shape == (
        2,
        3,
    )
    with pytest.raises(PolicyFileError, match="load it with known="):
        load_policy(believing).act(observations, begun)


def test_a_policy_trained_with_docks_observes_them_and_acts_nowhere_else(tmp_path: Path) -> None:
    docked, without = (
        HomewardVectorEnv(2, mission="Patrol", docks=docks, time_limit_s=9e3)
        for docks in ("0:15", "")
    )
    known, begun = docked.batch.known, np.ones(2, np.bool_)
    inputs, observations = make_inputs(known), docked.reset(seed=0)[0]
    seen = inputs(observations, begun)
    np.testing.assert_array_equal(seen[:, -len(DOCK_NAMES) :], observations[:, len(NAMES) :])
    assert len(valued(known)) == seen.shape[1] == first_policy(known, inputs)[0].shape[1]
    features = names_of(True)
    save_policy(tmp_path, draw_layers(seen.shape[1], 8, 13), DISCRETE, {}, inputs, features)
    assert make_policy("ppo", docked, tmp_path).act(observations, begun).shape == (2, 3)
    with pytest.raises(
        AgentError, match=rf"observes {len(features)} features, the environment \({len(NAMES)},\)"
    ):
        make_policy("ppo", without, tmp_path)
    with pytest.raises(AgentError, match="with docks there are more"):
        make_policy("ppo", docked)


@pytest.mark.parametrize(
    "inputs", [None, {}, {"columns": ["luck"]}, {"columns": [name for name, _ in COLUMNS]}]
)
def test_foreign_inputs_are_refused(believing: Path, inputs: Any) -> None:
    rewrite(believing, inputs=inputs)
    with pytest.raises(
        PolicyFileError, match="names other inputs than this version has, train again"
    ):
        load_policy(believing, known_of(Options("Survey")))


@pytest.mark.parametrize(
    "layers", ["1e400", "100000000000000000000", "-1", "2.5", '"two"', "[]", "null", "true"]
)
def test_a_count_of_layers_that_is_none_is_refused(folder: Path, layers: str) -> None:
    path = folder / "policy.json"
    data = json.loads(path.read_text())
    count = data["network"]["layers"]
    text = path.read_text().replace(f'"layers": {count}', f'"layers": {layers}')
    assert text != path.read_text()
    path.write_text(text)
    with pytest.raises(PolicyFileError):
        load_policy(folder)


def test_pipes_and_devices_are_refused_at_once(folder: Path) -> None:
    for name in ("policy.json", "policy.safetensors"):
        kept = (folder / name).read_bytes()
        for make in (os.mkfifo, lambda path: path.symlink_to("/dev/zero")):
            (folder / name).unlink()
            make(folder / name)
            with pytest.raises(PolicyFileError):
                load_policy(folder)
        (folder / name).unlink()
        (folder / name).write_bytes(kept)
    load_policy(str(folder))
