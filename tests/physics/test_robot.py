"""Robot files: what is wrong is refused in one line that names the field, the value and what is
allowed."""

from __future__ import annotations

import copy
import dataclasses
import io
import math
import pickle
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward import Robot, RobotError, load_robot
from homeward.physics import EFFECTS, preset_names
from homeward.physics.robot import HAS_CUTOFF, ROBOT_DTYPE
from tests.physics.drives import PLAIN, robots

QUANTITIES = {
    one.name: one.metadata for one in dataclasses.fields(Robot) if "bounds" in one.metadata
}
REQUIRED = [
    one.name
    for one in dataclasses.fields(Robot)
    if one.name in QUANTITIES and one.default is dataclasses.MISSING
]


def tables(robot: Robot = PLAIN) -> dict[str, Any]:
    return tomllib.loads(robot.to_toml())


def write(folder: Path, text: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(text, encoding="utf-8")
    return path


def edited(field: str, line: str | None) -> str:
    """The text of the plain robot's file with the line of one field replaced or left out."""
    lines = PLAIN.to_toml().splitlines()
    places = [i for i, text in enumerate(lines) if text.startswith(f"{field} = ")]
    assert len(places) == 1
    lines[places[0] : places[0] + 1] = [] if line is None else [line]
    return "\n".join(lines)


def refusal(source: str | Path) -> str:
    with pytest.raises(RobotError) as error:
        load_robot(source)
    message = str(error.value)
    assert message and "\n" not in message
    return message


@pytest.mark.parametrize("field", QUANTITIES)
@pytest.mark.parametrize(
    "text", ["-1.0", "nan", "inf", "-inf", "1e300", str(10**400), '"heavy"', "true", "[1.0]"]
)
def test_wrong_and_unphysical_values(field: str, text: str, tmp_path: Path) -> None:
    path = write(tmp_path, edited(field, f"{field} = {text}"))
    message = refusal(path)
    bounds, section = QUANTITIES[field]["bounds"], QUANTITIES[field]["section"]
    value = tomllib.loads(f"value = {text}")["value"]
    assert message.startswith(f"{path}: {section}.{field} = {value!r} is not ")
    assert message.endswith(f"allowed: a number in {bounds}")


@pytest.mark.parametrize("field", REQUIRED)
def test_missing_values(field: str, tmp_path: Path) -> None:
    path = write(tmp_path, edited(field, None))
    meaning, bounds = QUANTITIES[field]["meaning"], QUANTITIES[field]["bounds"]
    assert refusal(path) == (
        f"{path}: {QUANTITIES[field]['section']}.{field} is missing ({meaning}); give a number in {bounds}"
    )


@pytest.mark.parametrize("field", sorted(set(QUANTITIES) - set(REQUIRED)))
def test_optional_values_default_to_zero(field: str, tmp_path: Path) -> None:
    assert getattr(load_robot(write(tmp_path, edited(field, None))), field) == 0.0


@pytest.mark.parametrize("field", QUANTITIES)
def test_bounds_are_open_or_closed_as_printed(field: str) -> None:
    bounds = QUANTITIES[field]["bounds"]
    for end, is_open, printed in (
        (bounds.low, bounds.open_low, str(bounds)[0] == "("),
        (bounds.high, bounds.open_high, str(bounds)[-1] == ")"),
    ):
        assert is_open == printed
        if is_open:
            with pytest.raises(RobotError, match=field):
                dataclasses.replace(PLAIN, **{field: end})
        else:
            assert bounds.hold(end)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "mas_kg = 1.0",
            "body.mas_kg = 1.0 is not a known field; known: mass_kg, rolling_resistance, drag_ns2_per_m2, track_m "
            "(did you mean 'mass_kg'?)",
        ),
        (
            "motor_loss = 0.1",
            "body.motor_loss = 0.1 is not a known field; known: mass_kg, rolling_resistance, drag_ns2_per_m2, track_m "
            "(motor_loss belongs in [drive])",
        ),
    ],
)
def test_unknown_fields(line: str, expected: str, tmp_path: Path) -> None:
    path = write(tmp_path, PLAIN.to_toml().replace("[body]", f"[body]\n{line}"))
    assert refusal(path) == f"{path}: {expected}"


def test_fields_outside_their_section(tmp_path: Path) -> None:
    path = write(tmp_path, "mass_kg = 1.0\n" + PLAIN.to_toml())
    message = refusal(path)
    assert message.startswith(f"{path}: mass_kg = 1.0 is not a known field; known: name, ")
    assert message.endswith("(mass_kg belongs in [body])")


