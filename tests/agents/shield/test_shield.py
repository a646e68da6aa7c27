"""The shield brings home whom it guards, however reckless, and lets careful ones be."""

import numpy as np
import pytest

from homeward.agents import Policy, make_policy
from homeward.agents.evaluation import Run, episode_seeds, run_episodes
from homeward.agents.shield import Shield
from homeward.agents.shield.reckless import Onward, Wanderer
from homeward.envs.actions import decode_actions, encode_actions
from homeward.envs.options import MISSIONS, Options, known_of
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv


def shielded(policy: Policy, options: Options, count: int) -> Run:
    return run_episodes(Shield(policy, known_of(options)), options, episode_seeds(2, count))


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("mission", MISSIONS)
def test_who_wanders_for_ever_comes_home(mission: str, action_type: str) -> None:
    options = Options(mission, action_type=action_type)
    bare = run_episodes(Wanderer(known_of(options), np.random.default_rng(0)), options, episode_seeds(2, 64)).episodes
    safe = shielded(Wanderer(known_of(options), np.random.default_rng(0)), options, 64).episodes
    assert not bare.home.any()
    assert safe.home.all()
    assert (safe.score > 0.0).all()


@pytest.mark.parametrize("route", ["generated", "hidden_wind"])
def test_who_never_turns_is_turned_in_time(route: str) -> None:
    options = Options("OutAndBack", route=route)
    safe = shielded(Onward(known_of(options)), options, 200).episodes
    assert safe.home.all()
    assert np.median(safe.furthest_m) > 0.5 * known_of(options).shared["length_m"][0]


def test_a_careful_rule_is_left_alone_where_all_is_known() -> None:
    options = Options("Survey", difficulty="known")
    env = HomewardVectorEnv(**vars(options))
    bare = run_episodes(make_policy("dmax_mapped", env), options, episode_seeds(2, 64)).episodes
    safe = shielded(make_policy("dmax_mapped", env), options, 64).episodes
    assert bare.home.all()
    np.testing.assert_array_equal(safe.score, bare.score)
    np.testing.assert_array_equal(safe.energy_left_j, bare.energy_left_j)


def test_it_turns_back_late() -> None:
    """Once it knows the day, hardly more than the reserve is left in the battery."""
    options = Options("OutAndBack")
    safe = shielded(Onward(known_of(options)), options, 200).episodes
    left = safe.energy_left_j / known_of(options).robot.usable_energy_j
    assert np.median(left) < 0.03
    assert np.percentile(left, 90.0) < 0.04


def test_it_probes_on_the_way_out_unless_nothing_is_hidden() -> None:
    for difficulty, expected in (("known", {4}), ("uncertain", {2, 4})):
        options = Options("OutAndBack", difficulty=difficulty)
        policy = Shield(Onward(known_of(options)), known_of(options))
        env = HomewardVectorEnv(2, autoreset_mode="Disabled", **vars(options))
        observations, _ = env.reset(seed=0)
        begun, speeds = np.ones(2, np.bool_), set()
        for _ in range(12):
            actions = policy.act(observations, begun)
            begun = np.zeros(2, np.bool_)
            speeds |= set(actions[:, 0].tolist())
            observations, *_ = env.step(actions)
        assert speeds == expected


def test_a_biased_gauge_is_reckoned_with() -> None:
    options = Options("OutAndBack", difficulty="harsh")
    safe = shielded(Onward(known_of(options)), options, 200).episodes
    assert safe.stranded.sum() <= 1
    assert safe.home.sum() >= 199


@pytest.mark.parametrize("mission", MISSIONS)
def test_batches_equal_singles_and_nothing_is_left_of_missions_before(mission: str) -> None:
    options, seeds = Options(mission), episode_seeds(4, 5)
    policy = Shield(Onward(known_of(options)), known_of(options))
    together = run_episodes(policy, options, seeds).episodes
    for index, seed in enumerate(seeds):
        alone = run_episodes(policy, options, [seed]).episodes
        assert alone.energy_left_j[0] == together.energy_left_j[index]


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_actions_are_decoded_as_the_environment_takes_them(action_type: str) -> None:
    known = known_of(Options("Survey", action_type=action_type))
    for mode in (STOP, GO, RETURN):
        commands = decode_actions(known, encode_actions(known, [0.1, 0.55, 1.0], [0.0, 50.0, 100.0], mode))
        assert commands.sensing_hz == pytest.approx([0.0, 50.0, 100.0], abs=1e-5)
        assert commands.speed_mps == pytest.approx([0.0] * 3 if mode == STOP else [0.1, 0.55, 1.0], abs=1e-6)
        assert commands.homeward.tolist() == [mode == RETURN] * 3


def test_a_confidence_that_nothing_was_tuned_for_is_refused() -> None:
    options = Options("Survey")
    with pytest.raises(ValueError, match=r"confidence = 0.5 is not allowed; choose from 0.999"):
        Shield(Onward(known_of(options)), known_of(options), confidence=0.5)


def test_numbers_far_from_what_is_usual_are_not_believed() -> None:
    """Down a slope with the wind on its back a robot rolls by itself; what it then finds out need not be what it is."""
    options = Options("OutAndBack", route="hidden_wind")
    policy = Shield(Wanderer(known_of(options), np.random.default_rng(0)), known_of(options))
    safe = run_episodes(policy, options, episode_seeds(0, 512)).episodes
    assert not safe.stranded.any()
