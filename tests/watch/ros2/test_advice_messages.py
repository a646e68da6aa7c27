"""What is published of an advice."""

import dataclasses
import math
from typing import Any

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from homeward.companion import Advice, Companion, HomeOption
from homeward.watch.online.link import can_reach_home, reserve
from homeward.watch.ros2.advice_messages import messages
from homeward.watch.ros2.idl import message

FULL_J = 1.7e6


@pytest.fixture(scope="module")
def advice() -> Advice:
    """Of a robot with a full battery, 100 m from home."""
    companion = Companion("husky")
    companion.update(0.0, position=100.0)
    return companion.update(1.0, position=100.0)


def published(
    advice: Advice | None, warnings: list[str] | None = None, silent: bool = False
) -> dict[str, Any]:
    return filled(advice, warnings or [], silent, "")


def filled(
    advice: Advice | None, warnings: list[str], silent: bool, namespace: str
) -> dict[str, Any]:
    """Messages with the fields that are left out, by their topics."""
    contents = messages(advice, FULL_J, "husky", warnings, silent, namespace)
    return {name: message(kind, **content) for name, kind, content in contents}


def test_what_is_published_when_it_must_turn() -> None:
    companion = Companion("husky", soc=0.02)
    companion.update(0.0, position=900.0)
    advice = companion.update(10.0, position=900.0, speed_mps=0.0)
    assert advice.turn_now and advice.chance_home < 0.5
    said = filled(advice, ["dark"], False, "/r1")
    assert not said["/r1/homeward/can_reach_home"].data and said["/r1/homeward/turn_now"].data
    assert said["/r1/homeward/battery"].percentage == 0.0 and math.isnan(
        said["/r1/homeward/battery"].current
    )
    assert said["/r1/homeward/energy_to_home"].data == advice.energy_home_j.mean > 0.0
    (status,) = said["/diagnostics"].status
    assert (
        status.level == 2
        and "it may not get home" in status.message
        and status.name == "r1/homeward: way home"
    )
    assert ("warning", "dark") in {(pair.key, pair.value) for pair in status.values}


def test_reach_and_reserve_are_those_of_every_link(advice: Advice) -> None:
    for chance in (1.0, 0.5):
        given = dataclasses.replace(advice, chance_home=chance)
        said = published(given)
        assert said["/homeward/can_reach_home"].data == can_reach_home(given)
        assert said["/homeward/battery"].percentage == pytest.approx(reserve(given, FULL_J))


@pytest.mark.parametrize(
    ("change", "warnings", "silent", "level", "text"),
    [
        ({}, [], False, 0, "turn within 1.23 km, 10 min"),
        ({}, ["dark"], False, 1, "turn within 1.23 km, 10 min"),
        ({}, ["dark"], True, 3, "turn within 1.23 km, 10 min"),
        ({"turn_now": True}, [], False, 1, "turn now"),
        ({"turn_now": True}, [], True, 3, "turn now"),
        ({"chance_home": 0.5}, [], False, 2, "it may not get home: probability 50.00%"),
        (
            {"chance_home": 0.5, "turn_now": True},
            ["dark"],
            True,
            2,
            "it may not get home: probability 50.00%",
        ),
    ],
)
def test_the_level_of_the_diagnostics_is_the_worst_that_is_known(
    advice: Advice, change: dict[str, Any], warnings: list[str], silent: bool, level: int, text: str
) -> None:
    safe = {"turn_now": False, "chance_home": 1.0, "turn_in_m": 1230.0, "turn_in_s": 600.0}
    (status,) = published(dataclasses.replace(advice, **safe | change), warnings, silent)[
        "/diagnostics"
    ].status
    assert (status.level, status.message, status.hardware_id) == (level, text, "husky")
    said = {pair.key: pair.value for pair in status.values}
    assert float(said["way_home_m"]) == pytest.approx(100.0)
    assert float(said["margin_j_low"]) < float(said["margin_j"]) < float(said["margin_j_high"])
    assert said.get("warning") == (warnings[0] if warnings else None)


def test_of_several_homes_the_diagnostics_name_all(advice: Advice) -> None:
    spread = advice.energy_home_j
    other = HomeOption("bay", 900.0, spread, spread, 0.25, False)
    given = dataclasses.replace(advice, turn_now=True, home="hut", others=(other,))
    (status,) = published(given)["/diagnostics"].status
    said = {pair.key: pair.value for pair in status.values}
    assert status.message == "turn now, to hut" and said["home"] == "hut"
    assert (said["way_to_bay_m"], said["chance_bay"]) == ("900", "0.25")


def test_before_the_first_advice_there_are_diagnostics_alone() -> None:
    said = published(None)
    assert list(said) == ["/diagnostics"]
    (status,) = said["/diagnostics"].status
    assert (status.level, status.message, status.values) == (0, "no readings yet", [])
    assert status.name == "homeward: way home"


def test_what_a_battery_did_not_measure_is_none(advice: Advice) -> None:
    battery = published(advice)["/homeward/battery"]
    assert all(
        math.isnan(getattr(battery, name))
        for name in ("voltage", "temperature", "charge", "design_capacity")
    )
    assert (
        battery.present
        and battery.header.stamp.sec > 0
        and 0 <= battery.header.stamp.nanosec < 10**9
    )
