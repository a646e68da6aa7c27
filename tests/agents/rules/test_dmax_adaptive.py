"""The adaptive rule measures its consumption, mission by mission."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.agents import make_policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.pace import Pace
from homeward.envs.features import INDEX
from homeward.envs.options import Options, known_of
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import ancillary_power
from tests.agents.rules.shown import FIRST, episodes, observed


def drive(
    rule: AdaptiveDmaxRule, ratios: NDArray[np.float64], sensing: NDArray[np.float64]
) -> tuple[float, float]:
    """Spare energy, and what it falls by per home cost, after decisions of given consumption over
    the model's.

    Sensing, where it is on, takes what the file says times 1.1; the rest of the modelled energy
    takes its ratio.
    """
    known = known_of(Options("Survey"))
    s, robot = known.shared[0], known.robot
    used, modelled = 0.0, 0.0
    margin: Any = rule.margin_above_reserve(observed(), FIRST)
    for ratio, rate in zip(ratios, sensing, strict=True):
        extra_w = ancillary_power(robot, rate * s["max_sensing_hz"]) - ancillary_power(robot, 0.0)
        extra = extra_w * s["decision_s"] / s["usable_j"]
        used += 0.005 * ratio + 1.1 * extra
        modelled += 0.005 + extra
        state = {"energy": 1.0 - used, "modelled": modelled, "sensing": rate}
        margin = rule.margin_above_reserve(observed(**state), np.zeros(1, np.bool_))
    nothing_passed = observed(**state, home_cost=0.2)
    nothing_passed[0, INDEX["sensing"]] = 0.0
    farther = rule.margin_above_reserve(nothing_passed, np.zeros(1, np.bool_))
    return float(margin[0]), float((margin - farther)[0] / 0.2)


def adaptive(deviations: float) -> AdaptiveDmaxRule:
    return AdaptiveDmaxRule(known_of(Options("Survey")), Pace(1.0, 0.0, 0.9), deviations)


@pytest.mark.parametrize("ratio", [0.8, 1.0, 1.5])
def test_adaptive_scales_the_way_home_by_what_driving_took(ratio: float) -> None:
    silent, mixed = np.zeros(60), np.tile([1.0, 0.0], 30)
    for sensing in (silent, mixed):
        _, scale = drive(adaptive(0.0), np.full(60, ratio), sensing)
        assert scale == pytest.approx(ratio, abs=0.03)


def test_adaptive_keeps_more_back_where_consumption_varies() -> None:
    steady, varied = np.full(60, 1.2), np.tile([0.9, 1.5], 30)
    silent = np.zeros(60)
    no_reserve = drive(adaptive(0.0), steady, silent)[1]
    assert drive(adaptive(1.0), steady, silent)[1] == pytest.approx(no_reserve + 0.1, abs=1e-3)
    assert drive(adaptive(1.0), varied, silent)[1] == pytest.approx(
        no_reserve + np.hypot(0.1, 0.3), abs=0.02
    )


def test_a_mission_that_begins_finds_nothing_of_the_one_before() -> None:
    options = Options("Survey")
    env = HomewardVectorEnv(**vars(options))
    used, fresh = make_policy("dmax_adaptive", env), make_policy("dmax_adaptive", env)
    run_episodes(used, options, episode_seeds(3, 4))
    seeds = episode_seeds(4, 4)
    again, first = (run_episodes(policy, options, seeds).episodes for policy in (used, fresh))
    np.testing.assert_array_equal(again.score, first.score)
    np.testing.assert_array_equal(again.energy_left_j, first.energy_left_j)


def test_adaptive_beats_half_a_charge_on_uncertain_surveys() -> None:
    options = Options("Survey", difficulty="uncertain")
    gain = episodes("dmax_adaptive", options, 200).score - episodes("soc50", options, 200).score
    assert gain.mean() > 3.0 * gain.std() / np.sqrt(len(gain))
