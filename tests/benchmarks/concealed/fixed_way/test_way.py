"""A way is as steep, bent and rough as it is asked to be."""

import numpy as np
import pytest

from benchmarks.concealed.fixed_way.way import TURN_M, Way, draw_way, within


@pytest.fixture(scope="module")
def way() -> Way:
    return draw_way(np.random.default_rng(5), length_m=200.0, steepest_rad=0.07)


def test_the_steepest_slope_is_the_one_that_is_asked_for(way: Way) -> None:
    assert np.abs(way.grade_rad).max() == pytest.approx(0.07)
    assert way.grade_rad.min() < 0.0 < way.grade_rad.max()


def test_the_heading_is_the_integral_of_the_curvature(way: Way) -> None:
    turned_rad = np.diff(way.heading_rad)
    assert turned_rad == pytest.approx(way.curvature_per_m[1:] * 0.25)


def test_the_ends_of_the_way_are_straight(way: Way) -> None:
    is_end = (way.place_m < 5.0) | (way.place_m > 198.5)
    assert np.all(way.curvature_per_m[is_end] == 0.0)
    assert np.any(way.curvature_per_m)


def test_more_of_a_way_is_bent_where_more_is_asked_for() -> None:
    shares = []
    for bent_share in (0.2, 0.6):
        bent_way = draw_way(np.random.default_rng(5), 1000.0, bent_share=bent_share)
        shares.append(np.mean(bent_way.curvature_per_m != 0.0))
    assert shares[0] < 0.3 < 0.5 < shares[1]


def test_ground_is_rough_in_the_stretches_only(way: Way) -> None:
    rough = way.roughness((0.1, 0.3), (0.5, 0.6))
    is_inside = (way.place_m > 21.0) & (way.place_m < 59.0)
    is_outside = (way.place_m < 18.0) | (way.place_m > 122.0)
    assert rough[is_inside] == pytest.approx(way.texture[is_inside])
    assert np.all(rough[is_outside] == 0.0)
    assert way.at(rough, 110.0) > 0.5


def test_a_stretch_has_edges() -> None:
    place_m = np.array([0.0, 9.0, 10.0, 11.0, 15.0, 20.0, 30.0])
    assert within(place_m, 10.0, 20.0, 2.0).tolist() == [0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0]


def test_a_round_trip_is_twice_the_way_and_the_turn(way: Way) -> None:
    assert way.round_trip_m == 400.0 + TURN_M


def test_the_same_seed_gives_the_same_way(way: Way) -> None:
    again = draw_way(np.random.default_rng(5), length_m=200.0, steepest_rad=0.07)
    assert np.array_equal(again.texture, way.texture)
