"""Information: found on new ground, kept while there is room, sent by radio or carried home."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from homeward.envs.scalar import HomewardEnv
from homeward.envs.sensing import DRIVING_LINK
from homeward.envs.state import GO, RETURN, STOP
from tests.envs.rollouts import drive, feature, make, mission, route_file

EVEN = "distance_m,interest\n0,2\n{length_m},2\n"


def survey(folder: Path, length_m: float = 3200.0, **options: Any) -> HomewardEnv:
    """A survey of even ground, with nothing hidden."""
    path = route_file(folder, EVEN.format(length_m=length_m))
    env = make(
        "Survey",
        **{"route": path, "difficulty": "known", "shaping": "none", "decision_s": 20.0} | options,
    )
    env.reset(seed=0)
    return env


def test_information_of_new_metres_saturates_with_samples_per_metre(tmp_path: Path) -> None:
    """Interest n / (n + n_half) of each metre, whatever the decisions and places that the way is
    cut into."""
    for decision_s, speed, sensing in itertools.product((7.0, 60.0), (1, 2, 4), (1, 2, 4)):
        env = survey(tmp_path, decision_s=decision_s, robot="rusti")
        shared, m = env.batch.known.shared[0], mission(env)
        shared["backlog_limit"] = 1e12
        *_, last = drive(env, [[speed, sensing, GO]] * round(420.0 / decision_s))
        per_m = 25.0 * sensing / (0.1 + 0.9 * speed / 4)
        expected = 2.0 * per_m / (per_m + float(shared["saturation_per_m"])) * m["position_m"]
        assert last.info["score"] == pytest.approx(expected, rel=1e-6)
        assert last.info["score"] < 2.0 * m["position_m"]


def test_driving_over_known_ground_adds_nothing(tmp_path: Path) -> None:
    env = survey(tmp_path)
    *_, out = drive(env, [[2, 4, GO]] * 20)
    *_, back = drive(env, itertools.repeat([2, 4, RETURN], 40))
    assert back.info["home"]
    assert back.info["score"] == pytest.approx(out.info["score"])
    assert back.info["energy_j"]["computer"] > out.info["energy_j"]["computer"]


def test_standing_adds_nothing(tmp_path: Path) -> None:
    env = survey(tmp_path)
    *_, out = drive(env, [[2, 2, GO]] * 3)
    *_, stood = drive(env, [[2, 4, STOP]] * 3)
    assert stood.info["score"] == pytest.approx(out.info["score"])


def test_what_the_memory_cannot_hold_is_lost(tmp_path: Path) -> None:
    env = survey(tmp_path, decision_s=60.0)
    shared, m = env.batch.known.shared[0], mission(env)
    kept = []
    for _ in range(30):
        observation, *_, info = env.step([1, 4, GO])
        assert m["backlog"] <= shared["backlog_limit"] * (1.0 + 1e-12)
        assert info["score"] == pytest.approx(m["delivered"] + m["backlog_information"])
        kept.append((float(m["lost"]), feature(observation, "backlog")))
    lost = [value for value, _ in kept]
    full = [backlog > 0.9 for _, backlog in kept]
    assert lost[0] == 0.0 and lost[-1] > 0.0 and np.all(np.diff(lost) >= 0.0)
    assert full[-1] and not full[0]


def test_nothing_sensed_is_nothing_known(tmp_path: Path) -> None:
    env = survey(tmp_path)
    steps = list(drive(env, [[4, 0, GO]] * 10 + [[4, 0, RETURN]] * 20))
    assert steps[-1].info["home"] and steps[-1].info["score"] == 0.0
    assert mission(env)["backlog"] == mission(env)["lost"] == 0.0
    assert steps[-1].info["energy_j"]["computer"] == 0.0


def sent(folder: Path, distance_m: float, mode: int) -> float:
    """Samples sent in a decision that begins at a distance with many on board."""
    env = survey(folder, decision_s=1.0)
    m = mission(env)
    m["position_m"], m["place"], m["backlog"], m["backlog_information"] = distance_m, 0, 5e4, 100.0
    env.batch.records["place"] = env.batch.records["mapped"] = 0
    place_m = float(env.batch.known.shared["place_m"][0])
    env.batch.records["place"] = int(distance_m // place_m)
    env.batch.records["mapped"] = int(distance_m // place_m) + 1
    before = float(env.batch.records["backlog"][0])
    env.step([0, 0, mode])
    after = float(env.batch.records["backlog"][0])
    shares = float(env.batch.records["delivered"][0]) / 100.0, (before - after) / before
    assert shares[0] == pytest.approx(shares[1])
    return before - after


def test_the_radio_is_slower_far_away_and_while_driving(tmp_path: Path) -> None:
    env = survey(tmp_path)
    shared = env.batch.known.shared[0]
    radio_hz, link_m = float(shared["radio_hz"]), float(shared["link_m"])
    for distance_m in (0.0, link_m, 3.0 * link_m):
        standing = sent(tmp_path, distance_m, STOP)
        assert standing == pytest.approx(radio_hz / (1.0 + (distance_m / link_m) ** 2), rel=1e-6)
        assert sent(tmp_path, distance_m, GO) == pytest.approx(DRIVING_LINK * standing, rel=1e-3)


def test_information_is_sent_or_carried_home(tmp_path: Path) -> None:
    env = survey(tmp_path)
    m = mission(env)
    list(drive(env, [[4, 3, GO]] * 10))
    before = float(m["delivered"] + m["backlog_information"])
    delivered = float(m["delivered"])
    list(drive(env, [[0, 0, STOP]] * 5))
    assert m["delivered"] > delivered
    assert m["delivered"] + m["backlog_information"] == pytest.approx(before)
    *_, last = drive(env, itertools.repeat([4, 0, RETURN], 60))
    assert last.info["home"] and last.info["score"] == pytest.approx(before)
    assert last.reward == pytest.approx(before / float(env.batch.known.shared["score_scale"][0]))


def test_hot_spots_are_worth_more(tmp_path: Path) -> None:
    scores = []
    for interest in (1, 3):
        path = route_file(
            tmp_path, f"distance_m,interest\n0,{interest}\n3200,{interest}\n", f"{interest}.csv"
        )
        env = survey(tmp_path, route=path)
        *_, last = drive(env, [[4, 2, GO]] * 10)
        scores.append(last.info["score"])
    assert scores[1] == pytest.approx(3.0 * scores[0])
