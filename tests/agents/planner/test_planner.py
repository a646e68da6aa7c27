"""The planner turns back by what it identifies, senses where it pays, counts laps, and finds more than the rule."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from homeward.agents import make_policy
from homeward.agents.base import Observations
from homeward.agents.evaluation import run_episodes
from homeward.agents.planner import Planner
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.pace import NO_SENSING
from homeward.envs.features import INDEX, NAMES
from homeward.envs.options import MISSIONS, Options, known_of
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv


def observed(**features: float) -> Observations:
    """One observation of a survey on its way out over even ground of average interest."""
    row = np.zeros((1, len(NAMES)), np.float32)
    seen = {"energy": 0.8, "outbound": 1.0, "distance": 0.2, "home_cost": 0.12, "interest": 0.6, "interest_near": 0.6}
    for name, value in (seen | features).items():
        row[0, INDEX[name]] = value
    return row


def command(**features: float) -> NDArray[Any]:
    """Action of a fresh planner."""
    planner = Planner(known_of(Options("Survey")), 2.0)
    return np.asarray(planner.act(observed(**features), np.ones(1, np.bool_))[0])


def test_it_senses_where_it_pays() -> None:
    rates = [command(interest=interest, interest_near=interest)[1] for interest in (0.0, 0.15, 0.6, 2.0)]
    assert rates[0] == 0
    assert rates == sorted(rates)
    assert rates[-1] >= 3


def test_it_senses_less_the_fuller_the_memory_and_stops_before_it_is_full() -> None:
    filling = [command(backlog=backlog, distance=0.6, home_cost=0.4, energy=0.95) for backlog in (0.0, 0.5, 0.9)]
    assert [mode for *_, mode in filling] == [GO, GO, GO]
    rates = [rate for _, rate, _ in filling]
    assert rates[0] > rates[1] > rates[2] > 0
    full = command(backlog=0.95, distance=0.6, home_cost=0.4, energy=0.95)
    assert (full[1], full[2]) == (0, STOP)


def test_it_stops_for_the_radio_near_home_if_the_memory_will_be_short() -> None:
    assert command(distance=0.02, home_cost=0.01, energy=0.95, backlog=0.3)[2] == STOP
    assert command(distance=0.02, home_cost=0.01, energy=0.95, backlog=0.0)[2] == GO
    assert command(distance=0.6, home_cost=0.4, energy=0.95, backlog=0.3)[2] == GO


def test_it_turns_back_with_the_energy_for_the_way_home_and_senses_no_more() -> None:
    assert command(energy=0.8, home_cost=0.3)[2] == GO
    speed, rate, mode = command(energy=0.35, home_cost=0.3)
    assert (speed, rate, mode) == (4, 0, RETURN)


@pytest.mark.parametrize("robot", ["rusti_computer", "husky"])
def test_on_patrol_it_ends_with_less_than_a_lap_to_spare(robot: str) -> None:
    options = Options("Patrol", robot=robot)
    episodes = run_episodes(Planner(known_of(options), 1.75), options, range(64)).episodes
    assert episodes.home.all()
    full_j = known_of(options).shared["usable_j"][0]
    a_lap_j = full_j / episodes.score.min()
    assert (episodes.energy_left_j < 1.1 * a_lap_j).all()
    rule = run_episodes(AdaptiveDmaxRule(known_of(options), NO_SENSING, 0.0), options, range(64)).episodes
    assert (episodes.score >= rule.score).all()
    assert episodes.score.sum() > rule.score.sum()


def test_on_patrol_the_last_lap_has_no_pit_stop_at_the_far_post() -> None:
    options = Options("Patrol")
    planner, env = Planner(known_of(options), 2.0), HomewardVectorEnv(1, autoreset_mode="Disabled", **vars(options))
    observations, _ = env.reset(seed=0)
    action, begun = planner.act(observations, np.ones(1, np.bool_)), np.zeros(1, np.bool_)
    while action[0, 2] != RETURN:
        observations, *_ = env.step(action)
        action = planner.act(observations, begun)
    distance_m = observations[0, INDEX["distance"]] * known_of(options).shared["reach_m"][0]
    assert distance_m == pytest.approx(known_of(options).shared["length_m"][0])
    assert observations[0, INDEX["pit_stop"]] > 0.0


def test_a_patrol_that_passes_its_posts_unseen_still_comes_home() -> None:
    options = Options("Patrol", decision_s=90.0)
    episodes = run_episodes(Planner(known_of(options), 2.0), options, range(16)).episodes
    assert episodes.home.all()


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("difficulty", ["known", "harsh"])
def test_its_actions_are_allowed_and_bring_nearly_all_robots_home(
    mission: str, action_type: str, difficulty: str
) -> None:
    options = Options(mission, action_type=action_type, difficulty=difficulty)
    env = HomewardVectorEnv(**vars(options))
    episodes = run_episodes(make_policy("planner", env), options, range(100)).episodes
    assert episodes.home.mean() >= (1.0 if difficulty == "known" else 0.95)
    assert (episodes.score[episodes.home] > 0.0).all()


@pytest.mark.parametrize("mission", MISSIONS)
def test_a_mission_is_planned_alike_alone_and_among_others(mission: str) -> None:
    options = Options(mission)
    env = HomewardVectorEnv(**vars(options))
    together = run_episodes(make_policy("planner", env), options, range(5)).episodes.score
    alone = [run_episodes(make_policy("planner", env), options, [seed]).episodes.score[0] for seed in range(5)]
    np.testing.assert_array_equal(together, alone)


def test_it_finds_more_than_the_rule_that_it_turns_with() -> None:
    """On the same missions; with training seeds, as on those of evaluations it is measured and not tested."""
    options = Options("Survey")
    env = HomewardVectorEnv(**vars(options))
    planner, rule = (
        run_episodes(make_policy(name, env), options, range(96)).episodes for name in ("planner", "dmax_adaptive")
    )
    gain = stats.ttest_rel(planner.score, rule.score).confidence_interval(0.95)
    assert gain.low > 0.05 * rule.score.mean()
    assert planner.stranded.sum() <= rule.stranded.sum()
