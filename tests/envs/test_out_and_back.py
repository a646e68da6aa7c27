"""Out and back: the furthest distance counts, once home."""

from __future__ import annotations

import itertools
from pathlib import Path
from types import SimpleNamespace

import pytest

from homeward.envs.out_and_back import attainable
from homeward.envs.state import GO, RETURN
from tests.envs.rollouts import drive, make, mission, route_file


class TestOutAndBack:
    def test_the_furthest_distance_counts_once_home(self) -> None:
        env = make("OutAndBack", shaping="none", difficulty="known", decision_s=100.0)
        env.reset(seed=0)
        out = list(drive(env, [[4, 0, GO]] * 4 + [[4, 0, RETURN]] * 2))
        assert [step.info["score"] for step in out] == pytest.approx(
            [100.0, 200.0, 300.0, 400.0, 400.0, 400.0]
        )
        *_, last = drive(env, itertools.repeat([4, 0, GO], 5))
        assert (
            last.info["home"]
            and last.info["position_m"] == 0.0
            and last.info["score"] == pytest.approx(400.0)
        )
        scale = float(env.batch.known.shared["score_scale"][0])
        assert last.reward == pytest.approx(400.0 / scale)

    def test_a_stranded_robot_scores_nothing(self) -> None:
        env = make("OutAndBack", shaping="none")
        env.reset(seed=0)
        assert sum(step.reward for step in drive(env, itertools.repeat([4, 4, GO], 60))) == 0.0
        assert mission(env)["depleted"]

    def test_the_route_ends_where_it_ends(self, tmp_path: Path) -> None:
        path = route_file(tmp_path, "distance_m\n0\n250\n")
        env = make("OutAndBack", route=path, difficulty="known", decision_s=100.0)
        env.reset(seed=0)
        steps = list(drive(env, [[4, 0, GO]] * 5))
        assert [step.info["position_m"] for step in steps] == pytest.approx(
            [100.0, 200.0, 250.0, 250.0, 250.0]
        )
        # It waits at the end: ancillary power only.
        spent_j = steps[-1].info["energy_j"].total() - steps[-2].info["energy_j"].total()
        assert spent_j == pytest.approx(100.0 * 0.5881, rel=1e-3)

    def test_home_is_reached_within_a_step_and_no_more_is_spent(self) -> None:
        env = make("OutAndBack", difficulty="known", decision_s=100.0)
        env.reset(seed=0)
        list(drive(env, [[4, 0, GO], [4, 0, GO], [4, 0, RETURN], [2, 0, RETURN]]))
        before_s = float(mission(env)["time_s"])
        *_, last = drive(env, [[4, 0, RETURN]])
        assert last.terminated and last.info["home"]
        assert mission(env)["time_s"] - before_s == pytest.approx(45.0)

    def test_only_metres_beyond_the_furthest_are_attainable(self) -> None:
        shared = SimpleNamespace(per_out_and_home_j_per_m=0.1, length_m=500.0)
        turned = SimpleNamespace(position_m=100.0, furthest_m=130.0)
        assert attainable(turned, None, shared, 800.0) == pytest.approx(100.0 + 80.0 - 130.0)
        assert attainable(turned, None, shared, 200.0) == 0.0
