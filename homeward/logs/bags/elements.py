"""Several batteries in one message: paths with [*] for each element of a list, as `packs[*].current`."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

from homeward.logs.bags.messages import WrongField, getter
from homeward.logs.bags.topics import BATTERY

EVERY = "[*]"
MOST_PARTS = 16
"""Most batteries of a topic. Chosen: with more, the text or the list is none of batteries."""


class Element(NamedTuple):
    """Numbers of a message by path, and the name of the battery that they are of, as far as the message says so."""

    part: str
    values: dict[str, float]


def elements_reader(paths: Collection[str]) -> Callable[[Any, str], list[Element]]:
    """Reader of a message, with its type: one element, or one for each battery of a list that a path names with [*].

    Raises:
        WrongField: A path is not understood or, on reading, the message has no such field or too long a list.
    """
    alone = {path: getter(path) for path in paths if EVERY not in path}
    listed = [path for path in paths if EVERY in path]
    of_place: list[dict[str, Callable[[Any], float]]] = []

    def read(message: Any, kind: str) -> list[Element]:
        values = {path: get(message) for path, get in alone.items()}
        if not listed:
            return [Element(part_of(message, kind), values)]
        lists = [_list_at(message, path) for path in listed]
        count = max(map(len, lists))
        if count > MOST_PARTS:
            raise WrongField(f"{listed[0]!r} has {count} elements, more than the {MOST_PARTS} batteries of any robot")
        while len(of_place) < count:
            place = f"[{len(of_place)}]"
            of_place.append({path: getter(path.replace(EVERY, place)) for path in listed})
        longest = max(lists, key=len)
        names = [_said_by(element) for element in longest]
        if len({*names}) < count or "" in names:
            names = [str(place) for place in range(count)]
        return [
            Element(name, values | {path: get(message) for path, get in getters.items()})
            for name, getters in zip(names, of_place, strict=False)
        ]

    return read


def part_of(message: Any, kind: str) -> str:
    """Name of the battery that a message is of, as far as it says so: several may share a topic."""
    if kind != BATTERY:
        return ""
    frame = getattr(getattr(message, "header", None), "frame_id", "")
    return _said_by(message) or str(frame)


def _said_by(state: Any) -> str:
    """Where a battery is, or its serial number, as far as its state says so."""
    said = (getattr(state, "location", ""), getattr(state, "serial_number", ""))
    return str(next((name for name in said if name), ""))


def _list_at(message: Any, path: str) -> Any:
    """The list of a message that a path with [*] names."""
    value = message
    for name in path.partition(EVERY)[0].split("."):
        if not hasattr(value, name):
            fields = [field for field in getattr(value, "__dataclass_fields__", {}) if not field.startswith("_")]
            raise WrongField(f"no field {name!r} of {path!r}; it has {', '.join(fields)}")
        value = getattr(value, name)
    if not hasattr(value, "__len__") or isinstance(value, str):
        raise WrongField(f"{path!r} is not of a list but of {type(value).__name__}")
    return value
