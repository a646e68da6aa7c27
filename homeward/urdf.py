"""What a URDF says of a robot: mass, track, wheels and top speed, as the beginning of a robot file.

Of wheels it knows the joints that turn without end (`continuous`) about the lateral axis of the
robot, y (REP 103). What a URDF does not say, such as the battery, is left to be filled in.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from homeward import Robot, RobotError
from homeward.files import read_text

_LATERAL = 0.9
"""Least share of y in the axis of a wheel. Chosen: 26 degrees, more than any camber."""
_AGREE = 0.02
"""Largest relative difference of sizes that are written as one. Chosen: rounding, and halves of a
wheel's width."""
_NAMED = 4
"""Number of links that are named. Chosen: a line."""
_SECTIONS = ("body", "battery", "drive", "ancillary")

Array = NDArray[np.float64]


class Wheel(NamedTuple):
    """A wheel.

    Attributes:
        joint: Name of its joint.
        lateral_m: Its place to the left of the middle, m.
        radius_m: Its radius, m; NaN if no cylinder or sphere gives it.
        shape: What gives the radius.
        limit_radps: Limit of its speed, rad/s; infinite without one.
    """

    joint: str
    lateral_m: float
    radius_m: float
    shape: str
    limit_radps: float


class Described(NamedTuple):
    """What a URDF says.

    Attributes:
        name: Name of the robot.
        values: Numbers of a robot file, by field.
        sources: Where each comes from.
        said: What was taken from where, and what was not, a line each.
        radius_m: Radius of the wheels, m; NaN if it is not known.
    """

    name: str
    values: dict[str, float]
    sources: dict[str, str]
    said: list[str]
    radius_m: float


def read_urdf(path: Path) -> Described:
    """Read a URDF.

    Raises:
        RobotError: It is none, not expanded, or damaged.
    """
    try:
        return _described(_root_of(path))
    except RobotError as error:
        raise RobotError(f"{path}: {error}") from None


def _root_of(path: Path) -> ElementTree.Element:
    """The element `robot` of a file."""
    unexpanded = RobotError(f"is xacro; expand it first: xacro {path} > robot.urdf")
    try:
        text = read_text(path)
    except (ValueError, OSError) as error:
        raise RobotError(f"is not readable: {error}") from None
    if "<!ENTITY" in text:  # of which a small file can make a large one
        raise RobotError("declares entities, which no URDF needs; take them out")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        if "<xacro:" in text:
            raise unexpanded from None
        raise RobotError(f"is not a whole XML file: {error}") from None
    if root.tag != "robot":
        raise RobotError(f"its element is <{root.tag}>, not <robot>; give a URDF")
    for element in root.iter():
        values = element.attrib.values()
        if "xacro}" in str(element.tag) or any("${" in value or "$(" in value for value in values):
            raise unexpanded
    return root


def _described(root: ElementTree.Element) -> Described:
    links = {_name(link): link for link in root.findall("link")}
    if len(links) < len(root.findall("link")):
        raise RobotError("has two links of one name; rename one")
    values: dict[str, float] = {}
    sources: dict[str, str] = {}
    mass_kg, source = _mass(links)
    said = []
    if mass_kg > 0.0:
        values["mass_kg"] = mass_kg
        sources["mass_kg"] = source
    else:
        said.append("mass_kg is not taken: no link states a mass")
    wheels = list(_wheels(root, links))
    radius_m = math.nan
    if wheels:
        radius_m = float(np.mean([wheel.radius_m for wheel in wheels]))
        said += _take_wheels(wheels, values, sources)
    else:
        said.append("wheels are not taken: no continuous joint turns about the lateral axis (y)")
    value_lines = [f"{name} = {value:.6g}: {sources[name]}" for name, value in values.items()]
    return Described(
        name=root.get("name") or "robot",
        values=values,
        sources=sources,
        said=value_lines + said,
        radius_m=radius_m,
    )


def _mass(links: dict[str, ElementTree.Element]) -> tuple[float, str]:
    """Sum of the masses of the links, kg, and what it is the sum of."""
    masses_kg: dict[str, float] = {}
    for name, link in links.items():
        element = link.find("inertial/mass")
        if element is not None:
            masses_kg[name] = _number(element, "value", f"link {name!r}")
            if masses_kg[name] < 0.0:
                raise RobotError(f"link {name!r} has the mass {masses_kg[name]:g} kg; correct it")
    massless = [name for name in links if masses_kg.get(name, 0.0) == 0.0]
    source = f"sum of the masses of {len(links) - len(massless)} of {len(links)} links"
    if massless:
        source += f"; none is stated for {_listed(massless)}"
    return sum(masses_kg.values()), source


