"""A world to try the estimation in: robots of one kind on routes of their own, written from the
equations alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.estimation import READING_DTYPE, Estimator, Prior, vehicle_of
from homeward.physics import Robot, ancillary_power, load_robot, optimal_speed
from homeward.physics.model import GRAVITY_MPS2

Array = NDArray[Any]
ROBOT = load_robot("rusti_computer")
COUNT = 300
PLACES = 64
KNOTS = 8


@dataclass(frozen=True)
class Instruments:
    """Steps, noise and errors of what a robot reads of itself."""

    soc_step: float = 0.0
    soc_noise: float = 0.0
    soc_lag_s: float = 0.0
    gain: float = 0.0  # half width
    offset: float = 0.0  # half width, a share of full-scale power
    power_noise: float = 0.0
    speed_noise: float = 0.0
    slope_noise: float = 0.0


EXACT = Instruments()
METER = Instruments(0.001, 0.0, 0.0, 0.01, 0.0, 0.005, 0.005, 0.002)
GAUGE = Instruments(0.01, 0.003, 60.0, 0.03, 0.005, 0.01, 0.01, 0.005)


def full_scale_w(robot: Robot) -> float:
    """Power at top speed on the flat with everything on, W."""
    v = robot.max_speed_mps
    force_n = (
        robot.rolling_resistance * robot.mass_kg * GRAVITY_MPS2 + robot.drag_ns2_per_m2 * v * v
    )
    return (
        float(ancillary_power(robot, robot.max_sensing_hz))
        + force_n * v / robot.traction_efficiency
    )


def prior_of(
    robot: Robot, instruments: Instruments, *, rough: bool, route_m: float, **more: Any
) -> Prior:
    """What such a world says beforehand about robots, ground and instruments."""
    prior = Prior(
        gain_sd=instruments.gain / 3**0.5,
        offset_sd_w=instruments.offset / 3**0.5 * full_scale_w(robot),
        power_noise=instruments.power_noise,
        soc_step=instruments.soc_step,
        soc_noise=instruments.soc_noise,
        soc_lag_s=instruments.soc_lag_s,
        slope_noise=instruments.slope_noise,
    )
    if rough:
        prior = prior._replace(patch_m=route_m / KNOTS / 0.5, patch_sd=0.35)
    return prior._replace(**more)


class World:
    """Missions side by side; arrays of shape (n,)."""

    def __init__(
        self,
        robot: Robot,
        count: int,
        seed: int,
        instruments: Instruments,
        *,
        rough: bool = False,
        hidden_wind: bool = False,
        wind_sd_mps: float = 1.5,
        straight: bool = False,
    ) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.robot, self.instruments, self.count = robot, instruments, count
        self.cruise_mps = float(optimal_speed(robot))
        self.decision_s = self._flat_s() / 200.0
        self.route_m = 0.6 * self._flat_s() * self.cruise_mps
        self.place_m = self.route_m / PLACES
        self.capacity_j = robot.usable_energy_j * rng.uniform(0.8, 1.0, count)
        self.mass = 1.0 + rng.uniform(0.0, 0.2, count)
        self.rolling = rng.uniform(0.8, 1.3, count)
        self._routes(rough, straight)
        self.wind = rng.normal(0.0, wind_sd_mps, (count, 2))
        self.gust = rng.normal(size=(count, 2))
        self.gust_s = np.exp(rng.uniform(np.log(300.0), np.log(3600.0), count))
        if hidden_wind:
            out = self.heading.mean(axis=1)
            out /= np.maximum(np.hypot(*out.T), 1e-9)[:, None]
            self.wind = -out * rng.uniform(3.0, 6.0, count)[:, None]
        self.gust *= 0.3 * np.hypot(*self.wind.T)[:, None]
        self.forecast = self.wind + self.gust + rng.normal(0.0, 1.0, (count, 2))
        if hidden_wind:
            self.forecast = np.zeros((count, 2))
        if wind_sd_mps == 0.0:
            self.forecast = np.zeros((count, 2))
        self.gain = 1.0 + rng.uniform(-1.0, 1.0, count) * instruments.gain
        self.offset_w = rng.uniform(-1.0, 1.0, count) * instruments.offset * full_scale_w(robot)
        self.position_m, self.time_s, self.used_j, self.lagging_j = np.zeros((4, count))
        self.home_cost_j = np.zeros(count)

    def _flat_s(self) -> float:
        r, v = self.robot, float(optimal_speed(self.robot))
        force_n = r.rolling_resistance * r.mass_kg * GRAVITY_MPS2 + r.drag_ns2_per_m2 * v * v
        return r.usable_energy_j / (
            float(ancillary_power(r, 0.0)) + force_n * v / r.traction_efficiency
        )

    def _routes(self, rough: bool, straight: bool) -> None:
        rng, n = self.rng, self.count
        mean = rng.normal(0.0, 0.02, (n, 1))
        slope, turn = np.empty((n, KNOTS + 1)), np.empty((n, KNOTS + 1))
        slope[:, 0], turn[:, 0] = rng.normal(size=n), rng.normal(size=n)
        for k in range(KNOTS):
            slope[:, k + 1] = 0.5 * slope[:, k] + 0.75**0.5 * rng.normal(size=n)
            turn[:, k + 1] = 0.5 * turn[:, k] + 0.75**0.5 * rng.normal(size=n)
        sines = np.clip(mean + 0.04 * slope, -0.2, 0.2)
        at = (np.arange(PLACES) + 0.5) * KNOTS / PLACES
        left = at.astype(int)
        self.sine = sines[:, left] + (at - left) * (sines[:, left + 1] - sines[:, left])
        bend = 0.0 if straight else 3.0 * turn[:, 1:][:, left] / PLACES
        angle = rng.uniform(0.0, 2.0 * np.pi, (n, 1)) + np.cumsum(
            bend * np.ones((n, PLACES)), axis=1
        )
        self.heading = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
        roughness, now = np.empty((n, KNOTS)), np.zeros(n)
        for k in range(KNOTS):
            now = np.where(rng.random(n) < 0.5, np.maximum(rng.uniform(-1.0, 1.0, n), 0.0), now)
            roughness[:, k] = now
        gain = rng.uniform(0.2, 1.0, (n, 1)) if rough else 0.0
        self.rough = 1.0 + (gain * roughness)[:, left]

    def drive(
        self, towards: float, speed_mps: Any, sensing_hz: Any, lasts_s: Any = None
    ) -> tuple[Array, Array]:
        """Drive on at a speed (1 away from home, -1 towards it), stopping at home; energy taken and
        modelled, J."""
        r, n, row = self.robot, self.count, np.arange(self.count)
        dt_s = np.broadcast_to(
            np.asarray(self.decision_s if lasts_s is None else lasts_s, float), (n,)
        )
        speed = np.broadcast_to(np.asarray(speed_mps, float), (n,))
        kept = np.exp(-dt_s / self.gust_s)[:, None]
        gust_sd = 0.3 * np.hypot(*self.wind.T)[:, None]
        self.gust = kept * self.gust + np.sqrt(1 - kept**2) * gust_sd * self.rng.normal(size=(n, 2))
        wind = self.wind + self.gust
        way = np.minimum(
            speed * dt_s, self.position_m if towards < 0 else self.route_m - self.position_m
        )
        # At home the mission ends: nothing is drawn after that.
        time = np.where(speed > 0.0, way / np.maximum(speed, 1e-9), dt_s) if towards < 0 else dt_s
        idle = ancillary_power(r, np.broadcast_to(np.asarray(sensing_hz, float), (n,))) * time
        took, modelled, cost, left = idle.copy(), idle.copy(), np.zeros(n), way.copy()
        idle_per_m = float(ancillary_power(r, 0.0)) / self.cruise_mps
        position = self.position_m.copy()
        while (left > 1e-9).any():
            k = (
                np.floor(position / self.place_m + (1e-9 if towards > 0 else -1e-9))
                .astype(int)
                .clip(0, PLACES - 1)
            )
            border = (
                (k + 1) * self.place_m - position if towards > 0 else position - k * self.place_m
            )
            part = np.minimum(left, np.maximum(border, 1e-9))
            sine, cosine = towards * self.sine[row, k], np.sqrt(1.0 - self.sine[row, k] ** 2)
            headwind = towards * (wind * self.heading[row, k]).sum(axis=1)
            weight_n = r.mass_kg * GRAVITY_MPS2
            rolls, climbs = r.rolling_resistance * weight_n * cosine, weight_n * sine
            air = speed + headwind
            force = self.rolling * self.rough[row, k] * self.mass * rolls + self.mass * climbs
            force = force + r.drag_ns2_per_m2 * air * np.abs(air)
            took += np.maximum(force, 0.0) / r.traction_efficiency * part
            at_cruise = r.drag_ns2_per_m2 * self.cruise_mps**2
            own = (
                np.maximum(rolls + climbs + at_cruise, 0.0)
                + r.drag_ns2_per_m2 * speed**2
                - at_cruise
            )
            modelled += np.maximum(own, 0.0) / r.traction_efficiency * part
            home = np.maximum(rolls - self.sine[row, k] * weight_n + at_cruise, 0.0)
            cost += (home / r.traction_efficiency + idle_per_m) * part
            position += towards * part
            left -= part
        self.position_m = np.where(
            left > 1e-9, position, np.maximum(self.position_m + towards * way, 0.0)
        )
        self.home_cost_j = self.home_cost_j + towards * cost
        self.time_s, self.used_j = self.time_s + time, self.used_j + took
        self._took, self._modelled, self._lasted, self._speed = (
            took,
            modelled,
            time,
            np.where(way > 0, speed, 0.0),
        )
        lag_s = self.instruments.soc_lag_s
        kept_lag = np.exp(-time / lag_s) if lag_s else np.zeros(n)
        power = took / np.maximum(time, 1e-9)
        self.lagging_j = kept_lag * self.lagging_j + power * lag_s * (1.0 - kept_lag)
        return took, modelled

    def read(self) -> Array:
        """What the robots read after a decision, `READING_DTYPE`."""
        i, rng, n = self.instruments, self.rng, self.count
        readings = np.zeros(n, READING_DTYPE)
        readings["time_s"], readings["position_m"] = self.time_s, self.position_m
        power = self._took / np.maximum(self._lasted, 1e-9)
        readings["power_w"] = (power * self.gain + self.offset_w) * (
            1.0 + i.power_noise * rng.normal(size=n)
        )
        soc = (
            1.0
            - (self.used_j - self.lagging_j) / self.capacity_j
            + i.soc_noise * rng.normal(size=n)
        )
        readings["soc"] = np.clip(
            np.round(soc / i.soc_step) * i.soc_step if i.soc_step else soc, 0.0, 1.0
        )
        readings["modelled_j"] = self._modelled
        readings["speed_mps"] = self._speed * (1.0 + i.speed_noise * rng.normal(size=n))
        k = np.floor(self.position_m / self.place_m).astype(int).clip(0, PLACES - 1)
        row = np.arange(n)
        readings["sine"] = self.sine[row, k] + i.slope_noise * rng.normal(size=n)
        readings["east"], readings["north"] = self.heading[row, k].T
        return readings.astype(READING_DTYPE)

    def way_home_j(self, seed: int) -> Array:
        """What driving home at cruise takes from here, J: truth, by gusts of its own; the world
        stays as it is."""
        kept = dict(self.__dict__)
        self.rng = np.random.default_rng(seed)
        total = np.zeros(self.count)
        while (self.position_m > 1e-6).any():
            total += np.where(
                self.position_m > 1e-6, self.drive(-1.0, self.cruise_mps, 0.0)[0], 0.0
            )
        self.__dict__.update(kept)
        return total


def begin(world: World, rough: bool = False, **prior: Any) -> Estimator:
    known = prior_of(world.robot, world.instruments, rough=rough, route_m=world.route_m, **prior)
    estimator = Estimator(vehicle_of(world.robot, world.place_m), known, PLACES, world.count)
    estimator.begin(np.ones(world.count, np.bool_), *world.forecast.T)
    return estimator


def drive(world: World, estimator: Estimator, decisions: int, change: Any = None) -> None:
    """Drive out, every eighth decision at half speed; `change` may spoil what is read."""
    for decision in range(decisions):
        world.drive(1.0, 0.55 if decision % 8 == 1 else world.cruise_mps, 0.0)
        readings = world.read()
        if change is not None:
            change(decision, readings)
        estimator.update(readings, np.ones(world.count, np.bool_))


def home_error(world: World, estimator: Estimator) -> tuple[Array, Array, Array]:
    """Way home beyond what was believed, its standard deviation, and whether the margin is below
    its 1e-3 quantile."""
    home_j = world.way_home_j(99)
    total = estimator.margin(estimator.plans(world.home_cost_j), 1e-3).total
    margin_j = (world.capacity_j - world.used_j - home_j) * world.gain
    return (
        home_j / world.capacity_j - total["cost_share"],
        total["cost_share_sd"],
        margin_j < total["margin_low_j"],
    )


CALM = Prior(
    capacity=1.0, capacity_sd=0.0, rolling=1.0, rolling_sd=0.0, mass=1.0, mass_sd=0.0, wind_sd_mps=0.0,
    forecast_sd_mps=0.0, missed=0.0, model_error=0.0, slope_within_place=0.0,
)  # fmt: skip
"""A robot as in its file, in still air: of which the filter knows everything."""
PLACE_M = 25.0


def alone(prior: Prior, east_mps: float = 0.0, north_mps: float = 0.0) -> Estimator:
    """An estimator of one robot, cruising at 0.5 m/s, that begins with this forecast of the
    wind."""
    estimator = Estimator(vehicle_of(ROBOT, PLACE_M, 0.5), prior, PLACES, 1)
    estimator.begin(np.ones(1, np.bool_), np.array([east_mps]), np.array([north_mps]))
    return estimator


def read(estimator: Estimator, dt_s: float, position_m: float, **of: float) -> None:
    """Give it a reading on a way to the east, level unless `of` says so; what `of` lacks was not
    read."""
    reading = np.full(1, np.nan, READING_DTYPE)
    reading["time_s"], reading["position_m"] = estimator.state["robot"]["time_s"] + dt_s, position_m
    reading["sine"], reading["other_j"], reading["speed_mps"] = 0.0, 0.0, 0.5
    reading["east"], reading["north"] = 1.0, 0.0
    for name, value in of.items():
        reading[name] = value
    estimator.update(reading, np.ones(1, np.bool_))
