"""A URDF begins a robot file: numbers from where they stand, and a line on what is not clear."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from homeward import RobotError, load_robot
from homeward.commands.robots import Args, main
from homeward.urdf import Wheel, _take_wheels, read_urdf

FOUR_WHEELS = """<?xml version="1.0"?>
<robot name="four" xmlns:xacro="http://ros.org/wiki/xacro">
  <!-- expanded of ${something} -->
  <link name="base_link"><inertial><mass value="46.034"/></inertial></link>
  <link name="lidar"><inertial><mass value="1.1"/></inertial></link>
  <joint name="spins" type="continuous">
    <parent link="base_link"/><child link="lidar"/><axis xyz="0 0 1"/>
  </joint>
  {wheels}
</robot>
"""
WHEEL = """
  <link name="{name}">
    <inertial><mass value="2.637"/></inertial>
    <visual><geometry><sphere radius="9"/></geometry></visual>
    <collision><geometry>{shape}</geometry></collision>
  </link>
  <link name="{name}_hub"/>
  <joint name="{name}_steers" type="fixed">
    <parent link="base_link"/><child link="{name}_hub"/><origin xyz="{x} 0.1 0.03" rpy="0 0 3.14159265"/>
  </joint>
  <joint name="{name}_joint" type="continuous">
    <parent link="{name}_hub"/><child link="{name}"/><origin xyz="0 {y} 0" rpy="-1.5708 0 0"/><axis xyz="0 0 1"/>
    <limit effort="10" velocity="6.0"/>
  </joint>"""
CYLINDER = '<cylinder length="0.1" radius="0.1651"/>'


def four_wheels(shape: str = CYLINDER) -> str:
    """A robot with four wheels, 0.2854 m to both sides of the middle: their hubs are turned by half
    a turn."""
    wheels = "".join(
        WHEEL.format(name=f"{end}_{side}", x=x, y=y, shape=shape)
        for end, x in (("front", 0.256), ("rear", -0.256))
        for side, y in (("left", -0.1854), ("right", 0.3854))
    )
    return FOUR_WHEELS.replace("{wheels}", wheels)


def four(folder: Path, shape: str = CYLINDER, **changed: str) -> Path:
    """The file of that robot, changed."""
    text = four_wheels(shape)
    for old, new in changed.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "four.urdf"
    path.write_text(text)
    return path


def test_what_is_taken_stands_in_the_file_and_the_rest_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = four(tmp_path)
    main(Args(from_urdf=path))
    file, said = capsys.readouterr()
    joints = "front_left_joint, front_right_joint, rear_left_joint, rear_right_joint"
    lines = [line.removeprefix(f"{path}: ") for line in said.splitlines()]
    assert lines[:4] == [
        "mass_kg = 57.682: sum of the masses of 6 of 10 links; none is stated for front_left_hub, front_right_hub, "
        "rear_left_hub, rear_right_hub",
        "max_speed_mps = 0.9906: limit of the wheels' speed, 6 rad/s, times their radius",
        f"track_m = 0.5708: between the wheels of {joints}",
        f"wheels of 0.1651 m radius: collision cylinder of {joints}",
    ]
    assert "to be filled in, in [battery]: rated_energy_j, nominal_voltage_v" in lines
    assert "by the radius of 0.1651 m" in file
    begun = tmp_path / "mine.toml"
    begun.write_text(file)
    with pytest.raises(RobotError, match=r"body.rolling_resistance is missing"):
        load_robot(begun)
    husky = load_robot("husky")
    filled = re.sub(
        r"# (\w+) =   # FILL IN", lambda found: f"{found[1]} = {getattr(husky, found[1])} #", file
    )
    assert filled.count("\n") == file.count("\n")
    begun.write_text(filled)
    robot = load_robot(begun)
    assert (robot.name, robot.mass_kg, robot.track_m, robot.max_speed_mps) == (
        "four",
        57.682,
        0.5708,
        0.9906,
    )
    assert robot.rated_energy_j == husky.rated_energy_j


def test_what_is_not_clear_is_not_taken_and_said(tmp_path: Path) -> None:
    described = read_urdf(four(tmp_path, '<mesh filename="wheel.stl"/>', sphere="mesh"))
    assert "max_speed_mps" not in described.values and described.values["track_m"] == pytest.approx(
        0.5708
    )
    assert described.said[-1].endswith("rear_right_joint: their radius is not stated")
    described = read_urdf(four(tmp_path, continuous="revolute"))
    assert (
        described.said[-1]
        == "wheels are not taken: no continuous joint turns about the lateral axis (y)"
    )
    assert "track_m" not in described.values
    values: dict[str, float] = {}
    wheels = [
        Wheel("a", 0.3, 0.1, "collision cylinder", 1.0),
        Wheel("b", -0.2, 0.2, "collision cylinder", 1.0),
    ]
    assert _take_wheels(wheels, values, {}) == [
        "wheels a, b: their radii differ (a 0.1 m, b 0.2 m)",
        "track_m is not taken: the wheels are at different distances from the middle (a 0.3 m, b -0.2 m)",
    ]
    assert values == {}
    assert _take_wheels(wheels[:1], values, {})[-1] == (
        "track_m is not taken: no wheels on the left and the right of the middle"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "<robot><xacro:include filename='a'/></robot>",
            r"is xacro; expand it first: xacro .*odd\.urdf > robot\.urdf",
        ),
        ("<robot xmlns:xacro='http://ros.org/wiki/xacro'><xacro:arg/></robot>", "is xacro"),
        ("<robot><link name='${side}_wheel'/></robot>", "is xacro"),
        ("<!DOCTYPE r [<!ENTITY a 'b'>]><robot>&a;</robot>", "declares entities"),
        ("<sdf/>", "its element is <sdf>, not <robot>"),
        ("<robot", "is not a whole XML file"),
        ("<robot><link/></robot>", "has a <link> without a name"),
        ("<robot><link name='a'/><link name='a'/></robot>", "two links of one name"),
        (
            "<robot><link name='a'><inertial><mass value='1 kg'/></inertial></link></robot>",
            "value = '1 kg' in <mass>",
        ),
        (
            "<robot><link name='a'><inertial><mass value='-1'/></inertial></link></robot>",
            "the mass -1 kg",
        ),
        (
            "<robot><joint name='j'><parent link='a'/></joint></robot>",
            "the link 'a', which does not exist",
        ),
        (
            "<robot><link name='a'/><joint name='j' type='continuous'><parent link='a'/><child link='a'/></joint>"
            "</robot>",
            "its own ancestor",
        ),
        (
            "<robot><link name='a'/><link name='b'/><joint name='j' type='continuous'><parent link='a'/>"
            "<child link='b'/><origin xyz='0 0'/></joint></robot>",
            "xyz = '0 0', which is no three numbers",
        ),
    ],
)
def test_bad_input_takes_one_line(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.urdf"
    path.write_text(text)
    with pytest.raises(RobotError, match=said) as error:
        read_urdf(path)
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value)


def test_a_missing_file_and_two_requests_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="is not readable"):
        read_urdf(tmp_path / "missing.urdf")
    with pytest.raises(RobotError, match="not both"):
        main(Args("husky", from_urdf=tmp_path / "a.urdf"))
