"""Routes from files: cut into equal places, and a file that cannot be used says why."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from homeward.envs.routes import load_route, route_names, thresholds
from homeward.envs.routes.route import RouteError
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import MAX_PLACES
from tests.envs.rollouts import route_file


def test_the_routes_that_ship_are_named() -> None:
    assert route_names() == ["generated", "hidden_wind", "box", "incline"]
    for name in route_names()[2:]:
        assert load_route(name, 1.0).length_m < 1.0


def test_a_file_is_cut_into_equal_places(tmp_path: Path) -> None:
    path = route_file(
        tmp_path,
        "distance_m,grade_rad,roughness,interest,heading_rad,temperature_c,wind_mps,wind_from_rad\n"
        "0,0.1,0,1,0,5,2,1\n10,0.1,1,1,0,9,9,9\n20,0.1,1,3,1,9,9,9\n30,0.1,1,3,1,9,9,9\n40,0.1,1,3,2,9,9,9\n",
    )
    route = load_route(path, 11.0)
    assert (route.place_m, route.length_m) == (10.0, 40.0)
    np.testing.assert_allclose(route.grade_rad, 0.1)
    np.testing.assert_allclose(route.roughness, [0.5, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(route.interest, [1.0, 2.0, 3.0, 3.0])
    np.testing.assert_allclose(route.heading_rad, [0.0, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(route.curvature_per_m, [0.05, 0.05, 0.05, 0.0])
    assert (route.temperature_c, route.wind_mps, route.wind_from_rad) == (5.0, 2.0, 1.0)


def test_what_a_file_leaves_out_is_plain(tmp_path: Path) -> None:
    route = load_route(route_file(tmp_path, "# a corridor\n\ndistance_m\n0\n10\n"), 2.0)
    assert not route.grade_rad.any() and not route.roughness.any() and not route.heading_rad.any()
    assert (route.interest == 1.0).all() and (route.temperature_c, route.wind_mps) == (20.0, 0.0)


@pytest.mark.parametrize("place_m", [3.0, 7.3, 50.0, 1000.0])
def test_the_ascent_of_a_file_is_preserved(tmp_path: Path, place_m: float) -> None:
    """However coarse the places: the last one is as high as the file says."""
    rng = np.random.default_rng(0)
    distance = np.concatenate(([0.0], np.cumsum(rng.uniform(1.0, 20.0, 40))))
    elevation = 100.0 + np.cumsum(rng.normal(0.0, 0.5, 41))
    rows = [f"{d!r},{z!r}" for d, z in zip(distance.tolist(), elevation.tolist(), strict=True)]
    route = load_route(route_file(tmp_path, "\n".join(["distance_m,elevation_m", *rows])), place_m)
    assert len(route.grade_rad) <= MAX_PLACES and route.length_m == pytest.approx(distance[-1])
    assert (np.sin(route.grade_rad) * route.place_m).sum() == pytest.approx(
        elevation[-1] - elevation[0]
    )


def test_a_closed_heading_turns_the_short_way(tmp_path: Path) -> None:
    path = route_file(tmp_path, "distance_m,heading_rad\n0,6.2\n1,6.2\n1.001,0.1\n2,0.1\n")
    assert abs(load_route(path, 1.0).curvature_per_m[0]) < 0.2


BROKEN = {
    "": "at least two",
    "\n\n\n": "at least two",
    "distance_m\n": "at least two",
    "distance_m,grade_rad\n0,0\n": "at least two",
    "distance_m,grade_rad\n0,0\n,\n": "at least two",
    "grade_rad\n0\n1\n": "no column distance_m",
    "distance_m,slope\n0,0\n1,0\n": "unknown column 'slope'",
    "distance_m;grade_rad\n0;0\n1,0\n": "line 3: number of fields is 1, that of the header 2",
    "distance_m,grade_rad\n0;0\n1;0\n": "line 2: number of fields is 1, that of the header 2",
    "# nothing\n# but\n# comments\n": "at least two",
    "distance_m,grade_rad\n1,0\n2,0\n": "line 2: distance_m = 1; give metres, from 0 and increasing",
    "distance_m,grade_rad\n0,0\n2,0\n1,0\n": "line 4: distance_m = 1; give metres, from 0 and increasing",
    "distance_m,grade_rad\n0,0\n0,0\n": "from 0 and increasing",
    "distance_m,grade_rad\n0,0\n1\n": "line 3: number of fields is 1, that of the header 2; give a number for",
    "# a\n\ndistance_m,grade_rad\n0,0\n1,0,0.5\n2,0\n": "line 5: number of fields is 3, that of the header 2",
    "distance_m,grade_rad\n0,0,\n1,0,\n": "line 2: number of fields is 3, that of the header 2",
    "distance_m,grade_rad\n0,0\n1,\n": "line 3: grade_rad = '' is not a finite number",
    "distance_m,grade_rad\n0,steep\n1,0\n": "line 2: grade_rad = 'steep' is not a finite number",
    "distance_m,grade_rad\n0,0\n1,inf\n": "line 3: grade_rad = 'inf' is not a finite number",
    "distance_m,grade_rad\n0,0\nnan,0\n": "line 3: distance_m = 'nan' is not a finite number",
    "# a\n\ndistance_m,grade_rad\n0,0\n# b\n1,5.71\n": "line 6: grade_rad = 5.71 is not in",
    "distance_m,grade_rad,elevation_m\n0,0,5\n1,0,5\n": "columns grade_rad and elevation_m both give the slope",
    "distance_m,grade_rad\n0,0\n1,5.71\n": "line 3: grade_rad = 5.71 is not in",
    "distance_m,elevation_m\n0,0\n10,2000\n": "elevation_m",
    "distance_m,interest\n0,0\n1,-1\n": "line 3: interest = -1 is not in",
    "distance_m,roughness\n0,0\n1,-0.1\n": "roughness = -0.1",
    "distance_m,temperature_c\n0,293\n1,293\n": "temperature_c = 293",
    "distance_m,wind_mps\n0,-1\n1,0\n": "wind_mps = -1",
    "distance_m,wind_from_rad\n0,270\n1,270\n": "wind_from_rad = 270",
    "distance_m,distance_m\n0,0\n1,1\n": "column distance_m is there twice; keep one of them",
}


@pytest.mark.parametrize(("text", "says"), BROKEN.items())
def test_a_file_that_cannot_be_used_says_why(tmp_path: Path, text: str, says: str) -> None:
    path = route_file(tmp_path, text)
    with pytest.raises(RouteError) as caught:
        HomewardEnv(route=path)
    message = str(caught.value)
    assert says in message and str(path) in message and "\n" not in message


def test_a_file_that_is_no_text_says_so(tmp_path: Path) -> None:
    path = tmp_path / "route.csv"
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(RouteError, match="not a readable CSV"):
        HomewardEnv(route=path)


def test_a_byte_order_mark_is_no_part_of_a_name(tmp_path: Path) -> None:
    path = tmp_path / "route.csv"
    path.write_text("distance_m,grade_rad\n0,0\n10,0.1\n", encoding="utf-8-sig")
    assert load_route(path, 5.0).length_m == 10.0


@pytest.mark.parametrize(
    "text",
    [
        "distance_m;grade_rad\n0;0,1\n1,5;-0,1\n",
        "# tabs\ndistance_m\tgrade_rad\n0\t0.1\n1.5\t-0.1\n",
    ],
)
def test_semicolons_tabs_and_decimal_commas_are_read(tmp_path: Path, text: str) -> None:
    expected = load_route(route_file(tmp_path, "distance_m,grade_rad\n0,0.1\n1.5,-0.1\n"), 0.5)
    other = tmp_path / "other.csv"
    other.write_text(text)
    assert np.array_equal(load_route(other, 0.5).grade_rad, expected.grade_rad)


@pytest.mark.parametrize("route", ["nowhere", "", "no/such.csv", None, 5, ["box"], Path("/")])
def test_a_route_that_is_none_names_those_that_are(route: Any) -> None:
    with pytest.raises(RouteError, match="generated, hidden_wind, box, incline"):
        HomewardEnv(route=route)


@pytest.mark.parametrize(
    "text",
    [
        '"distance_m","grade_rad"\n"0","0.1"\n"9","0.1"\n',
        "distance_m , grade_rad #\n 0, 0.1 # x\n9 ,0.1\n",
    ],
)
def test_quotes_spaces_and_comments_are_no_part_of_a_value(tmp_path: Path, text: str) -> None:
    route = load_route(route_file(tmp_path, text), 3.0)
    assert route.length_m == 9.0 and route.grade_rad == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("rise_m", "climbs"),
    [(thresholds.STEEPEST_SINE - 1e-6, True), (thresholds.STEEPEST_SINE + 1e-6, False)],
)
def test_the_steepest_slope_is_the_last_that_is_read(
    tmp_path: Path, rise_m: float, climbs: bool
) -> None:
    path = route_file(tmp_path, f"distance_m,elevation_m\n0,0\n1,{rise_m!r}\n2,{rise_m!r}\n")
    if climbs:
        assert np.sin(load_route(path, 1.0).grade_rad) == pytest.approx([rise_m, 0.0], abs=1e-12)
    else:
        with pytest.raises(
            RouteError, match=r"changes by 0.700001 m in 1 m of way, which is too steep; feet\?"
        ):
            load_route(path, 1.0)


def test_places_are_shortened_to_fill_the_route_and_lengthened_when_too_many(
    tmp_path: Path,
) -> None:
    path = route_file(tmp_path, "distance_m\n0\n100\n")
    cut = {place_m: load_route(path, place_m) for place_m in (1000.0, 100.0, 50.0, 30.0, 0.1)}
    assert [len(route.grade_rad) for route in cut.values()] == [1, 1, 2, 4, MAX_PLACES]
    assert {route.length_m for route in cut.values()} == {100.0}
    assert cut[30.0].place_m == 25.0
