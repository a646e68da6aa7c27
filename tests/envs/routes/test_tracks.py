"""Tracks become routes: known ascents come out, noise does not, and what cannot be used says
why."""

import dataclasses
import gzip
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

import evaluate
from homeward.envs.routes import RouteError, load_route, thresholds
from homeward.envs.routes.tracks import Profile, Track, profile, read_track

gpxpy = pytest.importorskip("gpxpy")
pytest.importorskip("fitdecode")

Array = NDArray[np.float64]

RIDE = Path(__file__).parent / "data" / "edge1000_ride.csv.gz"
RIDE_ASCENT_M = 1254.0  # the device's own summary, from a barometer, see the head of the file
M_PER_DEGREE = 6371008.8 * np.pi / 180.0


@pytest.fixture(scope="module")
def ride() -> tuple[Array, Array]:
    """Distance and height of a real ride, as recorded."""
    with gzip.open(RIDE, "rt") as file:
        table = np.loadtxt(file, delimiter=",", skiprows=4)
    return table[:, 0], table[:, 1]


def write_gpx(path: Path, distance_m: Array, elevation_m: Array) -> Path:
    """Write a way due north as a GPX track."""
    gpx = gpxpy.gpx.GPX()
    segment = gpxpy.gpx.GPXTrackSegment()
    segment.points = [
        gpxpy.gpx.GPXTrackPoint(45.0 + d / M_PER_DEGREE, 7.0, elevation=h)
        for d, h in zip(distance_m, elevation_m, strict=True)
    ]
    gpx.tracks.append(gpxpy.gpx.GPXTrack())
    gpx.tracks[0].segments.append(segment)
    path.write_text(gpx.to_xml())
    return path


def write_csv(path: Path, distance_m: Array, elevation_m: Array) -> Path:
    """Write a way due north as positions."""
    rows = (
        f"{45.0 + d / M_PER_DEGREE:.9f},7.0,{h}\n"
        for d, h in zip(distance_m, elevation_m, strict=True)
    )
    path.write_text("latitude_deg,longitude_deg,elevation_m\n" + "".join(rows))
    return path


def write_fit(path: Path, distance_m: Array, elevation_m: Array, indoors: bool = False) -> Path:
    """Write a way due north as the records of a FIT file."""
    fit_tool = pytest.importorskip("fit_tool")
    from fit_tool.profile.messages.file_id_message import FileIdMessage
    from fit_tool.profile.messages.record_message import RecordMessage
    from fit_tool.profile.profile_type import FileType, Manufacturer

    builder = fit_tool.FitFileBuilder(auto_define=True)
    head = FileIdMessage()
    head.type, head.manufacturer, head.product = FileType.ACTIVITY, Manufacturer.DEVELOPMENT, 0
    head.serial_number, head.time_created = 1, 1_700_000_000_000
    builder.add(head)
    for second, (distance, height) in enumerate(zip(distance_m, elevation_m, strict=True)):
        record = RecordMessage()
        record.timestamp = 1_700_000_000_000 + 1000 * second
        record.enhanced_altitude = height
        if not indoors:
            record.position_lat, record.position_long = 45.0 + distance / M_PER_DEGREE, 7.0
            record.distance = distance
        builder.add(record)
    path.write_bytes(builder.build_bytes())
    return path


WRITERS = {".gpx": write_gpx, ".csv": write_csv, ".fit": write_fit}


def smoothed(path: Path) -> Profile:
    return profile(read_track(path), path.name)


def test_the_ascent_of_a_real_ride_is_what_its_barometer_counted(ride: tuple[Array, Array]) -> None:
    distance, height = ride
    rises = float(np.clip(np.diff(height), 0.0, None).sum())
    assert rises > 1.06 * RIDE_ASCENT_M  # what smoothing is for
    found = profile(Track(height, distance_m=distance), "ride")
    assert found.ascent_m == pytest.approx(RIDE_ASCENT_M, rel=0.03)
    assert found.distance_m[-1] == pytest.approx(57_567.0, rel=0.005)


