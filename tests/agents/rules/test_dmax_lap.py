"""The rule of a patrol that measures its laps: what laps consumed is what the next one is expected
to."""

from __future__ import annotations

import numpy as np
import pytest

from homeward.agents.base import Observations
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.rules.dmax_lap import LapRule
from homeward.agents.rules.pace import NO_SENSING
from homeward.agents.rules.turn_back import Outlook
from homeward.envs.options import Known, Options, known_of
from homeward.physics import ancillary_power
from tests.agents.rules.shown import observed

UNSEEN = 0.1
"""Relative deviation of a lap before two are measured."""


def known(**options: object) -> Known:
    """Of decisions so long that a return is final at once, so that it saves a pit stop."""
    return known_of(Options("Patrol", **{"instruments": "exact", "decision_s": 60.0} | options))  # type: ignore[arg-type]


@pytest.fixture
def rule() -> LapRule:
    return LapRule(known(), NO_SENSING, 1.0)


def far(rule: LapRule) -> float:
    """Distance of the far post, as it is observed."""
    s = rule._known.shared[0]
    return float(s["length_m"] / s["reach_m"])


def stop_share(rule: LapRule) -> float:
    """What a return saves of a pit stop at the far post, whose decisions before it is final are
    spent there."""
    s = rule._known.shared[0]
    saved_s = float(s["pit_stop_s"] - (s["return_decisions"] - 1) * s["decision_s"])
    assert saved_s > 0.0
    return saved_s * float(ancillary_power(rule._known.robot, 0.0)) / float(s["usable_j"])


def show(rule: LapRule, *posts: tuple[bool, float], begins: bool = True) -> Outlook:
    """Show posts in turn, each with whether it is the far one and the energy there; returns the
    last outlook."""
    if begins:
        rule.look(observed(), np.ones(1, np.bool_))
    for away, energy in posts:
        outlook = rule.look(at(rule, away, energy), np.zeros(1, np.bool_))
    return outlook


def at(rule: LapRule, away: bool, energy: float) -> Observations:
    return observed(energy=energy, distance=far(rule) if away else 0.0)


def test_before_any_lap_it_is_predicted_by_equation_7(rule: LapRule) -> None:
    predicted = float(rule.cost_of_going_on(observed())[0])
    outlook = rule.look(observed(), np.ones(1, np.bool_))
    assert outlook.onwards[0] == pytest.approx(predicted - stop_share(rule))
    assert outlook.deviation[0] == pytest.approx(UNSEEN * predicted)
    assert (outlook.energy_left[0], outlook.home[0]) == (1.0, 0.0)


def test_the_first_lap_serves_until_there_is_another(rule: LapRule) -> None:
    outlook = show(rule, (True, 0.92), (False, 0.85))
    assert outlook.onwards[0] == pytest.approx(0.15 - stop_share(rule))
    assert outlook.deviation[0] == pytest.approx(UNSEEN * 0.15)
    outlook = show(rule, (True, 0.75), (False, 0.65), begins=False)
    # without the first, which had no pit stop
    assert outlook.onwards[0] == pytest.approx(0.20 - stop_share(rule))
    assert outlook.deviation[0] == pytest.approx(UNSEEN * 0.20)


def test_mean_and_deviation_are_those_of_the_laps_after_the_first(rule: LapRule) -> None:
    laps, energy, posts = (0.15, 0.10, 0.14, 0.12), 1.0, []
    for lap in laps:
        posts += [(True, energy - 0.4 * lap), (False, energy - lap)]
        energy -= lap
    outlook = show(rule, *posts)
    assert outlook.onwards[0] == pytest.approx(np.mean(laps[1:]) - stop_share(rule))
    # of single-precision energies
    assert outlook.deviation[0] == pytest.approx(np.std(laps[1:], ddof=1), rel=1e-4)


def test_the_way_home_is_that_of_the_last_lap_less_what_was_spent_since_the_post(
    rule: LapRule,
) -> None:
    show(rule, (True, 0.92), (False, 0.85))  # 0.07 for the way home
    assert show(rule, (True, 0.75), begins=False).home[0] == pytest.approx(0.07, abs=1e-6)
    on_its_way = observed(energy=0.72, distance=0.5 * far(rule))
    assert rule.look(on_its_way, np.zeros(1, np.bool_)).home[0] == pytest.approx(0.04, abs=1e-6)


def test_an_arrival_that_is_shown_twice_counts_once(rule: LapRule) -> None:
    posts = [(True, 0.92), (False, 0.85), (True, 0.75), (False, 0.65), (True, 0.55), (False, 0.47)]
    once = show(rule, *posts)
    twice = show(LapRule(known(), NO_SENSING, 1.0), *(post for post in posts for _ in range(2)))
    np.testing.assert_array_equal(once, twice)


def test_a_mission_that_begins_forgets_its_laps_and_leaves_the_others(rule: LapRule) -> None:
    both, none = np.ones(2, np.bool_), np.zeros(2, np.bool_)
    rule.look(np.repeat(observed(), 2, axis=0), both)
    for away, energy in ((True, 0.92), (False, 0.85)):
        rule.look(np.repeat(at(rule, away, energy), 2, axis=0), none)
    shown = np.concatenate((observed(), at(rule, False, 0.85)))
    outlook = rule.look(shown, np.array([True, False]))
    fresh = LapRule(known(), NO_SENSING, 1.0).look(observed(), np.ones(1, np.bool_))
    assert outlook.onwards[0] == fresh.onwards[0]
    assert outlook.onwards[1] == pytest.approx(0.15 - stop_share(rule))


def test_an_inexact_gauge_widens_the_reserve_with_what_was_used() -> None:
    gauged = LapRule(known(instruments="gauge"), NO_SENSING, 1.0)
    error = float(gauged._known.instruments.soc_variance**0.5)
    assert error > 0.0
    outlook = show(gauged, (True, 0.92), (False, 0.85))
    assert outlook.deviation[0] == pytest.approx(np.hypot(UNSEEN * 0.15, error * (0.15 + 0.15)))


@pytest.mark.parametrize(("spare", "turns"), [(1e-3, False), (-1e-3, True)])
def test_it_turns_where_lap_and_reserve_no_longer_fit(
    rule: LapRule, spare: float, turns: bool
) -> None:
    """A second lap of x leaves 1 - 0.1 - x at home, and another one with its reserve consumes (1 +
    0.1) x."""
    lap = (0.9 + stop_share(rule) - spare) / (2.0 + UNSEEN)
    show(rule, (True, 0.95), (False, 0.9))
    rule.turns(at(rule, True, 0.9 - 0.5 * lap), np.zeros(1, np.bool_))
    assert rule.turns(at(rule, False, 0.9 - lap), np.zeros(1, np.bool_))[0] == turns


def test_it_turns_at_the_far_post_too_and_nowhere_between(rule: LapRule) -> None:
    show(rule, (True, 0.92), (False, 0.85))
    between = observed(energy=0.1, distance=0.5 * far(rule))
    assert not rule.turns(between, np.zeros(1, np.bool_))[0]
    assert rule.turns(at(rule, True, 0.1), np.zeros(1, np.bool_))[0]


def test_patrols_on_known_ground_all_come_home() -> None:
    options = Options("Patrol", difficulty="known")
    rule = LapRule(known_of(options), NO_SENSING, 1.0)
    assert run_episodes(rule, options, episode_seeds(1, 50)).episodes.home.all()
