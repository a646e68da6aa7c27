"""The numbers of topics with their times, on the clock of the message headers.

A header's stamp is the time of measurement, the time of receipt that of recording: later by transport and queues, with
a variable delay. So stamps of headers are used. Some topics have no header, empty stamps, or stamps of
another clock (more than `thresholds.CLOCKS_DIFFER_S` from the rest). Their time is that of receipt, less the median
delay of receipt of the other topics.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from scipy.ndimage import median_filter

from homeward.logs import thresholds
from homeward.logs.bags.container import Bag
from homeward.logs.bags.elements import MOST_PARTS, elements_reader
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
        The samples by the same names and, for each topic that cannot be read, one line with the reason.

    Raises:
        RecordingError: A message has no such field.
    """
    unread: dict[str, str] = {}
    decoders, readable = {}, []
    for connection in bag.connections:
        if connection.topic in wanted:
            try:
                decoders[id(connection.owner), connection.id] = decoder(
                    connection, bag.ros1, (kinds or {}).get(connection.topic, "")
                )
                readable.append(connection)
            except UnknownType as error:
                unread[connection.topic] = f"{connection.topic} is left out: {error}"
    readers = {name: elements_reader(paths) for name, paths in wanted.items()}
    rows: dict[str, list[list[float]]] = {connection.topic: [] for connection in readable}
    times: dict[str, list[tuple[int, int]]] = {name: [] for name in rows}
    parts: dict[str, list[str]] = {name: [] for name in rows}
    failures = dict.fromkeys(rows, 0)
    for connection, received_ns, content in bag.messages(readable):
        name, decode = connection.topic, decoders.get((id(connection.owner), connection.id))
        if decode is None:
            continue  # where a damaged index leads to messages of another topic
        if not isinstance(received_ns, int) or received_ns > _LATEST_NS:  # a damaged database may give other types
            failures[name] += 1
            continue
        try:
            message = decode(content)
            elements = readers[name](message, getattr(message, "__msgtype__", connection.msgtype))
        except SerdeError:
            failures[name] += 1
            continue
        except WrongField as error:
            raise RecordingError(f"{name} ({connection.msgtype}): {error}") from None
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        stamp_ns = 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)
        for element in elements:
            rows[name].append([element.values[path] for path in wanted[name]])
            parts[name].append(element.part)
            times[name].append((received_ns, stamp_ns))
    bag.notes += [f"{n} messages of {name} do not fit their type and are left out" for name, n in failures.items() if n]
    unread |= {name: f"{name} is left out: none of its messages can be read" for name in rows if not rows[name]}
    samples: dict[str, Samples] = {}
    for name in (topic for topic in rows if rows[topic]):
        table = np.array(rows[name], dtype=np.float64).reshape(len(rows[name]), -1).T
        received, stamps = np.array(times[name], dtype=np.int64).T
        samples_of_topic = Samples(received, stamps, dict(zip(wanted[name], table, strict=True)))
        samples |= _by_part(name, samples_of_topic, np.array(parts[name]))
    return samples, [line for name, line in unread.items() if name not in {without_part(part) for part in samples}]


def restarts(stamp_ns: NDArray[np.int64]) -> int:
    """How often stamps go back by more than messages overtake each other: their clock was set, or began again."""
    return int(_part_of_sample(stamp_ns)[-1]) if len(stamp_ns) else 0


def _part_of_sample(stamp_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of the part of each sample, from 0; single wrong stamps are those of damage."""
    steady = median_filter(stamp_ns, thresholds.SPIKE_SAMPLES, mode="nearest")
    back = np.diff(steady, prepend=steady[:1]) < -thresholds.CLOCK_BACK_S * 1e9
    return np.cumsum(back).astype(np.int64)


def keep_longest_part(samples: dict[str, Samples]) -> list[str]:
    """Keep the longest part of a log whose clock begins again, in place; a line says what is left out.

    Raises:
        RecordingError: Its messages do not tell the parts apart.
    """
    counts = {name: restarts(of_topic.stamp_ns) for name, of_topic in samples.items()}
    parts = max(counts.values(), default=0) + 1
    if parts == 1:
        return []
    if len(set(counts.values())) > 1:
        raise RecordingError("its clock begins again, and not all messages show where; cut the log at the restart")
    part_of_sample = {name: _part_of_sample(of_topic.stamp_ns) for name, of_topic in samples.items()}
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
    return [f"its clock begins again: of {parts} parts ({lengths}) the longest is read, and the others are left out"]


def _by_part(name: str, samples: Samples, parts: NDArray[np.str_]) -> dict[str, Samples]:
    """The samples of a topic, or those of each battery that it reports, by name."""
    names = np.unique(parts)
    if not 1 < len(names) <= MOST_PARTS:
        return {name: samples}
    divided = {}
    for part in names:
        mine = parts == part
        values = {path: column[mine] for path, column in samples.values.items()}
        divided[f"{name}{PART}{part}"] = Samples(samples.received_ns[mine], samples.stamp_ns[mine], values)
    return divided


def times_s(samples: Mapping[str, Samples], on_receipt: Collection[str]) -> tuple[dict[str, Array], int, list[str]]:
    """Times of the samples of all topics on one clock, s, from 0; the time of that 0, ns; and notes on topics
    without a stamp of their own.

    The header of the topics in `on_receipt` is not used.
    """
    late_s = {
        name: float(np.median(of_topic.received_ns - of_topic.stamp_ns)) * 1e-9
        for name, of_topic in samples.items()
        if (of_topic.stamp_ns > 0).all() and name not in on_receipt and not restarts(of_topic.stamp_ns)
    }
    median_s = float(np.median(list(late_s.values()))) if late_s else 0.0
    stamped = {name for name, late in late_s.items() if abs(late - median_s) <= thresholds.CLOCKS_DIFFER_S}
    times = {
        name: of_topic.stamp_ns if name in stamped else of_topic.received_ns - int(median_s * 1e9)
        for name, of_topic in samples.items()
    }  # fmt: skip
    start_ns = min(int(topic_ns.min()) for topic_ns in times.values())
    notes = []
    if others := sorted(set(samples) - stamped):
        notes.append(f"{', '.join(others)}: placed by the time of receipt, as they have no stamp of the same clock")
    by_stamp = [name for name in sorted(samples) if name not in on_receipt]
    restarted = [name for name in by_stamp if restarts(samples[name].stamp_ns)]
    if restarted:
        notes.append(f"stamps of {', '.join(restarted)} go back, as after a restart")
    since = {name: np.asarray((topic_ns - start_ns) * 1e-9, dtype=np.float64) for name, topic_ns in times.items()}
    return since, start_ns, notes
