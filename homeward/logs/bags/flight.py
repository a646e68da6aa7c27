"""Logs of autopilots as topics: ULog of PX4, read by `pyulog`, and DataFlash of ArduPilot, read by
`pymavlink`.

A topic is a message by its name, such as `battery_status` or `BAT`; of several instances the first,
but for batteries, which are topics of their own, such as `BAT@1` (`homeward.logs.bags.batteries`).
Beside the fields that a message has are those that follow from them (`_DERIVED`), in the axes of
REP 103 as in bags: x forward, y left, z up. Autopilots have y to the right and z down (PX4, "Frame
of reference"; ArduPilot, ATT of the log messages).
"""

from __future__ import annotations

import contextlib
import io
import mmap
import os
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from homeward.files import open_regular
from homeward.installed import advice
from homeward.logs import limits
from homeward.logs.bags.samples import Samples
from homeward.logs.bags.topics import PART, without_part
from homeward.logs.channels import Array
from homeward.logs.columns import RecordingError

Fields = dict[str, Array]
"""Numbers of one message by field, shape (n,) each."""

_BATTERIES = "battery_status", "BAT"
# of a battery's current and state of charge in PX4: "-1 if unknown" (msg/BatteryStatus.msg)
_UNKNOWN = -1.0
# GPS of both autopilots: below it there is no position (msg/SensorGps.msg, AP_GPS::GPS_Status)
_FIX_2D = 2
# which a damaged time exceeds: 285 years after the start, exact in double precision
_LATEST_US = 2**53


@dataclass(frozen=True)
class FlightTopic:
    """A message of a log, with the attributes of a topic."""

    topic: str
    msgcount: int

    @property
    def msgtype(self) -> str:
        """Its name: autopilots have one message of each type."""
        return self.topic


class FlightLog(contextlib.ExitStack):
    """A log of an autopilot, open for reading within a `with` block.

    `connections` are its messages; `notes` list what was left out.
    """

    def __init__(self, path: Path) -> None:
        """Open a .ulg or .bin file.

        Raises:
            RecordingError: Nothing in it can be read, or the package that reads it is not
                installed.
        """
        super().__init__()
        self.notes: list[str] = []
        is_ulog = path.suffix.lower() == ".ulg"
        kind = "PX4" if is_ulog else "ArduPilot"
        if path.stat().st_size == 0:
            raise RecordingError("is empty")
        with self._listening(path.name, kind):
            self._log: Any = _ULog(path) if is_ulog else _DataFlash(path)
        self.callback(self._log.close)
        self.connections = [
            FlightTopic(name, count) for name, count in sorted(self._log.counts.items()) if count
        ]
        if not self.connections:
            self.close()
            raise RecordingError(
                "; ".join([f"holds nothing that can be read as messages of {kind}", *self.notes])
            )
        self._about = path.name, kind

    def samples(
        self, wanted: Mapping[str, Collection[str]]
    ) -> tuple[dict[str, Samples], list[str]]:
        """Read fields of some messages, as `homeward.logs.bags.samples.read_samples` does of
        topics.

        Raises:
            RecordingError: A message has no such field.
        """
        samples: dict[str, Samples] = {}
        with self._listening(*self._about):
            read: dict[str, list[Fields]] = self._log.instances(wanted)
        for label, fields in self._topics(read):
            name = without_part(label)
            if name in _DERIVED:
                # a layout that lacks a field: named below if it is wanted
                with contextlib.suppress(KeyError):
                    fields |= _DERIVED[name](fields)
            of_label = _samples_of(name, fields, wanted[name])
            if of_label is not None:
                samples[label] = of_label
        names = {without_part(label) for label in samples}
        unread = [
            f"{name} is left out: none of its messages can be read"
            for name in wanted
            if name not in names
        ]
        return samples, unread

    def _topics(self, instances: Mapping[str, Sequence[Fields]]) -> list[tuple[str, Fields]]:
        """Names and fields of topics: each battery of several, of other messages the first
        instance, with a note."""
        topics = []
        for name, of_message in instances.items():
            if len(of_message) > 1 and name in _BATTERIES:
                topics += [
                    (f"{name}{PART}{number}", fields) for number, fields in enumerate(of_message)
                ]
                continue
            if len(of_message) > 1:
                self.notes.append(
                    f"{name} has {len(of_message)} instances, of which the first is read"
                )
            topics.append((name, of_message[0]))
        return topics

    @contextlib.contextmanager
    def _listening(self, name: str, kind: str) -> Iterator[None]:
        """Turn a reader's printed warnings into a note, and its exceptions into a
        `RecordingError`."""
        said = _FirstLine()
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                yield
        except ModuleNotFoundError as error:
            package = error.name or kind
            needed = f"a log of {kind} needs {package}; install it with {advice('logs', package)}"
            raise RecordingError(needed) from None
        # a damaged log raises anything, from ULogException to struct.error
        except Exception as error:
            why = (str(error).splitlines() or [type(error).__name__])[0][:120]
            raise RecordingError(
                f"is not a whole {kind} log ({why}); copy it from the vehicle again"
            ) from error
        if said.text:
            self.notes.append(f"{name} is damaged ({said.text}): what could be read is used")


