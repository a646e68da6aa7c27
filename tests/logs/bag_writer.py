"""Bags for the tests, written by rosbags: a robot's drive as its topics, in every format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

Array = NDArray[np.float64]

START_S = 1_700_000_000
KINDS = ("ros1", "sqlite3", "mcap")


@dataclass
class Stream:
    """What is published on one topic.

    `values` maps paths such as `twist.twist.linear.x` to one number a message, or to anything that
    is the same in all.
    """

    kind: str
    time_s: Array
    values: Mapping[str, Any]
    definition: str = ""  # of a type that no store has
    received_late_s: float = 0.003
    stamped: bool = True
    clock_s: float = 0.0  # of the publisher, ahead of the recorder's
    extra: dict[str, str] = field(default_factory=dict)  # further definitions that this one needs


def write_bag(
    folder: Path, form: str, streams: Mapping[str, Stream], compression: str = ""
) -> Path:
    """Write a bag named `run` and return what a user would hand over: a .bag file or the folder of
    a ROS 2 bag."""
    ros1 = form == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    for stream in streams.values():
        for kind, text in {**stream.extra, stream.kind: stream.definition}.items():
            if text and kind not in store.types:
                store.register(get_types_from_msg(text, kind))
    folder.mkdir(exist_ok=True)
    path = folder / ("run.bag" if ros1 else "run")
    writer: Any
    if ros1:
        writer = Writer1(path)
        writer.chunk_threshold = 1 << 18  # several chunks in a short bag
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[form.upper()])
        if compression:
            writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        queue: list[tuple[int, int, Any, Any]] = []
        for name, stream in streams.items():
            connection = writer.add_connection(name, stream.kind, typestore=store)
            for index, at_s in enumerate(stream.time_s):
                message = _message(store, stream, index)
                content = (store.serialize_ros1 if ros1 else store.serialize_cdr)(
                    message, stream.kind
                )
                queue.append((_ns(at_s + stream.received_late_s), len(queue), connection, content))
        for received_ns, _, connection, content in sorted(queue, key=lambda one: one[:2]):
            writer.write(connection, received_ns, content)
    return path


def _ns(time_s: float) -> int:
    return START_S * 10**9 + round(float(time_s) * 1e9)


def _message(store: Typestore, stream: Stream, index: int) -> Any:
    message = _blank(store, stream.kind)
    if stream.stamped:
        seconds, nanoseconds = divmod(_ns(stream.time_s[index] + stream.clock_s), 10**9)
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
    for path, values in stream.values.items():
        target = message
        *steps, last = path.split(".")
        for step in steps:
            target = target[int(step)] if step.isdigit() else getattr(target, step)
        per_message = isinstance(values, np.ndarray) and len(values) == len(stream.time_s)
        value = values[index] if per_message else values
        setattr(target, last, value if not isinstance(value, np.floating) else float(value))
    return message


def _blank(store: Typestore, kind: str) -> Any:
    """A message with every field at zero."""
    fields: dict[str, Any] = {}
    description: Any
    for name, description in store.fielddefs[kind][1]:
        node, what = description
        if node == Nodetype.NAME:
            fields[name] = _blank(store, what)
        elif node == Nodetype.BASE:
            fields[name] = {"string": "", "bool": False}.get(what[0], 0)
        else:
            (inner, sort), count = what
            count = count if node == Nodetype.ARRAY else 0
            if inner == Nodetype.NAME:
                fields[name] = [_blank(store, sort) for _ in range(count)]
            else:
                fields[name] = (
                    [] if sort[0] == "string" else np.zeros(count, dtype=np.dtype(sort[0]))
                )
    return store.types[kind](**fields)
