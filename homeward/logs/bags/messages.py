"""Numbers out of messages: type definitions of the bag or of this package, and fields by path."""

import re
from collections.abc import Callable, Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from homeward.logs import limits

_SEPARATOR = "=" * 80 + "\n"
SCHEMALESS = "__schemaless__"
"""Type that `rosbags` gives topics of an MCAP file without a schema."""

# which rosbags adds to a message without fields
_PLACEHOLDER = "structure_needs_at_least_one_member"
_STEP = re.compile(r"([A-Za-z_]\w*)|\[(\w+)\]")


class UnknownType(ValueError):
    """A message type without a definition; the message names it."""


class WrongField(ValueError):
    """A field that the message does not have; the error lists those that it has."""


def decoder(connection: Connection, ros1: bool, kind: str = "") -> Callable[[bytes], Any]:
    """Decoder of the content of a topic's messages into objects.

    The bag's own definition comes first. Bags of ROS 2 before Iron in sqlite3 have none: then those
    of the standard packages, and the ones that ship here (folder definitions), newest first where a
    package changed its layout. So it is for an empty definition, and for a topic without a schema
    whose `kind` the mapping gives.

    Raises:
        UnknownType: There is no definition.
    """
    if connection.msgtype == SCHEMALESS and kind:
        connection = connection._replace(msgtype=kind)
    kind = connection.msgtype
    stores = _stores(connection)
    for store in stores:
        _refuse_large(store, kind)
        store.max_sequence_length = limits.MOST_SEQUENCE

    def decode(content: bytes) -> Any:
        while True:
            try:
                if ros1:
                    return stores[0].deserialize_ros1(content, kind)
                return stores[0].deserialize_cdr(content, kind)
            # a damaged message or definition raises anything, from SerdeError to KeyError
            except Exception:
                if len(stores) == 1:
                    raise SerdeError(
                        f"a message of type {kind} does not fit its definition"
                    ) from None
                stores.pop(0)  # an older layout of the same type

    return decode


def _stores(connection: Connection) -> list[Typestore]:
    """Definitions of a topic's type, the one to try first in front.

    Raises:
        UnknownType: There is none, or that of the bag cannot be read.
    """
    kind = connection.msgtype
    definition = connection.msgdef
    try:
        own_types = _own_types(kind, definition)
        if own_types:
            return [_store(Stores.EMPTY, own_types)]
    except Exception as error:  # a damaged one raises anything, from TypesysError to KeyError
        why = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise UnknownType(f"{kind}: its definition in the bag cannot be read ({why})") from None
    standard = get_typestore(Stores.LATEST)
    if kind in standard.types:
        return [standard]
    stores = [
        _store(
            Stores.LATEST, [get_types_from_msg(text, name) for name, text in definitions.items()]
        )
        for definitions in shipped_definitions()
        if kind in definitions
    ]
    if not stores:
        raise UnknownType(
            f"{kind}: the bag has no definition of this type, and neither has this package"
        )
    return stores


def _own_types(kind: str, definition: MessageDefinition) -> list[Any]:
    """The types that the bag itself defines for a topic; none where the definition is missing or
    empty."""
    text = definition.data
    if not text.strip():
        return []
    if definition.format == MessageDefinitionFormat.MSG:
        return [get_types_from_msg(text, kind)]
    if definition.format == MessageDefinitionFormat.IDL:
        parts = [
            part.split("\n", 1)[1] for part in text.split(_SEPARATOR) if part.startswith("IDL: ")
        ]
        return [get_types_from_idl(part) for part in parts or [text]]
    return []


def _refuse_large(store: Typestore, kind: str) -> None:
    """Refuse a definition that lets a message of some bytes have millions of parts.

    Raises:
        UnknownType: It has more numbers than a message has, contains itself, or lists parts without
            content.
    """
    try:
        count = _elements(store, kind, {})
    except (RecursionError, KeyError):  # a part that contains itself, or has no definition
        raise UnknownType(
            f"{kind}: its definition in the bag is not complete, or contains itself"
        ) from None
    if count > limits.MOST_ELEMENTS:
        raise UnknownType(
            f"{kind}: by its definition in the bag a message has {count:.3g} numbers, which none has"
        )


