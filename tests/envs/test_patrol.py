"""Patrol: posts in turns, with pit stops; laps count at home."""

from __future__ import annotations

from typing import Any

import pytest

from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from tests.envs.rollouts import drive, feature, make, mission


class TestPatrol:
    def patrol(self, **options: Any) -> HomewardEnv:
        env = make(
            "Patrol", **{"difficulty": "known", "shaping": "none", "decision_s": 30.0} | options
        )
        env.reset(seed=0)
        return env

    def test_posts_are_served_in_turns_with_pit_stops(self) -> None:
        """At top speed a leg takes 4 decisions and a pit stop 2."""
        env = self.patrol()
        shared = env.batch.known.shared[0]
        length_m = float(shared["length_m"])
        assert (length_m, float(shared["pit_stop_s"])) == pytest.approx((120.0, 60.0))
        steps = list(drive(env, [[4, 0, GO]] * 18))
        positions = [step.info["position_m"] / 30.0 for step in steps]
        assert positions == pytest.approx([1, 2, 3, 4, 4, 4, 3, 2, 1, 0, 0, 0, 1, 2, 3, 4, 4, 4])
        laps = [step.info["score"] for step in steps]
        assert laps == [0] * 3 + [0.5] * 6 + [1.0] * 6 + [1.5] * 3
        pit_stops = [feature(step.observation, "pit_stop") for step in steps]
        assert pit_stops == pytest.approx([0, 0, 0, 2, 1, 0, 0, 0, 0, 2, 1, 0, 0, 0, 0, 2, 1, 0])
        assert not any(step.info["home"] for step in steps)
        outbound = [feature(step.observation, "outbound") for step in steps]
        assert outbound == [1] * 3 + [-1] * 6 + [1] * 6 + [-1] * 3

    @pytest.mark.parametrize("mode", [STOP, GO])
    def test_a_pit_stop_cannot_be_cut_short_nor_begun_early(self, mode: int) -> None:
        env = self.patrol()
        *_, arrived = drive(env, [[4, 0, GO]] * 4)
        assert feature(arrived.observation, "pit_stop") == pytest.approx(2.0)
        waiting = list(drive(env, [[4, 0, mode]] * 2))
        assert all(step.info["position_m"] == arrived.info["position_m"] for step in waiting)
        assert feature(waiting[-1].observation, "pit_stop") == 0.0
        *_, gone = drive(env, [[4, 0, GO]])
        assert gone.info["position_m"] == pytest.approx(90.0)

    def test_stopping_on_the_way_is_no_pit_stop(self) -> None:
        env = self.patrol()
        list(drive(env, [[4, 0, GO]] * 3 + [[4, 0, STOP]] * 10))
        *_, arrived = drive(env, [[4, 0, GO]])
        assert arrived.info["score"] == 0.5 and feature(
            arrived.observation, "pit_stop"
        ) == pytest.approx(2.0)

    def test_laps_count_at_home(self) -> None:
        env = self.patrol()
        *_, last = drive(env, [[4, 0, GO]] * 16 + [[4, 0, RETURN]] * 8)
        assert last.info["home"] and last.info["score"] == 2.0
        assert last.reward == pytest.approx(2.0 / float(env.batch.known.shared["score_scale"][0]))

    def test_a_leg_that_is_broken_off_does_not_count(self) -> None:
        env = self.patrol()
        # 90 m of the 120 m of the third leg
        *_, last = drive(env, [[4, 0, GO]] * 15 + [[4, 0, RETURN]] * 8)
        assert last.info["home"] and last.info["score"] == 1.0

    def test_the_return_leaves_a_pit_stop(self) -> None:
        """Once it is final, in the third decision; a return that is taken back would cut pit stops
        short."""
        env = self.patrol()
        *_, last = drive(env, [[4, 0, GO]] * 3 + [[3, 0, GO]] + [[4, 0, GO]])
        assert (
            last.info["position_m"] == pytest.approx(120.0)
            and feature(last.observation, "pit_stop") > 1.2
        )
        *_, last = drive(env, [[4, 0, RETURN]] * 1)
        assert (
            last.info["position_m"] == pytest.approx(120.0)
            and feature(last.observation, "pit_stop") > 0.2
        )
        *_, last = drive(env, [[4, 0, RETURN]] * 2)
        assert mission(env)["returning"] and feature(last.observation, "pit_stop") == 0.0
        *_, last = drive(env, [[4, 0, RETURN]] * 4)
        assert last.info["home"] and last.info["score"] == 1.0

    def test_a_return_at_the_home_post_ends_the_mission(self) -> None:
        env = self.patrol()
        *_, post = drive(env, [[4, 0, GO]] * 10)
        assert post.info["position_m"] == 0.0 and not post.terminated
        *waits, last = drive(env, [[4, 0, RETURN]] * 3)
        assert not any(step.terminated for step in waits) and len(waits) == 2
        assert last.info["home"] and last.info["score"] == 1.0
        # The decision in which the return becomes final takes no time at home.
        assert last.info["energy_j"].total() == waits[-1].info["energy_j"].total()

    def test_many_laps_fit_in_a_decision(self) -> None:
        """The paper's box is far shorter than what a robot drives between two decisions."""
        env = self.patrol(route="box", robot="rusti")
        *_, last = drive(env, [[4, 0, GO]])
        leg_s = 0.38 + float(env.batch.known.shared["pit_stop_s"][0])
        assert last.info["score"] == pytest.approx(0.5 * int((30.0 + leg_s - 0.38) / leg_s))
