"""Routes: their contents, and a seeded generator.

Along a route: grade, surface roughness, interest, heading and curvature; for the whole route: air
temperature and wind.
"""

from __future__ import annotations

import numbers
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward import thresholds as shared
from homeward.physics.jit import inline

GENERATED = "generated"
HIDDEN_WIND = "hidden_wind"

LIMITS: dict[str, tuple[float, float, str]] = {
    "grade_rad": (-shared.STEEPEST_RAD, shared.STEEPEST_RAD, "rad; degrees or per cent?"),
    "roughness": (0.0, 10.0, "0 where C_rr was measured"),
    "interest": (0.0, shared.MOST_INTEREST, "a weight, not negative"),
    "heading_rad": (
        -shared.MOST_HEADING_RAD,
        shared.MOST_HEADING_RAD,
        "rad, counter-clockwise from east",
    ),
    "temperature_c": (-shared.MOST_TEMPERATURE_C, shared.MOST_TEMPERATURE_C, "degrees Celsius"),
    "wind_mps": (0.0, shared.MOST_WIND_MPS, "m/s; km/h?"),
    "wind_from_rad": (-10.0, 10.0, "rad; degrees?"),
}
"""Lowest and highest value of each quantity of a route, and a likely mistake. Chosen: wider than
any ground and weather that a robot meets, narrow enough to detect another unit."""

WHOLE_ROUTE = ("temperature_c", "wind_mps", "wind_from_rad")


class RouteError(ValueError):
    """An invalid route; the message says where, and what to change."""


def without_heights(name: Any) -> str:
    """What to do with a track that has no heights."""
    return f"give a track with elevations, or say {name}@flat, or {name}@grade_rad=SLOPE for ground of one slope"


@dataclass(frozen=True)
class Route:
    """A route cut into places of equal length; arrays of shape (places,).

    Attributes:
        place_m: Length of one place, m.
        grade_rad: Slope angle along the way out, rad.
        roughness: Surface roughness, 0 where C_rr was measured.
        interest: Weight of the information there.
        heading_rad: Direction of the way out, rad counter-clockwise from east.
        temperature_c: Air temperature at the start, C.
        wind_mps: Mean wind speed, m/s.
        wind_from_rad: Direction that the wind blows from, rad counter-clockwise from east.

    Raises:
        RouteError: A value is outside what is allowed, or arrays differ in length.
    """

    place_m: float
    grade_rad: NDArray[np.float64]
    roughness: NDArray[np.float64]
    interest: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    temperature_c: float = 20.0
    wind_mps: float = 0.0
    wind_from_rad: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.place_m, numbers.Real) or not 0.0 < self.place_m < np.inf:
            raise RouteError(
                f"place_m = {self.place_m!r} is not allowed; give the length of a place, in metres"
            )
        places = max(np.size(self.grade_rad), 1)
        for name, (low, high, hint) in LIMITS.items():
            try:
                values = np.asarray(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError):
                raise RouteError(
                    f"{name} = {getattr(self, name)!r} is not made of numbers"
                ) from None
            shape = () if name in WHOLE_ROUTE else (places,)
            if values.shape != shape:
                raise RouteError(f"{name} has shape {values.shape}; give {shape}")
            wrong = ~((values >= low) & (values <= high))
            if wrong.any():
                raise RouteError(
                    f"{name} = {values[wrong].flat[0]:g} is not in [{low:g}, {high:g}] ({hint})"
                )
            object.__setattr__(self, name, float(values) if name in WHOLE_ROUTE else values)

    @property
    def length_m(self) -> float:
        """Length of the route, m."""
        return self.place_m * len(self.grade_rad)

    @property
    def curvature_per_m(self) -> NDArray[np.float64]:
        """Turning per metre from each place to the next, rad/m."""
        turn = np.diff(self.heading_rad, append=self.heading_rad[-1:])
        return (np.mod(turn + np.pi, 2.0 * np.pi) - np.pi) / self.place_m


MOST_ROUTE_BYTES = 100_000_000
"""Largest size of a file of a route or track, bytes. Chosen: a million rows of a profile, and it
bounds memory."""
KNOTS = 8
"""Pieces of a generated route: grade is linear and curvature constant between knots. Chosen:
several hills a route."""
NEW_PATCH = 0.5
"""Probability that the ground changes from one piece to the next. Chosen: two pieces of one ground
on average."""
WIND_SCALE_MPS = 1.5
"""Standard deviation of either component of the wind: its speed has a Rayleigh distribution of this
scale. Chosen: a mean of 1.9 m/s, Beaufort 2 (light breeze)."""
HIDDEN_WIND_MPS = (3.0, 6.0)
"""Range of the hidden wind, uniform. Chosen: Beaufort 2 to 4 (1.6 to 7.9 m/s)."""
GENERATED_PLACES = 32
"""Places of a generated route, except those of a patrol. Chosen: four a piece; a place is the unit
of the robot's map."""
INTEREST_LENGTH = 0.1
"""Correlation length of the interest, over the length of the route. Chosen so that sensed ground is
informative about the next, and a route has many different stretches."""
MEAN_INTEREST, INTEREST_DEVIATION = 1.23, 1.0
"""Mean of the interest, and standard deviation of its logarithm. Chosen: a fifth of the ground has
over half of it."""


