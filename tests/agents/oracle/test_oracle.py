"""No policy exceeds the oracle's upper bound, and the actions that it gives come close to it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import homeward
from homeward.agents import AGENTS, make_policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.oracle import Optimum, OracleError, check, score_of, solve
from homeward.agents.oracle.bound import (
    Multipliers,
    bounds_by_turn,
    dual_feasible,
    dual_feasible_at_docks,
    patrol_bound,
)
from homeward.agents.oracle.problem import problem_of
from homeward.agents.oracle.rates import PIECES, REFUSED, Rates, measure_rates
from homeward.agents.registry import FROM_FILES
from homeward.envs.missions import MISSIONS
from homeward.envs.options import Options, known_of
from homeward.envs.routes import Route
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics.effects import EFFECTS

SEEDS = episode_seeds(5, 8)
OUT_AND_BACK = ["OutAndBack", "Survey"]


@pytest.fixture(scope="module", params=["OutAndBack-harsh", "Survey-uncertain", "Patrol-harsh"])
def solved(request: pytest.FixtureRequest) -> tuple[Options, Optimum]:
    mission, difficulty = request.param.split("-")
    options = Options(mission, difficulty=difficulty)
    return options, solve(options, SEEDS)


def test_the_figures_enclose_each_other_in_changing_weather(
    solved: tuple[Options, Optimum],
) -> None:
    """The kindest wind of the mission is taken to blow all the time, so they are apart; by laps, a
    patrol's."""
    _, optimum = solved
    ratio = optimum.lower / optimum.upper
    assert (ratio <= 1.0).all()
    assert ratio.mean() > 0.92
    assert ratio.min() > 0.75


@pytest.mark.parametrize("mission", MISSIONS)
def test_the_two_figures_are_close_where_the_weather_is_still(mission: str) -> None:
    optimum = solve(Options(mission, weather="still"), SEEDS[:4])
    ratio = optimum.lower / optimum.upper
    assert (ratio <= 1.0).all()
    assert ratio.mean() > 0.985
    assert ratio.min() > 0.97


def test_the_lower_figure_is_the_score_of_the_actions(solved: tuple[Options, Optimum]) -> None:
    options, optimum = solved
    env = HomewardEnv(**vars(options))
    for seed, actions, lower in zip(SEEDS[:3], optimum.actions, optimum.lower, strict=False):
        env.reset(seed=seed)
        steps = [env.step(action) for action in actions]
        assert [terminated for _, _, terminated, _, _ in steps] == [False] * (len(actions) - 1) + [
            True
        ]
        info = steps[-1][4]
        assert info["home"]
        assert info["score"] == lower


@pytest.mark.parametrize("agent", sorted(set(AGENTS) - FROM_FILES))
def test_no_agent_exceeds_the_upper_figure(solved: tuple[Options, Optimum], agent: str) -> None:
    options, optimum = solved
    policy = make_policy(agent, HomewardVectorEnv(**vars(options)))
    assert (run_episodes(policy, options, SEEDS).episodes.score <= optimum.upper).all()


def test_no_random_actions_exceed_the_upper_figure(solved: tuple[Options, Optimum]) -> None:
    """Some go on for a random time with habits of their own, and then return at cruise."""
    options, optimum = solved
    rng = np.random.default_rng(1)
    copies = 30
    sequences = []
    for _ in SEEDS * copies:
        count = int(rng.integers(1, 200))
        speed, rate = rng.dirichlet(np.full(5, 0.5), 2)
        modes = np.where(rng.random(count) < rng.random() ** 3, STOP, GO)
        actions = np.stack(
            [rng.choice(5, count, p=speed), rng.choice(5, count, p=rate), modes], axis=1
        )
        sequences.append(np.concatenate([actions, [[4, 0, RETURN]]]))
    scores = score_of(options, SEEDS * copies, sequences).reshape(copies, -1)
    assert (scores.max(axis=0) > 0.0).all()
    assert (scores <= optimum.upper).all()


