"""The numbers of topics with their times, on the clock of the message headers.

A header's stamp is the time of measurement, the time of receipt that of recording: later by
transport and queues, with a variable delay. So stamps of headers are used. Some topics have no
header, empty stamps, or stamps of another clock (more than `thresholds.CLOCKS_DIFFER_S` from the
rest). Their time is that of receipt, less the median delay of receipt of the other topics.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.serde import SerdeError
from scipy.ndimage import median_filter

from homeward.logs import thresholds
from homeward.logs.bags.container import Bag
from homeward.logs.bags.elements import MOST_PARTS, Element, elements_reader
from homeward.logs.bags.messages import UnknownType, WrongField, decoder
from homeward.logs.bags.topics import PART, without_part
from homeward.logs.channels import Array
from homeward.logs.columns import RecordingError

_LATEST_NS = np.iinfo(np.int64).max  # of a time of receipt, which a damaged record exceeds


@dataclass
class Samples:
    """Numbers of one topic, in the order of reading; arrays of shape (n,)."""

    received_ns: NDArray[np.int64]  # time of receipt since the epoch
    stamp_ns: NDArray[np.int64]  # time in the header, 0 where there is none
    values: dict[str, Array]  # by path


def read_samples(
    bag: Bag, wanted: Mapping[str, Collection[str]], kinds: Mapping[str, str] | None = None
) -> tuple[dict[str, Samples], list[str]]:
    """Read fields of some topics in one pass, by their paths under the name of the topic.

    `kinds` gives the types of topics that have no schema.

    Returns:
        The samples by the same names and, for each topic that cannot be read, one line with the
        reason.

    Raises:
        RecordingError: A message has no such field.
    """
    decoders, unread = _decoders(bag, wanted, kinds or {})
    offered = [connection for connection in bag.connections if connection.topic in wanted]
    readable = [connection for connection in offered if _key(connection) in decoders]
    readers = {name: elements_reader(paths) for name, paths in wanted.items()}
    rows = {connection.topic: _Rows() for connection in readable}
    for connection, received_ns, content in bag.messages(readable):
        name = connection.topic
        decode = decoders.get(_key(connection))
        if decode is None:
            continue  # where a damaged index leads to messages of another topic
        # a damaged database may give other types
        if not isinstance(received_ns, int) or received_ns > _LATEST_NS:
            rows[name].failures += 1
            continue
        try:
            message = decode(content)
            elements = readers[name](message, getattr(message, "__msgtype__", connection.msgtype))
        except SerdeError:
            rows[name].failures += 1
            continue
        except WrongField as error:
            raise RecordingError(f"{name} ({connection.msgtype}): {error}") from None
        rows[name].add(elements, wanted[name], received_ns, _stamp_ns(message))
    samples: dict[str, Samples] = {}
    for name, of_topic in rows.items():
        if of_topic.failures:
            bag.notes.append(
                f"{of_topic.failures} messages of {name} do not fit their type and are left out"
            )
        if of_topic.values:
            samples |= _by_part(name, of_topic.samples(wanted[name]), np.array(of_topic.parts))
        else:
            unread[name] = f"{name} is left out: none of its messages can be read"
    names = {without_part(label) for label in samples}
    return samples, [line for name, line in unread.items() if name not in names]


def _stamp_ns(message: Any) -> int:
    """Time in the header of a message, 0 where there is none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return 0
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


@dataclass
class _Rows:
    """Numbers of one topic while its messages are read: a row for each message, or for each battery
    in it."""

    values: list[list[float]] = field(default_factory=list)
    parts: list[str] = field(default_factory=list)  # names of the batteries
    times_ns: list[tuple[int, int]] = field(default_factory=list)  # of receipt, and of the header
    failures: int = 0  # messages that cannot be read

    def add(
        self, elements: Sequence[Element], paths: Collection[str], received_ns: int, stamp_ns: int
    ) -> None:
        """Add the numbers of a message."""
        for element in elements:
            self.values.append([element.values[path] for path in paths])
            self.parts.append(element.part)
            self.times_ns.append((received_ns, stamp_ns))

    def samples(self, paths: Collection[str]) -> Samples:
        """The rows as samples, by the paths of their columns."""
        # (paths, n)
        columns = np.array(self.values, dtype=np.float64).reshape(len(self.values), -1).T
        received_ns, stamp_ns = np.array(self.times_ns, dtype=np.int64).T
        return Samples(received_ns, stamp_ns, dict(zip(paths, columns, strict=True)))


def _key(connection: Connection) -> tuple[int, int]:
    """What tells connections apart, also those of several files."""
    return id(connection.owner), connection.id


