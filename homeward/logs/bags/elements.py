"""Several batteries in one message: paths with [*] for each element of a list, as
`packs[*].current`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

from homeward.logs.bags.messages import WrongField, as_list, field_of, getter
from homeward.logs.bags.topics import BATTERY

EVERY = "[*]"
MOST_PARTS = 16
"""Most batteries of a topic. Chosen: with more, the text or the list is none of batteries."""


Getters = dict[str, Callable[[Any], float]]
"""Readers of the numbers of a message, by path."""


class Element(NamedTuple):
    """Numbers of a message by path, and the name of the battery that they are of, as far as the
    message says so."""

    part: str
    values: dict[str, float]


def elements_reader(paths: Collection[str]) -> Callable[[Any, str], list[Element]]:
    """Reader of a message, with its type: one element, or one for each battery of a list that a
    path names with [*].

    Raises:
        WrongField: A path is not understood or, on reading, the message has no such field or too
            long a list.
    """
    of_message = _getters([path for path in paths if EVERY not in path])
    listed = [path for path in paths if EVERY in path]
    if not listed:
        return lambda message, kind: [
            Element(part_of(message, kind), _numbers(of_message, message))
        ]
    of_places: list[Getters] = []  # of each place in the lists, made once the first message has it

    def read(message: Any, kind: str) -> list[Element]:
        values = _numbers(of_message, message)
        longest = max((_list_at(message, path) for path in listed), key=len)
        count = len(longest)
        if count > MOST_PARTS:
            raise WrongField(
                f"{listed[0]!r} has {count} elements, more than the {MOST_PARTS} batteries of any robot"
            )
        while len(of_places) < count:
            of_places.append(_getters(listed, len(of_places)))
        elements = []
        for name, of_place in zip(_names(longest), of_places, strict=False):
            elements.append(Element(name, values | _numbers(of_place, message)))
        return elements

    return read


def _getters(paths: Collection[str], place: int = 0) -> Getters:
    """Readers of numbers by path; [*] in a path stands for a place in a list."""
    return {path: getter(path.replace(EVERY, f"[{place}]")) for path in paths}


def _numbers(getters: Getters, message: Any) -> dict[str, float]:
    return {path: get(message) for path, get in getters.items()}


def _names(batteries: Sequence[Any]) -> list[str]:
    """Names of the batteries in a list: what they say of themselves, or their places where that is
    not unique."""
    names = [_said_by(battery) for battery in batteries]
    if len({*names}) < len(names) or "" in names:
        return [str(place) for place in range(len(names))]
    return names


def part_of(message: Any, kind: str) -> str:
    """Name of the battery that a message is of, as far as it says so: several may share a topic."""
    if kind != BATTERY:
        return ""
    frame = getattr(getattr(message, "header", None), "frame_id", "")
    return _said_by(message) or str(frame)


def _said_by(state: Any) -> str:
    """Where a battery is, or its serial number, as far as its state says so."""
    return str(getattr(state, "location", "") or getattr(state, "serial_number", "") or "")


def _list_at(message: Any, path: str) -> Any:
    """The list of a message that a path with [*] names."""
    value = message
    for name in path.partition(EVERY)[0].split("."):
        value = field_of(value, name, path)
    return as_list(value, path)