def to_and_fro(rng: np.random.Generator, return_decisions: int) -> NDArray[np.int64]:
    """Out, home and out again: a return is final only after being asked for in a row, and a stop
    breaks the row."""
    actions: list[tuple[int, int, int]] = []
    for _ in range(int(rng.integers(1, 5))):
        count, silent, speed, rate = rng.integers((3, 0, 0, 0), (70, 30, 5, 5)).tolist()
        actions += [(speed, rate if k >= silent else 0, GO) for k in range(count)]
        home = [
            STOP if k % return_decisions == return_decisions - 1 else RETURN
            for k in range(rng.integers(60))
        ]
        actions += [(4, 0, mode) for mode in home] + [(0, 0, STOP)] * int(
            rng.integers(60) * (rng.random() < 0.5)
        )
    return np.array([*actions, (4, 0, RETURN)])


def test_no_mission_that_comes_and_goes_exceeds_the_upper_figure(
    solved: tuple[Options, Optimum],
) -> None:
    options, optimum = solved
    known, rng, copies = known_of(options), np.random.default_rng(3), 30
    sequences = [to_and_fro(rng, int(known.shared["return_decisions"][0])) for _ in SEEDS * copies]
    scores = score_of(options, SEEDS * copies, sequences).reshape(copies, -1)
    assert (scores.max(axis=0) > 0.0).all()
    assert (scores <= optimum.upper).all()


@pytest.mark.parametrize("robot", ["rusti", "rusti_computer"])
def test_nor_does_one_that_empties_its_memory_near_home(robot: str) -> None:
    """All there is to find lies far out, and what is found there is sent from near home, where the
    radio is fast."""
    s = known_of(Options("Survey", robot=robot)).shared[0]
    interest = np.zeros(64)
    interest[8:24] = 5.0
    route = Route(float(s["length_m"]) / 64.0, np.zeros(64), np.zeros(64), interest, np.zeros(64))
    options = Options("Survey", difficulty="known", robot=robot, route=route)
    optimum, rng, sequences = solve(options, SEEDS[:1]), np.random.default_rng(4), []
    for _ in range(150):
        out, back, stands, again = rng.integers((25, 5, 0, 5), (45, 30, 100, 60)).tolist()
        rates = rng.integers(1, 5, 2).tolist()
        home = [
            STOP if k % int(s["return_decisions"]) == s["return_decisions"] - 1 else RETURN
            for k in range(back)
        ]
        actions = (
            [(4, 0, GO)] * 12 + [(4, rates[0], GO)] * (out - 12) + [(4, 0, mode) for mode in home]
        )
        actions += [(0, 0, STOP)] * stands + [(4, rates[1], GO)] * again + [(4, 0, RETURN)]
        sequences.append(np.array(actions))
    scores = score_of(options, SEEDS[:1] * len(sequences), sequences)
    assert scores.max() > 0.4 * optimum.upper[0]
    assert (scores <= optimum.upper[0]).all()


def test_no_hill_climbed_actions_exceed_the_upper_figure(solved: tuple[Options, Optimum]) -> None:
    options, optimum = solved
    rng = np.random.default_rng(2)
    climbers = 32
    for seed, upper, start in zip(SEEDS[:2], optimum.upper, optimum.actions, strict=False):
        best, best_score = start, 0.0
        for _ in range(12):
            tries = [best, *(_changed(best, rng) for _ in range(climbers - 1))]
            scores = score_of(options, [seed] * climbers, tries)
            assert (scores <= upper).all()
            best, best_score = tries[int(scores.argmax())], float(scores.max())
        assert best_score > 0.0


def _changed(actions: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
    """Actions with some changed, taken out or put in."""
    changed = actions.copy()
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(len(changed)))
        match rng.integers(4):
            case 0:
                changed[at, :2] = rng.integers(5, size=2)
            case 1:
                changed = np.delete(changed, at, axis=0) if len(changed) > 1 else changed
            case 2:
                changed = np.insert(changed, at, [*rng.integers(5, size=2), GO], axis=0)
            case _:
                changed[at : at + 5, 0] = rng.integers(5)
    changed[-1, 2] = RETURN
    return changed