@pytest.mark.parametrize("kind", [".gpx", ".fit"])
def test_a_file_of_the_ride_gives_the_same_ascent(
    tmp_path: Path, ride: tuple[Array, Array], kind: str
) -> None:
    distance, height = (values[::5] for values in ride)
    found = smoothed(WRITERS[kind](tmp_path / f"ride{kind}", distance, height))
    assert found.ascent_m == pytest.approx(RIDE_ASCENT_M, rel=0.03)


@pytest.mark.parametrize("part", range(3))
def test_the_ascent_survives_the_cut_into_places(
    tmp_path: Path, ride: tuple[Array, Array], part: int
) -> None:
    distance, height = ride
    here = (distance >= 16_000.0 * part) & (distance <= 16_000.0 * (part + 1))
    path = write_gpx(tmp_path / "part.gpx", distance[here], height[here])
    route = load_route(path, 1.0)
    climbed = float(np.clip(np.sin(route.grade_rad), 0.0, None).sum() * route.place_m)
    assert climbed == pytest.approx(smoothed(path).ascent_m, rel=0.05)


@pytest.mark.parametrize("kind", WRITERS)
def test_every_kind_of_file_becomes_the_same_route(tmp_path: Path, kind: str) -> None:
    distance = np.arange(0.0, 2000.0, 7.0)
    route = load_route(
        WRITERS[kind](tmp_path / f"track{kind}", distance, 100.0 + 0.05 * distance), 100.0
    )
    assert route.length_m == pytest.approx(distance[-1] * np.hypot(1.0, 0.05), rel=1e-3)
    np.testing.assert_allclose(route.grade_rad, np.arctan(0.05), atol=2e-3)
    np.testing.assert_allclose(np.sin(route.heading_rad), 1.0, atol=1e-6)  # north


def test_noise_and_spikes_make_no_hills() -> None:
    rng = np.random.default_rng(0)
    distance = np.arange(0.0, 20_000.0, 4.0)
    hills = 200.0 + 15.0 * np.sin(distance / 2000.0 * 2.0 * np.pi)  # 10 hills of 30 m
    noisy = hills + rng.normal(0.0, 2.0, len(hills))
    noisy[rng.integers(0, len(hills), 50)] += 40.0
    assert profile(Track(noisy, distance_m=distance), "hills").ascent_m == pytest.approx(
        300.0, rel=0.03
    )
    flat = rng.normal(0.0, 2.0, len(hills))
    assert np.clip(np.diff(flat), 0.0, None).sum() > 4000.0
    assert profile(Track(flat, distance_m=distance), "flat").ascent_m < 20.0


def test_a_robot_that_stands_does_not_drive() -> None:
    rng = np.random.default_rng(1)
    along = np.concatenate(
        (np.linspace(0.0, 500.0, 1000), np.full(600, 500.0), np.linspace(500.0, 1000.0, 1000))
    )
    jitter = rng.normal(0.0, 0.7, (2, len(along)))
    north, east = (along + jitter[0]) / M_PER_DEGREE, jitter[1] / M_PER_DEGREE
    raw = np.hypot(np.diff(north), np.diff(east)).sum() * M_PER_DEGREE
    assert raw > 3000.0
    found = profile(Track(np.full(len(along), 5.0), north, east), "stands")
    assert found.distance_m[-1] == pytest.approx(1000.0, abs=0.06 * 1000.0 + thresholds.SPACING_M)


def test_a_way_round_has_a_heading_that_goes_round() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    track = Track(
        np.zeros(400), 200.0 * np.sin(angle) / M_PER_DEGREE, 200.0 * np.cos(angle) / M_PER_DEGREE
    )
    found = profile(track, "circle")
    assert found.heading_rad[-1] - found.heading_rad[0] == pytest.approx(2.0 * np.pi, abs=0.3)
    assert found.distance_m[-1] == pytest.approx(400.0 * np.pi, rel=0.01)


