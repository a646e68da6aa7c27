"""One decision: how far it takes the robot, and a return that is final once it is meant."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest

from homeward import load_robot
from homeward.envs.features import FEATURES
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import ancillary_power, traction_force
from homeward.physics.battery import share_below_cutoff
from tests.envs.rollouts import MISSIONS, SHORT_S, feature, make, mission

WAITS = {None: 3, 20.0: 4, 50.0: 2, SHORT_S: 1}
"""Decisions in a row that a return takes, by the length of a decision."""


def away(mission_id: str, decision_s: float | None, **options: Any) -> HomewardEnv:
    """A mission with nothing hidden that is some way from home, heading out."""
    env = make(
        mission_id, **{"difficulty": "known", "shaping": "none", "decision_s": decision_s} | options
    )
    env.reset(seed=2)
    assert env.batch.known.shared["return_decisions"][0] == WAITS[decision_s]
    # of the four to the far post
    decisions = 2 if mission_id == "Patrol" or decision_s == SHORT_S else 8
    for _ in range(decisions):
        env.step([4, 1, GO])
    assert mission(env)["position_m"] > 0.0
    return env


@pytest.mark.parametrize("decision_s", WAITS)
@pytest.mark.parametrize("mission_id", MISSIONS)
class TestReturn:
    def test_it_is_final_once_it_was_asked_for_often_enough_in_a_row(
        self, mission_id: str, decision_s: float | None
    ) -> None:
        env, waits = away(mission_id, decision_s), WAITS[decision_s]
        for asked in range(1, waits + 1):
            before_m = float(mission(env)["position_m"])
            observation, _, terminated, _, info = env.step([1, 0, RETURN])
            assert mission(env)["returning"] == (asked == waits) and mission(env)["asked"] == asked
            assert feature(observation, "returning") == pytest.approx(asked / waits)
            assert terminated or info["position_m"] < before_m, "it heads home at once"
        latched = [float(mission(env)["position_m"])]
        for mode in (GO, STOP, GO, RETURN):
            if mission(env)["over"]:
                break
            observation, *_ = env.step([0, 0, mode])
            latched.append(float(mission(env)["position_m"]))
            assert mission(env)["returning"] and feature(observation, "returning") == 1.0
            assert feature(observation, "outbound") == -1.0
            assert (latched[-1] < latched[-2]) == (mode != STOP)

    @pytest.mark.parametrize("other", [STOP, GO])
    def test_anything_else_takes_it_back(
        self, mission_id: str, decision_s: float | None, other: int
    ) -> None:
        env, waits = away(mission_id, decision_s), WAITS[decision_s]
        for _ in range(4):
            for _ in range(waits - 1):
                env.step([0, 0, RETURN])
            observation, *_ = env.step([0, 0, other])
            assert feature(observation, "returning") == 0.0 == mission(env)["asked"]
        assert not mission(env)["returning"]
        before_m = float(mission(env)["position_m"])
        assert feature(observation, "outbound") == mission(env)["direction"]
        env.step([0, 0, GO])
        moved_m = float(mission(env)["position_m"]) - before_m
        assert decision_s == SHORT_S or moved_m * feature(observation, "outbound") > 0.0

    def test_home_is_an_end_only_once_it_is_final(
        self, mission_id: str, decision_s: float | None
    ) -> None:
        """Until then the robot waits there, which takes time and energy."""
        env, waits = away(mission_id, decision_s), WAITS[decision_s]
        for turn in range(10 * waits if waits > 1 else 0):
            mode = STOP if turn % waits == waits - 1 else RETURN
            _, _, terminated, _, info = env.step([4, 0, mode])
            assert not terminated and not info["home"]
        assert waits == 1 or mission(env)["position_m"] == 0.0
        before_j, legs = float(mission(env)["energy_j"]), float(mission(env)["legs"])
        for asked in range(1, 60):
            _, reward, terminated, _, info = env.step([4, 0, RETURN])
            assert (
                terminated
                == info["home"]
                == (mission(env)["returning"] and info["position_m"] == 0.0)
            )
            assert asked >= waits or not terminated
            if terminated:
                break
        assert terminated and (waits == 1 or asked == waits)
        assert (waits == 1) or (
            mission(env)["energy_j"] < before_j and mission(env)["legs"] == legs
        )
        assert reward == pytest.approx(
            info["score"] / float(env.batch.known.shared["score_scale"][0])
        )


@pytest.mark.parametrize("decision_s", [None, 7.0, 50.0])
@pytest.mark.parametrize("robot", ["rusti_computer", "rusti"])
def test_turning_in_and_out_gains_no_leg(decision_s: float | None, robot: str) -> None:
    """Legs count at the posts in turns, with a whole way and a pit stop between them, whatever is
    asked for."""
    for route, seed in itertools.product(("generated", "incline"), range(3)):
        env = make("Patrol", robot=robot, route=route, decision_s=decision_s, difficulty="known")
        env.reset(seed=seed)
        shared, rng = env.batch.known.shared[0], np.random.default_rng(seed)
        length_m, pit_stop_s = float(shared["length_m"]), float(shared["pit_stop_s"])
        asks = rng.uniform(0.1, 0.6)
        for _ in range(300):
            mode = int(rng.choice([STOP, GO, RETURN], p=[0.1, 0.9 - asks, asks]))
            before = float(mission(env)["legs"])
            *_, terminated, truncated, info = env.step([rng.integers(1, 5), 0, mode])
            m = mission(env)
            legs = float(m["legs"])
            assert legs >= before and info["score"] in (0.5 * legs, 0.0)
            assert legs * length_m <= m["distance_m"] + 1e-6
            assert legs * length_m / float(shared["max_speed_mps"]) + max(legs - 1.0, 0.0) * pit_stop_s <= m[
                "time_s"] + 1e-6  # fmt: skip
            # From home it goes out, and back from the far post, also after it has turned.
            if not m["returning"]:
                assert m["direction"] == (1.0 if legs % 2.0 == 0.0 else -1.0)
            if terminated or truncated:
                break


@pytest.mark.parametrize("mission_id", ["OutAndBack", "Survey"])
def test_turning_in_and_out_adds_nothing(mission_id: str) -> None:
    """The same ground driven out at the same speed scores the same, with detours towards home in
    between, and for more energy; as long as nothing is lost for want of memory, which a detour may
    empty."""
    envs = [make(mission_id, difficulty="known", decision_s=None) for _ in range(2)]
    for env in envs:
        env.reset(seed=4)
    straight, winding = envs
    rng = np.random.default_rng(4)
    for leg in range(12):
        speed, sensing = 4 if leg < 3 else int(rng.integers(1, 5)), int(rng.integers(0, 2))
        straight.step([speed, sensing, GO])
        winding.step([speed, sensing, GO])
        if leg >= 3 and rng.random() < 0.6:  # there and back at the same speed, short of home
            detour = int(rng.integers(0, 5))
            for mode in (RETURN, RETURN, GO, GO):
                winding.step([detour, int(rng.integers(0, 5)), mode])
    assert mission(winding)["furthest_m"] == pytest.approx(mission(straight)["furthest_m"])
    assert mission(winding)["score"] == pytest.approx(mission(straight)["score"], rel=1e-9)
    assert mission(winding)["lost"] == mission(straight)["lost"] == 0.0
    assert mission(winding)["energy_j"] < mission(straight)["energy_j"]


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_a_policy_that_acts_at_random_does_not_end_at_once(
    mission_id: str, action_type: str
) -> None:
    """A third of its decisions ask for a return; three in a row come after 39 on average."""
    count = 300
    envs = HomewardVectorEnv(
        count, mission=mission_id, action_type=action_type, autoreset_mode="Disabled"
    )
    envs.reset(seed=0)
    envs.action_space.seed(1)
    batch, rewards = envs.batch, np.zeros(count)
    observations = np.zeros((count, len(FEATURES)), np.float32)
    flags = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    lasted = np.zeros(count)
    for _ in range(400):
        lasted += ~batch.records["over"]
        batch.step(envs.action_space.sample(), observations, rewards, *flags)
    assert batch.records["over"].all()
    assert (lasted <= 3).mean() == pytest.approx(1.0 / 27.0, abs=0.05)
    assert np.median(lasted) > 20 and 30 < lasted.mean() < 60


def test_the_way_home_is_predicted_with_the_voltage_at_the_charge_as_read() -> None:
    """The battery is emptier than it is read: the robot's own model must not know, and the robot
    consumes more."""
    robot = dataclasses.replace(
        load_robot("turtlebot3_burger"), effects={"internal_resistance": {"ohm": 0.5}}, chemistry="flat",
        cells_in_series=0, open_circuit_v=((0.0, 9.0), (1.0, 12.6)),
    )  # fmt: skip
    ways = []
    for left in (1.0, 0.3):
        env = HomewardEnv(mission="OutAndBack", robot=robot, difficulty="uncertain")
        env.reset(seed=0)
        mission(env)["energy_j"] *= left
        place_m = float(env.batch.known.shared["place_m"][0])
        env.step([4, 0, GO])
        while mission(env)["place"] == 0:
            mission(env)["soc"] = 1.0
            env.step([4, 0, GO])
        place = env.batch.routes[0]["places"][1]
        ways.append((float(place["home_j_per_m"]), float(place["true_home_j_per_m"]), place_m))
    assert ways[0][0] == ways[1][0]
    assert ways[1][1] > 1.002 * ways[0][1]


def test_the_way_home_needs_what_stays_below_the_cut_off() -> None:
    """At every place as much as its load needs, and at the start of it what the places before it
    need and consume."""
    costs = {}
    for cutoff_v in (0.0, 11.0):
        robot = dataclasses.replace(
            load_robot("turtlebot3_burger"),
            cutoff_v=cutoff_v,
            effects={"internal_resistance": {"ohm": 0.3}},
        )
        env = HomewardEnv(mission="OutAndBack", robot=robot, difficulty="known", route="generated")
        env.reset(seed=3)
        while mission(env)["place"] < 5:
            env.step([4, 0, GO])
        costs[cutoff_v] = env.batch.routes[0]["places"][:6].copy()
        place_m = float(env.batch.known.shared["place_m"][0])
    full_j = robot.usable_energy_j
    true = robot.record().view(np.recarray)[0]
    needed_j = 0.0
    for place in costs[11.0]:
        sine = -float(place["sin_grade"])
        watts_per_n = robot.max_speed_mps / robot.traction_efficiency
        force_n = traction_force(robot, robot.max_speed_mps, np.arcsin(sine))
        load_w = float(ancillary_power(robot, 0.0) + max(float(force_n), 0.0) * watts_per_n)
        needed_j = max(needed_j, full_j * share_below_cutoff(true, load_w))
        assert float(place["home_cost_j"]) == pytest.approx(needed_j, rel=1e-5)
        assert float(place["true_home_cost_j"]) == pytest.approx(needed_j, rel=1e-5)
        needed_j += float(place["home_j_per_m"]) * place_m
    extra_j = costs[11.0]["home_cost_j"] - costs[0.0]["home_cost_j"]
    assert (extra_j > 0.1 * full_j).all()
