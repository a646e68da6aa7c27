"""Types of ROS 2 messages in the form of Cyclone DDS, from the message definitions of `rosbags`.

ROS 2 calls the type `sensor_msgs/msg/Imu` `sensor_msgs::msg::dds_::Imu_` in DDS, and serialises its
fields in order as plain CDR (design.ros2.org, Topic and Service name mapping to DDS; OMG DDS-XTypes
1.3, 7.4).
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct, types
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from homeward.companion import CompanionError
from homeward.logs.bags.messages import known_types

_BASES: dict[str, Any] = {
    "bool": bool, "string": str,
    # The DDS layers of ROS 2 declare both as uint8, and types that differ do not match
    # (rmw_cyclonedds, dyntype.cpp).
    "byte": types.uint8, "char": types.uint8,
    **{f"{sign}int{bits}": getattr(types, f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
    "float32": types.float32, "float64": types.float64,
}  # fmt: skip
_array: Any = types.array  # which its stubs do not declare as generic
_sequence: Any = types.sequence
_EMPTY: dict[str, Any] = {"bool": False, "string": "", "float32": 0.0, "float64": 0.0}


@cache
def _store() -> Typestore:
    return known_types()


def kind_of(type_name: str) -> str | None:
    """The message type of a DDS type, None if it is not a ROS 2 message or has no known definition.

    >>> kind_of("sensor_msgs::msg::dds_::Imu_"), kind_of("HelloWorld")
    ('sensor_msgs/msg/Imu', None)
    """
    match = re.fullmatch(r"(\w+)::msg::dds_::(\w+)_", type_name)
    kind = f"{match[1]}/msg/{match[2]}" if match else ""
    return kind if kind in _store().fielddefs else None


@cache
def struct_of(kind: str) -> type[IdlStruct]:
    """The type of a message such as `sensor_msgs/msg/Imu`, a dataclass with its fields.

    Raises:
        KeyError: It has no known definition.
        CompanionError: Cyclone DDS for Python has no type for one of its fields.
    """
    package, _, name = kind.split("/")
    fields = {field: _type_of(definition) for field, definition in _store().fielddefs[kind][1]}
    return make_idl_struct(f"{name}_", f"{package}.msg.dds_.{name}_", fields)


def _type_of(definition: Any) -> Any:
    node, content = definition
    if node == Nodetype.BASE:
        if content[0] not in _BASES:
            raise CompanionError(
                f"messages with a field of type {content[0]} cannot be read by Cyclone DDS for Python"
            )
        return _BASES[content[0]]
    if node == Nodetype.NAME:
        return struct_of(content)
    inner, size = content
    if node == Nodetype.ARRAY:
        return _array[_type_of(inner), size]
    if size:
        return _sequence[_type_of(inner), size]
    return _sequence[_type_of(inner)]


def message(kind: str, **values: Any) -> IdlStruct:
    """A message; fields that are left out are 0 or empty, and dictionaries are messages in it.

    >>> message("std_msgs/msg/Bool", data=True)
    Bool_(data=True)
    >>> message("std_msgs/msg/Header", stamp={"sec": 3}).stamp
    Time_(sec=3, nanosec=0)
    """
    fields = _store().fielddefs[kind][1]
    contents = {
        field: _filled(definition, values[field]) if field in values else _empty(definition)
        for field, definition in fields
    }
    return struct_of(kind)(**contents)


def _filled(definition: Any, value: Any) -> Any:
    node, content = definition
    if isinstance(value, dict):
        return message(content, **value)
    if node == Nodetype.SEQUENCE and isinstance(value, list):
        inner, _ = content
        return [_filled(inner, part) for part in value]
    return value


def _empty(definition: Any) -> Any:
    node, content = definition
    if node == Nodetype.NAME:
        return message(content)
    if node == Nodetype.BASE:
        return _EMPTY.get(content[0], 0)
    if node == Nodetype.ARRAY:
        part, size = content
        return [_empty(part) for _ in range(size)]
    return []
