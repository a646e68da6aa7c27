"""What a mission pays: its score on coming home, and a potential from d_max that changes no optimal
policy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.conditions.instruments import INSTRUMENTS, Instruments
from homeward.envs.reward import TERMS
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from tests.envs.rollouts import IN_PARTS, MISSIONS, drive, feature, make, mission, random_actions


@pytest.mark.parametrize("discount", [1.0, 0.997, 0.6])
@pytest.mark.parametrize("instruments", INSTRUMENTS)
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_shaped_rewards_telescope(
    mission_id: str, difficulty: str, instruments: str, discount: float
) -> None:
    """Discounted, they sum to the discounted final score less the potential of the start, whatever
    is done and read."""
    env = make(mission_id, difficulty=difficulty, instruments=instruments, discount=discount)
    scale = float(env.batch.known.shared["score_scale"][0])
    rng, ends = np.random.default_rng(5), set()
    for seed, home in itertools.product(range(6), (0.0, 0.15)):
        env.reset(seed=seed)
        start = float(mission(env)["potential"])
        assert start > 0.0
        steps = list(drive(env, random_actions(rng, "discrete", 60, home)))
        weights = discount ** np.arange(len(steps) + 1)
        for step in steps:
            assert step.reward == sum(step.info["reward_terms"].values())
            assert (step.info["reward_terms"]["score"] > 0.0) <= step.info["home"]
        paid = float(weights[:-1] @ [step.reward for step in steps])
        last = steps[-1]
        final = last.info["score"] / scale * weights[-2] if last.info["home"] else 0.0
        left = float(mission(env)["potential"]) * weights[-1]
        assert (left == 0.0) or last.truncated
        assert paid == pytest.approx(final + left - start, abs=1e-12)
        ends.add((bool(last.info["home"]), bool(last.truncated)))
    assert len(ends) >= 2


@pytest.mark.parametrize("action_type", IN_PARTS)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_without_shaping_the_score_is_paid_at_home_and_nothing_else(
    mission_id: str, action_type: str
) -> None:
    env = make(mission_id, shaping="none", action_type=action_type)
    scale = float(env.batch.known.shared["score_scale"][0])
    rng, home = np.random.default_rng(5), 0
    for seed in range(10):
        env.reset(seed=seed)
        *before, last = drive(env, random_actions(rng, action_type, 60, home=0.1))
        assert [step.reward for step in before] == [0.0] * len(before)
        assert last.info["reward_terms"] == {"score": last.reward, "shaping": 0.0}
        assert last.reward == (
            pytest.approx(last.info["score"] / scale) if last.info["home"] else 0.0
        )
        assert last.info["cost"] == float(last.info["stranded"])
        home += last.info["home"]
    assert home > 2


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_shaping_changes_rewards_and_nothing_else(mission_id: str) -> None:
    shaped, plain = make(mission_id, shaping="dmax"), make(mission_id, shaping="none")
    np.testing.assert_array_equal(shaped.reset(seed=8)[0], plain.reset(seed=8)[0])
    actions = random_actions(np.random.default_rng(5), "discrete", 60)
    rewards = []
    for one, other in zip(drive(shaped, actions), drive(plain, actions), strict=True):
        np.testing.assert_array_equal(one.observation, other.observation)
        assert one[2:4] == other[2:4] and one.info["score"] == other.info["score"]
        rewards.append((one.reward, other.reward))
    assert any(one != other for one, other in rewards)


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_stranding_pays_less_than_coming_home(mission_id: str) -> None:
    returns = {}
    for last_mode in (GO, RETURN):
        env = make(mission_id, difficulty="known", discount=1.0, decision_s=60.0)
        env.reset(seed=1)
        actions = itertools.chain([[4, 2, GO]] * 20, itertools.repeat([4, 2, last_mode], 200))
        steps = list(drive(env, actions))
        assert steps[-1].info["home"] == (last_mode == RETURN)
        returns[last_mode] = sum(step.reward for step in steps)
    assert returns[GO] < returns[RETURN]


@pytest.mark.parametrize("action_type", IN_PARTS)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_the_return_latches(mission_id: str, action_type: str) -> None:
    """From then on the robot heads home whether told to go or to return; a stop is still a stop."""
    env = make(mission_id, action_type=action_type, difficulty="known", decision_s=60.0)
    env.reset(seed=2)

    def act(speed: int, mode: int) -> tuple[float, bool]:
        if action_type == "discrete":
            *_, info = env.step([speed, 0, mode])
        else:
            *_, info = env.step(
                np.array([0.5 * speed - 1.0, -1.0, (mode - 1) * 2.0 / 3.0], np.float32)
            )
        return info["position_m"], bool(mission(env)["returning"])

    out_m, returning = act(4, GO)
    assert out_m == pytest.approx(60.0) and not returning
    positions = [act(1, mode) for mode in (RETURN, GO, STOP, GO)]
    assert all(returning for _, returning in positions)
    first, second, third, fourth = (position for position, _ in positions)
    assert out_m > first > second == third > fourth > 0.0
    assert first - second == pytest.approx((0.1 + 0.9 / 4) * 60.0)


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_going_home_at_once_is_worth_nothing(mission_id: str) -> None:
    env = make(mission_id, shaping="none")
    env.reset(seed=2)
    step = next(drive(env, [[4, 4, RETURN]]))
    assert step.terminated and step.info["home"] and step.info["score"] == step.reward == 0.0
    assert feature(step.observation, "returning") == 1.0


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_the_potential_is_worked_out_with_exact_numbers(mission_id: str) -> None:
    """Where the grade is read exactly, no instrument changes a reward, however wrong the readings
    are."""
    worst = Instruments(0.1, 0.1, 600.0, 0.3, 0.1, 0.3, 0.3, 0.0)
    exact, wrong = (
        make(mission_id, instruments=sizes, decision_s=60.0) for sizes in ("exact", worst)
    )
    for seed in range(3):
        for env in (exact, wrong):
            env.reset(seed=seed)
        rng, misread = np.random.default_rng(seed), 0
        for action in [*random_actions(rng, "discrete", 30, home=0.0), *[[4, 4, RETURN]] * 60]:
            one, other = exact.step(action), wrong.step(action)
            assert one[1:4] == other[1:4] and one[4]["reward_terms"] == other[4]["reward_terms"]
            assert one[4]["score"] == other[4]["score"]
            misread += abs(feature(one[0], "margin") - feature(other[0], "margin")) > 0.01
            if one[2] or one[3]:
                break
        assert misread > 3


def findable(env: HomewardEnv, way_m: float) -> float:
    """Information on the metres ahead, by their interest, with the samples a metre that memory and
    radio allow."""
    m, s = mission(env), env.batch.known.shared[0]
    borders_m = np.clip(np.arange(s["places"] + 1) * s["place_m"] - m["position_m"], 0.0, way_m)
    interest = float(np.diff(borders_m) @ env.batch.routes["places"]["interest"][0, : s["places"]])
    sent = float(
        0.5 * s["radio_hz"] / (1.0 + (m["position_m"] / s["link_m"]) ** 2) * way_m / s["cruise_mps"]
    )
    room = float(s["backlog_limit"] - m["backlog"]) + sent
    per_m = min(room / max(way_m, 1e-9), float(s["max_sensing_hz"] / s["cruise_mps"]))
    return interest * per_m / (per_m + float(s["saturation_per_m"]))


@pytest.mark.parametrize("instruments", INSTRUMENTS)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_the_potential_is_that_of_the_true_energy(mission_id: str, instruments: str) -> None:
    """By hand: the score so far and what the energy beyond the way home buys, over that of a good
    mission."""
    env = make(mission_id, instruments=instruments, decision_s=60.0)
    env.reset(seed=1)
    s = env.batch.known.shared[0]
    for step in drive(env, random_actions(np.random.default_rng(0), "discrete", 60, home=0.0)):
        m = mission(env)
        if step.terminated:
            assert m["potential"] == 0.0
            break
        here_m = float(m["position_m"] - m["place"] * s["place_m"])
        way_home_j = float(m["here"]["true_home_cost_j"] + here_m * m["here"]["true_home_j_per_m"])
        margin_j = float(m["energy_j"]) - way_home_j
        out_m = max(margin_j, 0.0) / float(s["energy_per_m"] + s["cruise_w"] / s["cruise_mps"])
        room_m = min(out_m, float(s["length_m"] - m["position_m"]))
        more = {
            "OutAndBack": max(float(m["position_m"] - m["furthest_m"]) + room_m, 0.0),
            "Survey": findable(env, room_m),
            "Patrol": 0.5 * max(margin_j, 0.0) / float(s["energy_per_m"] * s["length_m"]),
        }[mission_id]
        fits = float(np.clip(1.0 + 50.0 * margin_j / s["usable_j"], 0.0, 1.0))
        expected = fits * (step.info["score"] + more) / float(s["score_scale"])
        # places are kept in single precision
        assert m["potential"] == pytest.approx(expected, rel=1e-5)
        shaping = float(s["discount"]) * expected
        assert step.info["reward_terms"]["shaping"] <= shaping * (1.0 + 1e-6)


def test_the_terms_are_those_of_the_info() -> None:
    env = make("Survey")
    assert tuple(env.reset(seed=0)[1]["reward_terms"]) == TERMS


def test_a_return_that_is_not_final_still_hopes() -> None:
    """What is attainable is given up once the return is final, not while it is asked for."""
    env = make("OutAndBack", difficulty="known", decision_s=None, discount=1.0)
    env.reset(seed=0)
    list(drive(env, [[4, 0, GO]] * 20))
    potentials = []
    for _ in range(3):
        env.step([4, 0, RETURN])
        potentials.append(float(mission(env)["potential"]))
    score = float(mission(env)["score"] / env.batch.known.shared["score_scale"][0])
    assert potentials[0] == pytest.approx(potentials[1], rel=0.1) and potentials[1] > 1.5 * score
    assert potentials[2] == pytest.approx(score)


def test_the_potential_reckons_with_the_true_way_home() -> None:
    """In weather that stays, the energy that a robot comes home with is the margin with which it
    turned."""
    env = make("OutAndBack", difficulty="uncertain", decision_s=None, weather="still")
    s = env.batch.known.shared[0]
    cruise = round(
        4.0 * (s["cruise_mps"] - s["min_speed_mps"]) / (s["max_speed_mps"] - s["min_speed_mps"])
    )
    assert (
        s["min_speed_mps"] + 0.25 * cruise * (s["max_speed_mps"] - s["min_speed_mps"])
        == s["cruise_mps"]
    )
    for seed in range(5):
        env.reset(seed=seed)
        list(drive(env, [[cruise, 0, GO]] * 20))
        m = mission(env)
        here_m = float(m["position_m"] - m["place"] * s["place_m"])
        margin_j = float(
            m["energy_j"] - m["here"]["true_home_cost_j"] - here_m * m["here"]["true_home_j_per_m"]
        )
        list(drive(env, [[cruise, 0, RETURN]] * 40))
        assert mission(env)["home"]
        assert float(mission(env)["energy_j"]) == pytest.approx(margin_j, rel=2e-3)
