"""The numbers of topics with their times, on the clock of the message headers.

A header's stamp says when a value was measured, the time of receipt when the recorder got it: later by transport and
queues, and by different amounts. So stamps of headers are taken. A topic without a header, with empty stamps, or with
stamps of another clock (more than `_CLOCKS_DIFFER_S` from the rest) is placed by its time of receipt, less what
receipt is late for the other topics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.serde import SerdeError

from homeward.diagnosis.read.bags.container import Bag
from homeward.diagnosis.read.bags.messages import UnknownType, WrongField, decoder, getter
from homeward.diagnosis.read.columns import RecordingError, Source

Array = NDArray[np.float64]

_CLOCKS_DIFFER_S = 5.0


@dataclass
class Samples:
    """Numbers of one topic, in the order of reading; arrays of shape (n,).

    Attributes:
        received_ns: Time of receipt since the epoch, ns.
        stamp_ns: Time in the header, ns, or None where there is none.
        values: Numbers by path.
    """

    received_ns: NDArray[np.int64]
    stamp_ns: NDArray[np.int64] | None
    values: dict[str, Array]

    def channel(self, source: Source) -> Array:
        """A channel out of the fields it is made of."""
        total = np.full(len(self.received_ns), source.offset)
        for path, factor in source.terms:
            total += factor * self.values[path]
        return total


def read_samples(bag: Bag, wanted: Mapping[str, Sequence[str]]) -> dict[str, Samples | str]:
    """Read fields of some topics in one pass.

    Args:
        bag: The open bag.
        wanted: Paths of the fields, by the name of the topic.

    Returns:
        By the same names the samples or, where a topic cannot be read, one line that says why.

    Raises:
        RecordingError: A message has no such field.
    """
    result: dict[str, Samples | str] = {}
    connections = [connection for connection in bag.connections if connection.topic in wanted]
    decoders = {}
    for connection in connections:
        try:
            decoders[_key(connection)] = decoder(connection, bag.ros1)
        except UnknownType as error:
            result[connection.topic] = f"{connection.topic} is left out: {error}"
    readable = [connection for connection in connections if _key(connection) in decoders]
    getters = {name: [getter(path) for path in paths] for name, paths in wanted.items()}
    rows: dict[str, list[list[float]]] = {connection.topic: [] for connection in readable}
    times: dict[str, list[tuple[int, int]]] = {name: [] for name in rows}
    spoilt = dict.fromkeys(rows, 0)
    for connection, received_ns, content in bag.messages(readable):
        name = connection.topic
        try:
            message = decoders[_key(connection)](content)
            rows[name].append([get(message) for get in getters[name]])
        except SerdeError:
            spoilt[name] += 1
            continue
        except WrongField as error:
            raise RecordingError(f"{bag.path}: {name} ({connection.msgtype}): {error}") from None
        times[name].append((received_ns, _stamp_ns(message)))
    for name in rows:
        if spoilt[name]:
            bag.notes.append(f"{spoilt[name]} messages of {name} do not fit their type and are left out")
        if not rows[name]:
            result[name] = f"{name} is left out: none of its messages can be read"
            continue
        table = np.array(rows[name], dtype=np.float64).reshape(len(rows[name]), -1).T
        received, stamps = np.array(times[name], dtype=np.int64).T
        values = dict(zip(wanted[name], table, strict=True))
        result[name] = Samples(received, stamps if (stamps > 0).all() else None, values)
    return result


def times_s(samples: Mapping[str, Samples], on_receipt: Sequence[str]) -> tuple[dict[str, Array], list[str]]:
    """Times of the samples of all topics on one clock, s, from 0; and notes on those without a stamp of their own.

    Args:
        samples: By name of the topic.
        on_receipt: Topics whose header is not to be used.
    """
    late_s = {
        name: float(np.median(one.received_ns - one.stamp_ns)) * 1e-9
        for name, one in samples.items()
        if one.stamp_ns is not None and name not in on_receipt
    }
    usual_s = float(np.median(list(late_s.values()))) if late_s else 0.0
    stamped = {name for name, late in late_s.items() if abs(late - usual_s) <= _CLOCKS_DIFFER_S}
    times = {
        name: one.stamp_ns if name in stamped and one.stamp_ns is not None else one.received_ns - int(usual_s * 1e9)
        for name, one in samples.items()
    }
    start_ns = min(int(one.min()) for one in times.values())
    notes = []
    if others := sorted(set(samples) - stamped):
        notes.append(f"{', '.join(others)}: placed by the time of receipt, for want of a stamp of the same clock")
    return {name: np.asarray((one - start_ns) * 1e-9, dtype=np.float64) for name, one in times.items()}, notes


def _stamp_ns(message: object) -> int:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _key(connection: Connection) -> tuple[int, int]:
    return id(connection.owner), connection.id
