"""A robot finds out on the way what it is today: its battery, rolling resistance and weight, and the wind."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, feature
from homeward.agents.identification_kernel import (
    DRIVE_DTYPE,
    GROUND_DTYPE,
    GUESS_DTYPE,
    Prior,
    Vehicle,
    identify,
    look_home,
)
from homeward.envs.options import Known
from homeward.physics import ancillary_power

_KNOWN, _HIDDEN = (np.array([1.0, 1.0, 1.0]), 0.1), (np.array([1.116, 1.05, 1.1]), 1.5)
"""Gauge over truth, rolling resistance and mass over the file's, and the standard deviation of each part of the wind
beyond what is known of it, m/s: where nothing is hidden; and else, as `homeward.envs` draws them."""
_STRONG_WIND_MPS = 3.2
"""The same deviation of winds of U(3, 6) m/s, those of the routes `hidden_wind`."""
_DEVIATIONS = np.array([0.072, 0.144, 0.058])
"""Standard deviations of the first three, of `homeward.envs.difficulty`."""
_LEAST_ERROR = 0.0005
"""Error of a decision that is always reckoned with, as a share of its energy: ten times and more what single precision
leaves of one in the observation."""
_NOWHERE = -1  # place of a robot that has seen none
_ON_BORDER = 1e-4
"""Share of a place within which a robot is taken to be on its border."""
_GUESSES = 6
_PROBE = 8
"""Decisions of which one is a probe. At one speed a second wind from the other side often explains a drive as well."""


class Identification:
    """Estimates what is hidden from missions (`homeward.agents.identification_kernel.UNKNOWN`), and the way home by it.

    It sees what the observation shows, no more: what decisions took by the gauge and by the robot's own model, the
    slopes that were driven, and the compass. By that the wind is told from the ground: as the route turns, it comes
    from another side, and on the way home from the opposite one.

    Args:
        known: Constants of the environment.
        expects_strong_wind: Whether winds as on the routes `hidden_wind` are usual.

    Attributes:
        vehicle: Numbers of the robot's own model.
    """

    def __init__(self, known: Known, *, expects_strong_wind: bool = False) -> None:
        robot, s = known.robot, known.shared[0]
        nominal = robot.record()[0]
        self._known = known
        self.vehicle = Vehicle(
            rolling_resistance=robot.rolling_resistance,
            mass_kg=float(nominal["mass_kg"] + nominal["payload_mass_kg"]),
            drag_ns2_per_m2=robot.drag_ns2_per_m2,
            per_efficiency=1.0 / robot.traction_efficiency,
            cruise_mps=float(s["cruise_mps"]),
            idle_w=float(ancillary_power(robot, 0.0)),
            place_m=float(s["place_m"]),
        )
        usual, wind_mps = _KNOWN if s["route_is_known"] else _HIDDEN
        if expects_strong_wind and not s["route_is_known"]:
            wind_mps = _STRONG_WIND_MPS
        self._prior = _prior(usual, wind_mps)
        # In shorter pit stops, turns pass unseen: how far the robot went is not known, and nothing is learned from it.
        self._sees_turns = bool(s["pit_stop_s"] == 0.0 or s["pit_stop_s"] >= s["decision_s"])
        self._first = np.zeros(_GUESSES + 1, GUESS_DTYPE)
        self._first["unknown"], self._first["error"] = self._prior.mean, _LEAST_ERROR
        self._first["factor"] = np.linalg.cholesky(self._prior.inverse)
        self._first["weight"][0] = 1.0
        self._forget(0)

    def _forget(self, count: int) -> None:
        s = self._known.shared[0]
        self._decisions, self._counts = np.zeros((2, count), np.int64)
        self._drives = np.zeros((count, int(s["max_decisions"])), DRIVE_DTYPE)
        self._grounds = np.zeros((count, int(s["places"])), GROUND_DTYPE)
        self._guesses = np.tile(self._first, (count, 1))
        self._energy, self._modelled, self._position_m = np.ones(count), np.zeros(count), np.zeros(count)
        self._furthest = np.full(count, _NOWHERE)

    @property
    def position_m(self) -> NDArray[np.float64]:
        """Where missions are, shape (n,)."""
        return self._position_m

    @property
    def grounds(self) -> NDArray[np.void]:
        """The way out as it was seen, `GROUND_DTYPE`, shape (n, places)."""
        return self._grounds

    @property
    def guesses(self) -> NDArray[np.void]:
        """`GUESS_DTYPE`, shape (n, guesses): those with a weight explain the drive."""
        return self._guesses[:, :-1]

    @property
    def unknown(self) -> NDArray[np.float64]:
        """The likeliest numbers, shape (n, 5)."""
        return np.asarray(self._guesses["unknown"][:, 0])

    def learn(self, observations: Observations, begun: NDArray[np.bool_]) -> None:
        """Take in what the decision before took; one that is shown twice counts once.

        Args:
            observations: Of the missions, shape (n, features).
            begun: Missions that have just begun, shape (n,).
        """
        if len(begun) != len(self._counts):
            self._forget(len(begun))
        if begun.any():
            self._decisions[begun], self._counts[begun], self._guesses[begun] = 0, 0, self._first
            self._energy[begun], self._modelled[begun], self._position_m[begun] = 1.0, 0.0, 0.0
            self._furthest[begun] = _NOWHERE
        s = self._known.shared[0]
        energy, modelled = feature(observations, "metered"), feature(observations, "modelled")
        position_m = feature(observations, "distance") * s["reach_m"]
        self._see_ground(observations, position_m)
        new = np.zeros(len(begun), DRIVE_DTYPE)
        new["used_j"] = (self._energy - energy) * s["usable_j"]
        new["modelled_j"] = (modelled - self._modelled) * s["usable_j"]
        new["from_m"], new["to_m"] = self._position_m, position_m
        new["speed_mps"] = feature(observations, "speed") * s["max_speed_mps"]
        # One that came to an end of the route stands there in the end, and does not say how fast it came.
        arrives = (new["speed_mps"] == 0.0) & (new["from_m"] != new["to_m"])
        asked = (modelled > self._modelled) & ~arrives & self._sees_turns
        self._note(new, asked)
        self._energy, self._modelled, self._position_m = energy, modelled, position_m
        identify(
            self.vehicle, self._prior, asked, self._decisions, self._counts, self._drives, self._grounds, self._guesses
        )

    def _note(self, new: NDArray[np.void], asked: NDArray[np.bool_]) -> None:
        """Add new drives to those before: to the last one, if it is the same drive within the same place."""
        rows = np.flatnonzero(asked)
        new, before = new[rows], self._drives[rows, np.maximum(self._counts[rows] - 1, 0)]
        place_m = self.vehicle.place_m

        def place(position_m: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.floor(position_m / place_m)

        goes_on = (self._counts[rows] > 0) & (before["to_m"] == new["from_m"])
        goes_on &= before["speed_mps"] == new["speed_mps"]
        goes_on &= np.sign(before["to_m"] - before["from_m"]) == np.sign(new["to_m"] - new["from_m"])
        goes_on &= place(before["from_m"]) == place(new["to_m"])
        for name in ("used_j", "modelled_j"):
            new[name] += np.where(goes_on, before[name], 0.0)
        new["from_m"] = np.where(goes_on, before["from_m"], new["from_m"])
        self._decisions[rows] += 1
        self._counts[rows] += ~goes_on
        self._drives[rows, self._counts[rows] - 1] = new

    def _see_ground(self, observations: Observations, position_m: NDArray[np.float64]) -> None:
        """Note the place that the robot is in on its way out, and take it for what lies beyond all that was seen."""
        at = position_m / self.vehicle.place_m
        place = (at + _ON_BORDER).astype(np.int64)
        # On a border, rounding says which side is shown: that counts until the place is seen from within.
        within = np.abs(at - np.rint(at)) > _ON_BORDER
        outwards = (feature(observations, "returning") == 0.0) & (feature(observations, "outbound") > 0.0)
        new = outwards & ((place > self._furthest) | (place == self._furthest) & within)
        self._furthest = np.where(new, place, self._furthest)
        ahead = new[:, None] & (np.arange(self._grounds.shape[1]) >= place[:, None])
        for name, seen in (
            ("sine", 0.1 * feature(observations, "grade")),
            ("east", feature(observations, "east")),
            ("north", feature(observations, "north")),
        ):
            self._grounds[name] = np.where(ahead, seen[:, None], self._grounds[name])

    @property
    def probes(self) -> NDArray[np.bool_]:
        """Whether the next decision should be driven at half speed, so that its speed tells wind from ground, (n,)."""
        return np.asarray(self._decisions % _PROBE == 1)

    def look_home(self, observations: Observations, onwards_m: float) -> NDArray[np.float64]:
        """What the way home takes by the gauge, after `learn`.

        Args:
            observations: Of the missions, shape (n, features).
            onwards_m: Metres to go on before turning home.

        Returns:
            The way home, its standard deviation, going on and from there home, and the same by the robot's own model,
            as shares of the usable energy, shape (n, 4).
        """
        usable_j = self._known.shared["usable_j"][0]
        costs_j = np.empty((len(observations), 4))
        home_cost_j = feature(observations, "home_cost") * usable_j
        look_home(
            self.vehicle, self._position_m, home_cost_j, onwards_m, 0.1 * feature(observations, "grade_1"),
            self._grounds, self._guesses, costs_j,
        )  # fmt: skip
        return np.asarray(costs_j / usable_j)


def _prior(mean: NDArray[np.float64], wind_mps: float) -> Prior:
    """Usual numbers, from the means of gauge, rolling resistance and mass; deviations to first order."""
    gauge, rolling, mass = mean
    slopes = np.array([[1.0, 0.0, 0.0], [rolling * mass, gauge * mass, gauge * rolling], [mass, 0.0, gauge]])
    covariance = np.diag(np.full(5, wind_mps**2))
    covariance[:3, :3] = slopes @ np.diag(_DEVIATIONS**2) @ slopes.T
    usual = np.array([gauge, gauge * rolling * mass, gauge * mass, 0.0, 0.0])
    return Prior(usual, np.linalg.inv(covariance), _LEAST_ERROR)
