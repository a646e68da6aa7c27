"""Observations: what their names say, within their space, and nothing that the robot cannot
know."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from homeward import load_robot
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.conditions.instruments import load_instruments
from homeward.envs.features import FEATURES, GAINS, INDEX, LIMIT, NAMES, RANGES
from homeward.envs.routes import Route
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import AHEAD, GO, IN_SIGHT, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from tests.envs.rollouts import (
    IN_PARTS,
    MISSIONS,
    SHORT_S,
    drive,
    feature,
    make,
    mission,
    random_actions,
    route_file,
    windy,
)

READ = {
    "energy",
    "metered",
    "power",
    "speed",
    "grade",
    "grade_1",
    "grade_2",
    "forecast_east",
    "forecast_north",
}
"""Features that an instrument or a forecast gives, each with its own error."""
CONSUMED = {"energy", "metered", "power", "margin", "corrected", "consumption"}
CONSUMED |= {f"{margin}_{gain:g}" for margin in ("margin", "corrected") for gain in GAINS}
"""Features through which hidden parameters may show: what is consumed, as it is read, and what
follows from that."""
FORECAST = {f"{kind}_{first}" for kind in ("grade", "interest") for first, _ in AHEAD[IN_SIGHT:]}
"""Features of the route beyond sight."""
HILLS = "distance_m,grade_rad,interest\n0,0.02,1\n1000,0.1,2\n2000,-0.05,0.5\n3000,0.06,3\n"
WINDY_HILLS = "distance_m,grade_rad,interest,wind_mps\n0,0.02,1,3\n1000,0.1,2,3\n2000,-0.05,0.5,3\n3000,0.06,3,3\n"


def differing(one: Any, other: Any) -> set[str]:
    return {name for name, a, b in zip(NAMES, one, other, strict=True) if a != b}


@pytest.mark.parametrize("action_type", IN_PARTS)
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_observations_stay_in_their_space(
    mission_id: str, difficulty: str, action_type: str
) -> None:
    envs = HomewardVectorEnv(
        30,
        mission=mission_id,
        difficulty=difficulty,
        action_type=action_type,
        decision_s=SHORT_S,
        route="hidden_wind",
    )
    observations, _ = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    low, high = np.array([RANGES[name] for name in NAMES], np.float32).T
    for _ in range(40):
        assert observations in envs.observation_space and observations.dtype == np.float32
        assert (observations >= low).all() and (observations <= high).all()
        observations, rewards, *_ = envs.step(random_actions(rng, action_type, 30))
        assert np.isfinite(rewards).all()


def test_the_table_names_every_feature_once() -> None:
    assert len(set(NAMES)) == len(FEATURES) == len(make("Survey").reset()[0])
    assert all(unit and meaning for _, unit, meaning in FEATURES)


@pytest.fixture(scope="module")
def hills(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return route_file(tmp_path_factory.mktemp("routes"), WINDY_HILLS)


def twins(env: HomewardEnv, seed: int = 0) -> tuple[HomewardEnv, HomewardEnv]:
    """Two copies of a mission at its start."""
    env.reset(seed=seed)
    return copy.deepcopy(env), copy.deepcopy(env)


HIDDEN: dict[str, Callable[[HomewardEnv], None]] = {
    "capacity": lambda env: scale(env.batch.records, ("capacity_j", "energy_j"), 0.9),
    "rolling": lambda env: scale(env.batch.robots, ("rolling_resistance",), 1.2),
    "payload": lambda env: scale(env.batch.robots, ("payload_mass_kg",), 2.0),
    "wind": lambda env: scale(env.batch.records, ("mean_east_mps", "mean_north_mps"), -2.0),
    "gusts": lambda env: scale(env.batch.records, ("gust_kick",), 3.0),
    "gain": lambda env: scale(env.batch.records, ("meter_gain",), 1.02),
    "offset": lambda env: scale(env.batch.records, ("meter_offset_w",), -1.0),
}
"""What a mission may hide, and how to change it and nothing else."""


def scale(records: Any, names: tuple[str, ...], factor: float) -> None:
    for name in names:
        records[name] *= factor


@pytest.mark.parametrize("hidden", HIDDEN)
@pytest.mark.parametrize("instruments", ["meter", "gauge"])
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_hidden_parameters_show_in_what_is_consumed_only(
    hills: Path, mission_id: str, instruments: str, hidden: str
) -> None:
    """Twins with the same noise and weather, of which one has another battery, load, wind or
    meter."""
    one, other = twins(make(mission_id, instruments=instruments, route=hills, decision_s=60.0))
    HIDDEN[hidden](other)
    seen: set[str] = set()
    for action in [[4, 2, GO]] * 6 + [[2, 1, STOP], [3, 4, GO], [4, 0, RETURN], [4, 0, GO]]:
        ours, theirs = one.step(action), other.step(action)
        assert not ours[2] and not theirs[2]
        seen |= differing(ours[0], theirs[0])
    assert seen <= CONSUMED
    no_offset = hidden == "offset" and instruments == "meter"
    assert ("metered" in seen) == (not no_offset)
    assert ("power" in seen) == (hidden != "capacity" and not no_offset)
    if hidden in ("gain", "offset"):
        assert "energy" not in seen, "the gauge measures no power"


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_nothing_hidden_is_seen_before_it_is_driven(hills: Path, mission_id: str) -> None:
    """On one route, another seed is another battery, payload, rolling resistance and wind;
    forecasts and pitch err."""
    for difficulty in ("uncertain", "harsh"):
        envs = HomewardVectorEnv(
            8, mission=mission_id, difficulty=difficulty, route=hills, decision_s=60.0
        )
        observations, _ = envs.reset(seed=0)
        assert len(np.unique(envs.batch.records["capacity_j"])) == 8
        seen = set.union(*(differing(observations[0], other) for other in observations[1:]))
        assert seen <= (READ - {"energy", "metered", "power", "speed"}) | FORECAST | {"headwind"}


def test_ground_shows_in_what_is_consumed_only(tmp_path: Path) -> None:
    for difficulty in ("uncertain", "harsh"):
        seen = []
        for value in (0, 3):
            text = f"distance_m,roughness\n0,{value}\n3000,{value}\n"
            env = make(
                "Survey", difficulty=difficulty, route=route_file(tmp_path, text, f"{value}.csv")
            )
            first, _ = env.reset(seed=4)
            seen.append([first, *(step.observation for step in drive(env, [[4, 2, GO]] * 3))])
        assert not differing(seen[0][0], seen[1][0])
        for one, other in zip(seen[0][1:], seen[1][1:], strict=True):
            found = differing(one, other)
            assert {"power", "metered"} <= found <= CONSUMED if difficulty == "harsh" else not found


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_harsh_looks_like_uncertain_until_it_is_driven(mission_id: str) -> None:
    """Read by the same instruments; as a rule its inclinometer is worse."""
    envs = [
        make(mission_id, difficulty=name, instruments="gauge") for name in ("uncertain", "harsh")
    ]
    for seed in range(5):
        uncertain, harsh = (env.reset(seed=seed)[0] for env in envs)
        assert not differing(uncertain, harsh)


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_exact_instruments_read_the_truth_in_single_precision(
    mission_id: str, difficulty: str
) -> None:
    env = make(mission_id, difficulty=difficulty, instruments="exact", decision_s=60.0)
    env.reset(seed=3)
    m, shared, places = mission(env), env.batch.known.shared[0], env.batch.routes["places"][0]
    before_j = float(m["energy_j"])
    for step in drive(env, random_actions(np.random.default_rng(1), "discrete", 60, home=0.02)):
        used_j, before_j = before_j - float(m["energy_j"]), float(m["energy_j"])
        direction, place = float(m["direction"]), places[int(m["place"])]
        expected = {
            "energy": np.float32(m["energy_j"] / m["capacity_j"]),
            "metered": np.float32(m["energy_j"] / m["capacity_j"]),
            "power": np.float32(used_j / shared["decision_s"] / shared["cruise_w"]),
            "speed": np.float32(m["speed_mps"] / shared["max_speed_mps"]),
            "grade": np.float32(10.0 * direction * float(place["sin_grade"])),
        }
        found = {name: feature(step.observation, name) for name in expected}
        assert found == pytest.approx(expected, rel=3e-7, abs=1e-9)


def profile(sines: Any, interests: Any, here: int) -> dict[str, float]:
    """The features of the way ahead of a place, worked out from the ground."""
    expected = {}
    for first, last in AHEAD:
        for kind, values, unit in (("grade", sines, 10.0), ("interest", interests, 0.5)):
            stretch = np.asarray(values)[here + first : here + last]
            expected[f"{kind}_{first}"] = unit * float(stretch.mean()) if len(stretch) else 0.0
    return expected


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_the_way_ahead_of_a_known_route_is_exact(mission_id: str) -> None:
    """Also on the way back: places are counted outwards, and beyond the end there is nothing."""
    env = make(mission_id, difficulty="known", decision_s=100.0)
    env.reset(seed=2)
    places = env.batch.routes["places"][0, : int(env.batch.known.shared["places"][0])]
    for step in drive(env, [[4, 0, GO]] * 15 + [[4, 0, RETURN]] * 15):
        expected = profile(
            places["sin_grade"].astype(float), places["interest"], int(mission(env)["place"])
        )
        assert {name: feature(step.observation, name) for name in expected} == pytest.approx(
            expected, abs=1e-6
        )
        assert feature(step.observation, "interest") == 0.5 * float(
            places["interest"][int(mission(env)["place"])]
        )


@pytest.mark.parametrize("instruments", ["exact", "meter", "gauge"])
def test_two_places_are_seen_and_the_rest_is_forecast(instruments: str) -> None:
    """What is seen is exact, but for the grade, which is read; forecasts err, by as much as is
    documented."""
    count, seed = 1500, 0
    envs = HomewardVectorEnv(count, mission="OutAndBack", instruments=instruments)
    first, _ = envs.reset(seed=seed)
    places = envs.batch.routes["places"][:, : envs.batch.known.shared["places"][0]]
    sines, interests = places["sin_grade"].astype(float), places["interest"].astype(float)
    noise = 10.0 * load_instruments(instruments).grade_noise
    for start, last in AHEAD[:IN_SIGHT]:
        error = first[:, INDEX[f"grade_{start}"]] - 10.0 * sines[:, start:last].mean(axis=1)
        assert error.std() == pytest.approx(noise, rel=0.08, abs=1e-6)
        seen = first[:, INDEX[f"interest_{start}"]]
        np.testing.assert_allclose(
            seen, np.minimum(0.5 * interests[:, start:last].mean(axis=1), LIMIT), rtol=1e-6
        )
    # Stretches of whole quarters of the forecast: places 4 to 7 lie in one, so its error is that of
    # one draw.
    at_three = (
        places["sine_ahead"][:, 3, 2:4].astype(float),
        places["interest_ahead"][:, 3, 2:4].astype(float),
    )
    for stretch, (start, last) in enumerate(AHEAD[2:4]):
        ground = slice(3 + start, 3 + last)
        covered = np.arange(32)[ground] // 4
        share = np.array([np.mean(covered == block) for block in np.unique(covered)])
        truth = np.stack(
            [sines[:, 4 * block : 4 * block + 4].mean(axis=1) for block in np.unique(covered)]
        ).T
        error = at_three[0][:, stretch] - truth @ share
        assert error.mean() == pytest.approx(0.0, abs=4.0 * 0.01 / np.sqrt(count))
        assert error.std() == pytest.approx(0.01 * np.sqrt(np.square(share).sum()), rel=0.08)
    # Places 4 to 7 from place 0 belong half to stretch (3, 5) and half to (5, 9): take (5, 9) from
    # place 3: 8 to 11.
    block = interests[:, 8:12].mean(axis=1)
    ratio = at_three[1][:, 1] / block - 1.0
    assert ratio.mean() == pytest.approx(0.0, abs=4.0 * 0.3 / np.sqrt(count))
    assert ratio.std() == pytest.approx(0.3, rel=0.08)
    assert (places["interest_ahead"] >= 0.0).all()


def test_a_forecast_does_not_change_on_the_way() -> None:
    """Its errors belong to the ground: the same forecast from any place, and none that averages
    out."""
    env = make("OutAndBack", difficulty="uncertain")
    env.reset(seed=1)
    ahead = env.batch.routes["places"]["sine_ahead"][0, :32].astype(float)
    # The stretch (5, 9) of place k lies before the stretch (9, 17), half of which is the (5, 9) of
    # place k + 8.
    for k in (3, 7, 11):
        halves = 0.5 * (ahead[k + 4, 3] + ahead[k + 8, 3])
        assert ahead[k, 4] == pytest.approx(halves, abs=1e-7)


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_the_wind_is_known_or_forecast(tmp_path: Path, difficulty: str) -> None:
    """Where nothing is hidden it is what blows; else the forecast of the start, which errs and
    stays."""
    path = route_file(tmp_path, "distance_m,wind_mps,wind_from_rad\n0,4,0\n3000,4,0\n")
    env = make(
        "OutAndBack",
        difficulty=difficulty,
        route=path,
        robot=windy(load_robot("rusti_computer")),
        decision_s=100.0,
    )
    first, _ = env.reset(seed=0)
    east, north = (feature(first, f"forecast_{name}") for name in ("east", "north"))
    assert ((east, north) == pytest.approx((0.4, 0.0))) == (difficulty == "known")
    # The route leads east; the return is final at once.
    out, back = (step.observation for step in drive(env, [[4, 0, GO], [0, 0, RETURN]]))
    headwinds = [feature(observation, "headwind") for observation in (first, out, back)]
    assert headwinds == pytest.approx([east, east, -east])
    assert [feature(observation, "forecast_east") for observation in (out, back)] == pytest.approx(
        [east, east]
    )


def test_a_storm_stays_within_the_observation_space() -> None:
    """The strongest wind that a route may hold, with gusts and an error of the forecast beyond
    it."""
    even = np.zeros(8)
    route = Route(400.0, even, even, even + 1.0, even, wind_mps=60.0, temperature_c=60.0)
    envs = HomewardVectorEnv(500, mission="OutAndBack", route=route, decision_s=SHORT_S)
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    assert np.abs(observations).max() == LIMIT
    for _ in range(5):
        observations, *_ = envs.step(np.array([[4, 4, GO]] * 500))
        assert observations in envs.observation_space
        assert (envs.batch.records["temperature_c"] <= 60.0).all()


def test_features_are_what_they_are_called(tmp_path: Path) -> None:
    path = route_file(tmp_path, HILLS)
    env = make("Survey", difficulty="known", route=path, decision_s=100.0)
    first, _ = env.reset(seed=0)
    shared, m = env.batch.known.shared[0], mission(env)
    zero = "distance home_cost power consumption modelled returning speed sensing backlog score time pit_stop"
    assert {name: feature(first, name) for name in zero.split()} == dict.fromkeys(zero.split(), 0.0)
    one = "energy metered margin margin_10 margin_100 corrected corrected_10 corrected_100 outbound link"
    assert {name: feature(first, name) for name in one.split()} == dict.fromkeys(one.split(), 1.0)
    assert feature(first, "temperature") == pytest.approx(0.5)
    step = next(drive(env, [[2, 3, GO]]))
    seen = {name: feature(step.observation, name) for name in NAMES}
    position_m = 100.0 * 0.55
    place = env.batch.routes["places"][0, int(position_m // shared["place_m"])]
    expected = {
        "energy": m["energy_j"] / shared["usable_j"],
        "distance": position_m / shared["reach_m"],
        "margin": seen["metered"] - seen["home_cost"],
        "margin_10": min(10.0 * seen["margin"], 1.0),
        "corrected": seen["metered"] - seen["home_cost"] * (1.0 + seen["consumption"]),
        "east": 1.0,
        "north": 0.0,
        "speed": 0.55 / env.batch.known.robot.max_speed_mps,
        "sensing": 0.75,
        "grade": 10.0 * place["sin_grade"],
        "interest": 0.5 * place["interest"],
        "backlog": m["backlog"] / shared["backlog_limit"],
        "link": 1.0 / (1.0 + (position_m / shared["link_m"]) ** 2),
        "score": step.info["score"] / shared["score_scale"],
        "time": 1.0 / shared["max_decisions"],
        "modelled": m["modelled_j"] / shared["usable_j"],
        "returning": 0.0,
        "outbound": 1.0,
    }
    assert {name: seen[name] for name in expected} == pytest.approx(expected, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("robot", ["rusti", "husky"])
def test_the_robots_own_model_is_right_where_nothing_is_hidden(tmp_path: Path, robot: str) -> None:
    """Consumption reads 0, and the cost of the way home is what the way home then costs, at
    cruise."""
    path = route_file(tmp_path, HILLS)
    env = HomewardEnv(mission="OutAndBack", robot=robot, difficulty="known", route=path)
    env.reset(seed=0)
    *_, out = drive(env, [[4, 0, GO]] * 25)
    assert feature(out.observation, "consumption") == pytest.approx(0.0, abs=1e-4)
    cost = feature(out.observation, "home_cost")
    *_, home = drive(env, itertools.repeat([4, 0, RETURN], 300))
    assert home.info["home"]
    spent = feature(out.observation, "energy") - feature(home.observation, "energy")
    assert spent == pytest.approx(cost, rel=1e-3)
    assert feature(home.observation, "home_cost") == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("gain", [10.0, 40.0, 100.0])
def test_margins_are_shown_with_gains_and_cut(hills: Path, gain: float) -> None:
    env = make("OutAndBack", route=hills, decision_s=30.0)
    env.reset(seed=1)
    cut = set()
    for step in drive(env, itertools.repeat([4, 2, GO], 200)):
        for margin in ("margin", "corrected"):
            scaled = feature(step.observation, f"{margin}_{gain:g}")
            assert scaled == pytest.approx(
                np.clip(gain * feature(step.observation, margin), -1.0, 1.0), abs=1e-5
            )
            cut.add(abs(scaled) == 1.0)
    assert cut == {True, False}


@pytest.mark.parametrize("instruments", ["exact", "meter", "gauge"])
def test_metered_over_modelled_consumption_tells_more_of_the_way_home(instruments: str) -> None:
    """Most of what is hidden scales both ways alike; the wind, which now wanders too, does not."""
    count = 60
    envs = HomewardVectorEnv(
        count, mission="OutAndBack", instruments=instruments, autoreset_mode="Disabled"
    )
    envs.reset(seed=0)
    for _ in range(50):
        out, *_ = envs.step(np.array([[4, 0, GO]] * count))
    turn = envs.batch.records.copy()
    alone = envs.batch
    rewards, flags = np.zeros(count), (np.zeros(count, bool), np.zeros(count, bool))
    for _ in range(150):
        alone.step(np.array([[4, 0, RETURN]] * count), np.zeros_like(out), rewards, *flags)
    assert alone.records["home"].all()
    spent = (turn["energy_j"] - alone.records["energy_j"]) / alone.records["capacity_j"]
    cost, consumption = (out[:, INDEX[name]] for name in ("home_cost", "consumption"))
    unscaled, scaled = (
        np.abs(spent / cost - 1.0),
        np.abs(spent / (cost * (1.0 + consumption)) - 1.0),
    )
    assert np.median(scaled) < 0.15 and np.median(scaled) < 0.7 * np.median(unscaled)
