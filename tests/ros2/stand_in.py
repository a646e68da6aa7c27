"""A stand-in for rclpy and the message packages: one graph in this process, with their names,
defaults and checks.

Messages have the types that `rosidl_generator_py` gives their fields, and refuse others as it does:
`byte` is a byte string of length 1, numbers of fixed arrays are numpy arrays, those of sequences
are `array`s.
"""

from __future__ import annotations

import array
import enum
import sys
import types
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Nodetype

from homeward.logs.bags.messages import known_types

PACKAGES = (
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "nav_msgs",
    "sensor_msgs",
    "std_msgs",
)
_NAMES = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
}
_CODES = {"double": "d", "float": "f", "int32": "i", "uint8": "B"}
_STORE = known_types()


class Enumerated(enum.Enum):
    """A policy by its name, as the enumerations of rclpy have it."""

    BEST_EFFORT = 2
    RELIABLE = 1
    VOLATILE = 3
    TRANSIENT_LOCAL = 4
    KEEP_LAST = 5


class Message:
    """A message; its class has the names and types of the fields."""

    fields: dict[str, tuple[Any, Any]]

    def __init__(self, **values: Any) -> None:
        for name, definition in self.fields.items():
            object.__setattr__(self, name, empty(definition))
        for name, value in values.items():
            setattr(self, name, value)

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        return {name: described(definition) for name, definition in cls.fields.items()}

    def __setattr__(self, name: str, value: Any) -> None:
        assert name in self.fields, f"no field {name}"
        assert fits(self.fields[name], value), (
            f"{name} = {value!r} is no {described(self.fields[name])}"
        )
        object.__setattr__(self, name, value)


def described(definition: tuple[Any, Any]) -> str:
    node, content = definition
    if node == Nodetype.BASE:
        return _NAMES.get(content[0], str(content[0]))
    if node == Nodetype.NAME:
        return str(content).replace("/msg/", "/")
    inner, size = content
    return (
        f"{described(inner)}[{size}]" if node == Nodetype.ARRAY else f"sequence<{described(inner)}>"
    )


def empty(definition: tuple[Any, Any]) -> Any:
    node, content = definition
    if node == Nodetype.NAME:
        return class_of(content)()
    if node == Nodetype.BASE:
        kind = described(definition)
        return {"boolean": False, "octet": b"\0", "string": "", "float": 0.0, "double": 0.0}.get(
            kind, 0
        )
    inner, size = content
    if node == Nodetype.ARRAY:
        return np.zeros(size)
    code = _CODES.get(described(inner))
    return [] if code is None else array.array(code)


def fits(definition: tuple[Any, Any], value: Any) -> bool:
    node, content = definition
    if node == Nodetype.NAME:
        return type(value) is class_of(content)
    if node != Nodetype.BASE:
        return all(fits(content[0], part) for part in value)
    kind = described(definition)
    if kind == "octet":
        return isinstance(value, bytes) and len(value) == 1
    wanted = {"boolean": bool, "string": str, "float": float, "double": float}.get(kind, int)
    return isinstance(value, wanted) and not (wanted is int and isinstance(value, bool))


_CLASSES: dict[str, type[Message]] = {}


def class_of(kind: str) -> type[Message]:
    """The class of a message type such as `nav_msgs/msg/Odometry`."""
    if kind not in _CLASSES:
        name = kind.rpartition("/")[2]
        _CLASSES[kind] = type(
            name, (Message,), {"fields": dict(_STORE.fielddefs[kind][1]), "kind": kind}
        )
    return _CLASSES[kind]


class Publisher:
    """A publisher; its messages arrive at once."""

    def __init__(self, graph: Graph, made: type[Message], topic: str, reliable: bool) -> None:
        self.graph, self.made, self.topic, self.reliable = graph, made, topic, reliable
        graph.gids += 1
        self.info = SimpleNamespace(endpoint_gid=[graph.gids] * 16)
        graph.publishers.append(self)

    def publish(self, message: Message) -> None:
        assert type(message) is self.made
        for made, topic, heard, reliable in list(self.graph.subscriptions):
            if topic == self.topic and made is self.made and (self.reliable or not reliable):
                heard(message)

    def die(self) -> None:
        self.graph.publishers.remove(self)


class Graph:
    """What a ROS 2 network knows."""

    def __init__(self) -> None:
        self.publishers: list[Publisher] = []
        self.subscriptions: list[tuple[type[Message], str, Callable[[Any], None], bool]] = []
        self.gids = 0

    def publisher(self, kind: str, topic: str, reliable: bool = False) -> Publisher:
        """A publisher of somebody else."""
        return Publisher(self, class_of(kind), topic, reliable)

    def hear(self, kind: str, topic: str, heard: Callable[[Any], None]) -> None:
        """A reliable subscription of somebody else."""
        self.subscriptions.append((class_of(kind), topic, heard, True))


class Logger:
    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []
        for level in ("info", "warn", "error"):
            setattr(self, level, lambda text, level=level: self.lines.append((level, text)))

    def said(self, level: str) -> str:
        return "\n".join(text for of, text in list(self.lines) if of == level)


class Node:
    """A node, with the calls that the package makes."""

    def __init__(self, graph: Graph, parameters: dict[str, Any]) -> None:
        self.graph, self._given, self._values = graph, parameters, dict[str, Any]()
        self.logger = Logger()

    def declare_parameter(self, name: str, value: Any) -> None:
        given = self._given.get(name, value)
        assert type(given) is type(value), name
        self._values[name] = given

    def get_parameter(self, name: str) -> Any:
        return SimpleNamespace(value=self._values[name])

    def get_logger(self) -> Logger:
        return self.logger

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        named = {one.topic: one.made.kind for one in self.graph.publishers}  # type: ignore[attr-defined]
        named |= {topic: made.kind for made, topic, *_ in self.graph.subscriptions}  # type: ignore[attr-defined]
        return [(topic, [kind]) for topic, kind in sorted(named.items())]

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        return [one.info for one in self.graph.publishers if one.topic == topic]

    def create_subscription(
        self, made: type[Message], topic: str, heard: Callable[[Any], None], qos: Any
    ) -> None:
        assert qos.depth > 0 and qos.durability == Enumerated.VOLATILE
        reliable = qos.reliability == Enumerated.RELIABLE
        self.graph.subscriptions.append((made, topic, heard, reliable))

    def create_publisher(self, made: type[Message], topic: str, qos: Any) -> Publisher:
        return Publisher(self.graph, made, topic, qos.reliability == Enumerated.RELIABLE)


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the modules where they are imported from."""
    modules = {name: types.ModuleType(name) for name in ("rclpy", "rclpy.qos")}
    qos: Any = modules["rclpy.qos"]
    qos.ReliabilityPolicy = qos.DurabilityPolicy = qos.HistoryPolicy = Enumerated
    qos.QoSProfile = SimpleNamespace
    rclpy: Any = modules["rclpy"]
    rclpy.qos = qos
    rclpy.spin_once = lambda node, timeout_sec: None
    for package in PACKAGES:
        of_package: Any = types.ModuleType(f"{package}.msg")
        for kind in _STORE.fielddefs:
            if kind.startswith(f"{package}/msg/"):
                setattr(of_package, kind.rpartition("/")[2], class_of(kind))
        modules |= {package: types.ModuleType(package), f"{package}.msg": of_package}
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
