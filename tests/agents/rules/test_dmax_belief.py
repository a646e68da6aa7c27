"""The mapped rule with a belief: Eq. 8 where nothing is hidden, and a reserve that follows what is
not known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.rules.dmax_belief import BeliefDmaxRule
from homeward.agents.rules.pace import NO_SENSING, Pace
from homeward.agents.rules.turn_back import Outlook
from homeward.envs.actions import encode_actions
from homeward.envs.options import Known, Options, known_of
from homeward.envs.routes import Route
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import ancillary_power, d_max

ZEROS = np.zeros(60)
FLAT = Route(20.0, ZEROS, ZEROS, ZEROS + 1.0, ZEROS)
"""Long enough that no drive here reaches its end."""


def flat(mission: str = "OutAndBack", **options: Any) -> Options:
    given: dict[str, Any] = {"difficulty": "known", "route": FLAT, **options}
    return Options(mission, **given)


def out(
    rule: BeliefDmaxRule, options: Options, decisions: int, count: int = 1
) -> tuple[Outlook, Any]:
    """Drive out at cruise without sensing; the last outlook, and the mission's records."""
    env, known = (
        HomewardVectorEnv(count, autoreset_mode="Disabled", **vars(options)),
        known_of(options),
    )
    observations, _ = env.reset(seed=3)
    outlook = rule.look(observations, np.ones(count, np.bool_))
    action = encode_actions(known, known.shared["cruise_mps"][0], 0.0, np.full(count, GO))
    for _ in range(decisions):
        observations, *_ = env.step(action)
        outlook = rule.look(observations, np.zeros(count, np.bool_))
    return outlook, env.batch.records


def share_per_m(known: Known, speed_mps: float) -> float:
    """Share of a full battery for a metre on the flat, Eq. 8."""
    return 1.0 / float(d_max(known.robot, speed_mps))


def test_at_home_nothing_is_needed_but_to_go_on() -> None:
    options = flat()
    known = known_of(options)
    outlook, _ = out(BeliefDmaxRule(known, NO_SENSING, 1.0), options, 0)
    s = known.shared[0]
    outward_m = float(s["decision_s"] * s["cruise_mps"])
    assert outlook.energy_left[0] == pytest.approx(1.0, abs=1e-6)
    assert outlook.home[0] == pytest.approx(0.0, abs=1e-9)
    assert outlook.onwards[0] == pytest.approx(
        2.0 * outward_m * share_per_m(known, float(s["cruise_mps"])), rel=1e-3
    )


def test_the_way_home_is_equation_8s() -> None:
    options = flat()
    known = known_of(options)
    outlook, records = out(BeliefDmaxRule(known, NO_SENSING, 1.0), options, 12)
    m, cruise_mps = records[0], float(known.shared["cruise_mps"][0])
    assert m["position_m"] > 300.0
    assert outlook.energy_left[0] == pytest.approx(m["energy_j"] / m["capacity_j"], abs=1e-3)
    assert outlook.home[0] == pytest.approx(
        m["position_m"] * share_per_m(known, cruise_mps), rel=2e-3
    )


def test_to_go_on_includes_sensing() -> None:
    options = flat("Survey")
    known = known_of(options)
    s = known.shared[0]
    outlooks = [
        out(BeliefDmaxRule(known, Pace(rate, 0.0, 1.0), 1.0), options, 0)[0].onwards[0]
        for rate in (0.0, 0.5)
    ]
    sensing_w = ancillary_power(known.robot, 0.5 * s["max_sensing_hz"]) - ancillary_power(
        known.robot, 0.0
    )
    assert outlooks[1] - outlooks[0] == pytest.approx(
        s["decision_s"] * sensing_w / s["usable_j"], rel=1e-6
    )


def test_a_slower_step_goes_less_far() -> None:
    options = flat()
    known = known_of(options)
    s = known.shared[0]
    slow_mps = 0.5 * float(s["cruise_mps"])
    outlook, _ = out(BeliefDmaxRule(known, NO_SENSING, 1.0, slow_mps), options, 0)
    # out slowly, home at cruise
    per_m = share_per_m(known, slow_mps) + share_per_m(known, float(s["cruise_mps"]))
    assert outlook.onwards[0] == pytest.approx(slow_mps * float(s["decision_s"]) * per_m, rel=1e-3)


def test_on_a_patrol_the_step_is_a_lap_whatever_its_speed() -> None:
    known = known_of(Options("Patrol"))
    rules = [BeliefDmaxRule(known, NO_SENSING, 1.0, step_mps) for step_mps in (None, 0.2)]
    one, other = (out(rule, Options("Patrol"), 2)[0] for rule in rules)
    np.testing.assert_array_equal(one, other)


def test_where_nothing_is_hidden_there_is_hardly_a_reserve() -> None:
    deviations = [
        out(BeliefDmaxRule(known_of(options), NO_SENSING, 1.0), options, 12)[0].deviation[0]
        for options in (flat(), flat(difficulty="uncertain"))
    ]
    assert 0.0 <= deviations[0] < 0.1 * deviations[1]


def test_it_turns_where_energy_is_down_to_the_way_home_and_the_reserve() -> None:
    options = flat(difficulty="uncertain")
    known = known_of(options)
    rule = BeliefDmaxRule(known, NO_SENSING, 2.0)
    outlook, _ = out(rule, options, 12)
    needed = outlook.home + outlook.onwards + 2.0 * outlook.deviation
    np.testing.assert_allclose(
        rule.margin_above_reserve_by(outlook), outlook.energy_left - needed, atol=1e-15
    )


def test_a_greater_reserve_never_turns_later() -> None:
    options = Options("OutAndBack")
    known = known_of(options)
    furthest = [
        run_episodes(
            BeliefDmaxRule(known, NO_SENSING, deviations), options, episode_seeds(5, 20)
        ).episodes.furthest_m
        for deviations in (0.0, 3.0, 6.0)
    ]
    assert (furthest[1] <= furthest[0]).all() and (furthest[2] <= furthest[1]).all()
    assert (furthest[2] < furthest[0]).all()


def test_it_turns_in_time_and_keeps_the_return() -> None:
    options = flat()
    rule = BeliefDmaxRule(known_of(options), NO_SENSING, 1.0)
    episodes = run_episodes(rule, options, [1]).episodes
    assert episodes.home.all()
    env = HomewardVectorEnv(1, autoreset_mode="Disabled", **vars(options))
    observations, _ = env.reset(seed=1)
    shown = np.ones(1, np.bool_)
    modes = []
    for _ in range(int(episodes.decisions[0])):
        action = rule.act(observations, shown)
        modes.append(int(action[0, 2]))
        observations, *_ = env.step(action)
        shown = np.zeros(1, np.bool_)
    turn = modes.index(RETURN)
    assert modes == [GO] * turn + [RETURN] * (len(modes) - turn)
