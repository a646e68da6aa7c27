"""From a bag to a table of channels: which topic gives what, on one clock, with notes on what was decided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from homeward.diagnosis.read.bags import clock, grade
from homeward.diagnosis.read.bags.container import Bag
from homeward.diagnosis.read.bags.samples import Array, Samples, read_samples, times_s
from homeward.diagnosis.read.bags.topics import (
    ACCELERATION,
    BATTERY,
    IMU,
    ORIENTATION,
    Topic,
    Topics,
    best_topics,
    load_topics,
)
from homeward.diagnosis.read.channels import CHANNELS, MOTION, POWER
from homeward.diagnosis.read.columns import RecordingError

_MOVES_MPS = 0.05
_LEVEL_M = 0.05
_NEEDED = {name for sets in (MOTION, POWER) for names in sets for name in names}
_ELECTRIC = {name for names in POWER for name in names}


@dataclass(frozen=True)
class Series:
    """One channel at its own rate; arrays of shape (n,), time increasing, no value missing."""

    topic: str
    kind: str
    time_s: Array
    values: Array


def read_bag(path: Path, mapping: str | Path | Topics | None = None) -> tuple[pd.DataFrame, list[str]]:
    """Read a bag as a table of the schema's channels.

    Args:
        path: A .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.
        mapping: Topic mapping, see `load_topics`; by default the one that ships and covers most of the bag.

    Returns:
        The table, with the time in s from its start, and notes: one line each.

    Raises:
        RecordingError: Nothing can be read, power or motion is missing, or the mapping is wrong.
    """
    with Bag(path) as bag:
        topics = best_topics(bag.connections) if mapping is None else load_topics(mapping)
        return _Reading(bag, topics).table()


class _Reading:
    """One bag while it is read: its samples by topic, their times, and notes."""

    def __init__(self, bag: Bag, topics: Topics) -> None:
        self.bag, self.topics = bag, topics
        self.samples: dict[str, Samples] = {}
        self.times: dict[str, Array] = {}
        self.notes: list[str] = []
        self.unread: list[str] = []  # topics that give nothing, and why
        self.void: dict[str, list[str]] = {}  # channels that a topic should have, but gives as nothing
        self.candidates = {
            name: topics.candidates(name, bag.connections) for name in (*CHANNELS, ORIENTATION, ACCELERATION)
        }
        self._load()

    def table(self) -> tuple[pd.DataFrame, list[str]]:
        series = {name: one for name in CHANNELS if (one := self._channel(name)) is not None}
        motion, power = (self._set(series, what, sets) for what, sets in (("motion", MOTION), ("power", POWER)))
        speed = _speed(series)
        series = self._with_signs(series, speed)
        if "grade_rad" not in series:
            series |= self._grade(speed)
        if "elevation_m" in series and np.ptp(series["elevation_m"].values) < _LEVEL_M:
            del series["elevation_m"]  # odometry in the plane
        if "heading_rad" not in series:
            series |= self._heading()
        ticks = clock.slower(*(series[name].time_s for name in (*motion, *power)))
        if len(ticks) < 2:
            raise RecordingError(
                f"{self.bag.path}: power ({series[power[0]].topic}) and motion ({series[motion[0]].topic}) were not "
                'recorded at the same time; check the clocks, or set stamp = "receive" in a topic mapping'
            )
        columns = {name: clock.on_clock(one.time_s, one.values, ticks) for name, one in series.items()}
        self._leave_out_impossible(columns)
        self._say(series, motion, power)
        return pd.DataFrame({"time_s": ticks - ticks[0], **columns}), [*self.bag.notes, *self.notes]

    def _load(self) -> None:
        """Read every topic that may be needed, in one pass."""
        wanted: dict[str, list[str]] = {}
        for options in self.candidates.values():
            for topic, connection in options:
                paths = wanted.setdefault(connection.topic, [])
                paths += [path for path in topic.paths() if path not in paths]
        for name, read in read_samples(self.bag, wanted).items():
            if isinstance(read, str):
                self.unread.append(read)
            else:
                self.samples[name] = read
        if not self.samples:
            raise self._missing("motion and no power")
        receipt = [c.topic for options in self.candidates.values() for topic, c in options if topic.on_receipt]
        self.times, notes = times_s(self.samples, receipt)
        self.notes += notes

    def _channel(self, name: str) -> Series | None:
        """The first topic of the mapping that has something to say on a channel."""
        for topic, connection in self.candidates[name]:
            samples = self.samples.get(connection.topic)
            if samples is None:
                continue
            values = samples.channel(topic.sources[name])
            time_s, values = clock.in_order(self.times[connection.topic], values)
            if len(values) < 2 or (name in _ELECTRIC and not values.any()):
                if name in _NEEDED:
                    self.void.setdefault(connection.topic, []).append(name)
                continue
            return Series(connection.topic, connection.msgtype, time_s, values)
        return None

    def _set(self, series: dict[str, Series], what: str, sets: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
        """The channels that say how the robot moved, or what it drew."""
        for names in sets:
            if set(names) <= series.keys():
                return names
        raise self._missing(what)

    def _missing(self, what: str) -> RecordingError:
        topics = {connection.topic: connection.msgtype for connection in self.bag.connections}
        shown = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items())[:12])
        because = "".join(f"; {reason}" for reason in (*self._why(), *self.bag.notes))
        return RecordingError(
            f"{self.bag.path}: has no {what} by the topic mapping {self.topics.name}{because}; its topics: {shown}"
            f"{', ...' if len(topics) > 12 else ''}; name them in a mapping file (--columns)"
        )

    def _with_signs(self, series: dict[str, Series], speed: Series) -> dict[str, Series]:
        """Make the battery's current positive when discharging, whatever its driver thinks.

        `sensor_msgs/BatteryState` says "Negative when discharging", and mappings turn that round; some drivers publish
        it positive. A robot that drives does not charge, so the median while it drives gives the sign away.
        """
        current = series.get("current_a")
        if current is None or current.kind != BATTERY:
            return series
        moves = np.abs(np.interp(current.time_s, speed.time_s, speed.values)) > _MOVES_MPS
        while_driving = current.values[moves] if moves.any() else current.values
        if np.median(while_driving) >= 0.0:
            return series
        self.notes.append(
            f"{current.topic} gives the current positive when discharging, against the definition of BatteryState; "
            "it is taken as discharge"
        )
        return series | {"current_a": Series(current.topic, current.kind, current.time_s, -current.values)}

    def _grade(self, speed: Series) -> dict[str, Series]:
        """The grade by the first method of `homeward.diagnosis.read.bags.grade` that the bag allows."""
        orientations = self.candidates[ORIENTATION]
        ways = [
            *((ORIENTATION, one) for one in orientations if one[1].msgtype == IMU),
            *((ACCELERATION, one) for one in self.candidates[ACCELERATION]),
            *((ORIENTATION, one) for one in orientations if one[1].msgtype != IMU),
        ]
        for method, (topic, connection) in ways:
            found = self._grade_by(method, topic, connection.topic, speed)
            if found is not None:
                self.notes.append(f"grade from the {method} of {connection.topic}; a tilted mount would add a constant")
                return {"grade_rad": Series(connection.topic, connection.msgtype, *clock.in_order(*found))}
        return {}

    def _heading(self) -> dict[str, Series]:
        """The heading by odometry, else by an IMU."""
        for topic, connection in sorted(self.candidates[ORIENTATION], key=lambda one: one[1].msgtype == IMU):
            if connection.topic in self.samples:
                time_s, quaternion = self._quaternion(topic, connection.topic)
                found = grade.heading(quaternion)
                if found is not None:
                    return {"heading_rad": Series(connection.topic, connection.msgtype, *clock.in_order(time_s, found))}
        return {}

    def _quaternion(self, topic: Topic, name: str) -> tuple[Array, Array]:
        """Times and orientation x, y, z, w of a topic, in the order of time."""
        order = np.argsort(self.times[name], kind="stable")
        values, path = self.samples[name].values, topic.vectors[ORIENTATION]
        return self.times[name][order], np.stack([values[f"{path}.{axis}"][order] for axis in "xyzw"])

    def _grade_by(self, method: str, topic: Topic, name: str, speed: Series) -> tuple[Array, Array] | None:
        samples = self.samples.get(name)
        if samples is None:
            return None
        path = topic.vectors[method]
        if np.any(samples.values.get(f"{path}_covariance[0]", np.zeros(1)) == -1.0):
            return None
        if method == ORIENTATION:
            time_s, quaternion = self._quaternion(topic, name)
            found = grade.from_orientation(time_s, quaternion)
        else:
            time_s, forward = clock.in_order(self.times[name], samples.values[f"{path}.x"])
            found = grade.from_acceleration(time_s, forward, speed.time_s, speed.values)
        return None if found is None else (time_s, found)

    def _leave_out_impossible(self, columns: dict[str, Array]) -> None:
        """A channel that is not needed does not spoil a recording: out of its limits it is left out."""
        soc = columns.get("soc", np.empty(0))
        if 1.05 < np.max(soc, initial=0.0, where=np.isfinite(soc)) <= 105.0:
            columns["soc"] = soc / 100.0
            self.notes.append("the state of charge is in per cent, and divided by 100")
        for name in sorted(set(columns) - _NEEDED):
            channel = CHANNELS[name]
            with np.errstate(invalid="ignore"):
                wrong = (columns[name] < channel.low) | (columns[name] > channel.high)
            if wrong.any() or np.isnan(columns[name]).all():
                del columns[name]
                self.notes.append(f"{name} is left out: missing, or outside {channel.low:g} to {channel.high:g}")

    def _say(self, series: dict[str, Series], motion: tuple[str, ...], power: tuple[str, ...]) -> None:
        sources = {what: sorted({series[name].topic for name in names}) for what, names in
                   (("power", power), ("motion", motion))}  # fmt: skip
        said = ", ".join(f"{what} from {' and '.join(names)}" for what, names in sources.items())
        self.notes.insert(0, f"topic mapping {self.topics.name}: {said}, on the clock of the slower")
        self.notes += self._why()

    def _why(self) -> list[str]:
        """Why topics that the mapping names gave nothing."""
        empty = (f"{topic} gives {' and '.join(names)} as 0 or not at all" for topic, names in self.void.items())
        return [*self.unread, *empty]


def _speed(series: dict[str, Series]) -> Series:
    if "speed_mps" in series:
        return series["speed_mps"]
    left, right = series["wheel_left_mps"], series["wheel_right_mps"]
    other = np.interp(left.time_s, right.time_s, right.values)
    return Series(left.topic, left.kind, left.time_s, 0.5 * (left.values + other))
