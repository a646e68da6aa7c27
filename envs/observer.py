"""Observations on a real robot: from its readings, as the environments compute them for agents.

The environments' own code, in plain Python, updates a mission record: with the decisions as
commanded, corrected to the position readings; the map of the way home by the slope readings; and
the other instruments as read. With the same readings a policy therefore gets the same observations
on a robot as in the environment.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.envs.actions import decode_actions
from homeward.envs.conditions.instruments import meter
from homeward.envs.driving import cross, decide, map_place
from homeward.envs.features import FEATURES, OBSERVATION_DTYPE, home_cost, observe
from homeward.envs.kernel import note_ahead
from homeward.envs.options import OFF_COMMAND, Known
from homeward.envs.reward import score
from homeward.envs.routes.route import MEAN_INTEREST, Route
from homeward.envs.state import CONSTANTS_DTYPE, GO, MISSION_DTYPE, RETURN, ROUTE_DTYPE, STOP
from homeward.physics.plain import plain

Array = NDArray[np.float64]

# chosen: above 0, because the kernel divides by speed, and no distance in a decision
_STANDING_MPS = 1e-6
_BORDER = 1e-6
"""Share of a place within which a robot counts as being on its border. Chosen: above rounding, and
no distance."""


class Read(NamedTuple):
    """Readings of a robot over a decision, NaN where an instrument was not read.

    Attributes:
        position_m: Position along the route at its end, m; home is 0.
        power_w: Mean power out of the battery, W.
        soc: State of charge at its end, 0 to 1, as a share of the energy
            (`homeward.physics.battery.energy_share`).
        speed_mps: Speed at its end, m/s.
        temperature_c: Air temperature at its end, C.
    """

    position_m: float
    power_w: float = math.nan
    soc: float = math.nan
    speed_mps: float = math.nan
    temperature_c: float = math.nan


class Observer:
    """Makes the observations of one mission from a robot's readings.

    Args:
        known: Constants of the environment.
        forecast: The route as forecast, in the places of `known`: slopes, headings and interest; by
            default flat, with the mean interest of generated routes.
        forecast_mps: Forecast of the wind: components towards where it comes from, east and north,
            m/s.
        mean_grade: Mean sine of the route's slope; by default that of the forecast.

    Raises:
        ValueError: The forecast has other places than `known`, or that has docks.
    """

    def __init__(
        self,
        known: Known,
        forecast: Route | None = None,
        forecast_mps: tuple[float, float] = (0.0, 0.0),
        mean_grade: float | None = None,
    ) -> None:
        self.known = known
        s = known.shared[0]
        if s["dock_count"]:
            raise ValueError(
                "features of docks are not read on a robot yet; give an environment without docks"
            )
        self._count = int(s["places"])
        self._place_m = float(s["place_m"])
        if forecast is None:
            zeros = np.zeros(self._count)
            forecast = Route(
                place_m=self._place_m,
                grade_rad=zeros,
                roughness=zeros,
                interest=zeros + MEAN_INTEREST,
                heading_rad=zeros,
            )
        if len(forecast.grade_rad) != self._count or not math.isclose(
            forecast.place_m, self._place_m, rel_tol=1e-9
        ):
            raise ValueError(
                f"the forecast has {len(forecast.grade_rad)} places of {forecast.place_m:g} m; give {self._count} of "
                f"{self._place_m:g} m"
            )
        self._forecast = forecast
        self._constants = plain(np.zeros(1, CONSTANTS_DTYPE))
        self._constants["shared"] = s
        self._constants["nominal"] = known.robot.record()[0]
        self._records = plain(np.zeros(1, MISSION_DTYPE))
        self._routes = plain(np.zeros(1, ROUTE_DTYPE))
        self._sines = np.zeros(self._count)  # sum of the readings in each place
        self._readings = np.zeros(self._count)  # and their number
        self._interest = forecast.interest.copy()
        places = self._routes["places"][0, : self._count]
        places["curvature_per_m"] = forecast.curvature_per_m
        places["east"] = np.cos(forecast.heading_rad)
        places["north"] = np.sin(forecast.heading_rad)
        if mean_grade is None:
            mean_grade = float(np.mean(np.sin(forecast.grade_rad)))
        east_mps, north_mps = forecast_mps
        mission = self._records[0]
        mission["direction"] = 1.0
        mission["temperature_c"] = forecast.temperature_c
        mission["mean_grade"] = mean_grade
        mission["mean_east_mps"] = east_mps
        mission["mean_north_mps"] = north_mps
        mission["forecast_east_mps"] = east_mps
        mission["forecast_north_mps"] = north_mps

    def begin(self, read: Read) -> NDArray[np.float32]:
        """Observe the start of the mission, shape (1, features)."""
        mission = self._records[0]
        usable_j = float(self.known.shared["usable_j"][0])
        mission["temperature_c"] = _or(read.temperature_c, float(mission["temperature_c"]))
        mission["soc"] = _or(read.soc, 1.0)
        mission["metered"] = mission["soc"]
        mission["soc_lowest"] = 1.0
        # The energy left is read, not computed: it decides the voltage, and the battery does not
        # run out.
        mission["endless"] = True
        mission["capacity_j"] = usable_j
        mission["energy_j"] = mission["soc"] * usable_j
        # Energy missing from the battery counts as used, as the model predicts it.
        mission["metered_followed"] = 1.0 - mission["soc"]
        mission["metered_j"] = mission["metered_followed"] * usable_j
        mission["modelled_j"] = mission["metered_j"]
        self._note_places()
        rows = plain(np.zeros(1, OBSERVATION_DTYPE))
        _begin(self._records, self._routes, self._constants, read.position_m, rows)
        return _as_features(rows)

    def see(
        self,
        position_m: float,
        grade_rad: float = math.nan,
        interest: float = math.nan,
        heading_rad: float = math.nan,
        outwards: bool = True,
    ) -> None:
        """Store a reading of the ground, here or at a place in sight. Slopes read in a place are
        averaged.

        Args:
            position_m: Position along the route, m.
            grade_rad: Slope along the way out, rad; NaN: not seen.
            interest: Its interest; NaN: not seen.
            heading_rad: Direction of the way out there, rad counter-clockwise from east; NaN: not
                seen.
            outwards: On a border between places: whether the place beyond it is meant.
        """
        places_from_home = position_m / self._place_m
        border = round(places_from_home)
        place = math.floor(places_from_home)
        if abs(places_from_home - border) < _BORDER:
            place = border if outwards else border - 1
        place = min(max(place, 0), self._count - 1)
        if math.isfinite(grade_rad):
            self._sines[place] += math.sin(grade_rad)
            self._readings[place] += 1.0
        if math.isfinite(interest):
            self._interest[place] = interest
        if math.isfinite(heading_rad):
            self._routes["places"][0, place]["east"] = math.cos(heading_rad)
            self._routes["places"][0, place]["north"] = math.sin(heading_rad)

    def decide(self, action: NDArray[Any], read: Read) -> NDArray[np.float32]:
        """Update the mission with a decision, and observe its result, shape (1, features).

        Args:
            action: The commanded action, shape (1, 3).
            read: The readings meanwhile.
        """
        s = self.known.shared[0]
        decision_s = float(s["decision_s"])
        self._note_places()
        records_before = self._records.copy()
        routes_before = self._routes.copy()
        way_m = read.position_m - float(records_before["position_m"][0])
        self._drive(action, None)
        off_m = abs(self._records["position_m"][0] - read.position_m)
        if off_m > OFF_COMMAND * s["max_speed_mps"] * decision_s:
            self._records = records_before.copy()
            self._routes = routes_before
            self._drive(action, way_m / decision_s)
        mission = self._records[0]
        modelled_w = float(mission["modelled_j"] - records_before["modelled_j"][0]) / decision_s
        mission["read_w"] = _or(read.power_w, modelled_w)
        mission["read_mps"] = _or(read.speed_mps, abs(way_m) / decision_s)
        metered = float(mission["metered"] - mission["read_w"] * decision_s / s["usable_j"])
        mission["soc"] = _or(read.soc, max(metered, 0.0))
        mission["energy_j"] = mission["soc"] * mission["capacity_j"]
        rows = plain(np.zeros(1, OBSERVATION_DTYPE))
        temperature_c = _or(read.temperature_c, float(mission["temperature_c"]))
        _read(self._records, self._routes, self._constants, read.position_m, temperature_c, rows)
        return _as_features(rows)

    def _drive(self, action: NDArray[Any], along_mps: float | None) -> None:
        """Drive as commanded or, if the positions contradict that, at the speed that they imply,
        along the way out."""
        commands = decode_actions(self.known, action)
        speed_mps = float(commands.speed_mps[0])
        sensing_hz = float(commands.sensing_hz[0])
        mode = int(commands.mode[0])
        if along_mps is not None:
            ahead = float(self._records["direction"][0])
            if mode == RETURN:
                ahead = -1.0
            speed_mps = max(ahead * along_mps, _STANDING_MPS)
            if mode == STOP:
                mode = GO
        _drive(self._records, self._routes, self._constants, speed_mps, sensing_hz, mode)

    def state(self) -> bytes:
        """State for a restart."""
        return b"".join(array.tobytes() for array in self._memory())

    def restore(self, state: bytes) -> None:
        """Continue from `state`, with the same arguments.

        Raises:
            ValueError: The state is of another mission.
        """
        memory = self._memory()
        if len(state) != sum(array.nbytes for array in memory):
            raise ValueError("the state is of another version or of another route")
        for array in memory:
            array[:] = np.frombuffer(state[: array.nbytes], array.dtype)
            state = state[array.nbytes :]

    def _memory(self) -> tuple[NDArray[Any], ...]:
        return self._records, self._routes, self._sines, self._readings, self._interest

    @property
    def returning(self) -> bool:
        """Whether the return is final."""
        return bool(self._records["returning"][0])

    @property
    def home(self) -> bool:
        """Whether the robot is home after a final return."""
        return bool(self._records["home"][0])

    def _note_places(self) -> None:
        """Write the slopes and interests as seen and as forecast for the kernels."""
        places = self._routes["places"][0, : self._count]
        forecast_sines = np.sin(self._forecast.grade_rad)
        read_sines = self._sines / np.maximum(self._readings, 1.0)
        places["sine_read"] = np.where(self._readings > 0.0, read_sines, forecast_sines)
        places["interest"] = self._interest
        sines = np.stack((places["sine_read"], forecast_sines))
        interests = np.stack((places["interest"], self._forecast.interest))
        _note(self._records, self._routes, self._constants, _totals(sines), _totals(interests))


def _or(value: float, otherwise: float) -> float:
    """A value, or another one where it is not known."""
    if math.isfinite(value):
        return value
    return otherwise


def _totals(rows: Array) -> Array:
    """Cumulative sums to each place, shape (2, places + 1)."""
    return np.pad(np.cumsum(rows, axis=1), ((0, 0), (1, 0)))


def _as_features(rows: NDArray[np.void]) -> NDArray[np.float32]:
    return rows.view(np.float32).reshape(1, len(FEATURES))


def _begin(records: Any, routes: Any, constants: Any, position_m: float, rows: Any) -> None:
    mission, route, c = records[0], routes[0], constants[0]
    map_place(mission, c.nominal, route.places[0], c.nominal, c.shared, 0.0, 0.0)
    mission.here = route.places[0]
    _move_to(mission, route, c, position_m)
    observe(mission, c.shared, home_cost(mission, c.shared), rows[0])


def _note(records: Any, routes: Any, constants: Any, sines: Any, interests: Any) -> None:
    """Store slope and interest ahead of each place, and predict the present place with the slopes
    read since."""
    mission, route, c = records[0], routes[0], constants[0]
    note_ahead(route, c.shared, sines, interests)
    place = route.places[mission.place]
    if mission.place == mission.mapped - 1 and place.sine_read != mission.here.sine_read:
        map_place(
            mission,
            c.nominal,
            place,
            c.nominal,
            c.shared,
            place.home_cost_j,
            place.true_home_cost_j,
        )
        mission.mapped -= 1
    mission.here = place


def _drive(
    records: Any, routes: Any, constants: Any, speed_mps: float, sensing_hz: float, mode: int
) -> None:
    c = constants[0]
    decide(records[0], c.nominal, routes[0], c.nominal, c.shared, speed_mps, sensing_hz, mode)


def _read(
    records: Any, routes: Any, constants: Any, position_m: float, temperature_c: float, rows: Any
) -> None:
    """Set the robot's position and readings, and observe."""
    mission, c = records[0], constants[0]
    _move_to(mission, routes[0], c, position_m)
    meter(mission, c.shared)
    mission.score = score(mission, c.shared)
    mission.temperature_c = temperature_c
    observe(mission, c.shared, home_cost(mission, c.shared), rows[0])


def _move_to(mission: Any, route: Any, c: Any, position_m: float) -> None:
    """Move to the robot's position reading."""
    shared = c.shared
    slack_m = _BORDER * shared.place_m
    direction = mission.direction
    mission.position_m = position_m
    mission.furthest_m = max(mission.furthest_m, position_m)
    mission.direction = 1.0
    while (
        mission.place < shared.places - 1
        and position_m > (mission.place + 1) * shared.place_m + slack_m
    ):
        cross(mission, c.nominal, route, c.nominal, shared)
    mission.direction = -1.0
    while mission.place > 0 and position_m < mission.place * shared.place_m - slack_m:
        cross(mission, c.nominal, route, c.nominal, shared)
    mission.direction = direction
