"""A fixed way: slope, bends and roughness of the ground by place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from benchmarks.concealed.fixed_way.noise import Array, texture

PLACES_PER_M = 4  # chosen: a robot is about a metre long
TURN_M = 2.0 * np.pi  # chosen: half a circle of 2 m radius, at the far end

WAVES_M = (37.0, 53.0, 81.0, 120.0, 190.0)  # chosen: lengths of hills, none a multiple of another
STEEPEST_DEVIATIONS = 2.5  # chosen: where slopes are cut, so that no single slope is far steeper

FIRST_BEND_M = 6.0  # chosen: straight on at the base
LAST_BEND_M = 8.0  # chosen: before the far end, within which no bend begins
STRAIGHT_END_M = 3.0  # chosen: before the far end, within which every bend has ended
BEND_M = (5.0, 11.0)  # chosen: length of a bend
BEND_EDGE_M = 1.5  # chosen: where a bend begins and ends gradually
SPREAD = (0.7, 1.3)  # chosen: of bends and their distances, as a factor

ROUGH_EDGE_M = 2.0  # chosen: where rough ground begins and ends gradually
TEXTURE_SHARE = 0.15  # chosen: how much rough ground differs from place to place
TEXTURE_PLACES = 16  # chosen: 4 m


@dataclass(frozen=True)
class Way:
    """A way from the base to its far end; every array is by place, four a metre, shape (n,)."""

    length_m: float
    place_m: Array
    grade_rad: Array  # as it is driven outwards
    curvature_per_m: Array  # positive: to the left, as it is driven outwards
    heading_rad: Array
    texture: Array  # about 1: how much rougher than on average rough ground is here

    @property
    def round_trip_m(self) -> float:
        """Length of a drive out, round the turn at the far end, and back, m."""
        return float(2 * self.length_m + TURN_M)

    def at(self, by_place: Array, place_m: Array | float) -> Array:
        """Values of an array by place at other places, in the shape of these."""
        return np.asarray(np.interp(place_m, self.place_m, by_place), dtype=np.float64)

    def roughness(self, *stretches: tuple[float, float]) -> Array:
        """Roughness by place: about 1 within the stretches and 0 elsewhere, shape (n,).

        Args:
            stretches: First and last place of each, as shares of the length.
        """
        rough = np.zeros_like(self.place_m)
        for first_share, last_share in stretches:
            start_m = first_share * self.length_m
            end_m = last_share * self.length_m
            rough += within(self.place_m, start_m, end_m, ROUGH_EDGE_M)
        return np.clip(rough, 0, 1) * self.texture


def within(place_m: Array, start_m: float, end_m: float, edge_m: float) -> Array:
    """1 between two places and 0 elsewhere, with edges of a length, m; in the shape of `place_m`."""
    begun = np.clip((place_m - start_m) / edge_m + 0.5, 0, 1)
    not_ended = np.clip((end_m - place_m) / edge_m + 0.5, 0, 1)
    return np.asarray(begun * not_ended, dtype=np.float64)


def draw_way(
    rng: Generator,
    length_m: float,
    steepest_rad: float = 0.08,
    curvature_per_m: float = 0.10,
    bent_share: float = 0.35,
) -> Way:
    """Draw a way: hills as a sum of waves, and bends to either side.

    Args:
        rng: Random numbers.
        length_m: Length, m.
        steepest_rad: Steepest slope, rad. Chosen: over half of the rolling resistance.
        curvature_per_m: Mean curvature of a bend, 1/m. Chosen: a radius of 10 m.
        bent_share: Share of the length that is bends. Chosen.
    """
    place_m = np.arange(0.0, length_m + 1 / PLACES_PER_M, 1 / PLACES_PER_M)
    grade_rad = _hills(rng, place_m, steepest_rad)
    curvatures_per_m = _bends(rng, place_m, length_m, curvature_per_m, bent_share)
    heading_rad = np.cumsum(curvatures_per_m) / PLACES_PER_M
    rougher = 1 + TEXTURE_SHARE * texture(rng, len(place_m), TEXTURE_PLACES)
    return Way(length_m, place_m, grade_rad, curvatures_per_m, heading_rad, rougher)


def _hills(rng: Generator, place_m: Array, steepest_rad: float) -> Array:
    slope = np.zeros_like(place_m)
    for wave_m in WAVES_M:
        height = rng.normal()
        phase_rad = rng.uniform(0, 2 * np.pi)
        slope += height * np.sin(2 * np.pi * place_m / wave_m + phase_rad)
    most = STEEPEST_DEVIATIONS * slope.std()
    slope = np.clip(slope - slope.mean(), -most, most)
    return np.asarray(slope * (steepest_rad / np.abs(slope).max()), dtype=np.float64)


def _bends(
    rng: Generator, place_m: Array, length_m: float, curvature_per_m: float, bent_share: float
) -> Array:
    curvatures_per_m = np.zeros_like(place_m)
    start_m = FIRST_BEND_M
    side = rng.choice([-1, 1])
    while start_m < length_m - LAST_BEND_M:
        bend_m = rng.uniform(*BEND_M)
        end_m = min(start_m + bend_m, length_m - STRAIGHT_END_M)
        bend = within(place_m, start_m, end_m, BEND_EDGE_M)
        curvatures_per_m += side * curvature_per_m * rng.uniform(*SPREAD) * bend
        side *= rng.choice([-1, 1, -1])  # twice as often to the other side
        start_m += bend_m / bent_share * rng.uniform(*SPREAD)
    return curvatures_per_m
