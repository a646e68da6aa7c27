"""From a bag or flight log to a table of channels: the topic of each channel, on one clock, with
notes on decisions."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from homeward.logs import thresholds
from homeward.logs.bags import batteries, clock, grade, is_flight_log
from homeward.logs.bags.container import Bag
from homeward.logs.bags.flight import FlightLog
from homeward.logs.bags.messages import SCHEMALESS
from homeward.logs.bags.samples import Samples, keep_longest_part, read_samples, times_s
from homeward.logs.bags.topics import (
    ACCELERATION,
    BATTERY,
    IMU,
    ORIENTATION,
    Offer,
    Part,
    Topic,
    Topics,
    best_topics,
    load_topics,
    without_part,
)
from homeward.logs.channels import CHANNELS, MOTION, POWER, Array, first_set
from homeward.logs.columns import RecordingError
from homeward.logs.plausible import leave_out_spikes
from homeward.logs.times import is_epoch
from homeward.logs.unknown import left_out, unknown

_ELECTRIC = {name for names in POWER for name in names}
_NEEDED = {*_ELECTRIC, *(name for names in MOTION for name in names)}

Candidate = tuple[Topic, Offer]
"""An entry of a mapping, and a topic of the bag that it fits."""


@dataclass(frozen=True)
class Series:
    """One channel at its own rate; arrays of shape (n,), time increasing, no value missing."""

    topic: str
    kind: str
    time_s: Array
    values: Array


def read_bag(
    path: Path, mapping: str | Path | None = None
) -> tuple[pd.DataFrame, list[str], float]:
    """Read a log as a table of the schema's channels, with the time in s from its start; notes of
    one line each; and the start, s since 1970, or 0 if the log does not have it.

    Without a mapping (see `load_topics`) the shipped one that covers most of the log is used.

    Raises:
        RecordingError: Nothing can be read, power or motion is missing, or the mapping is invalid.
    """
    with FlightLog(path) if is_flight_log(path) else Bag(path) as bag:
        topics = best_topics(bag.connections) if mapping is None else load_topics(mapping)
        return _Reading(bag, topics).table()


class _Reading:
    """One bag while it is read: its samples by topic, their times, and notes."""

    def __init__(self, bag: Bag | FlightLog, topics: Topics) -> None:
        self.bag = bag
        self.topics = topics
        # channels of a topic that are zero or missing throughout
        self.void: dict[str, list[str]] = {}
        # Batteries that are added, by the name and type of the entry of the mapping.
        self.added: dict[tuple[str, str], tuple[str, ...]] = {}
        offered = {
            name: topics.candidates(name, bag.connections)
            for name in (*CHANNELS, ORIENTATION, ACCELERATION)
        }
        pairs: list[Candidate] = [pair for candidates in offered.values() for pair in candidates]
        self.samples, self.unread = self._read(pairs)  # unread: why topics could not be read
        if not self.samples:
            raise self._missing("motion and no power")
        if isinstance(bag, FlightLog):
            bag.notes += keep_longest_part(self.samples)
        self.candidates: dict[str, list[Candidate]] = {name: [] for name in offered}
        for name, candidates in offered.items():
            for topic, connection in candidates:
                self.candidates[name] += self._read_from(topic, connection)
        on_receipt = {connection.topic for topic, connection in pairs if topic.on_receipt}
        without_header = {
            name for name in self.samples if name in on_receipt or without_part(name) in on_receipt
        }
        self.times, self.start_ns, self.notes = times_s(self.samples, without_header)
        for topic, connection in self.candidates["current_a"]:
            self._leave_out_with_voltage(topic, connection.topic)

    def table(self) -> tuple[pd.DataFrame, list[str], float]:
        """The channels on one clock, notes, and the start, as `read_bag` gives them.

        Raises:
            RecordingError: Power or motion is missing, or they were not recorded at the same time.
        """
        series = self._series()
        motion = first_set(MOTION, series)
        power = first_set(POWER, series)
        if not motion:
            raise self._missing("motion")
        if not power:
            raise self._missing("power")
        self._derive(series)
        ticks = clock.slower(*(series[name].time_s for name in (*motion, *power)))
        if len(ticks) < 2:
            raise RecordingError(
                f"power ({series[power[0]].topic}) and motion ({series[motion[0]].topic}) were not "
                'recorded at the same time; check the clocks, or set stamp = "receive" in a topic mapping'
            )
        columns = {
            name: clock.on_clock(channel.time_s, channel.values, ticks)
            for name, channel in series.items()
        }
        self._leave_out_impossible(columns)
        sources = (
            f"power from {_topics_of(power, series)}, motion from {_topics_of(motion, series)}"
        )
        mapped = f"topic mapping {self.topics.name}: {sources}, on the clock of the slower"
        notes = [*self.bag.notes, mapped, *self.notes, *self._why()]
        start_s = self.start_ns * 1e-9 + float(ticks[0])
        if not is_epoch(start_s):
            start_s = 0.0
        return pd.DataFrame({"time_s": ticks - ticks[0], **columns}), notes, start_s

    def _read(self, pairs: Sequence[Candidate]) -> tuple[dict[str, Samples], list[str]]:
        """Samples of the topics that the mapping names, and why others could not be read."""
        wanted: dict[str, dict[str, None]] = {}  # paths in order, each once, by topic
        kinds = {}
        for topic, connection in pairs:
            wanted.setdefault(connection.topic, {}).update(dict.fromkeys(topic.paths()))
            if topic.kind:
                kinds[connection.topic] = topic.kind
        if isinstance(self.bag, FlightLog):
            return self.bag.samples(wanted)
        return read_samples(self.bag, wanted, kinds)

    def _series(self) -> dict[str, Series]:
        """The channels that topics of the mapping give, each at its own rate."""
        self._choose_batteries()
        series = {}
        for name in CHANNELS:
            channel = self._channel(name)
            if channel is not None:
                series[name] = channel
        return series

    def _derive(self, series: dict[str, Series]) -> None:
        """Give the current its sign, and add what follows from other channels, in place."""
        speed = _speed(series)
        if "current_a" in series:
            series["current_a"] = self._discharge(series["current_a"], speed)
        if "grade_rad" not in series:
            series |= self._grade(speed)
        if "elevation_m" in series and np.ptp(series["elevation_m"].values) < thresholds.LEVEL_M:
            del series["elevation_m"]  # odometry in the plane
        if "heading_rad" not in series:
            series |= self._heading()

    def _read_from(self, topic: Topic, connection: Offer) -> list[Candidate]:
        """A topic that was read, or each of the batteries that it reports."""
        if connection.topic in self.samples:
            return [(topic, connection)]
        parts = (
            name
            for name in self.samples
            if without_part(name) == connection.topic and topic.takes(name)
        )
        return [
            (topic, Part(name, connection.msgtype, len(self.samples[name].received_ns)))
            for name in parts
        ]

    def _choose_batteries(self) -> None:
        """Decide, for each entry of the mapping, between several batteries that report what is
        drawn from them."""
        entries: dict[int, Topic] = {}
        names_of_entry: dict[int, dict[str, None]] = {}  # topics in order, each once
        for channel in ("power_w", "current_a"):
            for topic, connection in self.candidates[channel]:
                entries[id(topic)] = topic
                names_of_entry.setdefault(id(topic), {})[connection.topic] = None
        for entry, topic in entries.items():
            offered = [self._battery(topic, name) for name in names_of_entry[entry]]
            drawing = [battery for battery in offered if battery is not None]
            if len(drawing) < 2:
                continue
            choice = batteries.choose(drawing, topic.several)
            self.notes.append(choice.why)
            if len(choice.names) > 1:
                self.added[topic.pattern, topic.kind] = choice.names
            self._keep_batteries(topic, choice.names)

    def _keep_batteries(self, entry: Topic, names: Collection[str]) -> None:
        """Of the topics of an entry keep those of some names as candidates for the channels of a
        battery."""
        for channel in batteries.OF_BATTERY:
            self.candidates[channel] = [
                (topic, connection)
                for topic, connection in self.candidates[channel]
                if topic is not entry or connection.topic in names
            ]

    def _leave_out_with_voltage(self, topic: Topic, name: str) -> None:
        """Leave out the readings of a battery in messages whose voltage is unknown: its driver has
        none yet."""
        if "voltage_v" not in topic.sources:
            return
        values = self.samples[name].values
        silent = unknown("voltage_v", topic.sources["voltage_v"].apply(values))
        if not silent.any():
            return
        for channel in batteries.OF_BATTERY & topic.sources.keys():
            for path, _ in topic.sources[channel].terms:
                values[path] = np.where(silent, np.nan, values[path])
        self.notes.append(
            f"{int(silent.sum())} of {len(silent)} messages of {name} have an unknown voltage: left out"
        )

    def _battery(self, topic: Topic, name: str) -> batteries.Battery | None:
        """What a battery reports; None if it reports nothing that is drawn."""
        values = self.samples[name].values
        measured = "current_a" if "current_a" in topic.sources else "power_w"
        drawn = topic.sources[measured].apply(values)
        if not np.nan_to_num(drawn).any():
            return None
        voltage_v = np.empty(0)
        if "voltage_v" in topic.sources:
            voltage_v = topic.sources["voltage_v"].apply(values)
        return batteries.Battery(name, voltage_v, drawn)

    def _channel(self, name: str) -> Series | None:
        """The channel from the first topic of the mapping with values of it."""
        for topic, connection in self.candidates[name]:
            if name in batteries.OF_BATTERY and (topic.pattern, topic.kind) in self.added:
                return self._over_packs(name, topic, connection)
            values = np.array(topic.sources[name].apply(self.samples[connection.topic].values))
            notes = [*left_out(name, values), *_stray_left_out(name, values)]
            count = int(np.isfinite(values).sum())
            time_s, values = clock.in_order(self.times[connection.topic], values)
            repeated = count - len(values)
            if repeated > thresholds.STRAY_SHARE * count:
                notes.append(
                    f"{repeated} of {count} values of {name} have the time of another: the first is used"
                )
            # Before they are averaged, which would spread a wrong reading over those beside it.
            notes += leave_out_spikes({"time_s": time_s, name: values})
            time_s, values = clock.in_order(time_s, values)
            is_measured = name not in _ELECTRIC or values.any()
            if len(values) >= 2 and is_measured:
                self.notes += notes
                kind = topic.kind if connection.msgtype == SCHEMALESS else connection.msgtype
                return Series(connection.topic, kind, time_s, values)
            if name in _NEEDED:
                self.void.setdefault(connection.topic, []).append(name)
        return None

    def _over_packs(self, name: str, topic: Topic, connection: Offer) -> Series:
        """A channel of several packs in parallel: what they draw is added, of the rest the mean is
        taken."""
        names = self.added[topic.pattern, topic.kind]
        packs = [
            clock.in_order(self.times[pack], topic.sources[name].apply(self.samples[pack].values))
            for pack in names
        ]
        packs = [(time_s, values) for time_s, values in packs if len(time_s) >= 2]
        ticks = clock.slower(*(time_s for time_s, _ in packs))
        # (packs, ticks)
        by_pack = np.array([clock.on_clock(time_s, values, ticks) for time_s, values in packs])
        over_packs = by_pack.sum(axis=0) if name in batteries.ADDED else by_pack.mean(axis=0)
        return Series(" + ".join(names), connection.msgtype, *clock.in_order(ticks, over_packs))

    def _missing(self, what: str) -> RecordingError:
        topics = {connection.topic: connection.msgtype for connection in self.bag.connections}
        shown = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items())[:12])
        if len(topics) > 12:
            shown += ", ..."
        has_schemaless = SCHEMALESS in topics.values()
        hint = ", with the type of a topic without a schema" if has_schemaless else ""
        because = "".join(f"; {reason}" for reason in (*self._why(), *self.bag.notes))
        return RecordingError(
            f"has no {what} by the topic mapping {self.topics.name}{because}; its topics: {shown}"
            f"; name them in a mapping file (--columns){hint}"
        )

    def _why(self) -> list[str]:
        """Why topics that the mapping names gave no values."""
        empty = (
            f"{topic} gives {' and '.join(names)} as 0 or not at all"
            for topic, names in self.void.items()
        )
        return [*self.unread, *empty]

    def _discharge(self, current: Series, speed: Series) -> Series:
        """Make the battery's current positive when discharging, whatever the sign convention of its
        driver.

        `sensor_msgs/BatteryState` says "Negative when discharging", and mappings change the sign;
        some drivers publish it positive. A robot that drives does not charge, so that the median
        while it drives determines the sign.
        """
        moves = (
            np.abs(np.interp(current.time_s, speed.time_s, speed.values))
            > thresholds.STANDSTILL_MPS
        )
        while_driving = current.values[moves] if moves.any() else current.values
        if current.kind != BATTERY or np.median(while_driving) >= 0.0:
            return current
        self.notes.append(
            f"{current.topic} gives the current positive when discharging, against the definition of BatteryState; "
            "it is taken as discharge"
        )
        return replace(current, values=-current.values)

    def _grade(self, speed: Series) -> dict[str, Series]:
        """The grade by the first method of `homeward.logs.bags.grade` that the bag allows."""
        by_orientation = [
            (ORIENTATION, topic, connection) for topic, connection in self.candidates[ORIENTATION]
        ]
        by_acceleration = [
            (ACCELERATION, topic, connection) for topic, connection in self.candidates[ACCELERATION]
        ]
        of_imu = [option for option in by_orientation if option[2].msgtype == IMU]
        of_odometry = [option for option in by_orientation if option[2].msgtype != IMU]
        for method, topic, connection in (*of_imu, *by_acceleration, *of_odometry):
            name = connection.topic
            path = topic.vectors[method]
            values = self.samples[name].values
            covariance = values.get(f"{path}_covariance[0]", np.zeros(1))
            if (covariance == -1.0).any():  # the driver does not measure it (sensor_msgs/Imu)
                continue
            if method == ORIENTATION:
                time_s, quaternion = self._quaternion(name, path)
                grade_rad = grade.from_orientation(time_s, quaternion)
            else:
                time_s, forward = clock.in_order(self.times[name], values[f"{path}.x"])
                grade_rad = grade.from_acceleration(time_s, forward, speed.time_s, speed.values)
            if grade_rad is not None:
                self.notes.append(
                    f"grade from the {method} of {name}; a tilted mount would add a constant"
                )
                return {
                    "grade_rad": Series(
                        name, connection.msgtype, *clock.in_order(time_s, grade_rad)
                    )
                }
        return {}

    def _heading(self) -> dict[str, Series]:
        """The heading by odometry, else by an IMU."""
        odometry_before_imu = sorted(
            self.candidates[ORIENTATION], key=lambda pair: pair[1].msgtype == IMU
        )
        for topic, connection in odometry_before_imu:
            time_s, quaternion = self._quaternion(connection.topic, topic.vectors[ORIENTATION])
            heading_rad = grade.heading(quaternion)
            if heading_rad is not None:
                samples = clock.in_order(time_s, heading_rad)
                return {"heading_rad": Series(connection.topic, connection.msgtype, *samples)}
        return {}

    def _quaternion(self, name: str, path: str) -> tuple[Array, Array]:
        """Times and orientation x, y, z, w of a topic, in the order of time."""
        order = np.argsort(self.times[name], kind="stable")
        values = self.samples[name].values
        return self.times[name][order], np.stack(
            [values[f"{path}.{axis}"][order] for axis in "xyzw"]
        )

    def _leave_out_impossible(self, columns: dict[str, Array]) -> None:
        """Leave out channels that are not needed and have values out of their limits."""
        soc = columns.get("soc", np.empty(0))
        known_soc = soc[np.isfinite(soc)]
        highest_soc = CHANNELS["soc"].high
        if len(known_soc) and highest_soc < np.median(known_soc) <= 100.0 * highest_soc:
            columns["soc"] = soc / 100.0
            self.notes.append("the state of charge is in per cent, and divided by 100")
        for name in sorted(set(columns) - _NEEDED):
            channel = CHANNELS[name]
            impossible = channel.impossible(columns[name])
            beyond = f"outside {channel.low:g} to {channel.high:g}"
            if impossible.mean() > thresholds.STRAY_SHARE or np.isnan(columns[name]).all():
                del columns[name]
                self.notes.append(f"{name} is left out: missing, or {beyond}")
            elif impossible.any():
                columns[name] = np.where(impossible, np.nan, columns[name])
                self.notes.append(
                    f"{int(impossible.sum())} values of {name} are {beyond} and left out"
                )


def _stray_left_out(name: str, values: Array) -> list[str]:
    """Set few impossible values to NaN, in place, before they are averaged with others; many are
    another unit."""
    channel = CHANNELS[name]
    impossible = channel.impossible(values)
    if not 0.0 < impossible.mean() <= thresholds.STRAY_SHARE:
        return []
    values[impossible] = np.nan
    return [
        f"{int(impossible.sum())} values of {name} are outside {channel.low:g} to {channel.high:g} and left out"
    ]


def _speed(series: dict[str, Series]) -> Series:
    if "speed_mps" in series:
        return series["speed_mps"]
    left_wheels = series["wheel_left_mps"]
    right_wheels = series["wheel_right_mps"]
    right_mps = np.interp(left_wheels.time_s, right_wheels.time_s, right_wheels.values)
    speed_mps = 0.5 * (left_wheels.values + right_mps)
    return replace(left_wheels, values=speed_mps)


def _topics_of(channels: Sequence[str], series: Mapping[str, Series]) -> str:
    """The topics that some channels come from, in words."""
    return " and ".join(sorted({series[name].topic for name in channels}))
