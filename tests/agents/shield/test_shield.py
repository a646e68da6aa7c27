"""The shield brings home whom it guards, however reckless, and lets careful ones be."""

from collections.abc import Iterator
from typing import Any, final

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.agents import Policy, make_policy
from homeward.agents.base import Observations
from homeward.agents.evaluation import Run, episode_seeds, run_episodes
from homeward.agents.shield import Shield
from homeward.agents.shield.reckless import Onward, Wanderer
from homeward.envs.actions import decode_actions, encode_actions
from homeward.envs.features import INDEX
from homeward.envs.missions import MISSIONS
from homeward.envs.options import Known, Options, known_of
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from tests.agents.rules.shown import RULES


def shielded(policy: Policy, options: Options, count: int) -> Run:
    return run_episodes(Shield(policy, known_of(options)), options, episode_seeds(2, count))


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("mission", MISSIONS)
def test_who_wanders_for_ever_comes_home(mission: str, action_type: str) -> None:
    options = Options(mission, action_type=action_type)
    bare = run_episodes(
        Wanderer(known_of(options), np.random.default_rng(0)), options, episode_seeds(2, 64)
    ).episodes
    safe = shielded(Wanderer(known_of(options), np.random.default_rng(0)), options, 64).episodes
    assert not bare.home.any()
    assert safe.home.all()
    assert (safe.score > 0.0).all()


@final
class Careless(Policy):
    """Drives out at cruise and, from half of the charge on, home at another speed."""

    def __init__(self, known: Known, home_mps: float, sensing_hz: float) -> None:
        self._known, self._home_mps, self._sensing_hz = known, home_mps, sensing_hz

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        returns = observations[:, INDEX["energy"]] < 0.5
        speed_mps = np.where(returns, self._home_mps, self._known.shared["cruise_mps"][0])
        return encode_actions(
            self._known, speed_mps, self._sensing_hz, np.where(returns, RETURN, GO)
        )


@pytest.mark.parametrize(
    ("robot", "home_at", "sensing_hz", "difficulty"),
    [
        ("rusti_computer", "max", 100.0, "known"),
        ("rusti_computer", "max", 100.0, "uncertain"),
        ("rusti_computer", "min", 0.0, "known"),  # which takes too long
        ("husky", "min", 0.0, "known"),  # whose electronics consume more by then than is left
    ],
)
def test_who_goes_home_in_a_costly_way_is_stopped_in_time(
    robot: str, home_at: str, sensing_hz: float, difficulty: str
) -> None:
    options = Options("OutAndBack", robot=robot, difficulty=difficulty)
    known = known_of(options)
    policy = Careless(known, float(known.shared[f"{home_at}_speed_mps"][0]), sensing_hz)
    assert run_episodes(policy, options, episode_seeds(2, 24)).episodes.home.mean() < 0.6
    assert shielded(policy, options, 24).episodes.home.all()


@pytest.mark.parametrize("route", ["generated", "hidden_wind"])
def test_who_never_turns_is_turned_in_time(route: str) -> None:
    options = Options("OutAndBack", route=route)
    safe = shielded(Onward(known_of(options)), options, 200).episodes
    assert safe.home.all()
    assert (
        np.median(safe.furthest_m)
        > (0.4 if route == "generated" else 0.33) * known_of(options).shared["length_m"][0]
    )


def test_a_careful_rule_is_left_alone_where_all_is_known() -> None:
    options = Options("Survey", difficulty="known")
    env = HomewardVectorEnv(**vars(options))
    bare = run_episodes(make_policy("dmax_mapped", env), options, episode_seeds(2, 64)).episodes
    safe = shielded(make_policy("dmax_mapped", env), options, 64).episodes
    assert bare.home.all()
    np.testing.assert_array_equal(safe.score, bare.score)
    np.testing.assert_array_equal(safe.energy_left_j, bare.energy_left_j)


@pytest.mark.parametrize(
    ("difficulty", "typical", "most"), [("known", 0.02, 0.03), ("uncertain", 0.17, 0.33)]
)
def test_it_turns_back_late(difficulty: str, typical: float, most: float) -> None:
    """Hardly more than the reserve is left in the battery, where it knows its robot and the
    wind."""
    options = Options("OutAndBack", difficulty=difficulty)
    safe = shielded(Onward(known_of(options)), options, 100).episodes
    left = safe.energy_left_j / known_of(options).robot.usable_energy_j
    assert np.median(left) < typical
    assert np.percentile(left, 90.0) < most


def test_it_looks_back_on_the_way_out_unless_nothing_is_hidden() -> None:
    for difficulty, expected in (("known", {GO}), ("uncertain", {GO, RETURN})):
        options = Options("OutAndBack", difficulty=difficulty)
        policy = Shield(Onward(known_of(options)), known_of(options))
        env = HomewardVectorEnv(2, autoreset_mode="Disabled", **vars(options))
        observations, _ = env.reset(seed=0)
        begun, modes = np.ones(2, np.bool_), set()
        for _ in range(12):
            actions = policy.act(observations, begun)
            begun = np.zeros(2, np.bool_)
            modes |= set(actions[:, 2].tolist())
            observations, *_ = env.step(actions)
        assert modes == expected


