"""Curves of score against stranding: read at equal stranding, and never better for being asked for
more safety."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward.agents import AGENTS, make_policy
from homeward.agents.evaluation import Run, episode_seeds, run_episodes
from homeward.agents.evaluation.tradeoff import LEVELS, Curve, curve_of, margins_png
from homeward.agents.registry import FROM_FILES, SWEPT
from homeward.agents.rules.reserves import RESERVES
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv
from tests.agents.evaluation.runs import made_up

POINTS = st.lists(st.tuples(st.floats(0.0, 1e3), st.floats(0.0, 1.0)), min_size=1, max_size=8)


def curve(points: list[tuple[float, float]]) -> Curve:
    return Curve(
        tuple(range(len(points))), tuple(s for s, _ in points), tuple(lost for _, lost in points)
    )


def test_between_two_reserves_it_is_interpolated() -> None:
    both = curve([(12.0, 0.02), (10.0, 0.0)])
    assert [both.at(level) for level in (0.0, 0.005, 0.01, 0.02, 0.5)] == [
        10.0,
        10.5,
        11.0,
        12.0,
        12.0,
    ]


def test_where_every_reserve_strands_more_there_is_none() -> None:
    assert curve([(12.0, 0.02), (10.0, 0.01)]).at(0.009) is None
    assert curve([(12.0, 0.02)]).at(0.02) == 12.0
    assert curve([(12.0, 0.02)]).at(0.019) is None


def test_interpolation_never_leaves_its_interval() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        (low, high), (few, many) = (
            np.sort(rng.uniform(0.0, 1e3, 2)),
            np.sort(rng.uniform(0.0, 1.0, 2)),
        )
        between = curve([(low, few), (high, many)]).at(float(np.nextafter(many, 0.0)))
        assert between is not None and low <= between <= high


def test_of_reserves_that_strand_alike_the_best_counts() -> None:
    for points in (
        [(12.0, 0.0), (10.0, 0.0), (11.0, 0.02)],
        [(10.0, 0.0), (12.0, 0.0), (11.0, 0.02)],
    ):
        assert [curve(points).at(level) for level in (0.0, 0.01, 0.02)] == [12.0, 12.0, 12.0]


@given(POINTS, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_more_stranding_never_costs_and_the_order_of_reserves_does_not_matter(
    points: list[tuple[float, float]], one: float, other: float
) -> None:
    less, more = sorted((one, other))
    low, high = curve(points).at(less), curve(points).at(more)
    assert low is None or (high is not None and low <= high)
    assert curve(points[::-1]).at(less) == low
    reached = [score for score, lost in points if lost <= less]
    assert (low is None) == (not reached)
    assert low is None or max(reached) <= low <= max(score for score, _ in points)


def test_a_curve_has_the_mean_over_missions_and_training_seeds() -> None:
    runs: dict[float | None, list[Run]] = {
        1.0: [made_up([2.0, 4.0]), made_up([6.0, 8.0])],
        0.0: [made_up([9.0, 9.0], [True, False]), made_up([9.0, 9.0])],
    }
    assert curve_of(runs) == Curve((1.0, 0.0), (5.0, 6.75), (0.0, 0.25))
    assert curve_of({None: [made_up([1.0])]}) == Curve((None,), (1.0,), (0.0,))


def test_a_picture_shows_whatever_curves_there_are() -> None:
    curves = {
        "a": curve([(12.0, 0.5), (10.0, 0.0)]),
        "b": Curve((None,), (3.0,), (0.0,)),
        "c": curve([(0.0, 1.0)]),
    }
    for mission in ("OutAndBack", "Survey", "Patrol"):
        assert margins_png(curves, mission, "title").startswith(b"\x89PNG")


def test_every_agent_with_a_reserve_is_swept_around_what_was_tuned() -> None:
    assert set(SWEPT) == set(AGENTS) - FROM_FILES - {"random"}
    assert len({len(reserves) for reserves in SWEPT.values()}) == 1
    for name, reserves in SWEPT.items():
        assert list(reserves) == sorted(set(reserves))
        for tuned in RESERVES.get(name, {"": 0.5}).values():
            assert reserves[0] <= tuned <= reserves[-1]


@pytest.mark.parametrize(
    "name", ["soc50", "dmax", "dmax_mapped", "dmax_adaptive", "dmax_belief", "planner"]
)
def test_more_reserve_leaves_more_energy_and_strands_no_more(name: str) -> None:
    options, seeds = (
        Options("OutAndBack", difficulty="uncertain", decision_s=120.0),
        episode_seeds(4, 24),
    )
    env = HomewardVectorEnv(**vars(options))
    runs = [
        run_episodes(make_policy(name, env, reserve=reserve), options, seeds).episodes
        for reserve in (SWEPT[name][0], SWEPT[name][6], SWEPT[name][-1])
    ]
    left = [one.energy_left_j.mean() for one in runs]
    assert left == sorted(left) and left[0] < left[2]
    stranded = [one.stranded.sum() for one in runs]
    assert stranded == sorted(stranded, reverse=True)
    assert runs[2].furthest_m.mean() < runs[0].furthest_m.mean()


def test_levels_of_stranding_are_in_order() -> None:
    assert list(LEVELS) == sorted(LEVELS) and LEVELS[0] > 0.0 and LEVELS[-1] < 1.0
    assert np.isfinite(LEVELS).all()