def _samples_of(name: str, fields: Fields, paths: Collection[str]) -> Samples | None:
    """Samples of a message at the times that are not damaged; None where there is none.

    Raises:
        RecordingError: The message has no such field.
    """
    for path in paths:
        if path not in fields:
            raise RecordingError(f"{name}: no field {path!r}; it has {', '.join(fields)}")
    time_us = fields["time_us"]
    is_possible = (time_us > 0.0) & (time_us < _LATEST_US)
    if not is_possible.any():
        return None
    stamp_ns = (time_us[is_possible] * 1e3).astype(np.int64)
    return Samples(stamp_ns, stamp_ns, {path: fields[path][is_possible] for path in paths})


class _Finite:
    """A file with a limit on reads, twice its bytes, because `pyulog` may loop for ever in a
    damaged one."""

    def __init__(self, file: Any, size_bytes: int) -> None:
        self._file = file
        self._reads_left = 2 * size_bytes

    def read(self, size: int = -1) -> bytes:
        self._reads_left -= 1
        if self._reads_left < 0:
            raise RuntimeError("its lengths lead back")  # not a ValueError, which pyulog ignores
        data: bytes = self._file.read(size)
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


class _ULog:
    """A log of PX4."""

    def __init__(self, path: Path) -> None:
        from pyulog import ULog

        class WithinLimits(ULog):  # type: ignore[misc]
            """A log whose definitions are checked before pyulog makes a field of each of their
            numbers."""

            def _read_file_definitions(self) -> None:
                super()._read_file_definitions()
                counts: dict[str, int] = {}
                for name in self._message_formats:
                    _refuse_many_fields(name, self._message_formats, counts)

        with open_regular(path) as file:
            log = WithinLimits(_Finite(file, path.stat().st_size))
        if log.file_corruption:
            print("bytes that are no message")
        self._data = log.data_list  # sorted by name and instance
        self.counts = {
            message.name: len(message.data["timestamp"]) for message in reversed(self._data)
        }

    def instances(self, names: Collection[str]) -> dict[str, list[Fields]]:
        instances: dict[str, list[Fields]] = {}
        for message in self._data:
            if message.name in names:
                fields = {
                    name: np.asarray(values, np.float64) for name, values in message.data.items()
                }
                instances.setdefault(message.name, []).append(
                    {"time_us": fields["timestamp"], **fields}
                )
        return instances

    def close(self) -> None: ...


def _refuse_many_fields(name: str, formats: Mapping[str, Any], counts: dict[str, int]) -> int:
    """The number of fields of a message with those of the messages in it.

    Raises:
        RuntimeError: It has more than a message has; not a ValueError, which pyulog ignores.
    """
    if name not in counts:
        fields = formats[name].fields if name in formats else ()
        parts = [
            max(size, 1) * (_refuse_many_fields(kind, formats, counts) or 1)
            for kind, size, _ in fields
        ]
        counts[name] = sum(parts)
    if counts[name] > limits.MOST_ELEMENTS:
        raise RuntimeError(
            f"by its definition {name} has {counts[name]:.3g} fields, which none has"
        )
    return counts[name]