@inline
def generate(
    rng: Any, route: Any, mission: Any, count: int, length_m: float, tailwind_out: bool
) -> None:
    """Draw a route of a given number of places and its weather, into the records of a mission.

    Distributions, all chosen, with lengths as shares of the route so that any robot meets the same
    variety. At each of 9 knots:

    * sine of the grade: a mean of N(0, 0.02) over the route plus an autoregressive part of
      deviation 0.04 that keeps half of itself from knot to knot, within +-0.2; linear in between;
    * roughness: with probability 0.5 a new patch of U(-1, 1), where negative means 0: smooth;
    * curvature: autoregressive, keeping half, of deviation 3 rad per route; its integral is the
      heading, from U(0, 2 pi).

    Further:

    * interest: log-normal of mean 1.23; its logarithm is a Gaussian process of deviation 1 whose
      correlation falls as exp(-distance / a tenth of the route);
    * temperature: N(12, 8) within -10 to 35 C; wind: Rayleigh of scale 1.5 m/s from any direction.

    With `hidden_wind` a wind of U(3, 6) m/s blows along the way out: the robot drives home against
    it.
    """
    mean_grade = 0.02 * rng.standard_normal()
    heading = 2.0 * np.pi * rng.random()
    slope = rng.standard_normal()
    turn = rng.standard_normal()
    roughness = 0.0
    sine = min(max(mean_grade + 0.04 * slope, -0.2), 0.2)
    interest_keeps = np.exp(-1.0 / (INTEREST_LENGTH * count))
    interest_new = np.sqrt(1.0 - interest_keeps * interest_keeps)
    log_interest = rng.standard_normal()  # of mean 0 and deviation 1
    east = np.cos(heading)
    north = np.sin(heading)
    start = 0
    for knot in range(KNOTS):
        # The new part of an autoregressive step that keeps half: sqrt(1 - 0.5^2).
        slope = 0.5 * slope + 0.8660254 * rng.standard_normal()
        turn = 0.5 * turn + 0.8660254 * rng.standard_normal()
        patch = rng.random()
        if patch < NEW_PATCH:
            roughness = max(0.0, 2.0 * patch / NEW_PATCH - 1.0)
        next_sine = min(max(mean_grade + 0.04 * slope, -0.2), 0.2)
        end = (knot + 1) * count // KNOTS
        sine_step = (next_sine - sine) / max(end - start, 1)
        curvature = 3.0 * turn / length_m
        bend = curvature * length_m / count
        cos_bend = np.cos(bend)
        sin_bend = np.sin(bend)
        for k in range(start, end):
            place = route.places[k]
            sine += 0.5 * sine_step
            place.sin_grade = sine  # in the middle of the place
            sine += 0.5 * sine_step
            place.roughness = roughness
            place.curvature_per_m = curvature
            place.east = east
            place.north = north
            place.interest = MEAN_INTEREST * np.exp(
                INTEREST_DEVIATION * (log_interest - 0.5 * INTEREST_DEVIATION)
            )
            log_interest = interest_keeps * log_interest + interest_new * rng.standard_normal()
            next_east = east * cos_bend - north * sin_bend
            north = north * cos_bend + east * sin_bend
            east = next_east
        sine = next_sine
        start = end
    mission.temperature_c = min(max(12.0 + 8.0 * rng.standard_normal(), -10.0), 35.0)
    strength = rng.random()
    direction = rng.random()
    mission.wind_mps = WIND_SCALE_MPS * np.sqrt(-2.0 * np.log(1.0 - strength))
    mission.wind_from_rad = 2.0 * np.pi * direction
    if tailwind_out:
        east = 0.0
        north = 0.0
        for k in range(count):
            east += route.places[k].east
            north += route.places[k].north
        mission.wind_mps = HIDDEN_WIND_MPS[0] + (HIDDEN_WIND_MPS[1] - HIDDEN_WIND_MPS[0]) * strength
        mission.wind_from_rad = np.arctan2(-north, -east)