def _wheels(root: ElementTree.Element, links: dict[str, ElementTree.Element]) -> Iterator[Wheel]:
    joints = _joints(root, links)
    for child, (joint, _) in joints.items():
        if joint.get("type") != "continuous":
            continue
        place_m, turned = _pose(child, joints)
        axis = turned.apply(
            _vector(joint.find("axis"), "xyz", (1.0, 0.0, 0.0), f"joint {_name(joint)!r}")
        )
        if abs(axis[1]) < _LATERAL * float(np.linalg.norm(axis)) or not axis.any():
            continue
        limit_radps = _limit_radps(joint)
        radius_m, shape = _radius(links[child])
        yield Wheel(
            joint=_name(joint),
            lateral_m=float(place_m[1]),
            radius_m=radius_m,
            shape=shape,
            limit_radps=limit_radps,
        )


def _joints(
    root: ElementTree.Element, links: dict[str, ElementTree.Element]
) -> dict[str, tuple[ElementTree.Element, str]]:
    """Joint above each link, by the link's name, with the name of the link above; a link has one
    parent."""
    joints = {}
    for joint in root.findall("joint"):
        parent = _linked(joint, "parent", links)
        child = _linked(joint, "child", links)
        joints[child] = joint, parent
    return joints


def _linked(joint: ElementTree.Element, end: str, links: dict[str, ElementTree.Element]) -> str:
    """Name of the link at an end of a joint, `parent` or `child`."""
    element = joint.find(end)
    name = None
    if element is not None:
        name = element.get("link")
    if name is None or name not in links:
        raise RobotError(f"joint {_name(joint)!r} leads to the link {name!r}, which does not exist")
    return name


def _limit_radps(joint: ElementTree.Element) -> float:
    """Limit of the speed of a joint, rad/s; infinite if none is stated, or 0."""
    limit = joint.find("limit")
    if limit is None:
        return math.inf
    limit_radps = _number(limit, "velocity", f"joint {_name(joint)!r}", 0.0)
    if limit_radps <= 0.0:
        return math.inf
    return limit_radps


def _pose(link: str, joints: dict[str, tuple[ElementTree.Element, str]]) -> tuple[Array, Rotation]:
    """Place, m, and direction of a link in the frame of the root, with all joints at zero."""
    place_m = np.zeros(3)
    turned = Rotation.identity()
    seen = set()
    while link in joints:
        if link in seen:
            raise RobotError(f"link {link!r} is its own ancestor; correct the joints")
        seen.add(link)
        joint, parent = joints[link]
        origin = joint.find("origin")
        where = f"joint {_name(joint)!r}"
        # about fixed axes
        step = Rotation.from_euler("xyz", _vector(origin, "rpy", (0.0, 0.0, 0.0), where))
        # From the frame of the link to that of its parent.
        place_m = _vector(origin, "xyz", (0.0, 0.0, 0.0), where) + step.apply(place_m)
        turned = step * turned
        link = parent
    return place_m, turned


def _radius(link: ElementTree.Element) -> tuple[float, str]:
    """Radius of a wheel, m, NaN if not known, and what gives it: what touches the ground before
    what is seen."""
    for use in ("collision", "visual"):
        for shape in ("cylinder", "sphere"):
            element = link.find(f"{use}/geometry/{shape}")
            if element is not None:
                return _number(element, "radius", f"link {_name(link)!r}"), f"{use} {shape}"
    return math.nan, ""


def _take_wheels(
    wheels: list[Wheel], values: dict[str, float], sources: dict[str, str]
) -> list[str]:
    """Take what the wheels say; lines on the wheels, and on what is not clear."""
    return [_take_speed(wheels, values, sources), *_take_track(wheels, values, sources)]


def _take_speed(wheels: list[Wheel], values: dict[str, float], sources: dict[str, str]) -> str:
    """Take the top speed, if radius and limit are stated; a line on the radius."""
    joints = _listed([wheel.joint for wheel in wheels])
    radii_m = [wheel.radius_m for wheel in wheels]
    if not _agree(radii_m):
        radii = ", ".join(
            f"{wheel.joint} {wheel.radius_m:.6g} m" for wheel in wheels if wheel.radius_m > 0.0
        )
        if radii:
            return f"wheels {joints}: their radii differ ({radii})"
        return f"wheels {joints}: their radius is not stated"
    radius_m = float(np.mean(radii_m))
    limit_radps = min(wheel.limit_radps for wheel in wheels)
    if limit_radps < math.inf:
        values["max_speed_mps"] = limit_radps * radius_m
        sources["max_speed_mps"] = (
            f"limit of the wheels' speed, {limit_radps:.6g} rad/s, times their radius"
        )
    return f"wheels of {radius_m:.6g} m radius: {wheels[0].shape} of {joints}"


