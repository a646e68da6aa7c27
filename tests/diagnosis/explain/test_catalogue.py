"""Every effect is a hypothesis with words, a check and a test drive, and only the catalogue knows
it by name."""

import ast
from pathlib import Path

import pytest

from homeward.diagnosis.explain.catalogue import (
    CATALOGUE,
    ancillaries,
    battery,
    drivetrain,
    forces,
    instruments,
)
from homeward.diagnosis.explain.hypothesis import CHECKS, Hypothesis
from homeward.diagnosis.explain.residual_test import TESTED
from homeward.physics.effects import EFFECTS, Effect, Parameter

NEW = Effect(
    id="new_effect",
    kind="ancillary",
    function=lambda p, s, x, load: 0.0,
    parameters=(Parameter("power_w", "W", 0.0, 10.0, "power"),),
    sentence="",
    equation="",
    source="",
    needs=("time_s", "sensing_hz"),
)


@pytest.mark.parametrize("effect", CATALOGUE)
def test_every_hypothesis_has_words_a_check_and_channels_that_are_tested(effect: str) -> None:
    one = CATALOGUE[effect]
    assert one.id == effect and one.entry.sentence.endswith(".") and one.otherwise
    assert (
        one.measurement[0].islower()
        and "{" not in one.measurement
        and not one.measurement.endswith(".")
    )
    assert set(one.channels) <= {channel.name for channel in TESTED} | {"wheel_difference_mps"}
    assert one.steady is not None or one.changes is not None
    assert set(one.entry.confused_with) <= set(CATALOGUE)


def test_every_effect_of_the_physics_is_tried() -> None:
    assert [effect.id for effect in EFFECTS] == [
        name for name, one in CATALOGUE.items() if one.physical
    ]


def test_every_file_holds_effects_of_one_kind() -> None:
    files = {"force": forces, "drive": drivetrain, "ancillary": ancillaries, "battery": battery}
    for kind, file in {**files, "instrument": instruments}.items():
        assert file.HYPOTHESES
        for one in file.HYPOTHESES:
            assert one.entry.kind == kind and CATALOGUE[one.id] is one


def test_motor_current_shows_forces_at_the_wheels_and_the_clock() -> None:
    shown = {name for name, one in CATALOGUE.items() if one.of_current}
    forces = {
        "inertia",
        "viscous",
        "wind",
        "surface",
        "air_temperature",
        "payload",
        "hidden_grade",
        "slip",
    }
    assert shown == forces | {"turning", "clock_lag"}


def test_an_effect_that_says_nothing_of_itself_is_tried_by_its_kind_and_channels() -> None:
    one = Hypothesis(NEW)
    assert one.measurement == "put a clamp meter on the lead of the new effect"
    assert one.channels == ("sensing_hz",)
    assert one.physical and not one.of_current and one.changes is None
    assert set(CHECKS) == {"force", "drive", "ancillary", "battery", "instrument"}


def test_no_other_module_of_the_diagnosis_knows_an_effect_by_its_name(root: Path) -> None:
    folder = root / "homeward" / "diagnosis"
    files = [file for file in folder.rglob("*.py") if file.parent.name != "catalogue"]
    assert len(files) > 30
    wrong = [
        f"{file.relative_to(root)}:{node.lineno} says {node.value!r}"
        for file in files
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and node.value in CATALOGUE
    ]
    assert not wrong, "\n".join(wrong)