def test_unknown_section(tmp_path: Path) -> None:
    path = write(tmp_path, PLAIN.to_toml() + "\n[batery]\ncycles = 1.0\n")
    assert refusal(path).endswith("(did you mean 'battery'?)")


def test_section_that_is_a_number(tmp_path: Path) -> None:
    path = write(tmp_path, 'name = "flat"\nbody = 3\n')
    assert refusal(path).startswith(f"{path}: body = 3 is not a table; write [body] with mass_kg, ")
    older = write(
        tmp_path, 'name = "flat"\ndrive = 3\n[uncertainty]\nof = "charge"\nrest_current_a = 1.5\n'
    )
    assert refusal(older).startswith(f"{older}: body.mass_kg is missing")


@pytest.mark.parametrize("line", ["name = 5", 'name = ""', "name = true"])
def test_name_that_is_no_text(line: str, tmp_path: Path) -> None:
    path = write(tmp_path, edited("name", line))
    assert refusal(path).startswith(f"{path}: name = ")
    assert "is not a text" in refusal(path)


def test_missing_name(tmp_path: Path) -> None:
    path = write(tmp_path, edited("name", None))
    assert refusal(path).startswith(f"{path}: name is missing; ")


def test_description_that_is_no_text(tmp_path: Path) -> None:
    path = write(tmp_path, edited("description", "description = 5"))
    assert refusal(path).startswith(f"{path}: description = 5 is not a text")


def test_speeds_in_the_wrong_order(tmp_path: Path) -> None:
    path = write(tmp_path, edited("min_speed_mps", "min_speed_mps = 4.5"))
    assert refusal(path) == (
        f"{path}: drive.min_speed_mps = 4.5 is above drive.max_speed_mps = 4; make it the smaller of the two"
    )


def test_cycles_that_leave_no_battery(tmp_path: Path) -> None:
    worn = edited("cycles", "cycles = 300.0").replace("cycle_fade = 0.0 ", "cycle_fade = 0.125 ")
    path = write(tmp_path, worn)
    assert refusal(path).startswith(
        f"{path}: battery.cycles = 300 and battery.age = 0 leave 5.2e-17 of the rated energy"
    )


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        (
            "[effects.turnin]\nscrub = 1.0",
            "effects.turnin = {'scrub': 1.0} is not a known field; known: inertia, ",
        ),
        ("[effects.turnin]\nscrub = 1.0", "(did you mean 'turning'?)"),
        (
            "[effects.turning]\nscrap = 1.0",
            "effects.turning.scrap = 1.0 is not a known field; known: scrub",
        ),
        (
            "[effects.turning]\nscrub = 9.0",
            "effects.turning.scrub = 9.0 is not allowed; allowed: a number in [0, 2]",
        ),
        (
            "[effects.turning]\nscrub = nan",
            "effects.turning.scrub = nan is not allowed; allowed: a number in [0, 2]",
        ),
        (
            '[effects.turning]\nscrub = "a"',
            "effects.turning.scrub = 'a' is not a number; allowed: a number in [0, 2]",
        ),
        ("[effects.turning]", "effects.turning.scrub is missing (wheel force over weight"),
        (
            "[effects.heater]\non_below_c = 3.0",
            "effects.heater.w_per_k is missing (power per kelvin",
        ),
        ("[effects]\nturning = 3", "effects.turning = 3 is not a table with scrub"),
        ("[[effects]]\nturning = 3", "effects = [{'turning': 3}] is not a table of effects"),
    ],
)
def test_effects_that_are_wrong(effects: str, expected: str, tmp_path: Path) -> None:
    path = write(tmp_path, f"{PLAIN.to_toml()}\n{effects}\n")
    message = refusal(path)
    assert message.startswith(f"{path}: effects") and expected in message


def test_turning_needs_the_track(tmp_path: Path) -> None:
    path = write(tmp_path, edited("track_m", None) + "\n[effects.turning]\nscrub = 0.5\n")
    expected = "body.track_m = 0 (unknown), but effects.turning needs it; allowed: the distance of the wheels, above 0"
    assert refusal(path) == f"{path}: {expected}"
    off = write(tmp_path, edited("track_m", None) + "\n[effects.turning]\nscrub = 0.0\n")
    assert load_robot(off).active_effects == ()