def test_a_way_across_the_date_line_is_short() -> None:
    longitude = np.where(np.arange(50) < 25, 179.995, -179.995) + 1e-4 * np.r_[0:25, 0:25]
    assert profile(Track(np.zeros(50), np.zeros(50), longitude), "Taveuni").distance_m[-1] < 2500.0


def test_a_missing_height_is_interpolated_and_a_wall_is_cut() -> None:
    distance = np.arange(0.0, 10_000.0, 5.0)
    height = 0.05 * distance
    height[::9] = np.nan
    with pytest.warns(UserWarning, match="gaps: 223 of 2000 elevations are unknown"):
        assert profile(Track(height, distance_m=distance), "gaps").ascent_m == pytest.approx(
            500.0, rel=0.01
        )
    wall = np.where(distance < 5000.0, 0.0, 100.0)
    slope = profile(Track(wall, distance_m=distance), "wall")
    grade = np.diff(slope.elevation_m) / np.diff(slope.distance_m)
    assert np.abs(grade).max() == pytest.approx(thresholds.STEEPEST_OF_TRACK)


def test_a_track_is_a_route_of_an_environment(tmp_path: Path) -> None:
    distance = np.arange(0.0, 3000.0, 10.0)
    path = write_gpx(tmp_path / "hill.gpx", distance, 20.0 * np.sin(distance / 500.0))
    env = gym.make("homeward/Survey-v0", route=str(path))
    env.reset(seed=0)
    assert env.unwrapped.batch.known.shared["length_m"][0] == pytest.approx(distance[-1], rel=0.01)  # type: ignore[attr-defined]
    args = evaluate.Args(agents=("soc50",), episodes=2, route=str(path), out=tmp_path / "out")
    assert str(evaluate.main(args).options.route) == str(path)


def spoil(text: str) -> Callable[[Path], Any]:
    return lambda path: path.write_text(text)


def without_height(path: Path) -> None:
    track = write_gpx(path, np.arange(0.0, 500.0, 10.0), np.zeros(50)).read_text()
    path.write_text(track.replace("<ele>0.0</ele>", ""))