@pytest.mark.parametrize("mission", OUT_AND_BACK)
@settings(deadline=None, max_examples=60)
@given(
    per_j=st.floats(0.0, 1.0),
    per_s=st.floats(0.0, 1.0),
    scale=st.floats(0.0, 0.1),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_bound_holds_at_any_multipliers(
    mission: str, per_j: float, per_s: float, scale: float, seed: int
) -> None:
    rates, lower = _measured(mission), _lower(mission)
    sample = scale * np.random.default_rng(seed).random(rates.places * PIECES + 1) ** 4
    assert (
        bounds_by_turn(rates, dual_feasible(rates, Multipliers(per_j, per_s, sample))).max()
        >= lower
    )


@settings(deadline=None, max_examples=60)
@given(
    per_j=st.floats(0.0, 1.0),
    per_s=st.floats(0.0, 1.0),
    scale=st.floats(0.0, 0.1),
    seed=st.integers(0, 2**32 - 1),
)
def test_at_feasible_multipliers_no_pass_back_with_a_full_memory_and_out_with_none_gains(
    per_j: float, per_s: float, scale: float, seed: int
) -> None:
    rates, rng = _measured("Survey"), np.random.default_rng(seed)
    given = Multipliers(per_j, per_s, scale * rng.random(rates.places * PIECES + 1) ** 4)
    multipliers = dual_feasible(rates, given)
    assert (multipliers.per_sample <= given.per_sample + 1e-12).all()
    assert multipliers.per_s >= given.per_s
    for _ in range(50):
        piece, at = int(rng.integers(rates.places * PIECES)), rng.random()
        near, far = multipliers.per_sample[piece : piece + 2]
        taken = 0.0
        for power_w in (rates.home_w, rates.out_w):
            level, rate = rng.integers(len(rates.speeds_mps), size=2)
            saved = (near + at * (far - near)) * rates.radio_hz[piece, 1]
            net_per_s = (
                multipliers.per_j * power_w[piece // PIECES, level, rate]
                + multipliers.per_s
                - saved
            )
            taken += net_per_s / rates.speeds_mps[level]
        assert taken > -1e-9
        assert rates.memory * (far - near) / rates.piece_m <= taken + 1e-9


@settings(deadline=None, max_examples=60)
@given(per_j=st.floats(1e-9, 1.0), per_s=st.floats(0.0, 1.0))
def test_a_patrol_s_bound_holds_at_any_multipliers(per_j: float, per_s: float) -> None:
    rates = _measured("Patrol")
    pit_stop_s = float(HomewardVectorEnv(mission="Patrol").batch.known.shared["pit_stop_s"][0])
    assert patrol_bound(rates, pit_stop_s, Multipliers(per_j, per_s, np.zeros(0))) >= _lower(
        "Patrol"
    )


@pytest.mark.parametrize("laps", [1, 3])
def test_the_last_lap_of_a_patrol_needs_no_pit_stop(laps: int) -> None:
    """In a time that just holds so many laps at top speed, with two pit stops between one and the
    next."""
    rates, pit_stop_s = _measured("Patrol"), 60.0
    lap_s = 2.0 * len(rates.out_w) * rates.place_m / float(rates.speeds_mps.max())
    limited = dataclasses.replace(rates, time_s=laps * lap_s + (laps - 1) * 2.0 * pit_stop_s)
    assert patrol_bound(limited, pit_stop_s, Multipliers(0.0, 1.0, np.zeros(0))) == laps


EXTRA = {effect.id: {effect.switch.name: 0.2} for effect in EFFECTS} | {
    "slip": {"per_load": 0.1},
    "breakaway": {"start_j": 5.0},
    "rate_capacity": {"excess": 0.1, "reference_w": 5.0},
    "radio": {"w_per_km2": 0.5},
    "heater": {"w_per_k": 0.05, "on_below_c": 20.0},
    "cooler": {"w_per_k": 0.05, "on_above_c": 10.0},
    "cold_battery": {"per_k": 0.005, "warm_c": 25.0},
    "intermittent_load": {"power_w": 2.0, "period_s": 400.0, "duty": 0.3},
    "motor_heating": {"per_k": 0.005, "rise_k_per_w": 3.0, "time_constant_s": 600.0},
    "hidden_grade": {"slope": 0.02},
    "air_temperature": {"rolling_per_k": 0.01},
}


LEAST = {"intermittent_load": 0.8, "motor_heating": 0.8}
"""Share of the upper figure that the lower one reaches at least, where what was before matters: the
bound is loose."""


@pytest.mark.parametrize("effect", sorted(set(EXTRA) - set(REFUSED)))
def test_the_figures_enclose_each_other_with_every_effect(effect: str) -> None:
    robot = homeward.load_robot("rusti_computer")
    options = Options(
        "Survey", robot=dataclasses.replace(robot, track_m=0.2, effects={effect: EXTRA[effect]})
    )
    optimum = solve(options, SEEDS[:1])
    assert (optimum.lower <= optimum.upper).all()
    assert (optimum.lower > LEAST.get(effect, 0.95) * optimum.upper).all()


def test_a_robot_with_inertia_is_refused() -> None:
    robot = dataclasses.replace(
        homeward.load_robot("rusti"), effects={"inertia": {"mass_factor": 1.0}}
    )
    with pytest.raises(
        OracleError, match="no bound for a robot with the effect inertia; switch it off"
    ):
        solve(Options("Survey", robot=robot), SEEDS[:1])


def test_a_robot_with_a_cut_off_is_refused() -> None:
    robot = dataclasses.replace(homeward.load_robot("turtlebot3_burger"), cutoff_v=9.9)
    with pytest.raises(OracleError, match=r"does not model .* cut off at 9\.9 V; leave out"):
        solve(Options("Survey", robot=robot), SEEDS[:1])


def test_continuous_actions_are_refused() -> None:
    with pytest.raises(OracleError, match="choose 'discrete'"):
        solve(Options("Survey", action_type="continuous"), SEEDS[:1])


def test_many_processes_find_the_same() -> None:
    options, seeds = Options("Patrol"), episode_seeds(6, 24)
    one, two = solve(options, seeds), solve(options, seeds, jobs=2)
    np.testing.assert_array_equal(one.upper, two.upper)
    np.testing.assert_array_equal(one.lower, two.lower)


def test_a_robot_that_cannot_leave_the_first_place_scores_no_more_than_it_can() -> None:
    steep = Route(100.0, np.full(4, 0.6), np.zeros(4), np.ones(4), np.zeros(4))
    for mission in MISSIONS:
        optimum = solve(Options(mission, route=steep), SEEDS[:2])
        assert (optimum.lower <= optimum.upper).all()


MEASURED: dict[str, Rates] = {}
LOWER: dict[str, float] = {}


def _measured(mission: str) -> Rates:
    if mission not in MEASURED:
        env = HomewardVectorEnv(mission=mission)
        env.reset(seed=SEEDS[:1])
        MEASURED[mission] = measure_rates(problem_of(env.batch, 0))
    return MEASURED[mission]


def _lower(mission: str) -> float:
    if mission not in LOWER:
        LOWER[mission] = float(solve(Options(mission), SEEDS[:1]).lower[0])
    return LOWER[mission]


def with_docks(docks: str) -> Options:
    return Options(
        "Patrol", weather="still", instruments="exact", docks=docks, time_limit_s=12_000.0
    )


def test_the_bound_is_reached_in_still_weather_and_by_no_agent_exceeded() -> None:
    for docks in ("0:15", "60:15"):
        options = with_docks(docks)
        optimum = solve(options, SEEDS)
        np.testing.assert_array_equal(score_of(options, SEEDS, optimum.actions), optimum.lower)
        assert (optimum.upper - optimum.lower <= 1.0).all()
        assert any((actions[:, 2] == STOP).any() for actions in optimum.actions)
        policy = make_policy("planner", HomewardVectorEnv(**vars(options)))
        assert (run_episodes(policy, options, SEEDS).episodes.score <= optimum.upper).all()


@pytest.mark.parametrize(("per_j", "per_s"), [(1e-4, 0.0), (5e-4, 1e-3), (0.0, 3e-3)])
def test_the_bound_with_docks_holds_at_any_feasible_multipliers(per_j: float, per_s: float) -> None:
    options = with_docks("0:15")
    env = HomewardVectorEnv(1, **vars(options))
    env.reset(seed=SEEDS[:1])
    case = problem_of(env.batch, 0)
    rates = measure_rates(case)
    assert rates.charge_w[0] == pytest.approx(15.0 - 0.588, abs=1e-3)
    multipliers = dual_feasible_at_docks(
        rates, Multipliers(per_j, per_s, np.zeros(len(rates.radio_hz) + 1))
    )
    assert multipliers.per_s >= per_j * rates.charge_w[0]
    assert (
        patrol_bound(rates, float(case.shared["pit_stop_s"]), multipliers)
        >= solve(options, SEEDS[:1]).upper[0]
    )


def test_other_missions_with_docks_have_no_bound() -> None:
    with pytest.raises(OracleError, match="no bound for Survey with docks, for Patrol only"):
        check(Options("Survey", docks="0:15", time_limit_s=12_000.0))
