"""`homeward range --route`: what a route takes, how sure that is, and whether the robot gets there and back."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from homeward.commands.range import Args, RangeError, main
from homeward.companion import CompanionError
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
    sure = Uncertainty("a test", ("rolling", "mass", "capacity"), tuple(map(tuple, (1e-4 * np.eye(3)).tolist())), 0.0)
    return dataclasses.replace(HUSKY, uncertainty=sure, drag_ns2_per_m2=1e-6)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_of_a_known_robot_it_is_the_closed_form(calm: Robot, share: float) -> None:
    length_m = share * float(d_max(calm))
    found = forecast_along(calm, flat(length_m), None, 1e-3)
    assert found.both_j.mean == pytest.approx(2.0 * share * calm.usable_energy_j, rel=0.01)
    assert found.there_j.mean == pytest.approx(share * calm.usable_energy_j, rel=0.01)
    assert found.left_j[-1, 1] == pytest.approx(
        (1.0 - 2.0 * share) * calm.usable_energy_j, rel=0.05
    )  # charged within 2 %
    assert found.advice.chance_there_and_back is not None and found.advice.chance_there_and_back > 0.999
    assert np.isinf(found.range_m).all()


def test_beyond_its_range_it_does_not_get_there_and_back(calm: Robot) -> None:
    range_m = float(d_max(calm))
    found = forecast_along(calm, flat(0.7 * range_m), None, 1e-3)
    low_m, middle_m, high_m = found.range_m
    assert low_m < range_m < high_m and middle_m == pytest.approx(range_m, rel=0.03)
    assert found.advice.chance_there_and_back is not None and found.advice.chance_there_and_back < 1e-3
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
    for part in ("probability of getting there", "there and back", "90 % interval", "Point of no return", "generic"):
        assert part in printed
    assert (tmp_path / "fan.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in picture(
        load_robot("husky"), 3000.0, forecast_along(load_robot("husky"), flat(3e3), 0.5, 0.01), ".svg"
    )


def test_what_cannot_be_asked(tmp_path: Path) -> None:
    with pytest.raises(RangeError, match="not allowed with --route"):
        main(Args("husky", route="box", duty=0.5))
    with pytest.raises(RouteError, match="neither a known route nor a file"):
        main(Args("husky", route=str(tmp_path / "none.gpx")))
    with pytest.raises(CompanionError, match="risk = 3"):
        main(Args("husky", route="box", risk=3.0))
