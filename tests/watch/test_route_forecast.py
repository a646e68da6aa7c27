"""`homeward range --route`: what a route takes, how sure that is, and whether the robot gets there
and back."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from homeward.commands.range import Args, RangeError, main
from homeward.companion import CompanionError
from homeward.companion.readings import Position
from homeward.envs.routes import Route, RouteError
from homeward.physics import Robot, d_max, load_robot
from homeward.physics.uncertainty import Uncertainty
from homeward.watch.route_forecast import RouteForecast, forecast_along, picture
from tests.companion.robots import HUSKY


def flat(length_m: float) -> Route:
    nothing = np.zeros(40)
    return Route(length_m / 40, nothing, nothing, nothing, nothing)


@pytest.fixture(scope="module")
def calm() -> Robot:
    """A Husky whose file is sure of it, and that hardly feels the wind."""
    sure = Uncertainty(
        "a test",
        ("rolling", "mass", "capacity"),
        tuple(map(tuple, (1e-4 * np.eye(3)).tolist())),
        0.0,
    )
    return dataclasses.replace(HUSKY, uncertainty=sure, drag_ns2_per_m2=1e-6)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_of_a_known_robot_it_is_the_closed_form(calm: Robot, share: float) -> None:
    length_m = share * float(d_max(calm))
    found = forecast_along(calm, flat(length_m), None, 1e-3)
    assert found.both_j.mean == pytest.approx(2.0 * share * calm.usable_energy_j, rel=0.01)
    assert found.there_j.mean == pytest.approx(share * calm.usable_energy_j, rel=0.01)
    # Charged within 2 %.
    left_j = (1.0 - 2.0 * share) * calm.usable_energy_j
    assert found.left_j[-1, 1] == pytest.approx(left_j, rel=0.05)
    assert (
        found.advice.chance_there_and_back is not None
        and found.advice.chance_there_and_back > 0.999
    )
    assert np.isinf(found.range_m).all()


def test_beyond_its_range_it_does_not_get_there_and_back(calm: Robot) -> None:
    range_m = float(d_max(calm))
    found = forecast_along(calm, flat(0.7 * range_m), None, 1e-3)
    low_m, middle_m, high_m = found.range_m
    assert low_m < range_m < high_m and middle_m == pytest.approx(range_m, rel=0.03)
    assert (
        found.advice.chance_there_and_back is not None and found.advice.chance_there_and_back < 1e-3
    )
    assert 0.4 * range_m < found.advice.turn_in_m < 0.5 * range_m


def test_the_less_a_file_is_sure_the_wider_the_interval(calm: Robot) -> None:
    route = flat(3000.0)

    def width(robot: Robot) -> float:
        both: RouteForecast = forecast_along(robot, route, None, 1e-3)
        return both.both_j.high - both.both_j.low

    assert calm.uncertainty is not None
    uneven = dataclasses.replace(calm.uncertainty, unexplained=0.5, unexplained_m=100.0)
    generic = dataclasses.replace(calm, uncertainty=None)
    assert width(calm) < width(dataclasses.replace(calm, uncertainty=uneven)) < width(generic)


def test_it_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    profile = tmp_path / "hill.csv"
    profile.write_text("distance_m,elevation_m\n0,0\n1000,30\n2000,10\n")
    main(Args("husky", route=str(profile), plot=tmp_path / "fan.png"))
    printed = capsys.readouterr().out
    for part in (
        "probability of getting there",
        "there and back",
        "90 % interval",
        "Point of no return",
        "generic",
    ):
        assert part in printed
    assert (tmp_path / "fan.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in picture(
        load_robot("husky"),
        3000.0,
        forecast_along(load_robot("husky"), flat(3e3), 0.5, 0.01),
        ".svg",
    )


def test_of_several_docks_the_best_at_the_end_is_advised(
    calm: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    range_m = float(d_max(calm))
    length_m = 0.6 * range_m
    alone = forecast_along(calm, flat(length_m), None, 1e-3)
    docks: dict[str, Position] = {
        "bay": 0.4 * range_m,
        "beside": (length_m, 0.1 * range_m),
        "far": (0.0, 2.0 * range_m),
    }
    found = forecast_along(calm, flat(length_m), None, 1e-3, docks)
    assert [option.name for option in found.homes] == ["beside", "bay", "home", "far"]
    assert [option.reachable for option in found.homes] == [True, True, False, False]
    assert found.homes[0].way_m == pytest.approx(0.13 * range_m, rel=1e-6)
    assert found.homes[0].energy_j.mean == pytest.approx(0.13 * calm.usable_energy_j, rel=0.02)
    assert alone.turn_m < 0.5 * range_m and found.turn_m == pytest.approx(length_m)
    assert found.both_j == alone.both_j
    near = forecast_along(calm, flat(length_m), None, 1e-3, {"bay": 0.2 * range_m})
    # From x the way back to the dock is x - 0.2, so that 2 x - 0.2 is at most the range.
    assert alone.turn_m < near.turn_m < 0.6 * range_m and near.turn_m == pytest.approx(
        0.1 * range_m + alone.turn_m, rel=0.02
    )
    profile = tmp_path / "hill.csv"
    profile.write_text("distance_m,elevation_m\n0,0\n1000,30\n2000,10\n")
    main(Args("husky", route=str(profile), docks=("bay=1700", "hut=1800,-90")))
    printed = capsys.readouterr().out
    assert "of getting there" in printed and "Advised at its end: hut" in " ".join(printed.split())


@pytest.mark.parametrize(
    ("docks", "said"),
    [
        ("bay", "--docks 'bay' is not allowed; give NAME=EAST,NORTH or NAME=METRES"),
        ("bay=1,2,3", "--docks 'bay=1,2,3' is not allowed"),
        ("bay=nan", "--docks 'bay=nan' is not allowed"),
        (
            "bay=1e7",
            "dock 'bay' = 10000000.0 is not allowed; give metres from home along the way, 0 to ",
        ),
    ],
)
def test_docks_that_cannot_be_used(docks: str, said: str) -> None:
    with pytest.raises(CompanionError, match=said):
        main(Args("husky", route="box", docks=(docks,)))


def test_what_cannot_be_asked(tmp_path: Path) -> None:
    with pytest.raises(RangeError, match="not allowed with --route"):
        main(Args("husky", route="box", duty=0.5))
    with pytest.raises(RangeError, match="--docks is for --route"):
        main(Args("husky", docks=("bay=3",)))
    with pytest.raises(CompanionError, match="names 'bay' twice"):
        main(Args("husky", route="box", docks=("bay=0", "bay=1")))
    with pytest.raises(RouteError, match="neither a known route nor a file"):
        main(Args("husky", route=str(tmp_path / "none.gpx")))
    with pytest.raises(CompanionError, match="risk = 3"):
        main(Args("husky", route="box", risk=3.0))
