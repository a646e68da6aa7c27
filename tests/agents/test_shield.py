"""The shield brings home whom it guards, however reckless, and lets careful ones be."""

import numpy as np
import pytest

from benchmarks.shield import Onward, Wanderer
from homeward.agents import Policy, make_policy, shield_belief
from homeward.agents.evaluation import Run, episode_seeds, run_episodes
from homeward.agents.shield import MARGINS, Shield, decode_actions
from homeward.agents.shield_belief import Days, imagine
from homeward.envs.actions import encode_actions
from homeward.envs.options import MISSIONS, Options, Setting, settle
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv


def shielded(policy: Policy, options: Options, count: int) -> Run:
    return run_episodes(Shield(policy, options, settle(options)), options, episode_seeds(2, count))


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("mission", MISSIONS)
def test_who_wanders_for_ever_comes_home(mission: str, action_type: str) -> None:
    options = Options(mission, action_type=action_type)
    bare = run_episodes(Wanderer(settle(options), np.random.default_rng(0)), options, episode_seeds(2, 64)).episodes
    safe = shielded(Wanderer(settle(options), np.random.default_rng(0)), options, 64).episodes
    assert not bare.home.any()
    assert safe.home.all()
    assert (safe.score > 0.0).all()


@pytest.mark.parametrize("route", ["generated", "hidden_wind"])
def test_who_never_turns_is_turned_in_time(route: str) -> None:
    options = Options("OutAndBack", route=route)
    safe = shielded(Onward(settle(options)), options, 200).episodes
    assert safe.stranded.sum() <= 1
    assert np.median(safe.furthest_m) > 0.3 * settle(options).shared["length_m"][0]


def test_a_careful_rule_is_left_alone_where_all_is_known() -> None:
    options = Options("Survey", difficulty="known")
    env = HomewardVectorEnv(**vars(options))
    bare = run_episodes(make_policy("dmax_mapped", env), options, episode_seeds(2, 64)).episodes
    safe = shielded(make_policy("dmax_mapped", env), options, 64).episodes
    assert bare.home.all()
    np.testing.assert_array_equal(safe.score, bare.score)
    np.testing.assert_array_equal(safe.energy_left_j, bare.energy_left_j)


def test_the_way_home_is_costed_as_it_turns_out_once_the_day_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Given the true days, and only those that fit best, nothing but the margin is left in the battery."""
    options, seeds = Options("OutAndBack"), episode_seeds(3, 64)
    setting = settle(options)

    def true_days(options: Options, setting: Setting) -> Days:
        env = HomewardVectorEnv(len(seeds), **vars(options))
        env.reset(seed=seeds)
        robots, records, nominal = env.batch.robots, env.batch.records, setting.robot
        places = env.batch.routes["places"][:, : setting.shared["places"][0]]
        heading_rad = np.arctan2(places["north"], places["east"])
        wind_mps = records["wind_mps"][:, None] * np.cos(records["wind_from_rad"][:, None] - heading_rad)
        health = records["capacity_j"] / nominal.usable_energy_j
        mass = 1.0 + robots["payload_mass_kg"] / nominal.mass_kg
        return Days(health, health, mass, (0.8, 1.3), np.ones(places.shape, np.float32), wind_mps.astype(np.float32))

    monkeypatch.setattr(shield_belief, "imagine", true_days)
    monkeypatch.setattr(shield_belief, "NEAREST", 1)
    monkeypatch.setattr(shield_belief, "TOLERANCE", 0.0)
    monkeypatch.setitem(MARGINS, 0.999, 0.02)
    run = run_episodes(Shield(Onward(setting), options, setting), options, seeds).episodes
    left = run.energy_left_j[run.home] / setting.robot.usable_energy_j
    assert run.home.mean() > 0.95  # now and then another of the days explains a drive as well
    assert np.median(left) < 0.03
    assert np.percentile(left, 95.0) < 0.05


def test_imagined_days_are_spread_as_the_environment_draws_them() -> None:
    options = Options("Survey")
    days = imagine(options, settle(options))
    usual = slice(0, shield_belief.DAYS)
    assert days.capacity[usual].mean() == pytest.approx(0.9, abs=0.01)
    assert days.mass[usual].mean() == pytest.approx(1.1, abs=0.01)
    assert days.rolling == pytest.approx((0.8, 1.3), abs=0.01)
    assert days.headwind_mps[usual].std() == pytest.approx(1.5, rel=0.1)  # Rayleigh 1.5 from any direction
    assert days.headwind_mps[shield_belief.DAYS :].mean() < -2.0
    assert (days.ground == 1.0).all()


def test_a_harsh_day_has_rough_ground_and_a_biased_gauge() -> None:
    options = Options("Survey", difficulty="harsh")
    days = imagine(options, settle(options))
    assert days.ground.max() > 1.3
    assert (days.gauge / days.capacity).min() == pytest.approx(1.0 / 1.15, abs=0.01)
    assert (days.gauge / days.capacity).max() == pytest.approx(1.0 / 0.85, abs=0.01)


@pytest.mark.parametrize("mission", MISSIONS)
def test_batches_equal_singles_and_nothing_is_left_of_missions_before(mission: str) -> None:
    options, seeds = Options(mission), episode_seeds(4, 5)
    policy = Shield(Onward(settle(options)), options, settle(options))
    together = run_episodes(policy, options, seeds).episodes
    for index, seed in enumerate(seeds):
        alone = run_episodes(policy, options, [seed]).episodes
        assert alone.energy_left_j[0] == together.energy_left_j[index]


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_actions_are_decoded_as_the_environment_takes_them(action_type: str) -> None:
    setting = settle(Options("Survey", action_type=action_type))
    for mode in (STOP, GO, RETURN):
        commands = decode_actions(setting, encode_actions(setting, [0.1, 0.55, 1.0], [0.0, 50.0, 100.0], mode))
        assert commands.sensing_hz == pytest.approx([0.0, 50.0, 100.0], abs=1e-5)
        assert commands.speed_mps == pytest.approx([0.0] * 3 if mode == STOP else [0.1, 0.55, 1.0], abs=1e-6)
        assert commands.homeward.tolist() == [mode == RETURN] * 3


def test_a_confidence_without_a_margin_is_refused() -> None:
    options = Options("Survey")
    with pytest.raises(ValueError, match=r"confidence = 0.5 is not allowed; choose from 0.999"):
        Shield(Onward(settle(options)), options, settle(options), confidence=0.5)