BROKEN: dict[str, tuple[str, Callable[[Path], Any], str]] = {
    "no XML": ("a.gpx", spoil("GPX"), "is not a whole GPX file"),
    "cut": ("a.gpx", spoil("<gpx><trk><trkseg><trkpt lat="), "is not a whole GPX file"),
    "no points": ("a.gpx", spoil("<gpx></gpx>"), "has 0 points"),
    "no height": ("a.gpx", without_height, "50 of 50 points have no elevation"),
    "short": ("a.gpx", lambda p: write_gpx(p, np.arange(5.0), np.zeros(5)), "give at least 100 m"),
    "feet": (
        "a.gpx",
        lambda p: write_gpx(p, np.arange(0.0, 500.0, 5.0), np.arange(100.0) * 5.0),
        "steeper than 30",
    ),
    "no FIT": ("a.fit", spoil("FIT"), "is not a whole FIT file"),
    "indoors": (
        "a.fit",
        lambda p: write_fit(p, np.zeros(3), np.zeros(3), True),
        "neither positions nor",
    ),
    "degrees": (
        "a.csv",
        spoil("latitude_deg,longitude_deg,elevation_m\n95,7,0\n96,7,0\n"),
        "at latitude 95",
    ),
    "columns": (
        "a.csv",
        spoil("latitude_deg,longitude_deg,grade_rad\n1,2,0\n3,4,0\n"),
        "a track has the columns",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_track_that_cannot_be_used_says_why(tmp_path: Path, case: str) -> None:
    name, write, says = BROKEN[case]
    write(tmp_path / name)
    with pytest.raises(RouteError) as caught:
        load_route(tmp_path / name, 10.0)
    message = str(caught.value)
    assert says in message and str(tmp_path / name) in message and "\n" not in message


def test_a_fit_file_cut_short_says_so(tmp_path: Path) -> None:
    path = write_fit(tmp_path / "a.fit", np.arange(0.0, 500.0, 5.0), np.zeros(100))
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(RouteError, match=r"a\.fit: is not a whole FIT file"):
        read_track(path)


def test_a_missing_package_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_gpx(tmp_path / "a.gpx", np.arange(5.0), np.zeros(5))
    monkeypatch.setitem(__import__("sys").modules, "gpxpy", None)
    with pytest.raises(
        RouteError, match=r"needs gpxpy; install it with pip install 'homeward\[logs\]'"
    ):
        read_track(path)


def test_a_profile_is_a_route_file(tmp_path: Path) -> None:
    distance = np.arange(0.0, 1000.0, 10.0)
    found = profile(Track(0.02 * distance, distance_m=distance), "ramp")
    assert {field.name for field in dataclasses.fields(found)} == set(found.columns())
    path = tmp_path / "ramp.csv"
    rows = np.column_stack(list(found.columns().values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(found.columns()), comments="")
    np.testing.assert_allclose(load_route(path, 50.0).grade_rad, np.arctan(0.02), atol=1e-3)


def test_a_fix_at_the_origin_of_the_globe_is_left_out(tmp_path: Path) -> None:
    distance_m = np.arange(0.0, 2000.0, 10.0)
    path = write_gpx(tmp_path / "way.gpx", distance_m, 100.0 + np.sin(distance_m / 100.0))
    whole = smoothed(path).distance_m[-1]
    text = path.read_text().split("<trkpt ")
    text[90] = 'lat="0" lon="0">' + text[90].partition(">")[2]
    path.write_text("<trkpt ".join(text))
    with pytest.warns(
        UserWarning, match="1 of 200 points are at latitude 0, longitude 0.*left out"
    ):
        route = smoothed(path)
    assert route.distance_m[-1] == pytest.approx(whole, rel=1e-3)


def test_a_track_that_jumps_says_where(tmp_path: Path) -> None:
    distance_m = np.arange(0.0, 2000.0, 10.0)
    distance_m[90] = 5e6
    with pytest.raises(RouteError, match="point 91 is 4999 km from the one before"):
        smoothed(write_gpx(tmp_path / "way.gpx", distance_m, np.zeros(200)))


@pytest.mark.parametrize("header", ["lat,lon,ele", "Latitude,Longitude,Altitude", "lat,lng,height"])
def test_the_names_that_loggers_write_are_a_track(tmp_path: Path, header: str) -> None:
    distance_m = np.arange(0.0, 2000.0, 10.0)
    path = write_csv(tmp_path / "way.csv", distance_m, 100.0 + 10.0 * np.sin(distance_m / 100.0))
    plain = load_route(path, 50.0)
    path.write_text(path.read_text().replace("latitude_deg,longitude_deg,elevation_m", header))
    assert load_route(path, 50.0).length_m == plain.length_m


def test_a_fit_file_that_is_damaged_anywhere_is_read_or_refused(tmp_path: Path) -> None:
    """Definitions of fields that are changed make fitdecode raise AssertionError, KeyError,
    TypeError and others."""
    content = write_fit(tmp_path / "a.fit", np.arange(0.0, 60.0, 5.0), np.zeros(12)).read_bytes()
    refused = 0
    for place in range(12, min(len(content), 160)):
        for value in (0, 7, 103, 255):
            (tmp_path / "b.fit").write_bytes(
                content[:place] + bytes([value]) + content[place + 1 :]
            )
            with warnings.catch_warnings(action="ignore"):
                try:
                    read_track(tmp_path / "b.fit")
                except RouteError as error:
                    assert str(tmp_path / "b.fit") in str(error)
                    refused += 1
    assert refused > 50


def test_elevations_that_no_ground_has_are_unknown(tmp_path: Path) -> None:
    along_m = np.arange(0.0, 1000.0, 5.0)
    heights = np.where(np.arange(200) % 20 == 3, 1e308, 10.0)
    with pytest.warns(UserWarning, match=r"10 of 200 elevations are unknown or impossible"):
        level = profile(Track(heights, distance_m=along_m), "track")
    assert np.abs(level.elevation_m - 10.0).max() < 0.1


def segments_of(path: Path, *segments: tuple[int, int]) -> Path:
    """A file of segments along one way, with points every 10 m, by the numbers of their first and
    last point."""
    gpx = gpxpy.gpx.GPX()
    gpx.tracks.append(gpxpy.gpx.GPXTrack())
    for first, last in segments:
        segment = gpxpy.gpx.GPXTrackSegment()
        for i in range(first, last):
            segment.points.append(
                gpxpy.gpx.GPXTrackPoint(47.0 + 10.0 * i / M_PER_DEGREE, 8.0, 400.0)
            )
        gpx.tracks[0].segments.append(segment)
    path.write_text(gpx.to_xml())
    return path


@pytest.mark.parametrize(
    ("segments", "way_m", "said"),
    [
        (((0, 30), (0, 60), (0, 90)), 890.0, "2 segments repeat points of others"),
        (((0, 90), (0, 90)), 890.0, "1 segments repeat points"),
        (((0, 40), (45, 90)), 890.0, None),
        (
            ((0, 30), (60, 200)),
            1390.0,
            r"2 parts with gaps of more than 100 m between them \(30, 140 points\)",
        ),
    ],
)
def test_what_was_not_driven_is_no_way(
    tmp_path: Path, segments: tuple[tuple[int, int], ...], way_m: float, said: str | None
) -> None:
    path = segments_of(tmp_path / "a.gpx", *segments)
    with warnings.catch_warnings(record=True, action="always") as caught:
        track = profile(read_track(path), "a")
    assert track.distance_m[-1] == pytest.approx(way_m, abs=1.0)
    messages = " ".join(str(one.message) for one in caught)
    assert re.search(said, messages) if said else not messages


@pytest.mark.parametrize("ending", [".gpx", ".csv"])
def test_a_track_without_heights_takes_a_slope_from_its_user(tmp_path: Path, ending: str) -> None:
    path, distance = tmp_path / f"flat{ending}", np.linspace(0.0, 1000.0, 50)
    if ending == ".gpx":
        write_gpx(path, distance, np.zeros(50))
        path.write_text(re.sub("<ele>.*?</ele>", "", path.read_text()))
    else:
        path.write_text(
            "lat,lon\n" + "".join(f"{45.0 + d / M_PER_DEGREE:.9f},7.0\n" for d in distance)
        )
    with pytest.raises(RouteError, match=f"{ending}@flat, or .*{ending}@grade_rad=SLOPE"):
        load_route(path, 50.0)
    assert not load_route(f"{path}@flat", 50.0).grade_rad.any()
    sloped = load_route(f"{path}@grade_rad=0.02", 50.0)
    assert np.allclose(sloped.grade_rad, 0.02) and sloped.length_m == pytest.approx(
        1000.0 / np.cos(0.02), rel=1e-3
    )
    with pytest.raises(RouteError, match="@grade_rad=2 is no slope"):
        load_route(f"{path}@grade_rad=2", 50.0)
    env: Any = gym.make("homeward/OutAndBack-v0", robot="husky", route=f"{path}@flat")
    env.close()


def test_heights_that_are_not_used_are_said(tmp_path: Path) -> None:
    path = write_gpx(tmp_path / "a.gpx", np.linspace(0.0, 1000.0, 50), np.linspace(0.0, 50.0, 50))
    with pytest.warns(UserWarning, match="its heights are not used"):
        assert not load_route(f"{path}@flat", 50.0).grade_rad.any()
    profile_of_slopes = tmp_path / "profile.csv"
    profile_of_slopes.write_text("distance_m,grade_rad\n0,0.1\n100,0.1\n")
    with pytest.raises(RouteError, match="is a profile, which has its slopes itself"):
        load_route(f"{profile_of_slopes}@flat", 50.0)
