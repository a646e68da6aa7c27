"""What the shield believes: many imagined days, kept or dropped by how well they explain what the robot has used."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, feature
from homeward.agents.shield_kernel import Vehicle, learn, spare
from homeward.envs.batch import Batch, observation_space
from homeward.envs.options import Options, Setting
from homeward.envs.routes import GENERATED, HIDDEN_WIND
from homeward.physics import ancillary_power
from homeward.physics.model import GRAVITY_MPS2, headwind

DAYS = 1024
"""Imagined days of each kind."""
KINDS = {
    GENERATED: ((GENERATED, 1.0), (HIDDEN_WIND, 5.0 / 6.0)),
    HIDDEN_WIND: ((HIDDEN_WIND, 1.0), (HIDDEN_WIND, 13.0 / 12.0)),
}
"""Routes and factors of the wind of the imagined days, by the route of the environment: as there, and as bad as they
come. A promise of one failure in thousands is kept or broken on days that hardly ever happen: a steady wind of 2.5 to
5 m/s on the back, which nothing on the way out gives away. Of those a sample as large as this has too few by itself."""
TOLERANCE = 0.01
"""Error of a day that explains the drive, root mean square, as a share of the energy."""
NEAREST = 64
"""Days that always count: those with the least error, however large."""
_FIRST_SEED = 1 << 40
"""Seeds of the imagined days: neither those of training and tuning, which are small, nor those of evaluations."""

DRIVE_DTYPE = np.dtype([(name, np.float64) for name in (
    "used_j", "modelled_j", "ancillary_j", "from_m", "to_m", "speed_mps",
)])  # fmt: skip
"""What a decision took: by the gauge, by the robot's own model, and its ancillary part; from where to where."""
PLAN_DTYPE = np.dtype([("in_doubt", np.bool_)] + [(name, np.float64) for name in (
    "energy", "home_cost_j", "position_m", "ends_m", "moves_m", "speed_mps", "ancillary_j", "most_sine", "least_sine",
)])  # fmt: skip
"""What a decision is to be: the state before it, where it ends, what it takes, and the slopes that may lie ahead."""


@dataclass(frozen=True)
class Days:
    """Imagined days: what the robot does not know, drawn as the environment draws it.

    Attributes:
        capacity: Battery capacity over the robot's own, shape (days,).
        gauge: True energy used over that shown by the gauge, shape (days,).
        mass: Moved mass over the robot's own, shape (days,).
        rolling: Least and most of rolling resistance over the robot's own.
        ground: Rolling resistance of each place over that of the day, shape (days, places).
        headwind_mps: Wind against the way out at each place, m/s, shape (days, places).
    """

    capacity: NDArray[np.float64]
    gauge: NDArray[np.float64]
    mass: NDArray[np.float64]
    rolling: tuple[float, float]
    ground: NDArray[np.float32]
    headwind_mps: NDArray[np.float32]