def _take_track(
    wheels: list[Wheel], values: dict[str, float], sources: dict[str, str]
) -> list[str]:
    """Take the track, if the wheels are equally far from the middle; otherwise a line that says why
    not."""
    left_m = [wheel.lateral_m for wheel in wheels if wheel.lateral_m > 0.0]
    right_m = [wheel.lateral_m for wheel in wheels if wheel.lateral_m < 0.0]
    if not left_m or not right_m:
        return ["track_m is not taken: no wheels on the left and the right of the middle"]
    if not _agree([abs(place_m) for place_m in left_m + right_m]):
        places = ", ".join(f"{wheel.joint} {wheel.lateral_m:.6g} m" for wheel in wheels)
        return [
            f"track_m is not taken: the wheels are at different distances from the middle ({places})"
        ]
    values["track_m"] = float(np.mean(left_m) - np.mean(right_m))
    sources["track_m"] = f"between the wheels of {_listed([wheel.joint for wheel in wheels])}"
    return []


def _agree(sizes: list[float]) -> bool:
    return max(sizes) <= (1.0 + _AGREE) * min(sizes)  # NaN does not


def robot_file(described: Described) -> str:
    """Text of a robot file with what is known; what must be filled in is a comment."""
    lines = [f"name = {_quoted(described.name)}", 'description = ""']
    for section in _SECTIONS:
        lines += ["", f"[{section}]"]
        for quantity in _quantities(section):
            if quantity.name in described.values:
                value = described.values[quantity.name]
                source = _printable(described.sources[quantity.name])
                lines.append(f"{quantity.name} = {value:.6g}  # URDF: {source}")
            elif quantity.default is dataclasses.MISSING:
                meaning = quantity.metadata["meaning"]
                bounds = quantity.metadata["bounds"]
                lines.append(f"# {quantity.name} =   # FILL IN: {meaning}; a number in {bounds}")
            elif quantity.name == "traction_n_per_a" and described.radius_m > 0.0:
                radius = f"the radius of {described.radius_m:.6g} m"
                with_radius = f"motor constant, N m/A, times the gear's ratio, by {radius}"
                lines.append(f"# {quantity.name} =   # for motor currents only: {with_radius}")
    return "\n".join(lines) + "\n"


def left_to_fill_in(described: Described) -> list[str]:
    """Numbers that a robot file needs and the URDF does not have, a line for each table."""
    lines = []
    for section in _SECTIONS:
        missing = [
            quantity.name
            for quantity in _quantities(section)
            if quantity.default is dataclasses.MISSING and quantity.name not in described.values
        ]
        if missing:
            lines.append(f"to be filled in, in [{section}]: {', '.join(missing)}")
    return lines


def _quantities(section: str) -> list[dataclasses.Field[float]]:
    return [
        quantity
        for quantity in dataclasses.fields(Robot)
        if quantity.metadata.get("section") == section
    ]


def _name(element: ElementTree.Element) -> str:
    name = element.get("name")
    if not name:
        raise RobotError(f"has a <{element.tag}> without a name; give it one")
    return name


def _number(
    element: ElementTree.Element, attribute: str, where: str, default: float | None = None
) -> float:
    text = element.get(attribute)
    if text is None and default is not None:
        return default
    try:
        number = float(text or "")
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise RobotError(
            f"{where} has {attribute} = {text!r} in <{element.tag}>, which is no number"
        )
    return number


def _vector(
    element: ElementTree.Element | None,
    attribute: str,
    default: tuple[float, float, float],
    where: str,
) -> Array:
    if element is None:
        return np.array(default)
    text = element.get(attribute)
    if text is None:
        return np.array(default)
    try:
        vector = np.array(text.split(), dtype=np.float64)
    except ValueError:
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise RobotError(f"{where} has {attribute} = {text!r}, which is no three numbers")
    return vector


def _listed(names: list[str]) -> str:
    listed = ", ".join(names[:_NAMED])
    if len(names) > _NAMED:
        listed += f" and {len(names) - _NAMED} more"
    return listed


def _printable(text: str) -> str:
    return "".join(sign if sign.isprintable() else "?" for sign in text)


def _quoted(text: str) -> str:
    plain = "".join("?" if sign in '"\\' else sign for sign in _printable(text))
    return f'"{plain}"'