@pytest.mark.parametrize(
    "robot", ["rusty", "Husky", "", "no/such/robot.toml", "a\0b", "x" * 5000, Path("gone.toml")]
)
def test_unknown_robots(robot: str | Path) -> None:
    message = refusal(robot)
    assert message.startswith(f"robot {str(robot)!r} is neither a preset nor a file; presets: ")
    assert all(name in message for name in preset_names())


def test_a_typo_in_a_preset_gets_a_suggestion() -> None:
    assert refusal("rusty").endswith("(did you mean 'rusti'?)")


@pytest.mark.parametrize("robot", [None, 3, b"rusti", {}])
def test_robots_of_another_type(robot: Any) -> None:
    with pytest.raises(RobotError, match=r"is not a preset name, a path or a Robot$"):
        load_robot(robot)


@pytest.mark.parametrize(
    "content",
    [
        b"\x89PNG\r\n\x1a\n\0\0",
        b"\0" * 100,
        b"name = ",
        b"",
        b"a = " + b"9" * 5000,
        b"a = " + b"[" * 20000,
    ],
)
def test_files_that_are_no_robot(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(content)
    assert refusal(path).startswith(f"{path}: ")


def test_a_truncated_file(tmp_path: Path) -> None:
    text = PLAIN.to_toml()
    for length in range(0, len(text), 40):
        path = write(tmp_path, text[:length])
        if length < text.index("controller_w"):
            assert refusal(path).startswith(f"{path}: ")


def test_a_folder_is_no_robot(tmp_path: Path) -> None:
    assert "is neither a preset nor a file" in refusal(tmp_path)
    (tmp_path / "mine.toml").write_text("")
    assert refusal(tmp_path / "mine").endswith(f"(did you mean '{tmp_path / 'mine.toml'}'?)")


def test_a_file_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, PLAIN.to_toml())

    def refuse(*args: Any, **kwargs: Any) -> str:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("homeward.files.open_regular", refuse)
    assert refusal(path) == f"{path}: not a readable TOML file: [Errno 13] Permission denied"


# drawn within bounds, no more
@pytest.mark.filterwarnings("ignore::homeward.physics.plausible.PlausibilityWarning")
@given(robot=robots(), name=st.text(min_size=1), description=st.text(), note=st.text())
def test_toml_round_trip(
    robot: Robot, name: str, description: str, note: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    robot = dataclasses.replace(robot, name=name, description=description)
    path = tmp_path_factory.getbasetemp() / "round_trip.toml"
    path.write_text(robot.to_toml({"mass_kg": note}), encoding="utf-8")
    again = load_robot(path)
    assert again == robot and again.record().tobytes() == robot.record().tobytes()


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_loads_by_name_and_by_path(name: str, root: Path) -> None:
    by_name = load_robot(name)
    assert by_name.name == name
    assert load_robot(str(root / "homeward" / "robots" / f"{name}.toml")) == by_name
    assert load_robot(by_name) is by_name


@given(robot=robots())
def test_copies_are_equal(robot: Robot) -> None:
    for twin in (
        copy.deepcopy(robot),
        pickle.loads(pickle.dumps(robot)),
        dataclasses.replace(robot),
    ):
        assert twin == robot and hash(twin) == hash(robot) and twin.effects is not robot.effects
    assert Robot(**dataclasses.asdict(robot)) == robot


def test_replace_checks_as_the_file_is_checked() -> None:
    with pytest.raises(
        RobotError,
        match=r"^body\.mass_kg = -1\.0 is not allowed; allowed: a number in \(0, 1e\+06\]$",
    ):
        dataclasses.replace(PLAIN, mass_kg=-1.0)
    with pytest.raises(RobotError, match=r"^drive\.min_speed_mps = 9 is above"):
        dataclasses.replace(PLAIN, min_speed_mps=9.0)
    with pytest.raises(RobotError, match=r"^effects\.standby\.power_w = -1 is not allowed"):
        dataclasses.replace(PLAIN, effects={"standby": {"power_w": -1}})
    with pytest.raises(RobotError, match=r"^name = None is not a text"):
        dataclasses.replace(PLAIN, name=None)  # type: ignore[arg-type]
    assert type(dataclasses.replace(PLAIN, mass_kg=np.float64(2.0)).mass_kg) is float
    assert type(dataclasses.replace(PLAIN, mass_kg=3).mass_kg) is float


def test_a_robot_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        PLAIN.mass_kg = 2.0  # type: ignore[misc]


@given(robot=robots())
def test_the_record_is_the_robot(robot: Robot) -> None:
    record = robot.record()
    assert record.shape == (1,) and record.dtype == ROBOT_DTYPE
    assert all(record[name][0] == getattr(robot, name) for name in QUANTITIES)
    mask = int(record["effects"][0])
    assert [effect.id for bit, effect in enumerate(EFFECTS) if mask >> bit & 1] == list(
        robot.active_effects
    )
    for effect in EFFECTS:
        for parameter in effect.parameters:
            given_ = robot.effects.get(effect.id, {}).get(parameter.name, parameter.default)
            assert record[effect.field(parameter)][0] == given_


def test_derived_values_follow_the_parameters() -> None:
    worn = dataclasses.replace(PLAIN, cycles=2.0, cycle_fade=0.1, motor_loss=0.2)
    assert worn.usable_energy_j == pytest.approx(1e5 * math.exp(-0.2))
    assert worn.traction_efficiency == pytest.approx(0.8)


def test_comments_stay_on_their_line() -> None:
    text = PLAIN.to_toml({"mass_kg": "weighed\nmass_kg = 3.0"})
    assert tomllib.loads(text)["body"]["mass_kg"] == PLAIN.mass_kg
    assert tables()["battery"]["rated_energy_j"] == PLAIN.rated_energy_j


def test_a_byte_order_mark_is_no_part_of_a_robot_file(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(load_robot("husky").to_toml(), "utf-8-sig")
    assert load_robot(path) == load_robot("husky")


def test_a_robot_comes_from_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    text = load_robot("husky").to_toml().encode()
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(text)))
    assert load_robot("-") == load_robot("husky")