def imagine(options: Options, setting: Setting) -> Days:
    """Draw days from the distributions of `homeward.envs.difficulty` and `homeward.envs.routes`.

    The options say what kind of days there may be (difficulty, and with the route `hidden_wind` a strong wind); which
    day it is stays unknown. Routes of a file are imagined with the headings and winds of generated ones, so that the
    day of the file is not given away. Where nothing is hidden, one day stands for all.
    """
    places = int(setting.shared["places"][0])
    if options.difficulty == "known":
        one, flat = np.ones(1), np.ones((1, places), np.float32)
        return Days(one, one, one, (1.0, 1.0), flat, np.zeros_like(flat))
    kinds = KINDS[HIDDEN_WIND if setting.shared["hidden_wind"][0] else GENERATED]
    drawn = [
        _draw(dataclasses.replace(options, robot=setting.robot, route=route), _FIRST_SEED * (1 + index))
        for index, (route, _) in enumerate(kinds)
    ]
    robots, records, ways = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
    ways = ways[:, np.arange(places) * ways.shape[1] // places]
    nominal = setting.robot.record()[0]
    rolling = robots["rolling_resistance"] / nominal["rolling_resistance"]
    rougher = robots["surface_gain"] - nominal["surface_gain"]
    wind_mps = robots["wind_exposure"] * records["wind_mps"] * np.repeat([factor for _, factor in kinds], DAYS)
    capacity = records["capacity_j"] / setting.robot.usable_energy_j
    return Days(
        capacity=capacity,
        gauge=capacity / (1.0 + records["gauge_bias"]),
        mass=(robots["mass_kg"] + robots["payload_mass_kg"]) / (nominal["mass_kg"] + nominal["payload_mass_kg"]),
        rolling=(float(rolling.min()), float(rolling.max())),
        ground=(1.0 + rougher[:, None] * ways["roughness"]).astype(np.float32),
        headwind_mps=headwind(wind_mps[:, None], records["wind_from_rad"][:, None], ways["east"], ways["north"]).astype(
            np.float32
        ),
    )


def _draw(options: Options, seed: int) -> tuple[NDArray[np.void], NDArray[np.void], NDArray[np.void]]:
    """True robots, records and places of missions that have just begun."""
    batch = Batch(options, DAYS)
    batch.generators = [np.random.default_rng(seed + i) for i in range(DAYS)]
    batch.reset(np.ones(DAYS, np.bool_), np.empty((DAYS, *(observation_space().shape or ())), np.float32))
    places = int(batch.setting.shared["places"][0])
    return batch.robots.copy(), batch.records.copy(), batch.routes["places"][:, :places].copy()


@dataclass(frozen=True)
class Commands:
    """What robots are told to do: speed (m/s, 0 to stop), sensing rate (Hz), and whether to head home; shape (n,)."""

    speed_mps: NDArray[np.float64]
    sensing_hz: NDArray[np.float64]
    homeward: NDArray[np.bool_]


class Belief:
    """Which imagined days explain the energy that missions have used so far, and what those days leave to spare.

    Args:
        options: Of the environment.
        setting: Its constants.
        home_mps: Speed of the way home, m/s.
    """

    def __init__(self, options: Options, setting: Setting, home_mps: float) -> None:
        robot, s = setting.robot, setting.shared[0]
        nominal, efficiency, drag = robot.record()[0], robot.traction_efficiency, robot.drag_ns2_per_m2
        days = self._days = imagine(options, setting)
        self._setting = setting
        # Days lie side by side, as all of them are asked about the same place.
        ground, headwind = (np.ascontiguousarray(values.T) for values in (days.ground, days.headwind_mps))
        self._arrays = days.gauge, days.mass, ground, headwind
        weight_n = float(nominal["mass_kg"] + nominal["payload_mass_kg"]) * GRAVITY_MPS2
        idle_w, cruise_mps = float(ancillary_power(robot, 0.0)), float(s["cruise_mps"])
        self._vehicle = Vehicle(
            rolling_n=robot.rolling_resistance * weight_n,
            weight_n=weight_n,
            drag_ns2_per_m2=drag,
            efficiency=efficiency,
            usable_j=float(s["usable_j"]),
            place_m=float(s["place_m"]),
            places=int(s["places"]),
            home_mps=home_mps,
            idle_w=idle_w,
            slower_j_per_m=idle_w / home_mps - idle_w / cruise_mps + drag * (home_mps**2 - cruise_mps**2) / efficiency,
        )
        # In shorter pit stops, turns pass unseen: how far the robot went is not known, and nothing is learned from it.
        self._sees_turns = bool(s["pit_stop_s"] == 0.0 or s["pit_stop_s"] >= s["decision_s"])
        self._forget(0)

    def _forget(self, count: int) -> None:
        self._energy, self._modelled, self._position_m = np.ones(count), np.zeros(count), np.zeros(count)
        self._squares, self._energy_j = np.zeros((count, 3, len(self._days.mass))), np.zeros(count)
        self._sines = np.zeros((count, self._vehicle.places))

    def learn(self, observations: Observations, begun: NDArray[np.bool_], last: Commands | None) -> None:
        """Take in what the decision before took.

        Args:
            observations: Of the missions, shape (n, features).
            begun: Missions that have just begun, shape (n,).
            last: What they were told before; `None` where n has changed.
        """
        if len(begun) != len(self._energy):
            self._forget(len(begun))
        v, s = self._vehicle, self._setting.shared[0]
        energy, modelled = feature(observations, "energy"), feature(observations, "modelled")
        position_m = feature(observations, "distance") * s["reach_m"]
        if last is not None and self._sees_turns:
            drives = np.zeros(len(begun), DRIVE_DTYPE)
            drives["used_j"] = (self._energy - energy) * v.usable_j
            drives["modelled_j"] = np.where(begun, 0.0, modelled - self._modelled) * v.usable_j
            drives["ancillary_j"] = ancillary_power(self._setting.robot, last.sensing_hz) * s["decision_s"]
            drives["from_m"], drives["to_m"], drives["speed_mps"] = self._position_m, position_m, last.speed_mps
            learn(v, self._arrays, drives, self._squares, self._energy_j)
        self._squares[begun], self._energy_j[begun] = 0.0, 0.0
        self._energy, self._modelled, self._position_m = energy, modelled, position_m
        self._see_ground(observations)

    def _see_ground(self, observations: Observations) -> None:
        """Note the slope here on the way out, and take it for that of what lies ahead."""
        v = self._vehicle
        place = np.clip((self._position_m / v.place_m).astype(np.int64), 0, v.places - 1)
        ahead = np.arange(v.places) >= place[:, None]
        outwards = feature(observations, "returning") == 0.0
        self._sines = np.where(ahead & outwards[:, None], _sine_here(observations)[:, None], self._sines)

    def spare(
        self, observations: Observations, commands: Commands, in_doubt: NDArray[np.bool_], margin: float
    ) -> NDArray[np.float64]:
        """Energy beyond a decision and the way home after it, as a share of the usable energy, shape (n,).

        It is the least on any of the days that explain the drive, and infinite where there is no doubt.

        Args:
            observations: Of the missions, shape (n, features), after `learn`.
            commands: What they are to do next.
            in_doubt: For which missions to ask, shape (n,).
            margin: Share of the way home to be kept beyond it.
        """
        s, position_m = self._setting.shared[0], self._position_m
        way_m = commands.speed_mps * s["decision_s"]
        inwards = commands.homeward | (feature(observations, "outbound") < 0.0)
        ends_m = np.where(inwards, np.maximum(position_m - way_m, 0.0), np.minimum(position_m + way_m, s["length_m"]))
        arrives = commands.homeward & (ends_m <= 0.0) & (commands.speed_mps > 0.0)
        lasts_s = np.where(arrives, position_m / np.maximum(commands.speed_mps, 1e-9), s["decision_s"])
        here, near = _sine_here(observations), 0.1 * feature(observations, "grade_near")
        plans = np.zeros(len(observations), PLAN_DTYPE)
        plans["in_doubt"], plans["energy"] = in_doubt, self._energy
        plans["home_cost_j"] = feature(observations, "home_cost") * s["usable_j"]
        plans["position_m"], plans["ends_m"] = position_m, ends_m
        plans["moves_m"] = np.where(inwards, position_m - ends_m, way_m)
        plans["speed_mps"] = commands.speed_mps
        plans["ancillary_j"] = ancillary_power(self._setting.robot, commands.sensing_hz) * lasts_s
        plans["most_sine"] = np.where(inwards, here, np.maximum(here, near))
        plans["least_sine"] = np.where(inwards, here, np.minimum(here, near))
        spare_j = np.full(len(observations), np.inf)
        spare(
            self._vehicle, self._arrays, self._days.capacity, self._days.rolling, self._squares, self._energy_j,
            self._sines, plans, TOLERANCE, min(NEAREST, len(self._days.mass)), margin, spare_j,
        )  # fmt: skip
        return spare_j / self._vehicle.usable_j


def _sine_here(observations: Observations) -> NDArray[np.float64]:
    """Sine of the slope here along the way out."""
    return 0.1 * feature(observations, "grade") * feature(observations, "outbound")
