"""The battery in the environments: the kernel alone draws from it, causes sum to it, and it runs
out inside a step."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from homeward import Robot, load_robot
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from homeward.physics import CAUSES, below_cutoff, d_max
from homeward.physics.battery import share_below_cutoff
from homeward.physics.robot import preset_names
from tests.envs.rollouts import (
    MISSIONS,
    SHORT_S,
    drive,
    feature,
    make,
    mission,
    random_actions,
    route_file,
    windy,
)
from tests.physics.drives import STEADY, robots
from tests.physics.drives import drive as drive_kernel

EPSILON = float(np.finfo(np.float64).eps)
PRESETS = preset_names()
FLAT = "distance_m,grade_rad\n0,0\n{length_m},0\n"


@pytest.mark.parametrize("robot", PRESETS)
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_the_ledger_sums_to_what_the_battery_lost(
    mission_id: str, difficulty: str, robot: str
) -> None:
    env = make(mission_id, difficulty=difficulty, robot=robot, decision_s=None)
    rng = np.random.default_rng(4)
    for seed in range(3):
        _, info = env.reset(seed=seed)
        assert info["energy_j"].total() == 0.0 and set(info["energy_j"]) == set(CAUSES)
        m = mission(env)
        for step in drive(env, random_actions(rng, "discrete", 100, home=0.01)):
            assert step.info["energy_j"].total() == pytest.approx(
                m["capacity_j"] - m["energy_j"], rel=1e-9
            )
            assert sum(step.info["energy_j"].values()) == pytest.approx(
                step.info["energy_j"].total(), rel=1e-12
            )
            assert (m["energy_j"] == 0.0) == step.info["stranded"]


@settings(max_examples=60)
@given(
    robot=robots(),
    difficulty=st.sampled_from(DIFFICULTIES),
    mission_id=st.sampled_from(MISSIONS),
    seed=st.integers(0, 9),
)
def test_any_robot_keeps_the_ledger_and_the_observation_space(
    robot: Robot, difficulty: str, mission_id: str, seed: int
) -> None:
    """From grams to tonnes and with any effects on."""
    assume(0.0 < d_max(robot) < np.inf)
    env = HomewardEnv(robot=robot, difficulty=difficulty, mission=mission_id)
    observation, _ = env.reset(seed=seed)
    assert observation in env.observation_space
    m = mission(env)
    for step in drive(env, random_actions(np.random.default_rng(seed), "discrete", 50)):
        assert step.observation in env.observation_space
        assert math.isfinite(step.reward)
        ledger_j = np.array(list(step.info["energy_j"].values()))
        turnover_j = float(np.abs(ledger_j).sum())  # what came back went out before
        # of the battery's own sum
        rounding_j = 2.0 * EPSILON * float(m["capacity_j"]) * (m["decisions"] + 64)
        lost_j = float(m["capacity_j"] - m["energy_j"])
        assert float(ledger_j.sum()) == pytest.approx(
            lost_j, rel=1e-9, abs=rounding_j + 1e-9 * turnover_j
        )
        assert 0.0 <= m["energy_j"] <= m["capacity_j"]


def test_a_mission_spends_what_the_kernel_says(tmp_path: Path) -> None:
    """On an even slope each decision is one step of the kernel, whatever the places it crosses."""
    slope_rad = 0.05
    path = route_file(tmp_path, f"distance_m,grade_rad\n0,{slope_rad}\n9000,{slope_rad}\n")
    env = make("Survey", difficulty="known", action_type="continuous", route=path)
    env.reset(seed=0)
    robot, rng = env.batch.known.robot, np.random.default_rng(3)
    commands = [
        (rng.uniform(0.1, 1.0), rng.uniform(0.0, 100.0), mode)
        for mode in (GO, GO, STOP, GO, STOP, GO)
    ]
    steps = []
    for speed_mps, sensing_hz, mode in commands:
        action = np.array(
            [(speed_mps - 0.1) / 0.45 - 1.0, sensing_hz / 50.0 - 1.0, (mode - 1.0) * 2.0 / 3.0],
            np.float32,
        )
        *_, info = env.step(action)
        steps.append(
            STEADY._replace(
                speed_mps=0.1 + 0.45 * (float(action[0]) + 1.0) if mode == GO else 0.0,
                sensing_hz=50.0 * (float(action[1]) + 1.0),
                sin_grade=float(np.float32(np.sin(slope_rad))),
                cos_grade=math.sqrt(1.0 - float(np.float32(np.sin(slope_rad))) ** 2),
            )
        )
        expected = drive_kernel(robot, steps, SHORT_S)
        assert info["position_m"] == pytest.approx(float(expected["distance_m"]), rel=1e-9)
        # Places are kept in single precision.
        np.testing.assert_allclose(list(info["energy_j"].values()), expected["ledger_j"], rtol=1e-7)


@pytest.mark.parametrize("robot", PRESETS)
@pytest.mark.parametrize(("speed", "sensing"), [(4, 0), (4, 4), (1, 0), (2, 1)])
def test_running_empty_on_the_flat_is_the_closed_form(
    tmp_path: Path, robot: str, speed: int, sensing: int
) -> None:
    """Eq. 8: with nothing hidden a robot that never turns round gets exactly d_max far."""
    nominal = load_robot(robot)
    speed_mps = nominal.min_speed_mps + (nominal.max_speed_mps - nominal.min_speed_mps) * speed / 4
    sensing_hz = nominal.max_sensing_hz * sensing / 4
    reach_m = float(d_max(nominal, speed_mps, sensing_hz=sensing_hz))
    path = route_file(tmp_path, FLAT.format(length_m=2.0 * reach_m))
    env = HomewardEnv(mission="OutAndBack", robot=robot, difficulty="known", route=path)
    env.reset(seed=0)
    *_, last = drive(env, itertools.repeat([speed, sensing, GO], 2000))
    if last.truncated:  # at a crawl the time limit comes first
        assert speed < 4
        return
    assert last.info["stranded"]
    assert last.info["position_m"] == pytest.approx(reach_m, rel=1e-6)


def ran_empty(decision_s: float, actions: Any, **options: Any) -> float:
    env = HomewardEnv(decision_s=decision_s, action_type="discrete", shaping="none", **options)
    env.reset(seed=12)
    # weather changes from decision to decision
    mission(env)["gust_kick"] = mission(env)["warming_k"] = 0.0
    *_, last = drive(env, actions)
    assert last.info["stranded"], "the battery is to be empty before the commands are over"
    return float(mission(env)["distance_m"])


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize(
    ("mission_id", "route"), [("OutAndBack", "generated"), ("Survey", "hidden_wind")]
)
@pytest.mark.parametrize("decision_s", [500.0, 40.0])
def test_halving_the_decision_moves_the_end_by_less_than_a_thousandth(
    difficulty: str, mission_id: str, route: str, decision_s: float
) -> None:
    rng = np.random.default_rng(6)
    commands = random_actions(rng, "discrete", 300, home=0.0)
    options = {
        "mission": mission_id,
        "difficulty": difficulty,
        "route": route,
        "robot": windy(load_robot("rusti_computer")),
    }
    whole_m = ran_empty(decision_s, commands, **options)
    half_m = ran_empty(0.5 * decision_s, np.repeat(commands, 2, axis=0), **options)
    assert half_m == pytest.approx(whole_m, rel=1e-3)


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_stranding_is_latched_and_costs(mission_id: str) -> None:
    env = make(mission_id, shaping="none")
    env.reset(seed=0)
    *_, last = drive(env, itertools.repeat([4, 4, GO], 100))
    assert last.terminated and not last.truncated
    assert last.info["stranded"] and not last.info["home"] and last.info["cost"] == 1.0
    assert last.reward == 0.0 and last.info["score"] == 0.0
    assert mission(env)["energy_j"] == 0.0 == feature(last.observation, "energy")
    assert mission(env)["time_s"] < mission(env)["decisions"] * SHORT_S, (
        "it ran out inside the step"
    )


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_the_time_limit_truncates_and_is_no_end(mission_id: str) -> None:
    env = make(mission_id, robot="husky", decision_s=None)
    env.reset(seed=0)
    limit = int(env.batch.known.shared["max_decisions"][0])
    patient = itertools.cycle([[0, 0, STOP]])
    # Standing would last until the limit in any case with a battery that never empties.
    env.batch.records["energy_j"] = env.batch.records["capacity_j"] = 1e12
    steps = list(drive(env, patient))
    assert len(steps) == limit
    assert steps[-1].truncated and not steps[-1].terminated
    assert (
        not steps[-1].info["home"]
        and not steps[-1].info["stranded"]
        and steps[-1].info["cost"] == 0.0
    )
    assert not any(step.truncated for step in steps[:-1])
    assert feature(steps[-1].observation, "time") == 1.0


@pytest.mark.parametrize("robot", PRESETS)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_a_mission_is_at_most_a_few_hundred_decisions(mission_id: str, robot: str) -> None:
    env = HomewardEnv(mission=mission_id, robot=robot, difficulty="uncertain")
    env.reset(seed=0)
    assert 100 <= env.batch.known.shared["max_decisions"][0] <= 600
    half = int(0.35 * 200)
    far = list(drive(env, [[4, 1, GO]] * half))
    back = list(drive(env, [[4, 1, RETURN]] * 600))
    assert 10 <= len(far) + len(back) <= 300
    assert back[-1].terminated


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_energy_never_comes_back(action_type: str) -> None:
    """No preset regenerates: in every decision, however steep, something is drawn."""
    env = make("Survey", action_type=action_type, difficulty="harsh")
    rng = np.random.default_rng(2)
    for seed in range(5):
        env.reset(seed=seed)
        before_j = float(mission(env)["energy_j"])
        for _ in drive(env, random_actions(rng, action_type, 30)):
            energy_j = float(mission(env)["energy_j"])
            # The one decision that may cost nothing: to be home already.
            assert energy_j < before_j or mission(env)["home"]
            before_j = energy_j


CUT_OFF = dataclasses.replace(
    load_robot("turtlebot3_burger"), cutoff_v=11.0, effects={"internal_resistance": {"ohm": 0.3}}
)


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_a_mission_ends_at_the_cut_off_and_its_ledger_closes(
    mission_id: str, difficulty: str
) -> None:
    env = make(mission_id, difficulty=difficulty, robot=CUT_OFF)
    env.reset(seed=1)
    full_j = float(mission(env)["energy_j"])
    *_, before, last = drive(env, [(4, 4, GO)] * 3000)
    ledger = last.info["energy_j"]
    assert last.terminated and last.info["stranded"] and last.info["score"] == 0.0
    assert before.info["energy_j"]["below_cutoff"] == 0.0 < ledger["below_cutoff"]
    assert mission(env)["energy_j"] == 0.0
    assert abs(ledger.total() - full_j) <= 1e-9 * full_j
    true = env.batch.known.robot.record()
    if difficulty != "known":
        true = env.batch.robots
    true = true.view(np.recarray)[0]
    kept = share_below_cutoff(true, float(mission(env)["terminal_w"]))
    assert ledger["below_cutoff"] == pytest.approx(kept * full_j, rel=1e-9)
    assert ledger["below_cutoff"] > 0.1 * full_j
    # The meter shows what the robot drew, not what stays.
    assert mission(env)["read_w"] < 1.2 * mission(env)["terminal_w"]


def test_a_robot_on_the_flat_ends_where_the_range_does(tmp_path: Path) -> None:
    path = route_file(tmp_path, "distance_m,elevation_m\n0,0\n5000,0\n")
    env = make("OutAndBack", difficulty="known", robot=CUT_OFF, route=str(path))
    env.reset(seed=1)
    *_, last = drive(env, [(4, 0, GO)] * 3000)
    speed_mps = CUT_OFF.max_speed_mps
    assert last.info["position_m"] == pytest.approx(float(d_max(CUT_OFF, speed_mps)), rel=1e-4)
    kept_j = float(below_cutoff(CUT_OFF, speed_mps))
    assert last.info["energy_j"]["below_cutoff"] == pytest.approx(kept_j, rel=1e-9)


def test_a_cut_off_that_is_never_reached_changes_no_mission() -> None:
    rows = []
    for cutoff_v in (0.0, 1.0):
        robot = dataclasses.replace(CUT_OFF, cutoff_v=cutoff_v)
        env = make("Survey", difficulty="harsh", robot=robot)
        env.reset(seed=1)
        rng = np.random.default_rng(1)
        steps = list(drive(env, random_actions(rng, "discrete", 200, home=0.0)))
        rows.append([(step.reward, *step.info["energy_j"].values()) for step in steps])
    assert len(rows[0]) > 10 and rows[0] == rows[1]
