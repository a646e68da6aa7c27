"""The belief finds what is hidden from what is observed alone, and the way home takes what it
says."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward import load_robot
from homeward.agents import make_policy
from homeward.agents.belief import Belief, prior_of
from homeward.agents.evaluation import run_episodes
from homeward.agents.shield import Shield
from homeward.agents.shield.reckless import Onward
from homeward.companion.prior_knowledge import known_of as companion_knows
from homeward.envs.actions import encode_actions
from homeward.envs.features import INDEX, NAMES
from homeward.envs.options import Options, known_of
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.estimation import MARGIN_DTYPE, Prior
from homeward.estimation.prior import (
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    PER_CAPACITY,
    ROLLING,
    WEIGHT,
)

MISSED = 0.02
SEED = 7_000_001
"""Of missions that nothing was tuned on."""
RISK = 1e-3
Array = NDArray[np.float64]
Records = NDArray[np.void]


class Drive:
    """Missions that drive out at top speed, as a rule looking back, and what is believed of
    them."""

    def __init__(
        self, count: int, mission: str = "OutAndBack", *, looks_back: bool = True, **options: Any
    ) -> None:
        self.options = Options(mission, **options)
        self.env = HomewardVectorEnv(count, autoreset_mode="Disabled", **vars(self.options))
        self.known = known_of(self.options)
        self.count, self._looks_back = count, looks_back
        self.belief = Belief(self.known, MISSED)
        self.observations, _ = self.env.reset(seed=SEED)
        self.belief.learn(self.observations, np.ones(count, np.bool_))

    def go(self, decisions: int, mode: int = GO, looks: int = 1, sensing_hz: float = 0.0) -> Drive:
        """Go on for some decisions; each observation is shown so often."""
        for _ in range(decisions):
            s = self.known.shared[0]
            actions = encode_actions(
                self.known, s["cruise_mps"], sensing_hz, np.full(self.count, mode)
            )
            if self._looks_back:
                actions[self.belief.looks_back(self.observations)] = self.belief.back_action
            self.observations, *_ = self.env.step(actions)
            for _ in range(looks):
                self.belief.learn(self.observations, np.zeros(self.count, np.bool_))
        return self

    def now(self) -> Records:
        """What heading home now leaves, `MARGIN_DTYPE`."""
        return np.asarray(self.belief.margin(self.belief.plans(self.observations), RISK).total)

    def way_home_j(self) -> Array:
        """What the way home takes in truth, J; the missions stay as they are, with a battery that
        suffices."""
        env = copy.deepcopy(self.env)
        m = env.batch.records
        m["energy_j"] = m["capacity_j"] = 1e3 * m["capacity_j"]
        before_j = m["energy_j"].copy()
        actions = encode_actions(
            self.known, np.full(self.count, self.known.shared["cruise_mps"][0]), 0.0, RETURN
        )
        for _ in range(int(self.known.shared["max_decisions"][0])):
            if m["over"].all():
                break
            env.batch.step(actions, np.empty_like(self.observations), *self._results())
        assert m["home"].all()
        return np.asarray(before_j - m["energy_j"])

    def _results(self) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        return np.empty(self.count), np.empty(self.count, np.bool_), np.empty(self.count, np.bool_)


def state(belief: Belief) -> bytes:
    return bytes(belief.estimator.state.tobytes())


@pytest.mark.parametrize(
    ("instruments", "weather", "difficulty", "typical", "most"),
    [
        ("exact", "still", "uncertain", 0.045, 0.18),
        ("meter", "changing", "uncertain", 0.045, 0.19),
        ("gauge", "changing", "uncertain", 0.06, 0.21),
        ("gauge", "changing", "harsh", 0.06, 0.24),
    ],
)
def test_the_way_home_takes_what_it_says(
    instruments: str, weather: str, difficulty: str, typical: float, most: float
) -> None:
    drive = Drive(300, instruments=instruments, weather=weather, difficulty=difficulty).go(45)
    m, total, home_j = drive.env.batch.records, drive.now(), drive.way_home_j()
    error = home_j / m["capacity_j"] - total["cost_share"]
    size = np.abs(error) / total["cost_share"]
    assert np.median(size) < typical
    assert np.quantile(size, 0.95) < most
    assert np.abs(error.mean()) < 0.01
    # Neither surer than it may be nor much less sure.
    assert (np.abs(error) < 1.645 * total["cost_share_sd"]).mean() > 0.78
    assert total["cost_share_sd"].mean() < 5.0 * np.sqrt(np.mean(error**2))
    margin_j = (m["energy_j"] - home_j) * m["meter_gain"]
    assert (margin_j < total["margin_low_j"]).mean() < 0.03
    by_the_file = np.abs(
        drive.observations[:, INDEX["home_cost"]] * drive.known.shared["usable_j"][0] - home_j
    )
    assert np.median(np.abs(error * m["capacity_j"])) < 0.4 * np.median(by_the_file)


@pytest.mark.parametrize("robot", ["husky", "jackal"])
def test_it_is_not_surer_than_it_may_be_of_robots_on_which_wind_hardly_shows(robot: str) -> None:
    drive = Drive(200, robot=robot).go(50)
    m, total = drive.env.batch.records, drive.now()
    short = (drive.way_home_j() / m["capacity_j"] - total["cost_share"]) / total["cost_share_sd"]
    assert (short > 4.0).mean() <= 0.02


def test_it_finds_the_robot_and_the_wind() -> None:
    drive = Drive(200, instruments="exact", weather="still")
    before = drive.belief.estimate().mean.copy()
    after = drive.go(60).belief.estimate().mean
    m, p, nominal = drive.env.batch.records, drive.env.batch.robots, drive.known.robot.record()[0]
    mass = (p["mass_kg"] + p["payload_mass_kg"]) / (nominal["mass_kg"] + nominal["payload_mass_kg"])
    truth = {
        PER_CAPACITY: drive.known.shared["usable_j"][0] / m["capacity_j"],
        ROLLING: mass * p["rolling_resistance"] / nominal["rolling_resistance"],
        WEIGHT: mass,
        EAST: m["mean_east_mps"],
        NORTH: m["mean_north_mps"],
    }
    for which, true in truth.items():
        gusts = {EAST: GUST_EAST, NORTH: GUST_NORTH}
        found = [
            one[:, which] + (one[:, gusts[which]] if which in gusts else 0.0)
            for one in (before, after)
        ]
        wrong = [np.median(np.abs(one - true)) for one in found]
        assert wrong[1] < (0.9 if which in gusts else 0.5) * wrong[0]
    assert np.median(np.abs(after[:, PER_CAPACITY] - truth[PER_CAPACITY])) < 1e-3


def test_a_look_back_helps_to_tell_wind_from_rolling() -> None:
    wrong = []
    for looks_back in (False, True):
        drive = Drive(200, looks_back=looks_back, instruments="exact", weather="still").go(56)
        m, mean = drive.env.batch.records, drive.belief.estimate().mean
        east = mean[:, EAST] + mean[:, GUST_EAST] - m["mean_east_mps"]
        north = mean[:, NORTH] + mean[:, GUST_NORTH] - m["mean_north_mps"]
        wrong.append(np.hypot(east, north))
    assert np.mean(wrong[1]) < np.mean(wrong[0])


def test_nothing_is_doubted_where_nothing_is_hidden() -> None:
    drive = Drive(64, difficulty="known").go(40)
    mean, total = drive.belief.estimate().mean, drive.now()
    np.testing.assert_allclose(mean[:, [GAIN, ROLLING, WEIGHT, PER_CAPACITY]], 1.0, atol=1e-3)
    assert not drive.belief.looks_back(drive.observations).any()
    full_j, m = drive.known.shared["usable_j"][0], drive.env.batch.records
    np.testing.assert_allclose(total["left_j"], m["energy_j"], atol=2e-3 * full_j)
    np.testing.assert_allclose(total["cost_j"], drive.way_home_j(), atol=3e-3 * full_j)
    assert (total["margin_sd_j"] < 3e-3 * full_j).all()


def test_on_the_way_home_it_stays_right() -> None:
    drive = Drive(200).go(45).go(25, RETURN)
    m, total = drive.env.batch.records, drive.now()
    assert (~m["over"]).all()
    error = drive.way_home_j() / m["capacity_j"] - total["cost_share"]
    assert np.median(np.abs(error)) < 0.005
    assert (np.abs(error) < 1.645 * total["cost_share_sd"]).mean() > 0.75


def test_a_patrol_to_and_fro_is_learned_from() -> None:
    drive = Drive(64, "Patrol", looks_back=False, instruments="exact", weather="still")
    before = np.abs(drive.belief.estimate().mean[:, ROLLING] - _rolling(drive))
    drive.go(80)
    mean = drive.belief.estimate().mean
    assert np.median(np.abs(mean[:, ROLLING] - _rolling(drive))) < 0.5 * np.median(before)
    usable_j = drive.known.shared["usable_j"][0]
    assert (
        np.median(
            np.abs(mean[:, PER_CAPACITY] * drive.env.batch.records["capacity_j"] / usable_j - 1.0)
        )
        < 2e-3
    )


def _rolling(drive: Drive) -> Array:
    p, nominal = drive.env.batch.robots, drive.known.robot
    mass = (p["mass_kg"] + p["payload_mass_kg"]) / nominal.mass_kg
    return np.asarray(mass * p["rolling_resistance"] / nominal.rolling_resistance)


@pytest.mark.parametrize("difficulty", ["uncertain", "harsh"])
def test_missions_that_show_the_same_are_believed_the_same(difficulty: str) -> None:
    """What differs is hidden: the ground and the weather that are still to come."""
    one, other = (Drive(16, difficulty=difficulty).go(20) for _ in range(2))
    batch = other.env.batch
    far = batch.routes["places"][:, 50:]
    far["sin_grade"], far["roughness"], far["interest"] = 0.1, 1.0, 9.0
    batch.records["gust_kick"] *= 3.0  # from the next decision on
    assert state(one.belief) == state(other.belief)
    plans = [drive.belief.plans(drive.observations) for drive in (one, other)]
    totals = [
        drive.belief.margin(plan, RISK).total
        for drive, plan in zip((one, other), plans, strict=True)
    ]
    assert totals[0].tobytes() == totals[1].tobytes()
    for drive in (one, other):
        drive.go(1)
    # gusts change after the decision
    np.testing.assert_array_equal(one.observations, other.observations)
    assert state(one.belief) == state(other.belief)
    one.go(10)
    other.go(10)
    assert state(one.belief) != state(other.belief)  # by now it shows


@pytest.mark.parametrize(
    "hidden",
    [
        {"true_robot": "jackal", "scaled_for": "rusti_computer"},
        {"route": "hidden_wind"},
        {"route": "hidden_wind", "difficulty": "harsh"},
    ],
)
def test_what_is_known_beforehand_does_not_tell_what_is_hidden(hidden: dict[str, Any]) -> None:
    plain = {name: value for name, value in hidden.items() if name == "difficulty"}
    there, here = known_of(Options("Survey", **hidden)), known_of(Options("Survey", **plain))
    assert there.shared.tobytes() == here.shared.tobytes()
    assert (there.robot, there.difficulty, there.instruments) == (
        here.robot,
        here.difficulty,
        here.instruments,
    )
    assert prior_of(there, MISSED) == prior_of(here, MISSED)


def test_generic_priors_are_those_of_uncertain_missions() -> None:
    """Estimation and companion know no environments, so that they have these numbers of their
    own."""
    unsure = dataclasses.replace(load_robot("rusti"), uncertainty=None)
    own = ("slope_within_place", "slope_offset", "model_knows_slopes", "model_error", "soc_error")
    for generic, instruments in (
        (Prior(), "exact"),
        (companion_knows(unsure, True).prior, "meter"),
    ):
        missions = prior_of(
            known_of(Options("OutAndBack", instruments=instruments)), generic.missed
        )
        for name, value in generic._asdict().items():
            assert name in own or value == pytest.approx(getattr(missions, name), rel=5e-3), name


def test_it_follows_from_the_observations_alone() -> None:
    """Replayed to another belief, made from what is known without an environment, they lead to the
    same."""
    drive = Drive(8, difficulty="harsh")
    again = Belief(pickle.loads(pickle.dumps(known_of(drive.options))), MISSED)
    again.learn(drive.observations, np.ones(8, np.bool_))
    for _ in range(30):
        drive.go(1)
        again.learn(drive.observations.copy(), np.zeros(8, np.bool_))
    assert state(again) == state(drive.belief)


@pytest.mark.parametrize("instruments", ["exact", "gauge"])
@pytest.mark.parametrize("mission", ["OutAndBack", "Patrol"])
def test_what_is_shown_twice_counts_once(mission: str, instruments: str) -> None:
    once, twice = (
        Drive(8, mission, instruments=instruments).go(30, looks=looks) for looks in (1, 2)
    )
    assert state(once.belief) == state(twice.belief)


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey", "Patrol"])
def test_a_mission_is_believed_alike_alone_and_among_others(mission: str) -> None:
    together, alone = (Drive(count, mission).go(30, sensing_hz=50.0) for count in (4, 1))
    assert together.belief.estimator.state[:1].tobytes() == state(alone.belief)


def test_a_new_mission_begins_anew_and_leaves_the_others() -> None:
    drive = Drive(4).go(30)
    begun = np.array([True, False, False, False])
    before = drive.belief.estimator.state.copy()
    drive.observations, _ = drive.env.reset(options={"reset_mask": begun})
    drive.belief.learn(drive.observations, begun)
    fresh = Belief(drive.known, MISSED)
    fresh.learn(drive.observations[:1], np.ones(1, np.bool_))
    assert drive.belief.estimator.state[:1].tobytes() == state(fresh)
    assert drive.belief.estimator.state[1:].tobytes() == before[1:].tobytes()
    drive.go(20)
    assert (drive.now()["margin_sd_j"] > 0.0).all() and np.isfinite(drive.now()["cost_j"]).all()


@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))], ids=["copy", "pickle"]
)
@pytest.mark.parametrize("name", ["dmax_belief", "planner", "dmax_adaptive", "shield"])
def test_copied_policies_go_on_alike(name: str, copied: Any) -> None:
    options = Options("Survey")
    env = HomewardVectorEnv(8, **vars(options))
    bare = make_policy("soc50" if name == "shield" else name, env)
    policy: Any = Shield(bare, env.batch.known) if name == "shield" else bare
    observations, _ = env.reset(seed=SEED)
    begun, twin = np.ones(8, np.bool_), None
    for decision in range(40):
        if decision == 15:
            twin = copied(policy)
        actions = policy.act(observations, begun)
        if twin is not None:
            np.testing.assert_array_equal(twin.act(observations.copy(), begun), actions)
        observations, _, terminated, truncated, _ = env.step(actions)
        begun = terminated | truncated


def test_to_stand_still_is_learned_from_and_breaks_nothing() -> None:
    drive = Drive(32).go(10).go(20, STOP, sensing_hz=50.0).go(10)
    total = drive.now()
    assert all(np.isfinite(total[name]).all() for name in MARGIN_DTYPE.names or ())
    error = drive.way_home_j() / drive.env.batch.records["capacity_j"] - total["cost_share"]
    size = np.abs(error) / total["cost_share_sd"]
    assert np.quantile(size, 0.9) < 2.5
    assert (size < 7.0).all()


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey", "Patrol"])
@pytest.mark.parametrize("difficulty", ["known", "uncertain", "harsh"])
def test_observations_that_cannot_be_leave_numbers(mission: str, difficulty: str) -> None:
    rng, belief = (
        np.random.default_rng(3),
        Belief(known_of(Options(mission, difficulty=difficulty)), MISSED),
    )
    for decision in range(30):
        observations = rng.uniform(-10.0, 10.0, (64, len(NAMES))).astype(np.float32)
        observations[:, INDEX["time"]] = decision / 400.0
        observations[:, INDEX["distance"]] = np.abs(observations[:, INDEX["distance"]])
        belief.learn(observations, np.full(64, decision == 0))
        total = belief.margin(belief.plans(observations), RISK).total
        assert all(np.isfinite(total[name]).all() for name in MARGIN_DTYPE.names or ())


def test_what_is_shown_twice_at_the_start_is_read_none_the_less() -> None:
    """Nothing is taken in where a mission begins; the slope there must be read by the next
    decision."""
    once, twice = Drive(8), Drive(8)
    twice.belief.learn(twice.observations, np.zeros(8, np.bool_))
    for drive in (once, twice):
        drive.go(3)
    np.testing.assert_array_equal(
        once.belief.estimator.state["places"], twice.belief.estimator.state["places"]
    )
    assert (once.belief.estimator.state["places"]["readings"][:, 0] == 1.0).all()


def test_it_never_looks_back_where_one_decision_makes_a_return_final() -> None:
    drive = Drive(8, decision_s=120.0)
    assert drive.known.shared["return_decisions"][0] == 1
    for _ in range(20):
        assert not drive.belief.looks_back(drive.observations).any()
        drive.go(1)


def weights(belief: Belief) -> Array:
    return np.asarray(np.exp(belief.estimator.state["hypotheses"]["log_weight"]))


def test_a_stand_says_nothing_about_the_wind() -> None:
    """Whether it coasted is asked once for all hypotheses: by noise alone, one of them took all
    weight."""
    drive = Drive(64, looks_back=False, weather="still").go(12)
    before = weights(drive.belief)
    drive.go(15, STOP)
    np.testing.assert_allclose(weights(drive.belief), before, atol=0.05)


def test_to_coast_in_a_tail_wind_does_not_end_the_doubt_about_it() -> None:
    """A density of one hypothesis must not outweigh the probability of another: one took all weight
    on this slope."""
    options = Options("OutAndBack", route="hidden_wind")
    known = known_of(options)
    assert run_episodes(
        Shield(Onward(known), known, risk=1e-6), options, [3_000_963]
    ).episodes.home.all()


def test_every_place_between_the_posts_is_mapped() -> None:
    """The first decision of a patrol passes the place at home unseen; later ones see it on the way
    out."""
    drive = Drive(8, "Patrol", looks_back=False, instruments="exact", weather="still").go(4)
    places = drive.belief.estimator.state["places"]
    assert (np.hypot(places["east"], places["north"]) > 0.99).all()
    drive.go(12)
    assert (places["readings"] > 0.0).all()
    ground = drive.env.batch.routes["places"][:, : places.shape[1]]
    assert places["sine"] == pytest.approx(ground["sin_grade"], abs=1e-6)
    assert places["east"] == pytest.approx(ground["east"], abs=1e-6)
