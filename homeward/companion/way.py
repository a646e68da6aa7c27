"""The robot's position on its way: along a route, along its recorded trail, or in metres from
home."""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from homeward.companion import thresholds
from homeward.companion.positions import Correction, PositionFilter
from homeward.companion.readings import POSITIONS, CompanionError, Position, Reading
from homeward.estimation import WAY_DTYPE, Vehicle
from homeward.estimation.filter import place_of

Array = NDArray[np.float64]


class RouteLike(Protocol):
    """A route cut into places of equal length, such as `homeward.envs.routes.Route`; arrays of
    shape (places,)."""

    @property
    def place_m(self) -> float:
        """Length of a place, m."""

    @property
    def grade_rad(self) -> Array:
        """Slope angle along the way out, rad."""

    @property
    def heading_rad(self) -> Array:
        """Direction of the way out, rad counter-clockwise from east."""


class Step(NamedTuple):
    """Change of the way with a reading."""

    position_m: float  # way home
    way_m: float  # driven since the last reading
    heading_rad: float  # of travel; NaN: unknown
    reckoned_m: float  # driven since the last position


_MOST_CRUMBS = 1024  # points of the trail; chosen: a saved state stays below 200 kB


class Way:
    """Tracks the robot by positions, and by speed and heading between them, and keeps the way home.

    With `(east, north)` it records a trail of points. The way home is the shortest along the trail:
    where it passes an earlier point, the loop in between is left out. With a route, the way home is
    back along the route.

    Args:
        home: Coordinates of home, `"here"` for the place of the first reading, or None if positions
            are metres.
        route: The route, if there is one.
        crumb_m: Distance between points of the trail, and from the trail at which the robot may
            join it.
        most_m: Longest way home that is possible, m.

    Attributes:
        position_m: Way home along the trail or route, m.
        moved_home: Where home has moved to, None if it has not.
    """

    SAVED: ClassVar = (
        "crumb_m", "position_m", "reckoned_m", "off_route_m", "moved_home", "_heading_rad", "_sign", "_positions",
        "_crumbs", "_at_m", "_shares", "_count", "_told_metres", "_speed_mps",
    )  # fmt: skip
    MAY_BE: ClassVar = {"moved_home": POSITIONS}

    def __init__(
        self, home: Position | str | None, route: RouteLike | None, crumb_m: float, most_m: float
    ) -> None:
        self.home = home
        self.crumb_m = crumb_m
        self._most_m = most_m
        self._route = route
        self.moved_home: Position | None = None
        self.position_m = 0.0
        self.reckoned_m = 0.0
        self._heading_rad = math.nan
        self._sign = 1.0
        self._speed_mps = math.nan
        start = (0.0, 0.0)
        if isinstance(home, tuple):
            start = home
        self._positions = PositionFilter(np.array(start, dtype=np.float64))
        self._crumbs = np.zeros((_MOST_CRUMBS, 2))
        self._at_m = np.zeros(_MOST_CRUMBS)
        # of a correction of the place, by which each point is off, too
        self._shares = np.zeros(_MOST_CRUMBS)
        self._count = 0
        self.route_m: float | None = None
        self._corners: Array | None = None
        self.ends_at_home = False
        if route is not None:
            self.route_m = float(route.place_m) * len(route.grade_rad)
            along = route.place_m * np.stack(
                (np.cos(route.heading_rad), np.sin(route.heading_rad)), axis=-1
            )
            self._corners = np.concatenate((np.zeros((1, 2)), np.cumsum(along, axis=0)))
            self._place_m = float(route.place_m)
            self.ends_at_home = (
                len(along) > 2 and float(np.hypot(*self._corners[-1])) <= self._place_m
            )
        self.off_route_m = 0.0
        self._told_metres = False

    def follow(self, reading: Reading) -> Step:
        """Process a reading.

        Raises:
            CompanionError: The position cannot be determined, or home was not set.
        """
        before_m = self.position_m
        speed = reading.speed_mps
        # Not more in a gap than a robot can drive at all; `min` keeps NaN where it comes first.
        driven_m = min(abs(speed) * reading.dt_s, self._most_m)
        if isinstance(reading.position, float):
            self._told_metres = True
            self.position_m = max(reading.position, 0.0)
            self.reckoned_m = 0.0
            moved_m = self.position_m - before_m
            if moved_m:
                self._sign = math.copysign(1.0, moved_m)
            way_m = 0.0  # nobody drives in no time: it starts there
            if reading.dt_s > 0.0:
                way_m = abs(moved_m)
            return Step(
                position_m=self.position_m,
                way_m=way_m,
                heading_rad=reading.heading_rad,
                reckoned_m=0.0,
            )
        heading = reading.heading_rad
        if reading.position is not None:
            moved = self._move_to(reading.position, driven_m, reading)
            if math.isnan(heading) and float(np.hypot(*moved)) > 0.0:
                heading = math.atan2(moved[1], moved[0])
            if reading.dt_s == 0.0:
                way_m = 0.0
            elif math.isfinite(driven_m):
                way_m = driven_m
            else:
                way_m = float(np.hypot(*moved))
            self.reckoned_m = 0.0
            if math.isfinite(heading):
                self._heading_rad = heading
            if math.isfinite(speed):
                self._speed_mps = speed
        else:
            way_m = self._reckon(driven_m, heading, speed)
            self.reckoned_m += way_m
        if not self._told_metres:
            self.position_m = self._way_home_m()
        return Step(
            position_m=self.position_m, way_m=way_m, heading_rad=heading, reckoned_m=self.reckoned_m
        )

    def _move_to(self, position: tuple[float, float], driven_m: float, reading: Reading) -> Array:
        """Move to a position, filtered by speed and heading where they are read; returns the
        change."""
        read = np.array(position, dtype=np.float64)
        if self._count == 0:
            if self.home is None:
                raise CompanionError(
                    "home was not set: give Companion(home=(east, north)), or home='here' for the robot's first place"
                )
            # A home that is the first position is as far off as that; one that is told is where it
            # is.
            if self.home == "here":
                self._lay(read, 0.0)
                self._shares[0] = 1.0
            else:
                self._lay(np.array(self.home, dtype=np.float64), 0.0)
                self._shares[0] = 0.0
            self._positions.see(read, reckons=False)
            return np.zeros(2)
        xy_before = self._xy
        heading = reading.heading_rad
        # After a charge nobody has reckoned the way: the position is taken as it is, and nothing
        # was driven.
        passed = reading.dt_s > 0.0
        reckons = passed and math.isfinite(driven_m) and math.isfinite(heading)
        guessed = passed and math.isfinite(self._speed_mps) and math.isfinite(self._heading_rad)
        if reckons:
            self._positions.reckon(_moved(math.copysign(driven_m, reading.speed_mps), heading))
        elif guessed:
            # As before, within all of that: one reading that is missing does not make a noisy
            # position exact.
            speed = reading.speed_mps
            if math.isnan(speed):
                speed = self._speed_mps
            if math.isnan(heading):
                heading = self._heading_rad
            as_before_m = math.copysign(min(abs(speed) * reading.dt_s, self._most_m), speed)
            self._positions.reckon(_moved(as_before_m, heading), 1.0)
        self._correct_trail(self._positions.see(read, reckons or guessed))
        return self._xy - xy_before

    def _correct_trail(self, correction: Correction) -> None:
        """Move the trail by what a position told of the error that it shares with the place."""
        trail = self._crumbs[: self._count]
        shares = self._shares[: self._count]
        shares *= correction.shared
        legs_m = np.hypot(*np.diff(trail, axis=0).T)
        trail += shares[:, None] * correction.moved
        longer_m = np.hypot(*np.diff(trail, axis=0).T) - legs_m
        self._at_m[1 : self._count] += np.cumsum(longer_m)

    @property
    def _xy(self) -> Array:
        """The robot's place, east and north, m."""
        return self._positions.place

    def _reckon(self, driven_m: float, heading: float, speed: float) -> float:
        """Dead reckoning by speed and heading; without a heading, away from home."""
        if not math.isfinite(driven_m):
            driven_m = 0.0
        if self._told_metres:
            self.position_m = max(self.position_m + self._sign * driven_m, 0.0)
        elif self._corners is not None and self._count == 0:
            self._along_route(driven_m, heading, speed)
        elif math.isfinite(heading) or math.isfinite(self._heading_rad):
            if self._count == 0:
                self._lay(self._xy, 0.0)
            if math.isfinite(heading):
                self._heading_rad = heading
            forward_m = 0.0
            if math.isfinite(speed):
                forward_m = math.copysign(driven_m, speed)
            self._positions.reckon(_moved(forward_m, self._heading_rad))
        elif driven_m > 0.0 and self._count == 0:
            raise CompanionError(
                "no position and no route: give position= (metres from home, or east and north), or heading_rad= with "
                "speed_mps=, or Companion(route=...)"
            )
        return driven_m

    def _along_route(self, driven_m: float, heading: float, speed: float) -> None:
        sign = 1.0
        if math.isfinite(speed) and speed:
            sign = math.copysign(1.0, speed)
        if math.isfinite(heading):
            assert self._route is not None
            ahead_rad = self._route.heading_rad[
                place_of(self._route, self.position_m, self._route.heading_rad)
            ]
            sign = math.copysign(1.0, math.cos(heading - ahead_rad)) * sign
        self._sign = sign
        assert self.route_m is not None
        self.position_m = min(max(self.position_m + sign * driven_m, 0.0), self.route_m)

    def _way_home_m(self) -> float:
        if self._count == 0:
            return self.position_m
        if self._corners is not None:
            return self._on_route_m()
        apart_m = np.hypot(*(self._crumbs[: self._count] - self._xy).T)
        total_m = np.where(apart_m <= self.crumb_m, self._at_m[: self._count] + apart_m, np.inf)
        total_m[-1] = self._at_m[self._count - 1] + apart_m[-1]
        # Of equals the last.
        nearest = self._count - 1 - int(np.argmin(total_m[::-1]))
        self._count = nearest + 1
        if apart_m[nearest] >= self.crumb_m:
            self._lay(self._xy, float(total_m[nearest]))
        return float(total_m[nearest])

    def _lay(self, place: Array, at_m: float) -> None:
        # drop every second one: memory is bounded, the trail is not
        if self._count == _MOST_CRUMBS:
            half = _MOST_CRUMBS // 2
            for values in (self._crumbs, self._at_m, self._shares):
                values[:half] = values[::2].copy()
            self._count = half
            self.crumb_m *= 2.0
        self._crumbs[self._count] = place
        self._at_m[self._count] = at_m
        self._shares[self._count] = 1.0
        self._count += 1

    def _on_route_m(self) -> float:
        """Distance along the route of its nearest point, near the robot's last position on it,
        m."""
        assert self._corners is not None
        corners = self._corners + self._crumbs[0]
        starts = corners[:-1]
        ends = corners[1:]
        along = ends - starts
        share = np.clip(((self._xy - starts) * along).sum(axis=1) / self._place_m**2, 0.0, 1.0)
        apart_m = np.hypot(*(starts + share[:, None] * along - self._xy).T)
        at_m = (np.arange(len(share)) + share) * self._place_m
        # If a route crosses itself, points far along it count as further away, by the error of dead
        # reckoning.
        nearest = int(
            np.argmin(apart_m + thresholds.DEAD_RECKONING_ERROR * np.abs(at_m - self.position_m))
        )
        self.off_route_m = float(apart_m[nearest])
        return float(at_m[nearest] + self.off_route_m)

    @property
    def unsure_m(self) -> float:
        """Standard deviation of the way home, as far as places are not exact, m."""
        place_sd_m = 0.0
        if self._count > 0:
            place_sd_m = math.sqrt(self._positions.variance)
        return math.hypot(place_sd_m, thresholds.DEAD_RECKONING_ERROR * self.reckoned_m)

    def noise_m(self) -> float:
        """Standard deviation of the positions along an axis, as learned so far, m."""
        return math.sqrt(self._positions.noise_variance)

    def is_possible(self, position: Position) -> bool:
        """Whether the robot can come to a position from home, on several charges; without a home,
        whether it is on the earth."""
        if isinstance(position, float):
            home_m = 0.0
            if isinstance(self.moved_home, float):
                home_m = self.moved_home
            return abs(position - home_m) <= self._most_m
        home = self._home_place()
        if home is None:
            return math.hypot(*position) <= thresholds.EARTH_M
        return math.dist(position, home) <= self._most_m

    def _home_place(self) -> tuple[float, float] | None:
        """East and north coordinate of home, None if it has none."""
        for home in (self.moved_home, self.home):
            if isinstance(home, tuple):
                return home
        if self._count == 0:
            return None
        return float(self._crumbs[0, 0]), float(self._crumbs[0, 1])

    def beyond(self, place: Position, from_m: float | None = None) -> tuple[float, float]:
        """For a place off the way: at which metre of the trail or route to leave it, and the length
        of the leg then, m.

        That is where the way is shortest, with the detour of the leg. A trail leads back only, a
        route ahead too.

        Args:
            place: The place.
            from_m: With a route: position on it to start from, m; by default the robot's.
        """
        if isinstance(place, float):
            return max(place, 0.0), max(-place, 0.0)
        if self._corners is not None:
            return self._beyond_route(place, from_m)
        if self._count == 0:
            return 0.0, float(np.hypot(*np.subtract(place, self._xy)))
        crumbs = np.concatenate((self._crumbs[: self._count], self._xy[None]))
        at_m = np.append(self._at_m[: self._count], self.position_m)
        leg_m = np.hypot(*(crumbs - np.asarray(place)).T)
        shortest = int(np.argmin(self.position_m - at_m + thresholds.DETOUR * leg_m))
        return float(at_m[shortest]), float(leg_m[shortest])

    def _beyond_route(
        self, place: tuple[float, float], from_m: float | None
    ) -> tuple[float, float]:
        assert self._corners is not None
        here_m = self.position_m
        if from_m is not None:
            here_m = from_m
        origin = np.zeros(2)
        if self._count:
            origin = self._crumbs[0]
        elif isinstance(self.home, tuple):
            origin = np.array(self.home)
        corners = self._corners + origin
        corners_m = np.arange(len(corners)) * self._place_m
        if self._count and from_m is None:
            xy_here = self._xy
        else:  # in metres along the route
            xy_here = np.array([np.interp(here_m, corners_m, axis) for axis in corners.T])
        points = np.concatenate((corners, xy_here[None]))
        at_m = np.append(corners_m, here_m)
        leg_m = np.hypot(*(points - np.array(place)).T)
        shortest = int(np.argmin(np.abs(here_m - at_m) + thresholds.DETOUR * leg_m))
        return float(at_m[shortest]), float(leg_m[shortest])


