"""Topic mappings: which fields of which topics are which channels, for stock robots and for any
other."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol, TypeVar

from homeward.logs.bags.messages import SCHEMALESS, WrongField, getter
from homeward.logs.channels import CHANNELS, MOTION, POWER, first_set
from homeward.logs.columns import RecordingError, Source, read_mapping, shipped, source_of

ORIENTATION, ACCELERATION = "orientation", "acceleration"
"""Entries that are no channels: a quaternion and a vector of specific force, from which the grade
follows."""

IMU, BATTERY = "sensor_msgs/msg/Imu", "sensor_msgs/msg/BatteryState"

PART = "@"
"""Sign between a topic and one of several batteries that it reports; no name of a topic may have
it."""

_KEYS = ("name", "type", "except", "stamp", "several")
_FOLDER = files("homeward.logs.bags") / "maps"


def without_part(name: str) -> str:
    """Name of a topic without that of a battery in it: `/battery` of `/battery@left`, `BAT` of
    `BAT@1`."""
    return name.partition(PART)[0]


class Offer(Protocol):
    """A topic of a bag or of a network."""

    @property
    def topic(self) -> str:
        """Name."""

    @property
    def msgtype(self) -> str:
        """Type of its messages, such as nav_msgs/msg/Odometry."""

    @property
    def msgcount(self) -> int:
        """How many there are."""


Offered = TypeVar("Offered", bound=Offer)


@dataclass(frozen=True)
class Part:
    """One of several batteries that a topic reports, as a topic of its own."""

    topic: str
    msgtype: str
    msgcount: int


@dataclass(frozen=True)
class Topic:
    """Fields to read from the topics whose name and type match."""

    pattern: str  # of the name as in a shell, such as */odometry/filtered
    kind: str  # of message, such as nav_msgs/msg/Odometry, or "" for any
    refused: str  # pattern of names that are excluded, or ""
    on_receipt: bool  # whether to take the time of receipt although there is a header
    sources: dict[str, Source]  # fields of each channel, with factors to SI
    vectors: dict[str, str]  # paths of ORIENTATION and ACCELERATION
    # "sum" or "first" of several batteries that match; "" to judge by what they report
    several: str = ""

    def fits(self, connection: Offer) -> bool:
        """Whether a topic matches."""
        name = connection.topic
        if not fnmatchcase(name, without_part(self.pattern)) or fnmatchcase(name, self.refused):
            return False
        # A topic without a schema is of the type that an entry for it alone says.
        takes_its_type_from_here = connection.msgtype == SCHEMALESS and "*" not in self.pattern
        return takes_its_type_from_here or self.kind in ("", connection.msgtype)

    def takes(self, part: str) -> bool:
        """Whether one of several batteries of a topic that fits is meant, by its name such as
        `/battery@left`."""
        return PART not in self.pattern or fnmatchcase(part, self.pattern)

    def paths(self) -> list[str]:
        """Paths of all numbers that are read from a message."""
        paths = [path for source in self.sources.values() for path, _ in source.terms]
        for name, path in self.vectors.items():
            axes = "xyzw" if name == ORIENTATION else "x"
            paths += [f"{path}.{axis}" for axis in axes]
            if self.kind == IMU:
                paths.append(f"{path}_covariance[0]")  # -1 where the driver does not measure it
        return list(dict.fromkeys(paths))


@dataclass(frozen=True)
class Topics:
    """A mapping, the topics in order of preference."""

    name: str
    topics: tuple[Topic, ...]

    def candidates(
        self, channel: str, connections: Sequence[Offered]
    ) -> list[tuple[Topic, Offered]]:
        """Topics that give a channel or vector: the preferred first, then by number of messages."""
        return [
            (topic, connection)
            for topic in self.topics
            if channel in topic.sources or channel in topic.vectors
            for connection in sorted(connections, key=lambda offer: -offer.msgcount)
            if topic.fits(connection) and connection.msgcount
        ]

    def value(self, connections: Sequence[Offer]) -> tuple[bool, bool, int]:
        """How much of a bag the mapping covers: power, motion, number of channels."""
        offered = {
            name
            for name in (*CHANNELS, ORIENTATION, ACCELERATION)
            if self.candidates(name, connections)
        }
        return first_set(POWER, offered) != (), first_set(MOTION, offered) != (), len(offered)


def shipped_topics() -> list[str]:
    """Names of the topic mappings that ship with the package."""
    return shipped(_FOLDER)


def load_topics(mapping: str | Path) -> Topics:
    """Load a topic mapping by shipped name or from a TOML file.

    The file has tables `[[topics]]`, the preferred first. In each: `name`, a pattern as in a shell;
    optionally `type`, `except` (a pattern of names to exclude), `stamp = "receive"` and `several`
    (`"sum"` or `"first"` of the batteries that match, see `homeward.logs.bags.batteries`); and one
    line per channel with the path of a field, or a table with `field` (or `fields`, which are
    added), `factor` (or `factors`) and `offset`. A path with [*], as `packs[*].current`, reads each
    element of a list as a battery. The entries `orientation` (path of a quaternion) and
    `acceleration` (path of a vector) give the grade.

    Raises:
        RecordingError: Unknown name, unreadable file or an invalid entry.

    >>> load_topics("turtlebot").topics[0].sources["current_a"]
    Source(terms=(('current', -1.0),), offset=0.0, unknown=())
    """
    entries = read_mapping("topic mapping", mapping, _FOLDER, {"topics"}).get("topics")
    if (
        not isinstance(entries, list)
        or not entries
        or not all(isinstance(entry, dict) for entry in entries)
    ):
        raise RecordingError(f"{mapping}: needs at least one table [[topics]]")
    topics = tuple(_topic(f"{mapping}: topics[{i}]", entry) for i, entry in enumerate(entries))
    return Topics(str(mapping), topics)


def best_topics(connections: Sequence[Offer]) -> Topics:
    """The shipped mapping that covers most of a bag; of equals the first by name."""
    return max(
        (load_topics(name) for name in shipped_topics()),
        key=lambda topics: topics.value(connections),
    )


def _topic(where: str, entry: dict[str, Any]) -> Topic:
    """A topic by an entry of a mapping file; `where` it stands is for messages.

    Raises:
        RecordingError: The entry is invalid.
    """
    texts = _texts(where, entry)
    sources = {}
    vectors = {}
    for key, value in entry.items():
        if key in (ORIENTATION, ACCELERATION):
            if not isinstance(value, str):
                raise RecordingError(f"{where}.{key} = {value!r} is not the path of a field")
            vectors[key] = value
        elif key in CHANNELS and key != "time_s":
            sources[key] = source_of(f"{where}.{key}", value, "field")
        elif key not in _KEYS:
            raise RecordingError(
                f"{where}: {key} is not a channel; channels: {', '.join(list(CHANNELS)[1:])}, "
                f"{ORIENTATION}, {ACCELERATION}"
            )
    topic = Topic(
        pattern=texts["name"],
        kind=texts["type"],
        refused=texts["except"],
        on_receipt=texts["stamp"] == "receive",
        sources=sources,
        vectors=vectors,
        several=texts["several"],
    )
    for path in topic.paths():
        try:
            getter(path.replace("[*]", "[0]"))
        except WrongField as error:
            raise RecordingError(f"{where}: {error}") from None
    return topic


def _texts(where: str, entry: dict[str, Any]) -> dict[str, str]:
    """The entries of a topic that are text, "" where one is missing.

    Raises:
        RecordingError: The name is missing, or an entry is no text or has a value that is not
            allowed.
    """
    texts = {key: entry.get(key, "") for key in _KEYS}
    if not texts["name"] or not all(isinstance(text, str) for text in texts.values()):
        raise RecordingError(f"{where}: needs the name of a topic; {', '.join(_KEYS)} are text")
    if texts["stamp"] not in ("", "header", "receive"):
        raise RecordingError(
            f"{where}: stamp = {texts['stamp']!r} is not allowed; choose from header, receive"
        )
    if texts["several"] not in ("", "sum", "first"):
        raise RecordingError(
            f"{where}: several = {texts['several']!r} is not allowed; choose from sum, first"
        )
    return texts
