"""Routes: the generator's distributions, the named case of hidden wind, and what a robot makes of
any route."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from homeward import load_robot
from homeward.envs.options import OptionError
from homeward.envs.routes.route import (
    INTEREST_DEVIATION,
    INTEREST_LENGTH,
    MEAN_INTEREST,
    Route,
    RouteError,
)
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, MAX_PLACES, RETURN
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import ancillary_power, traction_force
from tests.envs.rollouts import drive, mission, route_file

MANY = 4000


@pytest.fixture(scope="module")
def days() -> Any:
    """Records, places used and length of many generated missions, at the difficulty where the wind
    blows."""
    envs = HomewardVectorEnv(MANY, mission="Survey", difficulty="uncertain")
    envs.reset(seed=0)
    shared = envs.batch.known.shared[0]
    return (
        envs.batch.records,
        envs.batch.routes["places"][:, : shared["places"]],
        float(shared["length_m"]),
    )


def error(deviation: float, count: int = MANY) -> float:
    """Four standard errors of a mean."""
    return 4.0 * deviation / math.sqrt(count)


def test_grades_are_drawn_as_documented(days: Any) -> None:
    _, places, _ = days
    sines = places["sin_grade"].astype(float)
    assert np.abs(sines).max() <= 0.2
    # Beside the knots: the route's mean of N(0, 0.02) plus the part of deviation 0.04.
    for place in (0, -1):
        assert sines[:, place].mean() == pytest.approx(0.0, abs=error(0.045))
        assert 0.85 * 0.0447 < sines[:, place].std() < 0.0447
    assert sines.mean(axis=1).std() == pytest.approx(0.03, abs=0.01)
    # Neighbours belong together and the ends do not, but for the mean that they share.
    assert np.corrcoef(sines[:, 0], sines[:, 1])[0, 1] > 0.9
    assert np.corrcoef(sines[:, 0], sines[:, -1])[0, 1] == pytest.approx(0.2, abs=0.07)


def test_roughness_comes_in_patches(days: Any) -> None:
    _, places, _ = days
    roughness = places["roughness"]
    assert roughness.min() == 0.0 and roughness.max() <= 1.0
    first, last = roughness[:, 0], roughness[:, -1]
    assert (first > 0.0).mean() == pytest.approx(0.25, abs=error(0.43))
    assert first[first > 0.0].mean() == pytest.approx(0.5, abs=error(0.29, MANY // 4))
    assert (last > 0.0).mean() == pytest.approx(0.5, abs=error(0.5))
    changes = (np.diff(roughness, axis=1) != 0.0).sum(axis=1)
    assert 1 <= changes.mean() <= 5


def test_interest_is_a_log_normal_process(days: Any) -> None:
    """No longer hot spots on even ground: what is sensed tells of what comes next."""
    _, places, _ = days
    interest = places["interest"].astype(float)
    weight = np.log(interest / MEAN_INTEREST) + 0.5 * INTEREST_DEVIATION**2
    for place in (0, 15, -1):
        assert interest[:, place].mean() == pytest.approx(
            1.23, abs=error(1.23 * math.sqrt(math.e - 1.0))
        )
        assert weight[:, place].mean() == pytest.approx(0.0, abs=error(1.0))
        assert weight[:, place].std() == pytest.approx(1.0, abs=error(1.0 / math.sqrt(2.0)))
    # Third and fourth moment of a normal number.
    assert (weight**3).mean() == pytest.approx(0.0, abs=0.1) and (
        weight**4
    ).mean() == pytest.approx(3.0, abs=0.2)
    count = places.shape[1]
    for apart in (1, 3, 8, 20):
        correlation = (weight[:, apart:] * weight[:, :-apart]).mean()
        assert correlation == pytest.approx(math.exp(-apart / (INTEREST_LENGTH * count)), abs=0.03)
    best = np.sort(interest, axis=None)[-interest.size // 5 :]
    assert best.sum() > 0.5 * interest.sum()


def test_the_interest_of_a_patrol_is_the_same_process() -> None:
    """With other places: its correlation length is a tenth of its route too."""
    envs = HomewardVectorEnv(MANY, mission="Patrol")
    envs.reset(seed=0)
    interest = envs.batch.routes["places"]["interest"][
        :, : envs.batch.known.shared["places"][0]
    ].astype(float)
    weight = np.log(interest / MEAN_INTEREST) + 0.5
    assert weight.std() == pytest.approx(1.0, abs=0.03)
    assert (weight[:, 1:] * weight[:, :-1]).mean() == pytest.approx(
        math.exp(-10.0 / interest.shape[1]), abs=0.04
    )


def test_routes_wind_and_their_heading_is_the_integral_of_the_curvature(days: Any) -> None:
    _, places, length_m = days
    heading = np.unwrap(np.arctan2(places["north"], places["east"]).astype(float), axis=1)
    curvature = places["curvature_per_m"].astype(float)
    np.testing.assert_allclose(np.hypot(places["east"], places["north"]), 1.0, rtol=1e-6)
    place_m = length_m / places.shape[1]
    np.testing.assert_allclose(np.diff(heading, axis=1), curvature[:, :-1] * place_m, atol=1e-4)
    assert curvature[:, 0].std() * length_m == pytest.approx(3.0, abs=0.15)
    assert (heading[:, 0].min(), heading[:, 0].max()) == pytest.approx(
        (-math.pi, math.pi), abs=0.02
    )


def test_days_are_drawn_as_documented(days: Any) -> None:
    records, _, _ = days
    temperature, wind, direction = (
        records[name] for name in ("temperature_c", "wind_mps", "wind_from_rad")
    )
    assert temperature.mean() == pytest.approx(12.0, abs=error(8.0))
    assert (temperature.min(), temperature.max()) == (-10.0, 35.0)
    assert np.median(temperature) == pytest.approx(12.0, abs=error(10.0))
    assert wind.mean() == pytest.approx(1.5 * math.sqrt(math.pi / 2.0), abs=error(1.0))  # Rayleigh
    assert wind.min() > 0.0
    assert direction.mean() == pytest.approx(math.pi, abs=error(1.82))
    assert (direction.min(), direction.max()) == pytest.approx((0.0, 2.0 * math.pi), abs=0.02)


def test_any_robot_meets_the_same_variety() -> None:
    """Lengths scale with the robot: one seed is one profile, stretched."""
    profiles = []
    for robot in ("rusti", "husky"):
        env = HomewardEnv(robot=robot)
        env.reset(seed=3)
        profiles.append(
            env.batch.routes["places"][0][["sin_grade", "roughness", "interest"]].copy()
        )
    np.testing.assert_array_equal(*profiles)


def test_hidden_wind_helps_on_the_way_out_and_hurts_on_the_way_home() -> None:
    envs = HomewardVectorEnv(60, mission="OutAndBack", route="hidden_wind", difficulty="uncertain")
    envs.reset(seed=0)
    records, places = (
        envs.batch.records,
        envs.batch.routes["places"][:, : envs.batch.known.shared["places"][0]],
    )
    assert ((records["wind_mps"] >= 3.0) & (records["wind_mps"] <= 6.0)).all()
    against = np.cos(
        records["wind_from_rad"][:, None] - np.arctan2(places["north"], places["east"])
    )
    assert (against.mean(axis=1) < 0.0).all() and against.mean() < -0.5
    # It comes from behind, on average over the way out.
    behind = np.arctan2(-places["north"].sum(axis=1), -places["east"].sum(axis=1))
    np.testing.assert_allclose(np.cos(records["wind_from_rad"] - behind), 1.0, atol=1e-6)
    for _ in range(60):
        *_, info = envs.step(np.array([[4, 0, GO]] * 60))
    out_j = info["energy_j"]["wind"].copy()
    assert (out_j < 0.0).mean() > 0.5 and out_j.mean() < 0.0
    over = np.zeros(60, bool)
    home_j = np.zeros(60)
    for _ in range(100):
        *_, terminated, truncated, info = envs.step(np.array([[4, 0, RETURN]] * 60))
        ended = (terminated | truncated) & ~over
        home_j[ended] = info["energy_j"]["wind"][ended] - out_j[ended]
        over |= ended
        if over.all():
            break
    assert over.all() and (home_j > 0.0).mean() > 0.9 and home_j.mean() > abs(out_j.mean())


def test_hidden_wind_fools_who_extrapolates() -> None:
    """The way home costs more, over the way out, than on days with a wind from anywhere."""
    dearer = {}
    for route in ("generated", "hidden_wind"):
        ratios = []
        for seed in range(15):
            env = HomewardEnv(mission="OutAndBack", route=route, difficulty="uncertain")
            env.reset(seed=seed)
            start_j = float(mission(env)["energy_j"])
            list(drive(env, [[4, 0, GO]] * 40))
            turn_j = float(mission(env)["energy_j"])
            list(drive(env, [[4, 0, RETURN]] * 100))
            assert mission(env)["home"]
            ratios.append((turn_j - float(mission(env)["energy_j"])) / (start_j - turn_j))
        dearer[route] = float(np.mean(ratios))
    assert dearer["hidden_wind"] > 1.3 * dearer["generated"]


@pytest.mark.parametrize("mission_id", ["OutAndBack", "Survey", "Patrol"])
@pytest.mark.parametrize(
    ("length_m", "says"),
    [
        (
            1e-7,
            "route has 1 places of 1e-07 m; give places of at least 0.003 m, so that 'rusti' crosses",
        ),
        (1e9, "route is 1e+09 m long; give at most"),
    ],
)
def test_routes_too_short_or_too_long_for_the_robot(
    tmp_path: Path, mission_id: str, length_m: float, says: str
) -> None:
    path = route_file(tmp_path, f"distance_m\n0\n{length_m}\n")
    with pytest.raises(RouteError) as caught:
        HomewardEnv(mission=mission_id, robot="rusti", route=path)
    assert str(caught.value).startswith(says) and "\n" not in str(caught.value)
    if length_m > 1.0:
        longest_m = 5800 if mission_id == "Patrol" else 23000
        assert f"at most {longest_m} m" in str(caught.value)
        HomewardEnv(
            mission=mission_id,
            robot="rusti",
            route=route_file(tmp_path, f"distance_m\n0\n{longest_m}\n"),
        )


def test_the_shortest_patrol_ends_its_decisions_and_counts_its_laps() -> None:
    env = HomewardEnv(
        mission="Patrol", robot="rusti", route=flat(1, place_m=0.003), difficulty="known"
    )
    env.reset(seed=0)
    *_, info = env.step([4, 0, GO])
    legs = 30.0 / (0.003 + 0.5 * 0.003)  # at 1 m/s, with pit stops of half of a leg
    assert mission(env)["legs"] == pytest.approx(legs, abs=1.0) and not info["stranded"]


def flat(count: int, **changes: Any) -> Route:
    zeros = np.zeros(count)
    values: dict[str, Any] = {
        "place_m": 10.0,
        "grade_rad": zeros,
        "roughness": zeros,
        "interest": zeros + 1.0,
    }
    return Route(**values | {"heading_rad": zeros} | changes)


def test_a_route_may_be_made_of_lists() -> None:
    route = Route(5.0, [0.0, 0.1], [0.0, 0.0], [1, 2], [0.0, 0.5])  # type: ignore[arg-type]
    assert HomewardEnv(route=route).batch.known.shared["information_per_m"][0] == pytest.approx(1.0)


def test_a_route_made_in_python_is_taken_as_it_is() -> None:
    env = HomewardEnv(mission="OutAndBack", route=flat(7), difficulty="known")
    env.reset(seed=0)
    *_, last = drive(env, [[4, 0, GO]] * 5)
    assert last.info["position_m"] == pytest.approx(70.0)
    with pytest.raises(OptionError, match=f"at most {MAX_PLACES}"):
        HomewardEnv(route=flat(MAX_PLACES + 1))


@pytest.mark.parametrize(
    "changes",
    [
        {"place_m": 0.0},
        {"place_m": math.nan},
        {"place_m": "10"},
        {"roughness": ["rough"] * 7},
        {"grade_rad": np.full(7, math.nan)},
        {"grade_rad": np.full(7, 1.6)},
        {"interest": np.ones(6)},
        {"roughness": np.full(7, -1.0)},
        {"wind_mps": math.inf},
        {"temperature_c": 300.0},
    ],
)
def test_a_route_made_in_python_is_checked(changes: dict[str, Any]) -> None:
    with pytest.raises(RouteError, match=next(iter(changes))):
        HomewardEnv(route=flat(7, **changes))


@pytest.mark.parametrize("count", range(1, MAX_PLACES + 1))
def test_the_end_of_any_route_is_reached(count: int) -> None:
    """With places whose sum rounds below the length or above it."""
    env = HomewardEnv(
        mission="OutAndBack", route=flat(count, place_m=0.1), difficulty="known", decision_s=50.0
    )
    env.reset(seed=0)
    *_, end = drive(env, [[4, 0, GO]] * 2)
    assert end.info["position_m"] == pytest.approx(0.1 * count)
    *_, home = drive(env, [[4, 0, RETURN]] * 2)
    assert home.info["home"] and home.info["score"] == pytest.approx(0.1 * count)


@pytest.mark.parametrize(
    ("route", "grade_rad", "length_m"), [("box", 0.0, 0.38), ("incline", 0.09966, 0.5)]
)
@pytest.mark.parametrize("speed", [2, 4])
def test_patrols_on_the_papers_trajectories_draw_what_the_model_says(
    route: str, grade_rad: float, length_m: float, speed: int
) -> None:
    """Eqs. 3, 5 and 7 with the duty cycle of a mission in turns: forth, pit stop, back, pit
    stop."""
    rusti = load_robot("rusti")
    env = HomewardEnv(mission="Patrol", robot=rusti, route=route, difficulty="known")
    env.reset(seed=0)
    *_, last = drive(env, [[speed, 4, GO]] * 10)
    m, ledger = mission(env), last.info["energy_j"]
    speed_mps = 0.1 + 0.9 * speed / 4
    forth_n, back_n = (
        float(traction_force(rusti, speed_mps, sign * grade_rad)) for sign in (1.0, -1.0)
    )
    force_n = 0.5 * (forth_n + max(back_n, 0.0))
    drive_j = ledger["rolling"] + ledger["drag"] + ledger["grade"]
    assert m["legs"] > 100
    # A leg that is under way at the end may be the dearer one.
    assert drive_j == pytest.approx(
        force_n * m["distance_m"] / rusti.traction_efficiency, rel=2.0 / m["legs"]
    )
    assert ledger.total() - drive_j == pytest.approx(
        float(ancillary_power(rusti, 100.0)) * m["time_s"], rel=1e-9
    )
    duty = m["distance_m"] / speed_mps / m["time_s"]
    pit_stop_s = float(env.batch.known.shared["pit_stop_s"][0])
    leg_s = length_m / speed_mps
    assert duty == pytest.approx(leg_s / (leg_s + pit_stop_s), rel=2.0 / m["legs"])


def test_the_box_at_full_speed_takes_the_papers_drive_power() -> None:
    """8.83 W against rolling friction at 1 m/s, as the model gives for 0.78 kg."""
    env = HomewardEnv(mission="Patrol", robot="rusti", route="box", difficulty="known")
    env.reset(seed=0)
    *_, last = drive(env, [[4, 0, GO]] * 10)
    driven_s = float(mission(env)["distance_m"]) / 1.0
    assert last.info["energy_j"]["rolling"] / driven_s == pytest.approx(8.83, abs=0.005)
