"""Docks: a robot that stands at one charges, and without docks nothing is different."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.envs.docks import DockError, docks_of, text_of
from homeward.envs.features import DOCK_NAMES, FEATURES, INDEX
from homeward.envs.options import OptionError, Options, known_of
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from tests.envs.rollouts import Step, drive, feature, make, mission, random_actions, windy

LONG_S = 23_000.0


def patrol(docks: Any = ((75.0, 40.0),), **options: Any) -> HomewardEnv:
    """A patrol of 120 m between the posts; at top speed a decision leads 30 m."""
    keywords = {"difficulty": "known", "decision_s": 30.0, "docks": docks, "time_limit_s": LONG_S}
    env = make("Patrol", **keywords | options)
    env.reset(seed=0)
    return env


def resistive(robot: str = "rusti_computer") -> Robot:
    return dataclasses.replace(load_robot(robot), effects={"internal_resistance": {"ohm": 0.5}})


def test_a_stop_drives_on_to_a_dock_within_the_decision_and_charges_there() -> None:
    env = patrol()
    *_, last = drive(env, [[4, 0, GO]] * 2 + [[4, 0, STOP]])
    assert last.info["position_m"] == 75.0
    # Half of the decision's way, and half of its time at the dock, unless the battery is full
    # before.
    supplied_j = -last.info["energy_j"]["charger"]
    assert mission(env)["energy_j"] == mission(env)["capacity_j"] and 0.0 < supplied_j < 40.0 * 15.0
    assert supplied_j == pytest.approx(last.info["energy_j"].total() + supplied_j)


def test_a_stop_out_of_reach_of_a_dock_stands_where_it_is() -> None:
    env = patrol()
    *_, last = drive(env, [[4, 0, GO], [4, 0, STOP]])
    assert last.info["position_m"] == 30.0 and last.info["energy_j"]["charger"] == 0.0
    *_, passed = drive(env, [[4, 0, GO]] * 2)
    # no stop, no charge
    assert passed.info["position_m"] == 90.0 and passed.info["energy_j"]["charger"] == 0.0


def test_a_charge_is_what_the_charger_gives_beyond_the_robot_and_ends_when_the_battery_is_full() -> (
    None
):
    env = patrol(docks=((0.0, 40.0),))
    mission(env)["energy_j"] = 0.5 * mission(env)["capacity_j"]
    start_j, capacity_j = float(mission(env)["energy_j"]), float(mission(env)["capacity_j"])
    first, *_, last = drive(env, [[0, 0, STOP]] * 60)
    idle_j = -first.info["energy_j"]["charger"] + first.info["energy_j"].total()
    assert first.info["energy_j"]["charger"] == pytest.approx(-40.0 * 30.0)
    assert mission(env)["energy_j"] == capacity_j
    assert -last.info["energy_j"].total() == pytest.approx(capacity_j - start_j, rel=1e-9)
    # The charger carries the robot all the time, and charges until the battery is full.
    assert -last.info["energy_j"]["charger"] == pytest.approx(
        capacity_j - start_j + 60.0 * idle_j, rel=1e-9
    )
    assert not last.terminated


def test_the_battery_loses_at_a_charger_what_its_own_model_says() -> None:
    stored = {}
    for name, robot in (("ideal", load_robot("rusti_computer")), ("resistive", resistive())):
        env = patrol(docks=((0.0, 40.0),), robot=robot)
        mission(env)["energy_j"] *= 0.5
        *_, step = drive(env, [[0, 0, STOP]] * 4)
        stored[name] = -step.info["energy_j"].total()
        lost_j = step.info["energy_j"]["internal_resistance"]
    assert lost_j > 0.0 and stored["ideal"] - stored["resistive"] == pytest.approx(lost_j)


@pytest.mark.parametrize("mission_name", ["OutAndBack", "Survey", "Patrol"])
@pytest.mark.parametrize("difficulty", ["known", "harsh"])
def test_the_ledger_closes_and_the_battery_is_never_beyond_full(
    mission_name: str, difficulty: str
) -> None:
    rng = np.random.default_rng(3)
    robot = windy(load_robot("rusti_computer"))
    docks = ((0.0, 60.0), (50.0, 200.0))
    env = make(mission_name, difficulty=difficulty, docks=docks, time_limit_s=LONG_S, robot=robot)
    env.reset(seed=4)
    full_j = float(mission(env)["energy_j"])
    for step in drive(env, random_actions(rng, "discrete", 70, home=0.0)):
        ledger, left_j = step.info["energy_j"], float(mission(env)["energy_j"])
        assert left_j <= float(mission(env)["capacity_j"])
        assert abs(ledger.total() - (full_j - left_j)) <= 1e-9 * full_j
    assert ledger["charger"] < 0.0
    assert env.observation_space.contains(step.observation)


def test_features_of_docks_follow_the_others_and_show_where_they_are() -> None:
    env = patrol(docks=((0.0, 15.0), (75.0, 40.0)))
    assert env.observation_space.shape == (len(FEATURES) + len(DOCK_NAMES),)
    reach_m = float(env.batch.known.shared["reach_m"][0])
    for at_m, out_m, back_m in (
        (30.0, 45.0, 30.0),
        (60.0, 15.0, 60.0),
        (75.0, 0.0, 0.0),
        (105.0, math.inf, 30.0),
    ):
        mode = STOP if at_m == 75.0 else GO
        step = Step(*env.step([4, 0, mode]))
        assert step.info["position_m"] == at_m
        assert feature(step.observation, "dock_out") == pytest.approx(min(out_m / reach_m, 10.0))
        assert feature(step.observation, "dock_back") == pytest.approx(back_m / reach_m)
        to_here, beyond = (
            feature(step.observation, "home_cost"),
            feature(step.observation, "dock_cost"),
        )
        assert 0.0 <= beyond <= to_here and (beyond == to_here) == (at_m < 75.0)
    supplied_j = feature(step.observation, "supplied") * float(
        env.batch.known.shared["usable_j"][0]
    )
    assert supplied_j == pytest.approx(-step.info["energy_j"]["charger"], rel=1e-6)
    # With exact instruments, what was used is what was drawn.
    used = 1.0 - feature(step.observation, "metered") + feature(step.observation, "charged")
    drawn_j = step.info["energy_j"].total() + supplied_j
    assert used == pytest.approx(drawn_j / float(mission(env)["capacity_j"]), abs=1e-6)


def test_a_dock_that_no_mission_uses_changes_nothing_to_the_last_digit() -> None:
    rng = np.random.default_rng(5)
    options: dict[str, Any] = {
        "difficulty": "harsh",
        "time_limit_s": 6_000.0,
        "decision_s": 300.0,
        "autoreset_mode": "SameStep",
    }
    far = ((3_600.0, 15.0),)
    plain, docked = (
        HomewardVectorEnv(6, mission="Survey", docks=docks, **options) for docks in ((), far)
    )
    assert plain.single_observation_space.shape == (len(FEATURES),)
    seen = [env.reset(seed=7)[0][:, : len(FEATURES)] for env in (plain, docked)]
    np.testing.assert_array_equal(seen[0], seen[1])
    for _ in range(40):
        actions = random_actions(rng, "discrete", 6)
        (one, *more, info), (other, *others, _) = plain.step(actions), docked.step(actions)
        np.testing.assert_array_equal(one, other[:, : len(FEATURES)])
        for a, b in zip(more, others, strict=True):
            np.testing.assert_array_equal(a, b)
        assert (info["energy_j"]["charger"] == 0.0).all()


BEFORE_DOCKS = {
    "OutAndBack": (86678.66139799591, 2512.5, 66.20797199755907),
    "Survey": (97012.80371315226, 2282.205245874141, 78.55781255569309),
    "Patrol": (93726.92766570079, 0.0, 59.49635683372617),
}
"""Energy left (J), score and features of four missions, summed, at commit 325159d before there were
docks."""


def test_without_docks_missions_are_those_of_before() -> None:
    rng = np.random.default_rng(9)
    for name, figures in BEFORE_DOCKS.items():
        envs = HomewardVectorEnv(
            4, mission=name, difficulty="harsh", decision_s=300.0, autoreset_mode="Disabled"
        )
        envs.reset(seed=3)
        for _ in range(5):
            modes = rng.choice([STOP, GO], 4, p=[0.3, 0.7])
            observations, *_ = envs.step(np.column_stack((rng.integers(0, 5, (4, 2)), modes)))
        records = envs.batch.records
        now = (
            records["energy_j"].sum(),
            records["score"].sum(),
            observations.astype(np.float64).sum(),
        )
        assert now == pytest.approx(figures, rel=1e-9), name  # processors differ in the last digits


def test_the_viewer_shows_a_charged_battery() -> None:
    env = patrol(docks=((0.0, 60.0),), render_mode="rgb_array")
    for _ in drive(env, [[4, 0, GO]] * 60):
        pass
    picture = env.render()
    assert isinstance(picture, np.ndarray) and picture.ndim == 3


def test_a_mission_with_docks_lasts_for_the_time_limit_and_several_charges() -> None:
    env = patrol(docks=((0.0, 60.0),))
    *_, last = drive(env, [[4, 0, GO]] * 1000)
    used_j = sum(joules for cause, joules in last.info["energy_j"].items() if cause != "charger")
    assert last.truncated and not last.terminated
    assert mission(env)["decisions"] == LONG_S // 30.0
    assert used_j > 2.5 * float(mission(env)["capacity_j"])


def test_a_return_to_a_dock_at_home_ends_the_mission() -> None:
    env = patrol(docks=((0.0, 60.0),))
    *_, last = drive(env, [[4, 0, GO]] * 12 + [[4, 0, RETURN]] * 3)
    assert last.info["home"] and last.info["score"] == 1.0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"docks": ((500.0, 15.0),)}, "a dock at 500 m is not on the route, which ends at 120 m"),
        ({"docks": ((-1.0, 15.0),)}, "a dock at -1 m is not on the route; home is 0 m"),
        ({"docks": ((0.0, 0.0),)}, "the dock at 0 m has 0 W; give a power above 0 W"),
        ({"docks": ((0.0, math.nan),)}, "give a power above 0 W"),
        ({"docks": ((0.0, 0.5),)}, "charges no battery; give more than the 0.588 W"),
        ({"docks": ((0.0, 15.0), (0, 20))}, "two docks are at one position, of 0, 0 m"),
        ({"docks": "0-15"}, "give POSITION:POWER,..."),
        ({"docks": (0.0, 15.0)}, "give pairs of position (m) and power of the charger (W)"),
        (
            {"docks": tuple((float(at_m), 15.0) for at_m in range(9))},
            "9 docks are given; give at most 8",
        ),
        ({"docks": "0:15", "time_limit_s": None}, "docks need a time limit"),
        ({"time_limit_s": 1e6}, "time_limit_s = 1e+06 is not allowed; give 150 to 29018 s"),
    ],
)
def test_docks_that_cannot_be_used_are_refused_in_a_line(
    options: dict[str, Any], says: str
) -> None:
    with pytest.raises(OptionError) as caught:
        known_of(Options("Patrol", **{"time_limit_s": LONG_S} | options))
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_the_text_of_docks_is_read_as_it_is_written() -> None:
    docks = ((0.0, 15.0), (1234.5678, 1e3))
    assert docks_of(text_of(docks)) == docks and docks_of("") == ()
    assert Options("Patrol", docks="120:20,0:15", time_limit_s=LONG_S).docks == (
        (0.0, 15.0),
        (120.0, 20.0),
    )
    with pytest.raises(DockError):
        docks_of("0:15,")


def test_a_dock_beside_a_post_is_at_it() -> None:
    s = known_of(
        Options("Patrol", robot="husky", docks=((0.0, 500.0),), time_limit_s=20_000.0)
    ).shared[0]
    end_m = float(s["length_m"]) * (1.0 + 1e-9)
    s = known_of(
        Options("Patrol", robot="husky", docks=((end_m, 500.0),), time_limit_s=20_000.0)
    ).shared[0]
    assert s["docks"]["position_m"][0] == s["places"] * s["place_m"]


def test_a_gauge_that_rises_at_a_charger_is_believed() -> None:
    env = patrol(docks=((0.0, 60.0),), difficulty="uncertain")
    mission(env)["energy_j"] *= 0.4
    *_, last = drive(env, [[0, 0, STOP]] * 12)
    assert mission(env)["soc_lowest"] >= 0.0
    assert feature(last.observation, "energy") == pytest.approx(
        float(mission(env)["energy_j"] / mission(env)["capacity_j"]), abs=0.01
    )
    assert INDEX["dock_out"] == len(FEATURES)
