"""A mission of an environment, as the instruments of its robot read it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.conditions.draws import FORECAST_GRADE, FORECAST_INTEREST, normal
from homeward.envs.kernel import _FORECAST_INTEREST, _FORECAST_PLACES, _FORECAST_SINE
from homeward.envs.routes import Route
from homeward.envs.scalar import HomewardEnv

SEED = 8_000_001
"""Of missions that nothing was trained or tuned on."""


def drawn(key: Any, number: int, channel: int) -> float:
    with np.errstate(over="ignore"):
        return float(normal(key, number, channel))


class ReadRobot:
    """A mission of an environment, as the instruments of its robot read it."""

    def __init__(self, mission: str, seed: int = SEED, **options: Any) -> None:
        self.env = HomewardEnv(mission=mission, **options)
        self.observation, _ = self.env.reset(seed=seed)
        self.shared, self.time_s, self.outwards = self.env.batch.known.shared[0], 0.0, True

    def forecast(self) -> Route:
        """The route as the mission forecasts it."""
        m, places = (
            self.env.batch.records[0],
            self.env.batch.routes["places"][0, : self.shared["places"]],
        )
        sines, interests = np.zeros((2, len(places)))
        for first in range(0, len(places), _FORECAST_PLACES):
            part = slice(first, first + _FORECAST_PLACES)
            error = _FORECAST_SINE * drawn(m["key"], first, FORECAST_GRADE)
            sines[part] = places["sin_grade"][part].mean(dtype=np.float64) + error
            share = 1.0 + _FORECAST_INTEREST * drawn(m["key"], first, FORECAST_INTEREST)
            interests[part] = max(places["interest"][part].mean(dtype=np.float64) * share, 0.0)
        nothing = np.zeros(len(places))
        return Route(float(self.shared["place_m"]), np.arcsin(sines), nothing, interests, nothing)

    def prior_knowledge(self) -> tuple[Route, tuple[float, float], float]:
        """The route and the wind as they are forecast, and the mean slope of the route."""
        m = self.env.batch.records[0]
        wind = float(m["forecast_east_mps"]), float(m["forecast_north_mps"])
        return self.forecast(), wind, float(m["mean_grade"])

    def seen_ahead(self) -> list[tuple[float, float, float]]:
        """Middle, slope and interest of the next two places on the way out."""
        here, places = int(self.env.batch.records["place"][0]), self.env.batch.routes["places"][0]
        ahead = range(here + 1, min(here + 3, int(self.shared["places"])))
        place_m = float(self.shared["place_m"])
        return [
            ((k + 0.5) * place_m, math.asin(places["sine_read"][k]), float(places["interest"][k]))
            for k in ahead
        ]

    def reads(self) -> dict[str, Any]:
        """What its instruments read now."""
        m = self.env.batch.records[0]
        here, sign = m["here"], 1.0 if self.outwards else -1.0
        return {
            "position": float(m["position_m"]), "speed_mps": float(m["read_mps"]), "power_w": float(m["read_w"]),
            "soc": float(m["soc"]), "grade_rad": sign * math.asin(here["sine_read"]),
            "heading_rad": math.atan2(sign * here["north"], sign * here["east"]),
            "temperature_c": float(m["temperature_c"]), "interest": float(here["interest"]),
        }  # fmt: skip

    def drive(self, action: NDArray[Any]) -> bool:
        """Carry out a decision; whether the mission is over."""
        before_m = float(self.env.batch.records["position_m"][0])
        self.observation, _, terminated, truncated, _ = self.env.step(action)
        self.time_s += float(self.shared["decision_s"])
        moved_m = float(self.env.batch.records["position_m"][0]) - before_m
        self.outwards = moved_m > 0.0 if moved_m else self.outwards
        return terminated or truncated