def _moved(forward_m: float, heading_rad: float) -> Array:
    """A distance in a direction as east and north, m."""
    return forward_m * np.array([math.cos(heading_rad), math.sin(heading_rad)])


def along_route(route: RouteLike, driven_m: float, speed_mps: float) -> NDArray[np.void]:
    """The rest of a route after some metres, `WAY_DTYPE`."""
    ends_m = np.arange(1, len(route.grade_rad) + 1) * route.place_m
    lengths_m = np.clip(ends_m - driven_m, 0.0, route.place_m)
    ways = np.zeros(len(ends_m), WAY_DTYPE)
    ways["way_m"] = lengths_m
    ways["sine"] = np.sin(route.grade_rad)
    ways["east"] = np.cos(route.heading_rad)
    ways["north"] = np.sin(route.heading_rad)
    ways["speed_mps"] = speed_mps
    return np.asarray(ways[lengths_m > 0.0])


def along_and_off(
    places: NDArray[np.void],
    vehicle: Vehicle,
    here_m: float,
    leave_m: float,
    leg_m: float,
    speed_mps: float,
) -> NDArray[np.void]:
    """Along the way out to a given metre, back or ahead, and then a leg over unknown ground,
    `WAY_DTYPE`.

    Ahead of a trail the ground is unknown too.

    Args:
        places: The estimator's notes on the places of the way out, shape (places,).
        vehicle: The robot's own model, with the length of a place.
        here_m: Position of the robot on it, m.
        leave_m: Position on it to leave it at, m.
        leg_m: Length of the leg, m.
        speed_mps: Speed, m/s.
    """
    place_m = vehicle.place_m
    nearest_m = min(leave_m, here_m)
    farthest_m = max(leave_m, here_m)
    direction = -1.0 if leave_m <= here_m else 1.0
    nearest = place_of(vehicle, nearest_m, places)
    farthest = place_of(vehicle, farthest_m, places)
    numbers = np.arange(nearest, farthest + 1)
    # The last place goes on for as long as the way does.
    ends_m = np.where(numbers == farthest, farthest_m, (numbers + 1) * place_m)
    lengths_m = ends_m - np.maximum(numbers * place_m, nearest_m)
    is_crossed = lengths_m > 0.0
    crossed = places[numbers[is_crossed]]
    along = np.zeros(len(crossed), WAY_DTYPE)
    along["way_m"] = lengths_m[is_crossed]
    along["sine"] = direction * crossed["sine_driven"]
    along["east"] = direction * crossed["east"]
    along["north"] = direction * crossed["north"]
    along["speed_mps"] = speed_mps
    if not leg_m > 0.0:  # also NaN
        return along
    leg = np.zeros(1, WAY_DTYPE)
    leg["way_m"] = leg_m
    leg["speed_mps"] = speed_mps
    return np.concatenate((along, leg))