class _DataFlash:
    """A log of ArduPilot."""

    def __init__(self, path: Path) -> None:
        # Its compiled index writes a line for each bad byte past Python's own streams.
        os.environ.setdefault("PYMAVLINK_FAST_INDEX", "0")
        from pymavlink.DFReader import DFReader_binary

        with (
            open_regular(path) as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
        ):
            if _EMPTY_FORMAT.search(content):  # pymavlink would loop for ever
                raise ValueError("the definition of a message is damaged")
        self._log: Any = DFReader_binary.__new__(DFReader_binary)
        # or it reads all of a log without GPS for the time of day
        self._log.init_clock = self._log.init_clock_usec
        try:
            self._log.__init__(str(path), zero_time_base=True)
        except BaseException:
            self._log.filehandle.close()
            raise
        self._numbers: dict[str, int] = self._log.name_to_id
        self.counts = {name: self._log.counts[number] for name, number in self._numbers.items()}

    def instances(self, names: Collection[str]) -> dict[str, list[Fields]]:
        instances = {}
        for name in names:
            if not self.counts.get(name):
                continue
            number = self._numbers[name]
            rows = self._rows(number)
            layout = self._log.formats[number]
            fields = {
                column: rows[column] * (factor or 1.0)
                for column, factor in zip(layout.columns, layout.msg_mults, strict=True)
                if rows[column].dtype.kind != "S"
            }
            clock = next((column for column in _CLOCKS_US if column in fields), None)
            if clock is None or not len(rows):
                continue
            fields["time_us"] = fields[clock] * _CLOCKS_US[clock]
            instance = fields.get(layout.instance_field, np.zeros(len(rows)))
            instances[name] = [
                _of_instance(fields, instance == value) for value in np.unique(instance)
            ]
        return instances

    def _rows(self, number: int) -> NDArray[np.void]:
        """The messages of a kind, shape (n,), from where pymavlink found them: one by one it takes
        0.2 ms for each."""
        layout = self._log.formats[number]
        codes = re.findall(r"\d*[a-zA-Z]", layout.msg_struct)
        row = np.dtype(
            [
                (column, _numpy_kind(code))
                for column, code in zip(layout.columns, codes, strict=True)
            ]
        )
        if row.itemsize + _HEADER_BYTES != layout.len:
            raise ValueError(f"{layout.name} is defined with another length than its fields have")
        content = np.frombuffer(self._log.data_map, np.uint8)
        start = np.array(self._log.offsets[number], np.intp) + _HEADER_BYTES
        start = start[start + row.itemsize <= len(content)]  # the last may be cut off
        rows: NDArray[np.void] = content[start[:, None] + np.arange(row.itemsize)].view(row)[:, 0]
        return rows

    def close(self) -> None:
        self._log.close()


_CLOCKS_US = {"TimeUS": 1.0, "TimeMS": 1e3}
"""Fields of the time since the start, the preferred first, each with its unit in microseconds."""
_HEADER_BYTES = 3  # before the fields of a message: two that are always the same, and its kind
_EMPTY_FORMAT = re.compile(rb"\xa3\x95\x80.[\x00-\x02]", re.DOTALL)
"""A FMT message of a message that is shorter than its own header."""


class _FirstLine(io.TextIOBase):
    """A stream that keeps the first line of what is written to it: damage makes a line for each
    byte."""

    def __init__(self) -> None:
        super().__init__()
        self.text = ""

    def write(self, text: str) -> int:
        self.text = self.text or text.strip()[:120]
        return len(text)


def _numpy_kind(code: str) -> str:
    """A type of numpy, without padding, by a code of `struct` such as "64s" or "f"."""
    return f"S{code[:-1]}" if code.endswith("s") else f"<{code}"


def _of_instance(fields: Fields, rows: NDArray[np.bool_]) -> Fields:
    return {name: values[rows] for name, values in fields.items()}


def _battery(fields: Fields) -> Fields:
    return {
        name: np.where(fields[name] == _UNKNOWN, np.nan, fields[name])
        for name in ("current_a", "remaining")
    }


def _local_position(fields: Fields) -> Fields:
    """Speed along the heading, which is negative in reverse; `heading` is `yaw` in old releases."""
    heading_rad = fields["heading"] if "heading" in fields else fields["yaw"]
    forward = np.cos(heading_rad) * fields["vx"] + np.sin(heading_rad) * fields["vy"]
    return {
        "forward": np.where(fields["v_xy_valid"] != 0.0, forward, np.nan),
        "up": np.where(fields["z_valid"] != 0.0, -fields["z"], np.nan),
    }


def _oriented(w: Array, x: Array, y: Array, z: Array) -> Fields:
    """A rotation from x forward, y right, z down, in those of REP 103."""
    return {"orientation.w": w, "orientation.x": x, "orientation.y": -y, "orientation.z": -z}


def _attitude(fields: Fields) -> Fields:
    return _oriented(*(fields[f"q[{i}]"] for i in range(4)))


def _euler(fields: Fields) -> Fields:
    angles_deg = np.stack([fields["Yaw"], fields["Pitch"], fields["Roll"]], axis=1)
    return _oriented(
        *Rotation.from_euler("ZYX", angles_deg, degrees=True).as_quat(scalar_first=True).T
    )


def _fixed(speed: str, fix: str) -> Callable[[Fields], Fields]:
    return lambda fields: {speed: np.where(fields[fix] >= _FIX_2D, fields[speed], np.nan)}


_DERIVED: Mapping[str, Callable[[Fields], Fields]] = {
    "battery_status": _battery,
    "vehicle_local_position": _local_position,
    "vehicle_attitude": _attitude,
    "vehicle_gps_position": _fixed("vel_m_s", "fix_type"),
    "ATT": _euler,
    "GPS": _fixed("Spd", "Status"),
}
"""Fields that follow from those of a message, or take their place."""
