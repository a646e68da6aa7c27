"""Identification finds what is hidden from what the observation shows, and the way home takes what it says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.agents.evaluation import episode_seeds
from homeward.agents.identification import Identification
from homeward.envs.features import INDEX
from homeward.envs.options import Options, known_of
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv

MISSIONS = 64
FAST, HALF = 4, 2


def truth(env: HomewardVectorEnv) -> NDArray[np.float64]:
    """The numbers of `identification_kernel.UNKNOWN` as they are, shape (missions, 5)."""
    m, p, nominal = env.batch.records, env.batch.robots, env.batch.known.robot.record()[0]
    gauge = env.batch.known.shared["usable_j"][0] / m["capacity_j"] * (1.0 + m["gauge_bias"])
    weight = gauge * (p["mass_kg"] + p["payload_mass_kg"]) / (nominal["mass_kg"] + nominal["payload_mass_kg"])
    rolling = weight * p["rolling_resistance"] / nominal["rolling_resistance"]
    wind_mps = np.where(env.batch.known.shared["difficulty"][0] > 0, m["wind_mps"], 0.0)
    wind = wind_mps * np.stack((np.cos(m["wind_from_rad"]), np.sin(m["wind_from_rad"])))
    return np.stack((gauge, rolling, weight, *wind), axis=1)


class Drive:
    """Missions that drive out and, later, home, watched by an identification."""

    def __init__(self, count: int = MISSIONS, probes: bool = True, **options: Any) -> None:
        self.options = Options(**{"mission": "OutAndBack", **options})
        self.env = HomewardVectorEnv(count, autoreset_mode="Disabled", **vars(self.options))
        self.observations, _ = self.env.reset(seed=episode_seeds(3, count))
        self.identification = Identification(known_of(self.options))
        self.identification.learn(self.observations, np.ones(count, np.bool_))
        self._probes = probes

    def go(self, decisions: int, mode: int = GO, looks: int = 1) -> None:
        """Go on for some decisions; each observation is shown so often."""
        count = self.env.num_envs
        for _ in range(decisions):
            slow = self.identification.probes & self._probes & (mode == GO)
            actions = np.stack((np.where(slow, HALF, FAST), np.zeros(count, int), np.full(count, mode)), axis=1)
            self.observations, *_ = self.env.step(actions)
            for _ in range(looks):
                self.identification.learn(self.observations, np.zeros(count, np.bool_))

    def seen(self, name: str) -> NDArray[np.float32]:
        return np.asarray(self.observations[:, INDEX[name]])


def test_it_finds_what_is_hidden() -> None:
    drive = Drive()
    before = np.abs(drive.identification.unknown - truth(drive.env))
    drive.go(60)
    after = np.abs(drive.identification.unknown - truth(drive.env))
    assert (np.median(after, axis=0) < [0.01, 0.001, 0.001, 0.02, 0.02]).all()
    assert (np.quantile(after, 0.95, axis=0) < 0.35 * np.quantile(before, 0.95, axis=0)).all()


@pytest.mark.parametrize("probes", [True, False])
def test_a_patrol_to_and_fro_keeps_the_ground_that_it_saw(probes: bool) -> None:
    drive = Drive(mission="Patrol", probes=probes)  # without probes all observations are made on borders of places
    drive.go(80)
    wrong = np.abs(drive.identification.unknown - truth(drive.env))
    assert (np.median(wrong, axis=0) < ([0.001] * 3 + [0.01] * 2 if probes else [0.1] * 3 + [2.0] * 2)).all()
    assert np.median(drive.identification.guesses["error"][:, 0]) < 0.001


def test_nothing_is_learned_from_how_fast_it_came_to_an_end_of_the_route() -> None:
    drive, arrived = Drive(mission="Patrol"), False
    for _ in range(40):
        before_m = drive.identification.position_m
        drive.go(1)
        arrived |= bool(((drive.seen("speed") == 0.0) & (drive.identification.position_m != before_m)).any())
    drives = drive.identification._drives
    assert arrived
    assert (drives["speed_mps"][drives["from_m"] != drives["to_m"]] > 0.0).all()


def test_the_way_home_takes_what_it_says() -> None:
    drive = Drive()
    drive.go(48)
    home, deviation, *_ = drive.identification.look_home(drive.observations, 0.0).T
    energy, by_the_file = drive.seen("energy").copy(), drive.seen("home_cost").copy()
    drive.go(44, RETURN)
    left = drive.seen("distance") > 0.0
    assert (drive.seen("energy") > 0.0).all() and left.all()  # on the road still: nobody's mission is over
    here, *_ = drive.identification.look_home(drive.observations, 0.0).T
    took = energy - drive.seen("energy")
    error = np.abs(home - here - took) / took
    assert np.median(error) < 0.002 and np.quantile(error, 0.95) < 0.02
    assert np.median(np.abs(by_the_file - took) / took) > 100.0 * np.median(error)
    assert (np.abs(home - here - took) < 5.0 * deviation).all()


@pytest.mark.parametrize("robot", ["rusti_computer", "husky"])
def test_it_is_not_surer_than_it_may_be(robot: str) -> None:
    """On the Husky wind hardly shows: a wrong one may explain a drive nearly as well, and has to be kept in mind."""
    drive = Drive(512, robot=robot)
    drive.go(56)
    home, deviation, *_ = drive.identification.look_home(drive.observations, 0.0).T
    energy = drive.seen("energy").copy()
    drive.go(48, RETURN)
    here, *_ = drive.identification.look_home(drive.observations, 0.0).T
    took = energy - drive.seen("energy")
    short = (took + here - home) / deviation
    assert (drive.seen("energy") > 0.0).all() and (drive.seen("distance") > 0.0).all()
    assert (short > 4.0).mean() < 0.01


def test_a_change_of_speed_tells_the_wind_from_its_mirror_image() -> None:
    errors = []
    for probes in (False, True):
        drive = Drive(256, probes)
        drive.go(56)
        errors.append(np.abs(drive.identification.unknown - truth(drive.env))[:, 3:].max(axis=1))
    assert (errors[1] > 0.5).mean() < 0.2 * (errors[0] > 0.5).mean()


def test_nothing_is_found_where_nothing_is_hidden() -> None:
    drive = Drive(difficulty="known")
    drive.go(40)
    np.testing.assert_allclose(drive.identification.unknown[:, :3], 1.0, atol=1e-3)
    home, *_ = drive.identification.look_home(drive.observations, 0.0).T
    np.testing.assert_allclose(home, drive.seen("home_cost"), rtol=2e-3)


def test_where_the_ground_changes_the_way_home_takes_about_what_it_says() -> None:
    """At harsh the ground is rough in patches, which no number explains."""
    drive = Drive(difficulty="harsh")
    drive.go(40)
    home, *_ = drive.identification.look_home(drive.observations, 0.0).T
    energy, by_the_file = drive.seen("energy").copy(), drive.seen("home_cost").copy()
    drive.go(30, RETURN)
    assert (drive.seen("energy") > 0.0).all() and (drive.seen("distance") > 0.0).all()
    here, *_ = drive.identification.look_home(drive.observations, 0.0).T
    took = energy - drive.seen("energy")
    error = np.median(np.abs(home - here - took) / took)
    assert error < 0.1
    assert error < 0.4 * np.median(np.abs(by_the_file - drive.seen("home_cost") - took) / took)


def test_what_is_shown_twice_counts_once() -> None:
    once, twice = Drive(8), Drive(8)
    once.go(30)
    twice.go(30, looks=2)
    np.testing.assert_array_equal(once.identification.unknown, twice.identification.unknown)


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey"])
def test_a_mission_is_identified_alike_alone_and_among_others(mission: str) -> None:
    together, alone = Drive(4, mission=mission), Drive(1, mission=mission)
    together.go(30)
    alone.go(30)
    np.testing.assert_array_equal(together.identification.unknown[:1], alone.identification.unknown)


def test_a_new_mission_begins_from_what_is_usual() -> None:
    drive = Drive(4)
    first = drive.identification.unknown.copy()
    drive.go(30)
    begun = np.array([True, False, False, False])
    found = drive.identification.unknown.copy()
    drive.observations, _ = drive.env.reset(options={"reset_mask": begun})
    drive.identification.learn(drive.observations, begun)
    np.testing.assert_array_equal(drive.identification.unknown[0], first[0])
    np.testing.assert_array_equal(drive.identification.unknown[1:], found[1:])
