"""From messages of a network to readings for the companion, by the topic mappings for bags.

A bag's reader knows the whole drive; here decisions are made as messages arrive. For each channel
the most preferred topic that has had values is used. The sign of a battery's current is its
direction while the robot drives. Messages within a short time are combined: means of measurements,
the last position.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

from homeward import quantities
from homeward.companion import thresholds as companion_thresholds
from homeward.logs import RecordingError
from homeward.logs import thresholds as logs_thresholds
from homeward.logs.bags import grade
from homeward.logs.bags.batteries import OF_BATTERY
from homeward.logs.bags.elements import Element, elements_reader
from homeward.logs.bags.messages import WrongField
from homeward.logs.bags.topics import (
    ACCELERATION,
    BATTERY,
    IMU,
    ORIENTATION,
    PART,
    Topic,
    Topics,
    best_topics,
)
from homeward.logs.channels import CHANNELS, POWER
from homeward.watch import thresholds
from homeward.watch.online.batteries import Batteries
from homeward.watch.online.charge import Charge
from homeward.watch.online.odometry import Odometry
from homeward.watch.online.spikes import Spikes
from homeward.watch.online.stamps import Stamps
from homeward.watch.online.values import (
    POSE,
    Value,
    acceleration,
    east_m,
    field_value,
    heading,
    heading_of,
    slope,
)

ODOMETRY = "nav_msgs/msg/Odometry"

_MOTION = "speed_mps", "wheel_left_mps"
"""Channels of which the first that is received gives the clock."""
_SETTLES_S = 2.0
"""Time from the first motion in which topics are discovered but not yet used. Chosen: slow topics
then have come."""
_MOST = 1000
"""Values of a channel that are kept until there is motion. Chosen: bounds memory."""
_ELECTRIC = {name for names in POWER for name in names}
_PER_CENT = 100.0
_LAST = {"heading", "heading_rad", "soc"}
"""Channels of which the last value is used, not the mean: directions have none."""
_VOID = _ELECTRIC | {"grade", "heading"}
"""Channels that count as missing as long as they are zero: drivers leave unmeasured fields so."""


class NetworkTopic(NamedTuple):
    """A topic of the network."""

    topic: str
    msgtype: str
    msgcount: int = 1


class _Option(NamedTuple):
    """One way to obtain a channel."""

    topic: Topic
    offer: NetworkTopic
    value: Value


class Heard(NamedTuple):
    """Readings combined over a short time.

    Attributes:
        time_s: Time, s.
        reading: Keyword arguments of `Companion.update`.
        charged: State of charge to which the battery was charged or swapped, None if it was not.
        by_charger: Whether that was a charge: since the robot drove last, a current flowed into the
            battery.
        values: Channels as received.
    """

    time_s: float
    reading: dict[str, Any]
    charged: float | None = None
    by_charger: bool = False
    values: Mapping[str, float] = MappingProxyType({})


def _key(topic: Topic) -> tuple[str, str]:
    return topic.pattern, topic.kind


def _stamp_s(message: Any) -> float | None:
    """Time in the header of a message, s; None where it is missing or empty."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    time_s = int(stamp.sec) + 1e-9 * int(stamp.nanosec)
    return time_s if time_s > 0.0 else None


def _combined(channel: str, values: Sequence[float]) -> float:
    """The value of a channel over a short time: the mean, or the last of those that have none."""
    return values[-1] if channel in _LAST else sum(values) / len(values)


def _speed_mps(values: Mapping[str, float]) -> float:
    """Speed as received, or the mean of both wheels'; NaN where neither is there."""
    if "speed_mps" in values:
        return values["speed_mps"]
    return 0.5 * (values.get("wheel_left_mps", math.nan) + values.get("wheel_right_mps", math.nan))