@pytest.mark.parametrize(
    "text", ["a = " + "[" * 100_000, "a" + ".a" * 50_000 + " = 1", "a = " + "[" * 50 + "]" * 50]
)
def test_deep_files_are_refused_at_once(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    began = time.monotonic()
    assert "not a readable TOML file" in refusal(path)
    assert time.monotonic() - began < 1.0


def test_a_current_at_rest_is_read_from_where_older_files_have_it(tmp_path: Path) -> None:
    """It was in `[uncertainty]`, and is a number of the drive."""
    older = load_robot("husky").to_toml().replace("rest_current_a", "# rest_current_a")
    older += '\n[uncertainty]\nof = "charge"\nrest_current_a = 1.5\nunexplained = 0.1\n'
    (tmp_path / "older.toml").write_text(older)
    robot = load_robot(tmp_path / "older.toml")
    assert robot.rest_current_a == 1.5
    assert robot.uncertainty is not None and robot.uncertainty.unexplained == 0.1
    (tmp_path / "newer.toml").write_text(robot.to_toml())
    assert load_robot(tmp_path / "newer.toml") == robot


LIPO: dict[str, Any] = {"chemistry": "lipo", "cells_in_series": 3, "nominal_voltage_v": 11.1}


@pytest.mark.parametrize(
    ("battery", "full"),
    [
        ({}, "10 V"),  # its nominal voltage
        (LIPO, "12.51 V"),  # three cells of 4.17 V
        ({"open_circuit_v": ((0.0, 8.0), (1.0, 12.0))}, "12 V"),
    ],
)
def test_a_cut_off_is_below_the_voltage_of_the_full_battery(
    battery: dict[str, Any], full: str, tmp_path: Path
) -> None:
    robot = dataclasses.replace(PLAIN, **battery)
    full_v = float(full.removesuffix(" V"))
    assert dataclasses.replace(robot, cutoff_v=full_v - 0.01).cutoff_v == full_v - 0.01
    text = robot.to_toml().replace("cutoff_v = 0.0", f"cutoff_v = {full_v + 0.01}")
    message = refusal(write(tmp_path, text))
    assert f"battery.cutoff_v = {full_v + 0.01:g} is not below the {full} of the full" in message
    assert message.endswith("or 0 for none")


def test_only_a_voltage_that_falls_ends_at_a_cut_off() -> None:
    flat = dataclasses.replace(PLAIN, cutoff_v=9.0)
    falling = dataclasses.replace(PLAIN, cutoff_v=9.9, **LIPO)
    assert not flat.has_cutoff and flat.without_cutoff() is flat
    assert flat.record()["effects"] == 0
    assert falling.has_cutoff and not falling.without_cutoff().has_cutoff
    assert falling.active_effects == () and falling.record()["effects"] == HAS_CUTOFF
