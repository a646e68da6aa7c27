"""The loop closes: what the example records leads back to the robot that drove, and its table says
what it must."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, analyse
from homeward.envs.options import known_of
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import replay
from tests.command_line import example_ended

pytest.importorskip("stable_baselines3")

TRAINED = ("nominal-trained", "randomised-trained", "corrected-trained", "file-randomised")


@pytest.fixture(scope="module")
def example(load_example: Callable[[str], Any]) -> Any:
    """The example, which diagnoses the same recordings once."""
    module = load_example("sim_to_real")
    diagnosed: dict[bytes, Analysis] = {}

    def analyse_once(paths: list[Path], *known: Any) -> Analysis:
        given = b"".join(path.read_bytes() for path in paths) + repr((paths, known)).encode()
        if given not in diagnosed:
            diagnosed[given] = analyse(paths, *known)
        return diagnosed[given]

    module.analyse = analyse_once
    return module


@pytest.fixture(scope="module")
def args(example: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    small = example.PPOSettings(
        start="scratch", n_envs=32, n_steps=16, batch_size=128, epochs=1, hidden=16
    )
    return example.Args(
        steps=512, episodes=40, trainings=1, out=tmp_path_factory.mktemp("sim") / "out", ppo=small
    )


@pytest.fixture(scope="module")
def done(example: Any, args: Any, short_curves: None) -> tuple[dict[str, Any], str]:
    """What the example returned and printed."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        result = example.main(args)
    return result, printed.getvalue()


def test_every_missing_effect_is_named(example: Any, done: tuple[dict[str, Any], str]) -> None:
    result, printed = done
    assert set(result["found"]) == set(example.MISSING)
    assert printed.startswith("The simulator lacks: turning")
    assert printed.count("; in truth ") == 3 and "not found" not in printed


def test_the_corrected_robot_consumes_what_the_real_one_does(
    example: Any, args: Any, done: tuple[dict[str, Any], str]
) -> None:
    nominal, corrected = load_robot("husky"), load_robot(args.out / "diagnosis" / "corrected.toml")
    real = load_robot(args.out / "real.toml")
    assert real == example.real_robot()
    grid = [
        (v, yaw, rough, hz)
        for v in (0.5, 1.0)
        for yaw in (0.0, 0.5)
        for rough in (0.0, 0.5, 1.0)
        for hz in (0, 25)
    ]
    speed, yaw_rate, roughness, sensing_hz = np.array(grid).T

    def power_w(robot: Robot) -> Any:
        time_s = np.arange(len(grid), dtype=np.float64)
        return replay(robot, time_s, speed, yaw_rate_radps=yaw_rate, roughness=roughness, sensing_hz=sensing_hz,
                      accel_mps2=0.0).power_w  # fmt: skip

    np.testing.assert_allclose(power_w(corrected), power_w(real), rtol=0.06)
    assert (power_w(real) > 1.25 * power_w(nominal)).mean() > 0.5


def test_the_diagnosis_sees_what_sensors_see(args: Any, done: tuple[dict[str, Any], str]) -> None:
    runs = sorted((args.out / "recordings").iterdir())
    assert len(runs) == 4
    for run in runs:
        assert "roughness" not in pd.read_csv(run)
    noisy = pd.read_csv(runs[0])
    assert noisy["power_w"].diff().std() > 3.0


def test_all_meet_the_same_missions_of_the_real_robot(
    example: Any, args: Any, done: tuple[dict[str, Any], str]
) -> None:
    envs = {}
    for label, one in example.contenders(args).items():
        env = HomewardVectorEnv(3, **vars(example.reality(one, args.out / "real.toml")))
        env.reset(seed=1)
        envs[label] = env.batch
    first = envs["nominal-trained"]
    for batch in envs.values():
        for name in (
            "turning_scrub",
            "surface_gain",
            "compute_power_w",
            "rolling_resistance",
            "payload_mass_kg",
        ):
            np.testing.assert_array_equal(batch.robots[name], first.robots[name])
        np.testing.assert_array_equal(batch.records["capacity_j"], first.records["capacity_j"])
        np.testing.assert_array_equal(
            batch.routes["places"]["sin_grade"], first.routes["places"]["sin_grade"]
        )
        for name in (
            "length_m",
            "decision_s",
            "max_decisions",
            "backlog_limit",
            "link_m",
            "score_scale",
        ):
            assert batch.known.shared[name] == first.known.shared[name]
    assert "turning" in envs["corrected-trained"].known.robot.effects
    assert not first.known.robot.effects
    assert first.robots["turning_scrub"][0] == 0.6
    # What the file says of itself is what its policy reckons with, and not what the missions are
    # drawn from.
    generic, own = (
        known_of(example.simulator(example.contenders(args)[label])) for label in TRAINED[2:]
    )
    assert (
        own.robot == generic.robot
        and own.difficulty.rolling.deviation < 0.5 * generic.difficulty.rolling.deviation
    )
    assert envs["file-randomised"].known.difficulty == envs["corrected-trained"].known.difficulty


def test_the_table_has_a_row_for_everyone(
    example: Any, args: Any, done: tuple[dict[str, Any], str]
) -> None:
    result, printed = done
    labels = [*TRAINED, *(f"{rule}, {file}" for rule in ("dmax_mapped", "dmax_adaptive")
                          for file in ("nominal", "corrected"))]  # fmt: skip
    assert list(result["real"]["agents"]) == list(result["simulated"]["agents"]) == labels
    for label in labels:
        # the rest may stand on the next line
        assert printed.count(label.split()[0]) == (2 if ", " in label else 1)
        one = result["real"]["agents"][label]
        assert one["stranded_ci95"][0] <= one["stranded_rate"] <= one["stranded_ci95"][1]
        assert one["score_ci95"][0] <= one["score_mean"] <= one["score_ci95"][1]
        assert label == labels[0] or f"{label} - nominal-trained" in result["real"]["paired"]
    assert result["real"]["options"]["true_robot"] == str(args.out / "real.toml")
    # A rule that trusts its map strands on the real robot, and comes home with the corrected file.
    mapped, corrected = (
        result["real"]["agents"][f"dmax_mapped, {file}"] for file in ("nominal", "corrected")
    )
    assert mapped["stranded"] > corrected["stranded"]
    assert result["simulated"]["agents"]["dmax_mapped, nominal"]["stranded"] < mapped["stranded"]


def test_a_second_run_trains_nothing_and_says_the_same(
    example: Any, args: Any, done: tuple[dict[str, Any], str], capsys: pytest.CaptureFixture[str]
) -> None:
    weights = [args.out / label / "0" / "policy.safetensors" for label in TRAINED]
    before = [file.stat().st_mtime_ns for file in weights]
    again = example.main(args)
    assert capsys.readouterr().err.count("finished: nothing to do") == 4
    assert [file.stat().st_mtime_ns for file in weights] == before
    assert again["found"] == done[0]["found"]
    for label, one in again["real"]["agents"].items():
        assert one | {"decision_us": 0} == done[0]["real"]["agents"][label] | {"decision_us": 0}


def test_too_few_missions_take_one_line(tmp_path: Path) -> None:
    code, _, said = example_ended("sim_to_real", "--episodes", "1", "--out", str(tmp_path / "out"))
    assert code == 2
    assert said == (
        "sim_to_real.py: --episodes 1 --seed 0 --trainings 5: give at least 2 episodes, a seed "
        "of 0 or more and at least 1 training\n"
    )
    assert not (tmp_path / "out").exists()
