"""Weather: a wind that wanders, a temperature that drifts, and a forecast that errs."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.envs.conditions.weather import (
    FORECAST_ERROR_MPS,
    GUSTINESS,
    WANDERS_S,
    WARMING_K_PER_H,
    headwind,
)
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from tests.envs.rollouts import make, mission, random_actions, route_file

MANY = 3000
STANDING = [0, 0, STOP]


def error(deviation: float, count: int = MANY) -> float:
    """Four standard errors of a mean."""
    return 4.0 * deviation / math.sqrt(count)


class Days:
    """Missions that stand: gusts over the mean wind, shape (decisions + 1, missions), and
    temperatures."""

    def __init__(
        self, decision_s: float, decisions: int, count: int = MANY, **options: Any
    ) -> None:
        envs = HomewardVectorEnv(count, decision_s=decision_s, autoreset_mode="Disabled", **options)
        envs.reset(seed=0)
        records = self.records = envs.batch.records
        self.robots, self.decision_s = envs.batch.robots, decision_s
        gusts, temperatures = [], []
        for decision in range(decisions + 1):
            if decision:
                envs.step(np.array([STANDING] * count))
            wind = np.stack((records["gust_east_mps"], records["gust_north_mps"]))
            gusts.append(wind / np.maximum(records["wind_mps"], 1e-9))
            temperatures.append(records["temperature_c"].copy())
        self.gusts: NDArray[np.float64] = np.array(gusts)
        self.temperatures: NDArray[np.float64] = np.array(temperatures)


@pytest.fixture(scope="module", params=[60.0, 300.0])
def days(request: pytest.FixtureRequest) -> Days:
    return Days(request.param, 9)


def test_gusts_are_stationary(days: Days) -> None:
    """Of the same deviation from the first decision to the last, whatever the length of a
    decision."""
    for gusts in days.gusts:
        for part in gusts:
            assert part.mean() == pytest.approx(0.0, abs=error(GUSTINESS))
            assert part.std() == pytest.approx(GUSTINESS, rel=0.06)
        assert np.corrcoef(gusts)[0, 1] == pytest.approx(0.0, abs=error(1.0))


def test_gusts_forget_within_their_time(days: Days) -> None:
    """Five minutes to an hour, log-uniform; one decision keeps exp(-decision / time)."""
    wanders_s = -days.decision_s / np.log(days.records["gust_keeps"])
    share = np.log(wanders_s / WANDERS_S[0]) / math.log(WANDERS_S[1] / WANDERS_S[0])
    assert (share.min(), share.max()) == pytest.approx((0.0, 1.0), abs=0.005)
    assert share.mean() == pytest.approx(0.5, abs=error(0.29)) and share.std() == pytest.approx(
        0.289, rel=0.03
    )
    for third in range(3):
        some = (share >= third / 3.0) & (share < (third + 1) / 3.0)
        for apart in (1, 4, 9):
            keeps = np.exp(-apart * days.decision_s / wanders_s[some]).mean()
            products = days.gusts[apart:][..., some] * days.gusts[:-apart][..., some]
            assert products.mean() / GUSTINESS**2 == pytest.approx(
                keeps, abs=error(1.0, int(some.sum()))
            )


def test_it_gets_warmer_or_colder(days: Days) -> None:
    rate = np.diff(days.temperatures, axis=0) / days.decision_s * 3600.0
    np.testing.assert_allclose(rate, np.broadcast_to(rate[0], rate.shape), atol=1e-9)
    assert (rate[0].min(), rate[0].max()) == pytest.approx(
        (-WARMING_K_PER_H, WARMING_K_PER_H), abs=0.01
    )
    assert rate[0].mean() == pytest.approx(0.0, abs=error(WARMING_K_PER_H / math.sqrt(3.0)))
    np.testing.assert_allclose(
        days.temperatures[-1] - days.temperatures[0],
        days.records["warming_k"] * (len(days.temperatures) - 1),
    )


def test_a_forecast_is_the_wind_of_the_start_with_an_error() -> None:
    envs = HomewardVectorEnv(MANY, difficulty="uncertain")
    envs.reset(seed=0)
    r = envs.batch.records
    errors = [
        r[f"forecast_{part}_mps"] - r[f"mean_{part}_mps"] - r[f"gust_{part}_mps"]
        for part in ("east", "north")
    ]
    for part in errors:
        assert part.mean() == pytest.approx(0.0, abs=error(FORECAST_ERROR_MPS))
        assert part.std() == pytest.approx(FORECAST_ERROR_MPS, rel=0.06)
        for known in (
            "mean_east_mps",
            "mean_north_mps",
            "gust_east_mps",
            "temperature_c",
            "capacity_j",
        ):
            assert np.corrcoef(part, r[known])[0, 1] == pytest.approx(0.0, abs=error(1.0))
    assert np.corrcoef(*errors)[0, 1] == pytest.approx(0.0, abs=error(1.0))
    east_mps: NDArray[np.float64] = r["mean_east_mps"]
    north_mps: NDArray[np.float64] = r["mean_north_mps"]
    np.testing.assert_allclose(np.hypot(east_mps, north_mps), r["wind_mps"], rtol=1e-12)
    from_rad = np.mod(np.arctan2(north_mps, east_mps), 2.0 * np.pi)
    np.testing.assert_allclose(from_rad, r["wind_from_rad"], rtol=1e-9)


def test_no_forecast_tells_of_a_hidden_wind() -> None:
    """It is that of another wind, as strong as those of other routes."""
    envs = HomewardVectorEnv(
        2000, mission="OutAndBack", route="hidden_wind", difficulty="uncertain"
    )
    envs.reset(seed=0)
    m = envs.batch.records
    for part in ("east", "north"):
        forecast_mps = m[f"forecast_{part}_mps"]
        assert forecast_mps.std() == pytest.approx(np.hypot(1.5, 1.0), rel=0.06)
        assert abs(np.corrcoef(forecast_mps, m[f"mean_{part}_mps"])[0, 1]) < 0.07
    assert (m["wind_mps"] >= 3.0).all()


def test_where_nothing_is_hidden_the_weather_stays_and_is_known(tmp_path: Path) -> None:
    path = route_file(
        tmp_path, "distance_m,wind_mps,wind_from_rad,temperature_c\n0,4,1,5\n3000,4,1,5\n"
    )
    for options in ({"route": path}, {}):
        days = Days(300.0, 5, 20, difficulty="known", robot="husky", **options)
        assert (days.temperatures == days.temperatures[0]).all()
        assert not days.records["gust_east_mps"].any()
        for part in ("east", "north"):
            np.testing.assert_array_equal(
                days.records[f"forecast_{part}_mps"], days.records[f"mean_{part}_mps"]
            )


def test_it_never_leaves_what_a_route_may_hold(tmp_path: Path) -> None:
    path = route_file(tmp_path, "distance_m,temperature_c\n0,60\n3000,60\n")
    days = Days(300.0, 10, 20, route=path)
    assert days.temperatures.max() == 60.0 and days.temperatures.min() < 60.0


def test_the_headwind_is_the_wind_against_the_way_out() -> None:
    env = make("OutAndBack", difficulty="uncertain")
    env.reset(seed=1)
    env.step([4, 0, GO])
    m, place = (
        env.batch.records.view(np.recarray)[0],
        env.batch.routes["places"].view(np.recarray)[0, 3],
    )
    wind = np.array([m.mean_east_mps + m.gust_east_mps, m.mean_north_mps + m.gust_north_mps])
    assert headwind(m, place) == pytest.approx(float(wind @ [place.east, place.north]))
    assert abs(headwind(m, place)) <= np.hypot(*wind)


WEATHER = (
    "gust_east_mps",
    "gust_north_mps",
    "temperature_c",
    "forecast_east_mps",
    "forecast_north_mps",
)


@pytest.mark.parametrize("difficulty", ["uncertain", "harsh"])
def test_a_mission_driven_otherwise_meets_the_same_weather(difficulty: str) -> None:
    """At the same decision, from a copy in the middle on; and nothing is drawn from the mission's
    generator."""
    env = make("Survey", difficulty=difficulty, decision_s=60.0)
    env.reset(seed=3)
    for _ in range(5):
        env.step([4, 2, GO])
    other = copy.deepcopy(env)
    state = env.np_random.bit_generator.state
    for another in [[1, 0, GO], [0, 0, STOP], [2, 4, RETURN], [1, 1, GO]] * 5:
        env.step([4, 4, GO])
        *_, terminated, _, _ = other.step(another)
        if terminated:
            break
        for name in WEATHER:
            assert mission(env)[name] == mission(other)[name]
    assert (
        mission(env)["decisions"] > 7 and mission(env)["position_m"] != mission(other)["position_m"]
    )
    assert env.np_random.bit_generator.state == state == other.np_random.bit_generator.state


def test_instruments_and_robots_change_no_weather() -> None:
    actions = random_actions(np.random.default_rng(0), "discrete", 12, home=0.0)
    seen = []
    for options in (
        {"instruments": "exact"},
        {"instruments": "gauge"},
        {"true_robot": "rusti"},
        {"shaping": "none"},
    ):
        env = make("OutAndBack", **options)
        env.reset(seed=4)
        for action in actions:
            env.step(action)
        seen.append([float(mission(env)[name]) for name in WEATHER])
    assert all(one == seen[0] for one in seen[1:])
