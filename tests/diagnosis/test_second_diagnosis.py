"""A robot file that already holds effects: as it was handed over, without another, and with one too
many."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import pytest

from homeward import Robot
from homeward.diagnosis import Analysis, Recording, analyse, diagnose
from tests.diagnosis.explain.test_channel_effects import at_terminals
from tests.diagnosis.made_up import ends

Drive = Callable[..., list[Recording]]

TURNING: Mapping[str, Mapping[str, float]] = {"turning": {"scrub": 0.3}}
INERTIA: Mapping[str, Mapping[str, float]] = {"inertia": {"mass_factor": 1.0}}


RECORDED: Mapping[str, Callable[[Drive, Robot], list[Recording]]] = {
    "turning": lambda drive, robot: drive(robot, effects=TURNING),
    "internal_resistance": lambda drive, robot: at_terminals(drive(robot), 0.15),
}
"""Recordings of a robot with an effect, by its id."""


@pytest.mark.parametrize("effect", RECORDED)
def test_a_corrected_robot_asks_for_nothing_on_the_same_recordings(
    effect: str, scrubbing: Analysis, short_drive: Drive, husky: Robot
) -> None:
    runs = RECORDED[effect](short_drive, husky)
    first = scrubbing if effect == "turning" else analyse(runs, husky)
    assert [one.effect for one in first.diagnosis.missing_physics] == [effect]
    assert effect in first.corrected.active_effects
    again = diagnose(runs, first.corrected)
    assert again.verdict == "no_mismatch"
    assert again.missing_physics == () and again.parameters_off == ()


def test_a_file_that_holds_the_true_effects_has_no_mismatch(
    short_drive: Drive, husky: Robot
) -> None:
    true = dataclasses.replace(husky, effects={**TURNING, **INERTIA})
    analysis = analyse(short_drive(true), true)
    assert analysis.diagnosis.verdict == "no_mismatch"
    assert analysis.corrected == true


def test_a_file_that_holds_one_of_two_effects_lacks_the_other_only(
    short_drive: Drive, husky: Robot
) -> None:
    analysis = analyse(
        short_drive(husky, effects={**TURNING, **INERTIA}),
        dataclasses.replace(husky, effects=TURNING),
    )
    (found,) = analysis.diagnosis.missing_physics
    assert found.effect == "inertia"
    low, high = ends(found.parameters["mass_factor"])
    assert low <= 1.0 <= high
    assert analysis.corrected.effects["turning"] == TURNING["turning"]
    assert analysis.corrected.effects["inertia"]["mass_factor"] == pytest.approx(1.0, rel=0.1)


def test_an_effect_that_a_file_holds_too_large_is_named_with_its_true_size(
    short_drive: Drive, husky: Robot
) -> None:
    half = {"turning": {"scrub": 0.15}}
    analysis = analyse(
        short_drive(husky, effects=half), dataclasses.replace(husky, effects=TURNING)
    )
    (found,) = analysis.diagnosis.missing_physics
    assert found.effect == "turning"
    low, high = ends(found.parameters["scrub"])
    assert low <= 0.15 <= high
    assert analysis.corrected.effects["turning"]["scrub"] == pytest.approx(0.15, rel=0.1)


@pytest.mark.parametrize(
    ("effect", "number", "size"),
    [("turning", "scrub", 0.3), ("no_load", "power_w", 20.0)],
)
def test_an_effect_that_a_file_holds_without_cause_is_taken_out(
    effect: str, number: str, size: float, short_drive: Drive, husky: Robot
) -> None:
    """Another effect on top of it would be wrong."""
    analysis = analyse(
        short_drive(husky), dataclasses.replace(husky, effects={effect: {number: size}})
    )
    (found,) = analysis.diagnosis.missing_physics
    assert found.effect == effect
    assert f"{found.name} at another size than the robot file's" in analysis.diagnosis.summary
    assert analysis.corrected.effects[effect][number] == pytest.approx(0.0, abs=0.05 * size)


def test_a_load_that_changes_between_runs_counts_beyond_that_of_the_file(
    drive: Drive, husky: Robot
) -> None:
    """Two runs with the 10 kg of the file, and two with 30 kg, which is the robot's present
    state."""

    def loaded(load_kg: float) -> Robot:
        return dataclasses.replace(husky, effects={"payload": {"mass_kg": load_kg}})

    runs = [
        drive(loaded(kg), runs=4, minutes=4.0)[number]
        for number, kg in enumerate((10.0, 10.0, 30.0, 30.0))
    ]
    analysis = analyse(runs, loaded(10.0))
    (found,) = analysis.diagnosis.missing_physics
    assert found.effect == "payload"
    assert analysis.diagnosis.file is not None and analysis.diagnosis.file.holds == "corrected"
    assert analysis.corrected.effects["payload"]["mass_kg"] == pytest.approx(30.0, rel=0.1)
