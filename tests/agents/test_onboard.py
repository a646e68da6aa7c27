"""On a robot a policy decides what it decides in the environment on the same readings."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from homeward.agents import AgentError
from homeward.agents.onboard import Onboard, load_onboard
from homeward.agents.registry import shipped
from homeward.agents.trained.policy_file import PolicyFileError, load_policy
from homeward.companion import Advice, Companion, CompanionError
from homeward.envs import IDS
from homeward.envs.actions import MODES, decode_actions
from homeward.envs.routes import Route
from homeward.estimation.prior import EAST
from homeward.physics import load_robot
from tests.companion.robots import Driven
from tests.envs.conditions.reading import SEED, ReadRobot


def compare(mission: str, start: str, seed: int = SEED) -> tuple[list[str], int, float]:
    """Drive a mission by a policy in the environment, and ask the same on board what it would do.

    Returns:
        Modes that were asked for, how many decisions differed, and the largest difference of a
        feature.
    """
    robot = ReadRobot(mission, seed)
    known = robot.env.batch.known
    inside, outside = (load_policy(shipped(mission, start), known) for _ in range(2))
    onboard = Onboard(outside, known, *robot.prior_knowledge())
    companion = Companion(known.robot, policy=onboard)
    over, modes, differ, worst = False, list[str](), 0, 0.0
    for seen in robot.seen_ahead():
        onboard.see(*seen)
    while not over:
        advice = companion.update(robot.time_s, **robot.reads())
        worst = max(worst, float(np.abs(onboard._observations[-1][0] - robot.observation).max()))
        action = inside.act(robot.observation[None], np.array([not modes]))
        asked = decode_actions(known, action)
        mode = MODES[asked.mode[0]]
        if robot.env.batch.records["returning"][0] and mode == "go":
            mode = "return"  # all the same to the environment
        differ += advice.action != (asked.driven_mps[0], asked.sensing_hz[0], mode)
        modes.append(mode)
        over = robot.drive(action[0])
        for seen in robot.seen_ahead():
            onboard.see(*seen)
    if robot.env.batch.records["home"][0]:
        assert companion.update(robot.time_s, **robot.reads()).action is None  # the mission is over
    return modes, differ, worst


@pytest.mark.parametrize("start", ["dmax", "scratch"])
@pytest.mark.parametrize("mission", IDS)
def test_decisions_are_those_in_the_environment(mission: str, start: str) -> None:
    modes, differ, worst = compare(mission, start)
    assert differ == 0 and worst < 2e-7  # single precision
    assert len(modes) > 50 and {"go", "return"} <= set(modes)


class Obedient(Driven):
    """Drives on a plane as it is asked, in steps of `every_s`."""

    def __init__(self, soc: float = 1.0, **keywords: Any) -> None:
        super().__init__(load_robot("rusti_computer"), **keywords)
        self.companion = Companion(self.robot, policy=load_onboard("ppo", "OutAndBack"))
        self.used_j = (1.0 - soc) * self.full_j
        self.advice = self.update(0.0)

    def update(self, speed_mps: float) -> Advice:
        power_w = self.power_w(speed_mps)
        self.advice = self.companion.update(
            self.time_s,
            position=float(self.xy[0]),
            speed_mps=speed_mps,
            soc=self.left_j / self.full_j,
            power_w=power_w,
        )
        return self.advice

    def step(self, share: float = 1.0) -> None:
        """Drive on at a share of the speed that is asked."""
        action = self.advice.action
        assert action is not None
        speed_mps = share * action.speed_mps
        if action.mode == "return":
            speed_mps = -min(speed_mps, float(self.xy[0]) / self.every_s)
        self.time_s += self.every_s
        self.used_j += self.power_w(abs(speed_mps)) * self.every_s
        self.xy[0] += speed_mps * self.every_s
        self.update(abs(speed_mps))


@pytest.mark.parametrize(
    ("every_s", "share", "soc"), [(3.0, 1.0, 1.0), (7.0, 0.8, 1.0), (30.0, 1.0, 0.6)]
)
def test_it_comes_home_at_any_rate_of_readings_slower_than_told_and_with_half_a_battery(
    every_s: float, share: float, soc: float
) -> None:
    robot, furthest_m = Obedient(soc, every_s=every_s, rolling=1.1, health=0.9), 0.0
    while robot.advice.action is not None and robot.left_j > 0.0:
        robot.step(share)
        furthest_m = max(furthest_m, float(robot.xy[0]))
    left = robot.left_j / robot.full_j
    assert robot.advice.action is None and robot.xy[0] < 1.0
    assert furthest_m > 2000.0 * soc and 0.005 < left < 0.1


def test_a_robot_that_is_held_up_is_not_taken_to_have_driven() -> None:
    robot = Obedient(every_s=5.0)
    for _ in range(60):
        robot.step()
    before = robot.companion._policy._observer._records.copy()  # type: ignore[union-attr]
    for _ in range(60):  # five minutes
        robot.time_s += 5.0
        robot.used_j += robot.power_w(0.0) * 5.0
        robot.update(0.0)
    m, idle_j = robot.companion._policy._observer._records[0], robot.power_w(0.0) * 300.0  # type: ignore[union-attr]
    assert m["position_m"] == before["position_m"][0] == 300.0
    assert m["modelled_j"] - before["modelled_j"][0] == pytest.approx(idle_j, rel=0.01)
    assert m["decisions"] - before["decisions"][0] == 10


def test_a_gap_counts_as_the_decisions_that_passed() -> None:
    whole, gap = (load_onboard("ppo", "OutAndBack") for _ in range(2))

    def readings(second: float) -> dict[str, float]:
        return {"soc": round(1.0 - 1.8e-4 * second, 3), "power_w": 10.0, "speed_mps": 1.0}

    for second in np.arange(0.0, 1501.0, 30.0):
        expected = whole.update(second, second, **readings(second))
        if not 600.0 < second < 900.0:
            action = gap.update(second, second, **readings(second))
    assert action == expected and len(gap._observations) == len(whole._observations)
    np.testing.assert_allclose(gap._observations[-1], whole._observations[-1], atol=2e-3)
    late = gap.update(1e9, 1500.0)  # the mission's time is over
    assert late is None and len(gap._observations) < 500


def test_a_restart_goes_on_as_if_nothing_had_been() -> None:
    robot = Obedient(every_s=10.0, rolling=1.2)
    for _ in range(100):
        robot.step()
    other = Companion(robot.robot, policy=load_onboard("ppo", "OutAndBack"))
    other.restore(json.loads(json.dumps(robot.companion.state())))
    for _ in range(100):
        reads = {
            "soc": robot.left_j / robot.full_j,
            "power_w": robot.power_w(1.0),
            "speed_mps": 1.0,
        }
        again = other.update(robot.time_s, position=float(robot.xy[0]), **reads)
        assert again.action == robot.advice.action
        robot.step()
    other.update(robot.time_s, position=float(robot.xy[0]), **reads)
    ours, theirs = (two._policy._observations[-1] for two in (robot.companion, other))  # type: ignore[union-attr]
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
    with pytest.raises(CompanionError, match="state cannot be used"):
        other.restore(robot.companion.state() | {"policy": {}})


def test_without_a_forecast_any_wind_is_possible() -> None:
    calm, unknown = (
        load_onboard("ppo", "OutAndBack", forecast_mps=forecast) for forecast in ((0.0, 0.0), None)
    )
    for onboard in (calm, unknown):
        onboard.update(0.0, 0.0)
    beliefs: list[Any] = [one._beliefs for one in (calm, unknown)]
    of_calm, of_unknown = (one._belief.estimate().covariance[0] for one in beliefs)
    assert of_unknown[EAST, EAST] > 1.5 * of_calm[EAST, EAST]
    np.testing.assert_array_equal(calm._observations[-1], unknown._observations[-1])


def test_another_battery_begins_another_mission() -> None:
    robot = Obedient(every_s=30.0)
    for _ in range(20):
        robot.step()
    robot.companion.swap_battery()
    robot.used_j = 0.0
    robot.step()
    observer = robot.companion._policy._observer  # type: ignore[union-attr]
    assert (
        observer._records["decisions"][0] == 0 and observer._records["position_m"][0] == robot.xy[0]
    )
    assert observer._records["mapped"][0] > 1  # the way home is known


def test_what_cannot_be_used_takes_one_line() -> None:
    onboard = load_onboard("ppo", "OutAndBack")
    with pytest.raises(
        CompanionError, match="the policy is for robot 'rusti_computer', whose parameters differ"
    ):
        Companion("husky", policy=onboard)
    with pytest.raises(AgentError, match="mission = None is not allowed; choose from OutAndBack"):
        load_onboard("ppo")
    with pytest.raises(PolicyFileError, match="cannot read nothing"):
        load_onboard("nothing", "OutAndBack")
    nothing = np.zeros(3)
    with pytest.raises(ValueError, match=r"the forecast has 3 places of 50 m; give 32 of"):
        Onboard(onboard._policy, onboard.known, Route(50.0, nothing, nothing, nothing, nothing))