class Listener:
    """Collects messages, and combines them to readings.

    Args:
        mapping: Fields of topics for each channel; by default the shipped mapping that covers most.
        max_speed_mps: Top speed of the robot, m/s.

    Attributes:
        wanted: Discovered topics that the mapping names, with the types of their messages.
        fields: Paths of the fields that are read of each.
        sources: Topic of each channel.
        mapping_name: Name of the mapping.
        odometry: The frame of the positions.
    """

    SAVED: ClassVar = (
        "odometry", "_charge", "_per_cent", "_as_charging", "_as_discharging", "_voltage_v", "_turned_rad",
        "_on_charger",
    )  # fmt: skip

    def __init__(self, mapping: Topics | None, max_speed_mps: float) -> None:
        self._mapping = mapping
        self.wanted: dict[str, str] = {}
        self.fields: dict[str, list[str]] = {}
        self.sources: dict[str, str] = {}
        self.mapping_name = "" if mapping is None else mapping.name
        self.odometry = Odometry(max_speed_mps)
        self._options: dict[str, dict[str, list[_Option]]] = {}  # by topic and channel
        self._chosen: dict[str, tuple[Topic, NetworkTopic]] = {}
        self._readers: dict[str, Callable[[Any, str], list[Element]]] = {}
        self._spikes = Spikes(max_speed_mps)
        self._values: dict[str, deque[float]] = {}
        self._place: tuple[float, float, float] | None = None
        self.stamps = Stamps()
        self._stamp: tuple[float | None, float] | None = None
        self._first_motion_s: float | None = None
        self._said: dict[str, tuple[str, float]] = {}  # by kind: what, and when
        # of each topic: when it last came, and how often it does
        self._at: dict[str, tuple[float, float]] = {}
        self._charge = Charge()
        self._batteries: dict[tuple[str, str], Batteries] = {}  # by the entry of the mapping
        self._voltage_v = math.nan
        self._per_cent = False
        # Readings of the current while driving, by their sign.
        self._as_charging = 0
        self._as_discharging = 0
        self._turned_rad: float | None = None
        self._on_charger = False
        self._past: deque[tuple[float, float, float]] = deque()  # time, acceleration, speed

    def offer(self, topics: Mapping[str, str]) -> None:
        """Choose among the topics of the network.

        Args:
            topics: Types of their messages by their names.
        """
        offered = [NetworkTopic(*item) for item in sorted(topics.items())]
        mapping = best_topics(offered) if self._mapping is None else self._mapping
        self.mapping_name = mapping.name

        def options(channel: str, value: Callable[[Topic], Value]) -> list[_Option]:
            return [
                _Option(topic, offer, value(topic))
                for topic, offer in mapping.candidates(channel, offered)
            ]

        by_channel = {
            channel: options(channel, partial(field_value, name=channel)) for channel in CHANNELS
        }
        # A slope is preferred from an IMU, a heading from odometry.
        by_channel["grade"] = sorted(
            options(ORIENTATION, slope), key=lambda option: option.offer.msgtype != IMU
        )
        by_channel["heading"] = sorted(
            options(ORIENTATION, heading), key=lambda option: option.offer.msgtype == IMU
        )
        by_channel[ACCELERATION] = options(ACCELERATION, acceleration)
        of_odometry = [
            option for option in by_channel["speed_mps"] if option.offer.msgtype == ODOMETRY
        ]
        by_channel["pose"] = [option._replace(value=east_m) for option in of_odometry]
        self._options = {}
        paths_of: dict[str, dict[str, None]] = {}  # paths in order, each once, by topic
        for channel, of_channel in by_channel.items():
            for option in of_channel:
                name = option.offer.topic
                paths = paths_of.setdefault(name, {})
                paths.update(dict.fromkeys(option.topic.paths()))
                if option.offer.msgtype == ODOMETRY:
                    paths.update(dict.fromkeys(POSE))
                self._options.setdefault(name, {})[channel] = of_channel
        self._readers = {name: elements_reader(paths) for name, paths in paths_of.items()}
        self.wanted = {
            offer.topic: offer.msgtype for offer in offered if offer.topic in self._readers
        }
        self.fields = {name: list(paths) for name, paths in paths_of.items()}

    def hear(self, name: str, message: Any, publisher: int, now_s: float) -> None:
        """Process a message.

        Args:
            name: Name of its topic.
            message: An object with the fields of its type.
            publisher: Identity of its publisher.
            now_s: Time of receipt by a monotonic clock, s.

        Raises:
            RecordingError: It lacks a field that the mapping names.
        """
        try:
            elements = self._readers[name](message, self.wanted[name])
        except WrongField as error:
            raise RecordingError(f"{name} ({self.wanted[name]}): {error}") from None
        self._heard(name, now_s)
        channels: set[str] = set()  # that have a value in the message
        values: dict[str, float] = {}
        for part, values in elements:
            channels |= self._hear_channels(name, part, values, now_s)
        if "pose" in channels:
            self._hear_pose(name, values, publisher, now_s)
        motion = next((channel for channel in _MOTION if channel in self._chosen), None)
        if motion in channels:
            if self._first_motion_s is None:
                self._first_motion_s = now_s
            topic, _ = self._chosen[motion]
            stamp_s = None if topic.on_receipt else _stamp_s(message)
            self._stamp = stamp_s, now_s

    def _hear_pose(self, name: str, values: dict[str, float], publisher: int, now_s: float) -> None:
        """Keep the position that a message gives, in the frame of the first one."""
        topic, _ = self._chosen["pose"]
        yaw_rad = heading_of(values, topic)
        if math.isnan(yaw_rad):
            yaw_rad = 0.0
        x_m, y_m = (values[path] for path in POSE[:2])
        pose = x_m, y_m, yaw_rad
        if not math.hypot(x_m, y_m) <= companion_thresholds.EARTH_M:
            self._place = pose  # as it is, so that the companion says it; no frame is moved for it
            return
        speed_mps = self._values["speed_mps"][-1] if "speed_mps" in self._values else math.nan
        self._place, moved = self.odometry.place(pose, speed_mps, publisher, now_s)
        if moved:
            self.say(
                f"{name} was restarted elsewhere: the way continues from where the robot was", now_s
            )

    def _hear_channels(
        self, name: str, part: str, values: dict[str, float], now_s: float
    ) -> set[str]:
        """Keep the values of the channels that a message gives, or one battery of it; their
        names."""
        battery = self._battery_of(name, part, values)
        channels = set()
        for channel, options in self._options[name].items():
            option = self._preferred(channel, options, name, values, battery)
            if option is None:
                continue
            value = self._value(option, channel, values, battery)
            if not math.isfinite(value):
                continue
            if self._spikes.see(channel, value, now_s):
                count = self._spikes.counts[channel]
                kind = f"readings of {channel} that no motion explains are left out"
                self.say(f"{kind}: {count} (the last {value:.4g})", now_s, kind)
                continue
            self._values.setdefault(channel, deque(maxlen=_MOST)).append(value)
            channels.add(channel)
        return channels

    def take(self, now_s: float) -> Heard | None:
        """Readings since the last call; None without motion.

        Args:
            now_s: Time by the clock of `hear`, s.
        """
        if self._stamp is None or self._first_motion_s is None:
            return None
        before_s = self.stamps.time_s
        time_s = self.stamps.see(*self._stamp)
        self._stamp = None
        if self.stamps.said:
            self.say(self.stamps.said, now_s)
        if time_s is None:
            return None
        if now_s - self._first_motion_s < _SETTLES_S:
            self._values = {}
            self._place = None
            return None
        self._choose_batteries(now_s)
        return self._heard_by(time_s, time_s - before_s, now_s)

    def _choose_batteries(self, now_s: float) -> None:
        """Choose among several batteries; a channel of one that is not used is chosen anew."""
        for batteries in self._batteries.values():
            why = batteries.choose()
            if why is not None:
                self.say(why, now_s)
                for channel in OF_BATTERY:
                    self._chosen.pop(channel, None)
                    self._values.pop(channel, None)

    def silence(self, now_s: float) -> Heard:
        """Readings since the last call without motion: the passed time, and whatever else there
        is."""
        return self._heard_by(self.stamps.without(now_s), 0.0, now_s)

    def warnings(self, now_s: float) -> list[str]:
        """Present warnings about messages, a line each."""
        for name, (at_s, usual_s) in self._at.items():
            allowed_s = max(thresholds.SILENT_INTERVALS * usual_s, thresholds.SHORTEST_SILENCE_S)
            if name in self.sources.values() and now_s - at_s > allowed_s:
                self.say(
                    f"nothing on {name} for {quantities.duration(now_s - at_s)}",
                    now_s,
                    f"nothing on {name}",
                )
        for kind, (_, said_s) in list(self._said.items()):
            if now_s - said_s > companion_thresholds.STAYS_S:
                del self._said[kind]
        return [text for text, _ in self._said.values()]

    def _battery_of(self, name: str, part: str, values: dict[str, float]) -> str:
        """Name of the battery that values are of, whose readings are kept for the choice among
        several."""
        battery = f"{name}{PART}{part}" if part else name
        # an entry of the mapping, and its readings
        of_entries: dict[int, tuple[Topic, dict[str, float]]] = {}
        for channel in OF_BATTERY & self._options[name].keys():
            for option in self._options[name][channel]:
                if option.offer.topic == name and option.topic.takes(battery):
                    _, readings = of_entries.setdefault(id(option.topic), (option.topic, {}))
                    readings[channel] = option.value(values)
        for topic, readings in of_entries.values():
            if math.isnan(readings.get("voltage_v", 0.0)):  # its driver knows nothing yet
                for channel in OF_BATTERY & topic.sources.keys():
                    for path, _ in topic.sources[channel].terms:
                        values[path] = math.nan
                continue
            self._batteries.setdefault(_key(topic), Batteries(topic)).hear(battery, readings)
        return battery

    def _value(
        self, option: _Option, channel: str, values: dict[str, float], battery: str
    ) -> float:
        value = option.value(values)
        if channel not in OF_BATTERY or _key(option.topic) not in self._batteries:
            return value
        return self._batteries[_key(option.topic)].value(battery, channel, value)

    def _preferred(
        self,
        channel: str,
        options: list[_Option],
        name: str,
        values: dict[str, float],
        battery: str,
    ) -> _Option | None:
        """The option used for a channel, if it is of this topic: the first that has had values."""
        for option in options:
            if (option.topic, option.offer) == self._chosen.get(channel):
                return option if option.offer.topic == name else None
            if option.offer.topic == name:
                value = self._value(option, channel, values, battery)
                is_measured = channel not in _VOID or abs(value) > logs_thresholds.PLANAR
                if math.isfinite(value) and is_measured:
                    self._chosen[channel] = option.topic, option.offer
                    self.sources[channel] = name
                    return option
        return None

    def _heard_by(self, time_s: float, dt_s: float, now_s: float) -> Heard:
        """The readings so far, combined; from here on they are collected anew."""
        values = {name: _combined(name, heard) for name, heard in self._values.items()}
        self._values = {}
        place = self._place
        self._place = None
        speed_mps = _speed_mps(values)
        if abs(speed_mps) > logs_thresholds.STANDSTILL_MPS:
            self._on_charger = False
        reading: dict[str, Any] = {"speed_mps": speed_mps, "sensing_hz": values.get("sensing_hz")}
        reading |= self._power(values, speed_mps, now_s)
        if "soc" in values:
            reading["soc"] = self._soc(values["soc"])
        slope_rad = values.get("grade_rad", values.get("grade", math.nan))
        if math.isnan(slope_rad):
            slope_rad = self._slope_felt(time_s, values.get(ACCELERATION, math.nan), speed_mps)
        reading["grade_rad"] = -slope_rad if speed_mps < 0.0 else slope_rad
        if place is not None:
            reading["position"] = place[:2]
        reading["heading_rad"] = self._heading(values, place, dt_s)
        charged_to = self._charged_to(reading.get("soc", math.nan), now_s)
        return Heard(time_s, reading, charged_to, self._on_charger, values)

    def _soc(self, value: float) -> float:
        """State of charge as a share; once a value was in per cent, all are."""
        highest = CHANNELS["soc"].high
        if highest < value <= _PER_CENT * highest:
            self._per_cent = True
        return value / _PER_CENT if self._per_cent else value

    def _charged_to(self, soc: float, now_s: float) -> float | None:
        """State of charge to which the battery was charged or swapped since the last one; None if
        it was not."""
        # The companion says which states of charge are impossible; they show no charge either.
        is_possible = abs(soc - 0.5) <= 0.5 + companion_thresholds.SOC_SLACK
        if not is_possible or not self._charge.see(soc):
            return None
        what = "charged" if self._on_charger else "charged or swapped"
        self.say(f"the battery was {what}: {soc:.0%}", now_s, "the battery was charged")
        return soc

    def _heading(
        self, values: dict[str, float], place: tuple[float, float, float] | None, dt_s: float
    ) -> float:
        """The heading by odometry, else as recorded or by an IMU, else by turning rates from
        east."""
        if place is not None and self._chosen.get("heading") == self._chosen["pose"]:
            return place[2]
        for name in ("heading_rad", "heading"):
            if name in values:
                return values[name]
        has_direction = not {"heading_rad", "heading", "pose"}.isdisjoint(self._chosen)
        if place is None and "yaw_rate_radps" in values and not has_direction:
            turned_rad = (self._turned_rad or 0.0) + values["yaw_rate_radps"] * dt_s
            if math.isfinite(turned_rad):
                self._turned_rad = math.remainder(turned_rad, math.tau)
            return self._turned_rad or 0.0
        return math.nan

    def _power(self, values: dict[str, float], speed_mps: float, now_s: float) -> dict[str, float]:
        """Power, or voltage and current with the sign of a discharge; {} while the battery is
        charged."""
        if "power_w" in values:
            return {"power_w": values["power_w"]}
        self._voltage_v = values.get("voltage_v", self._voltage_v)
        if "current_a" not in values:
            return {}
        current_a = values["current_a"]
        moves = abs(speed_mps) > logs_thresholds.STANDSTILL_MPS
        _, source = self._chosen["current_a"]
        if source.msgtype == BATTERY:
            if moves and current_a < 0.0:
                self._as_charging += 1
            if moves and current_a > 0.0:
                self._as_discharging += 1
            readings = self._as_charging + self._as_discharging
            if self._as_charging > self._as_discharging and readings >= thresholds.FEWEST_SIGNS:
                current_a = -current_a
                self.say(
                    f"{self.sources['current_a']} gives the current positive when discharging, against the definition "
                    "of BatteryState; it is used as discharge", now_s,
                )  # fmt: skip
        if current_a < 0.0 and not moves:
            self._on_charger = True
            return {}  # charging, which does not show the robot's consumption
        return {"voltage_v": self._voltage_v, "current_a": current_a}

    def _slope_felt(self, time_s: float, forward_mps2: float, speed_mps: float) -> float:
        """Slope by an accelerometer less the robot's own acceleration, NaN until both were received
        for a while."""
        if not math.isfinite(forward_mps2 + speed_mps):
            return math.nan
        self._past.append((time_s, forward_mps2, speed_mps))
        while time_s - self._past[0][0] > grade.ACCELERATION_S:
            self._past.popleft()
        start_s, _, start_mps = self._past[0]
        passed_s = time_s - start_s
        if passed_s < thresholds.LEAST_OF_WINDOW * grade.ACCELERATION_S:
            return math.nan
        own_mps2 = (speed_mps - start_mps) / passed_s
        mean_mps2 = sum(mps2 for _, mps2, _ in self._past) / len(self._past)
        sine = (mean_mps2 - own_mps2) / grade.GRAVITY_MPS2
        return math.asin(min(max(sine, -1.0), 1.0))

    def _heard(self, name: str, now_s: float) -> None:
        if name not in self._at:
            self._at[name] = now_s, math.inf  # it may arrive only once
            return
        last_s, usual_s = self._at[name]
        since_s = now_s - last_s
        if usual_s == math.inf:
            self._at[name] = now_s, since_s
            return
        # Moved towards the new interval; one gap does not become typical at once.
        weight = companion_thresholds.NEW_INTERVAL
        longest_s = companion_thresholds.LONGEST_INTERVAL * usual_s + thresholds.SHORTEST_INTERVAL_S
        interval_s = min(since_s, longest_s)
        self._at[name] = now_s, (1.0 - weight) * usual_s + weight * interval_s

    def say(self, text: str, now_s: float, kind: str | None = None) -> None:
        """Warn for a while; a warning replaces one of the same kind."""
        self._said[kind or text] = text, now_s