def _decoders(
    bag: Bag, wanted: Collection[str], kinds: Mapping[str, str]
) -> tuple[dict[tuple[int, int], Callable[[bytes], Any]], dict[str, str]]:
    """Decoders of the connections of some topics, by `_key`, and why topics have none."""
    decoders = {}
    undefined = {}
    for connection in bag.connections:
        name = connection.topic
        if name not in wanted:
            continue
        try:
            decoders[_key(connection)] = decoder(connection, bag.ros1, kinds.get(name, ""))
        except UnknownType as error:
            undefined[name] = f"{name} is left out: {error}"
    return decoders, undefined


def restarts(stamp_ns: NDArray[np.int64]) -> int:
    """How often stamps go back by more than messages overtake each other: their clock was set, or
    began again."""
    return int(_part_of_sample(stamp_ns)[-1]) if len(stamp_ns) else 0


def _part_of_sample(stamp_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of the part of each sample, from 0; single wrong stamps are those of damage."""
    steady = median_filter(stamp_ns, thresholds.SPIKE_SAMPLES, mode="nearest")
    back = np.diff(steady, prepend=steady[:1]) < -thresholds.CLOCK_BACK_S * 1e9
    return np.cumsum(back).astype(np.int64)


def keep_longest_part(samples: dict[str, Samples]) -> list[str]:
    """Keep the longest part of a log whose clock begins again, in place; a line says what is left
    out.

    Raises:
        RecordingError: Its messages do not tell the parts apart.
    """
    counts = {name: restarts(of_topic.stamp_ns) for name, of_topic in samples.items()}
    parts = max(counts.values(), default=0) + 1
    if parts == 1:
        return []
    if len(set(counts.values())) > 1:
        raise RecordingError(
            "its clock begins again, and not all messages show where; cut the log at the restart"
        )
    part_of_sample = {
        name: _part_of_sample(of_topic.stamp_ns) for name, of_topic in samples.items()
    }
    spans_s = np.zeros(parts)
    for name, of_topic in samples.items():
        for part in range(parts):
            stamps = of_topic.stamp_ns[part_of_sample[name] == part]
            spans_s[part] = max(spans_s[part], float(stamps[-1] - stamps[0]) * 1e-9)
    longest = int(spans_s.argmax())
    for name, of_topic in samples.items():
        mine = part_of_sample[name] == longest
        values = {path: column[mine] for path, column in of_topic.values.items()}
        samples[name] = Samples(of_topic.received_ns[mine], of_topic.stamp_ns[mine], values)
    lengths = ", ".join(f"{span_s:.4g} s" for span_s in spans_s)
    return [
        f"its clock begins again: of {parts} parts ({lengths}) the longest is read, and the others are left out"
    ]


def _by_part(name: str, samples: Samples, parts: NDArray[np.str_]) -> dict[str, Samples]:
    """The samples of a topic, or those of each battery that it reports, by name."""
    names = np.unique(parts)
    if not 1 < len(names) <= MOST_PARTS:
        return {name: samples}
    divided = {}
    for part in names:
        mine = parts == part
        values = {path: column[mine] for path, column in samples.values.items()}
        divided[f"{name}{PART}{part}"] = Samples(
            samples.received_ns[mine], samples.stamp_ns[mine], values
        )
    return divided


def times_s(
    samples: Mapping[str, Samples], on_receipt: Collection[str]
) -> tuple[dict[str, Array], int, list[str]]:
    """Times of the samples of all topics on one clock, s, from 0; the time of that 0, ns; and notes
    on topics without a stamp of their own.

    The header of the topics in `on_receipt` is not used.
    """
    restarted = {
        name for name in samples if name not in on_receipt and restarts(samples[name].stamp_ns)
    }
    delays_s = {}  # of receipt, of topics whose stamps may be used
    for name, of_topic in samples.items():
        if (of_topic.stamp_ns > 0).all() and name not in on_receipt and name not in restarted:
            delays_s[name] = float(np.median(of_topic.received_ns - of_topic.stamp_ns)) * 1e-9
    delay_s = float(np.median(list(delays_s.values()))) if delays_s else 0.0
    of_one_clock = {
        name for name in delays_s if abs(delays_s[name] - delay_s) <= thresholds.CLOCKS_DIFFER_S
    }
    times_ns = {}
    for name, of_topic in samples.items():
        if name in of_one_clock:
            times_ns[name] = of_topic.stamp_ns
        else:
            times_ns[name] = of_topic.received_ns - int(delay_s * 1e9)
    start_ns = min(int(topic_ns.min()) for topic_ns in times_ns.values())
    notes = []
    by_receipt = sorted(samples.keys() - of_one_clock)
    if by_receipt:
        notes.append(
            f"{', '.join(by_receipt)}: placed by the time of receipt, as they have no stamp of the same clock"
        )
    if restarted:
        notes.append(f"stamps of {', '.join(sorted(restarted))} go back, as after a restart")
    since_start_s = {
        name: np.asarray((topic_ns - start_ns) * 1e-9, np.float64)
        for name, topic_ns in times_ns.items()
    }
    return since_start_s, start_ns, notes
