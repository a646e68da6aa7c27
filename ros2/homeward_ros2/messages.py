"""Messages of ROS 2 as values for JSON, as far as homeward reads them, and back."""

from __future__ import annotations

import importlib
import re

SEQUENCE = re.compile(r"(?:sequence<)?([\w/]+)(?:, \d+>|>|\[\d+\])?$")
"""Type of the parts of a field: `std_msgs/Header`, `sequence<std_msgs/Header>`, `double[9]`."""


class UnknownType(LookupError):
    """A type of message that this robot does not have."""


def class_of(kind):
    """The class of a message type such as `nav_msgs/msg/Odometry`.

    Raises:
        UnknownType: It is not installed.
    """
    package, _, name = kind.rpartition("/")
    try:
        return getattr(importlib.import_module(package.replace("/", ".")), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise UnknownType(f"{kind} is not installed: {error}") from None


def needed(message, paths):
    """The fields of a message that homeward reads, with lists as a whole, and what dates and names
    it.

    Args:
        message: The message.
        paths: Such as `twist.twist.linear.x`, `measured_currents[0]` or, by the names in the field
            `name`, `velocity[front_left_wheel]`; `packs[*].current` of each message in a list.
    """
    content = {}
    for path in [
        *paths,
        "header.stamp.sec",
        "header.stamp.nanosec",
        "header.frame_id",
        "location",
        "serial_number",
    ]:
        if "[" in path:
            _copy(message, ["name"], content)
        _copy(message, path.split("[")[0].split("."), content)
    return content


def _copy(message, names, content):
    """Copy a field; one that is not there is left out, and homeward says so if it needs it."""
    value = message
    for name in names:
        if not hasattr(value, name):
            return
        value = getattr(value, name)
    for name in names[:-1]:
        content = content.setdefault(name, {})
    content[names[-1]] = value if isinstance(value, (bool, int, float, str)) else _listed(value)


def _listed(value):
    """A list of numbers or texts, which rclpy has as `array` or as an array of numpy, or of
    messages."""
    return value.tolist() if hasattr(value, "tolist") else [_plain(element) for element in value]


def _plain(element):
    """A number or text; of a message in a list, such as a battery among several, its numbers and
    texts."""
    if not hasattr(element, "get_fields_and_field_types"):
        return element
    fields = {name: getattr(element, name) for name in element.get_fields_and_field_types()}
    return {
        name: value for name, value in fields.items() if isinstance(value, (bool, int, float, str))
    }


def filled(kind, content):
    """A message with these fields; the others have the values of an empty one.

    Args:
        kind: Type, such as `std_msgs/msg/Bool`.
        content: Fields by name, with dictionaries for the messages in it.

    Raises:
        UnknownType: The type is not installed.
    """
    message = class_of(kind)()
    types = message.get_fields_and_field_types()
    for name, value in content.items():
        inner = SEQUENCE.match(types[name]).group(1)
        if isinstance(value, list):
            setattr(message, name, [_value(inner, part) for part in value])
        else:
            setattr(message, name, _value(inner, value))
    return message


def _value(kind, value):
    if isinstance(value, dict):
        package, _, name = kind.rpartition("/")
        return filled(f"{package}/msg/{name}", value)
    if kind == "octet":
        return bytes([value])  # of type `byte`, which rclpy has as a byte string
    return float(value) if kind in ("float", "double") else value