@pytest.mark.parametrize("difficulty", ["uncertain", "harsh"])
@pytest.mark.parametrize("mission", MISSIONS)
def test_hardly_any_strands_whoever_drives(mission: str, difficulty: str) -> None:
    """One in a thousand is asked for: four of 240 are more than chance explains."""
    options = Options(mission, difficulty=difficulty)
    known, stranded = known_of(options), 0
    for reckless in (Onward(known), Wanderer(known, np.random.default_rng(1))):
        episodes = run_episodes(
            Shield(reckless, known), options, range(8_100_000, 8_100_120)
        ).episodes
        stranded += int(episodes.stranded.sum())
        assert not episodes.timed_out.any()
    assert stranded <= 3


@pytest.mark.parametrize("name", [*RULES, "planner"])
def test_no_agent_strands_more_with_a_shield(name: str) -> None:
    options, stranded = Options("OutAndBack", difficulty="harsh", route="hidden_wind"), []
    env, seeds = HomewardVectorEnv(**vars(options)), range(8_200_000, 8_200_060)
    for guarded in (False, True):
        policy = make_policy(name, env)
        run = run_episodes(Shield(policy, env.batch.known) if guarded else policy, options, seeds)
        stranded.append(int(run.episodes.stranded.sum()))
    assert stranded[1] <= min(stranded[0], 2)


def driven(bare: Policy, options: Options, count: int) -> Iterator[tuple[Any, Any, Any]]:
    """What is observed, what the policy wants and what the shield makes of it, decision by
    decision."""
    env = HomewardVectorEnv(count, autoreset_mode="Disabled", **vars(options))
    known, wanted = env.batch.known, Heard(bare)
    shield, begun = Shield(wanted, known), np.ones(count, np.bool_)
    observations, _ = env.reset(seed=episode_seeds(8, count))
    results = np.empty(count), np.empty(count, np.bool_), np.empty(count, np.bool_)
    while not env.batch.records["over"].all():
        actions = shield.act(observations, begun)
        going = ~env.batch.records["over"]
        yield observations[going].copy(), wanted.said[going], actions[going]
        env.batch.step(actions, observations, *results)
        begun = np.zeros(count, np.bool_)
    assert env.batch.records["home"].all()


@final
class Heard(Policy):
    """A policy whose last actions are kept."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        self.said = self._policy.act(observations, begun).copy()
        return self.said


@pytest.mark.parametrize("mission", MISSIONS)
def test_once_it_overrules_it_brings_home(mission: str) -> None:
    options = Options(mission)
    overruled, safe, looks_back = 0, np.array([4, 0, RETURN]), np.array([0, 0, RETURN])
    for observations, wanted, actions in driven(Onward(known_of(options)), options, 12):
        # One decision of a look back is none: it goes on then.
        returning = observations[:, INDEX["returning"]] > 0.5
        overruled += int((wanted[:, 2] != actions[:, 2]).sum())
        assert (actions[returning] == safe).all()
        known = (actions == safe).all(axis=1) | (actions == looks_back).all(axis=1)
        assert ((actions[:, 2] != RETURN) | known).all()
    assert overruled > 12


@pytest.mark.parametrize("difficulty", ["known", "harsh"])
def test_who_returns_at_cruise_and_senses_nothing_is_not_disturbed(difficulty: str) -> None:
    options = Options("Survey", difficulty=difficulty)
    policy = make_policy("soc50", HomewardVectorEnv(**vars(options)))
    returns = 0
    for _, wanted, actions in driven(policy, options, 24):
        back = wanted[:, 2] == RETURN
        returns += int(back.sum())
        np.testing.assert_array_equal(actions[back], wanted[back])
    assert returns > 24


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
        commands = decode_actions(
            known, encode_actions(known, [0.1, 0.55, 1.0], [0.0, 50.0, 100.0], mode)
        )
        assert commands.sensing_hz == pytest.approx([0.0, 50.0, 100.0], abs=1e-5)
        assert commands.speed_mps == pytest.approx([0.1, 0.55, 1.0], abs=1e-6)
        assert commands.driven_mps == pytest.approx(
            [0.0] * 3 if mode == STOP else [0.1, 0.55, 1.0], abs=1e-6
        )
        assert commands.returns.tolist() == [mode == RETURN] * 3


def test_numbers_far_from_the_prior_are_not_believed() -> None:
    """Down a slope with the wind on its back a robot rolls by itself; what it then finds out need
    not be what it is."""
    options = Options("OutAndBack", route="hidden_wind")
    policy = Shield(Wanderer(known_of(options), np.random.default_rng(0)), known_of(options))
    assert run_episodes(policy, options, episode_seeds(0, 250)).episodes.stranded.sum() <= 1


def test_the_less_risk_the_earlier_it_turns() -> None:
    options = Options("OutAndBack")
    known = known_of(options)
    furthest_m = [
        run_episodes(
            Shield(Onward(known), known, risk=risk), options, range(40)
        ).episodes.furthest_m.mean()
        for risk in (1e-1, 1e-3, 1e-6)
    ]
    assert furthest_m == sorted(furthest_m, reverse=True)
    assert furthest_m[0] > 1.05 * furthest_m[2]


@pytest.mark.parametrize("decision_s", [10.0, 120.0])
def test_it_waits_for_a_return_to_be_final_with_what_it_kept(decision_s: float) -> None:
    """It is asked for in as many decisions as take the same time: nine, or one."""
    options = Options("Patrol", decision_s=decision_s)
    assert shielded(Onward(known_of(options)), options, 24).episodes.home.all()