def _elements(store: Typestore, kind: str, counts: dict[str, int]) -> int:
    """How many numbers, texts and lists a message has; a list in it counts as one."""
    if kind not in counts:
        fields: Any = store.fielddefs[kind][1]
        parts = [part for name, part in fields if name != _PLACEHOLDER]
        counts[kind] = sum(_elements_of(store, node, content, counts) for node, content in parts)
    return counts[kind]


def _elements_of(store: Typestore, node: Nodetype, content: Any, counts: dict[str, int]) -> int:
    if node == Nodetype.BASE:
        return 1
    if node == Nodetype.NAME:
        return _elements(store, content, counts)
    (inner, inside), size = content
    count = _elements_of(store, inner, inside, counts)
    if node == Nodetype.ARRAY:
        return int(size) * max(count, 1)
    # A list says its own length, which nothing limits where its parts have no bytes.
    return 1 if count else limits.MOST_ELEMENTS + 1


def _store(base: Stores, types: Sequence[Any]) -> Typestore:
    store = get_typestore(base)
    for definitions in types:
        store.register(
            {name: fields for name, fields in definitions.items() if name not in store.types}
        )
    return store


def known_types() -> Typestore:
    """Types of the standard packages of ROS 2, and those that ship here in their newest layout."""
    newest, _ = shipped_definitions()
    return _store(Stores.LATEST, [get_types_from_msg(text, name) for name, text in newest.items()])


def shipped_definitions() -> list[dict[str, str]]:
    """Message definitions that ship, by type: one mapping for the newest layouts, then one for
    older ones."""
    folder = files("homeward.logs.bags") / "definitions"
    newest: dict[str, str] = {}
    older: dict[str, str] = {}
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        package, name, *age = entry.name.removesuffix(".msg").split(".")
        layouts = older if age else newest
        layouts[f"{package}/msg/{name}"] = entry.read_text(encoding="utf-8")
    return [newest, newest | older]


def getter(path: str) -> Callable[[Any], float]:
    """Reader of a number by its path, such as `twist.twist.linear.x`, `measured_currents[0]` or, in
    a message with names as `sensor_msgs/JointState` has them, `velocity[front_left_wheel]`; NaN
    where an element is missing. Paths with [*] are read by `homeward.logs.bags.elements`.

    Raises:
        WrongField: The path is not understood or, on reading, the message has no such field.

    >>> from types import SimpleNamespace
    >>> joints = SimpleNamespace(name=["left", "right"], velocity=[1.5, 2.5])
    >>> getter("velocity[right]")(joints)
    2.5
    """
    steps = [(match[1], match[2]) for match in _STEP.finditer(path)]
    understood = "".join(f"[{key}]" if key else f".{name}" for name, key in steps).lstrip(".")
    if not steps or understood != path:
        raise WrongField(
            f"{path!r} is not a path such as twist.twist.linear.x or velocity[left_wheel]"
        )

    def get(message: Any) -> float:
        value = message
        for name, key in steps:
            if name:
                value = field_of(value, name, path)
                continue
            items = as_list(value, path)
            place = _place(message, key)
            if place is None or place >= len(items):
                return float(np.nan)
            value = items[place]
        try:
            return float(value)
        except (TypeError, ValueError):
            raise WrongField(f"{path!r} is not a number but {type(value).__name__}") from None

    return get


def field_of(message: Any, name: str, path: str) -> Any:
    """A field of a message or of a part of it.

    Raises:
        WrongField: It has no such field; `path` is where a mapping names it.
    """
    try:
        return getattr(message, name)
    except AttributeError:
        fields = [
            field
            for field in getattr(message, "__dataclass_fields__", {})
            if not field.startswith("_")
        ]
        raise WrongField(f"no field {name!r} of {path!r}; it has {', '.join(fields)}") from None


def as_list(value: Any, path: str) -> Any:
    """A list in a message, as it is.

    Raises:
        WrongField: It is none; `path` is where a mapping names it.
    """
    if not hasattr(value, "__len__") or isinstance(value, str):
        raise WrongField(f"{path!r} is not of a list but of {type(value).__name__}")
    return value


def _place(message: Any, key: str) -> int | None:
    """Place in a list by its number, or by the name that the message gives it; None where it gives
    none."""
    if key.isdigit():
        return int(key)
    names = list(getattr(message, "name", ()))
    return names.index(key) if key in names else None
