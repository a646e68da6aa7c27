"""From messages of a network to readings for the companion, by the topic mappings for bags.

A bag's reader knows the whole drive; here decisions are made as messages arrive. For each channel the most preferred
topic that has had values is used. The sign of a battery's current is its direction while the robot drives. Messages
within a short time are combined: means of measurements, the last position.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
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
from homeward.watch.online.values import POSE, Value, acceleration, east_m, field_value, heading, heading_of, slope

ODOMETRY = "nav_msgs/msg/Odometry"

_MOTION = "speed_mps", "wheel_left_mps"
"""Channels of which the first that is received gives the clock."""
_SETTLES_S = 2.0
"""Time from the first motion in which topics are discovered but not yet used. Chosen: slow topics then have come."""
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
        by_charger: Whether that was a charge: since the robot drove last, a current flowed into the battery.
        values: Channels as received.
    """

    time_s: float
    reading: dict[str, Any]
    charged: float | None = None
    by_charger: bool = False
    values: Mapping[str, float] = MappingProxyType({})


def _key(topic: Topic) -> tuple[str, str]:
    return topic.pattern, topic.kind


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
        self._at: dict[str, tuple[float, float]] = {}  # of each topic: when it last came, and how often it does
        self._charge = Charge()
        self._batteries: dict[tuple[str, str], Batteries] = {}  # by the entry of the mapping
        self._voltage_v, self._per_cent = math.nan, False
        self._as_charging = self._as_discharging = 0  # readings of the current while driving, by their sign
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
            return [_Option(topic, offer, value(topic)) for topic, offer in mapping.candidates(channel, offered)]

        every = {channel: options(channel, partial(field_value, name=channel)) for channel in CHANNELS}
        slopes, headings = options(ORIENTATION, slope), options(ORIENTATION, heading)
        every["grade"] = sorted(slopes, key=lambda option: option.offer.msgtype != IMU)
        every["heading"] = sorted(headings, key=lambda option: option.offer.msgtype == IMU)
        every[ACCELERATION] = options(ACCELERATION, acceleration)
        every["pose"] = [way._replace(value=east_m) for way in every["speed_mps"] if way.offer.msgtype == ODOMETRY]
        self._options = {}
        paths_of: dict[str, dict[str, None]] = {}  # by topic
        for channel, ways in every.items():
            for way in ways:
                paths = [*way.topic.paths(), *(POSE if way.offer.msgtype == ODOMETRY else ())]
                paths_of.setdefault(way.offer.topic, {}).update(dict.fromkeys(paths))
                self._options.setdefault(way.offer.topic, {})[channel] = ways
        self._readers = {topic: elements_reader(paths) for topic, paths in paths_of.items()}
        self.wanted = {offer.topic: offer.msgtype for offer in offered if offer.topic in self._readers}
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
        spoke, values = set[str](), dict[str, float]()
        for part, values in elements:
            spoke |= self._hear_channels(name, part, values, now_s)
        if "pose" in spoke:
            yaw_rad = heading_of(values, self._chosen["pose"][0])
            speed = self._values["speed_mps"][-1] if "speed_mps" in self._values else math.nan
            pose = values[POSE[0]], values[POSE[1]], 0.0 if math.isnan(yaw_rad) else yaw_rad
            if not math.hypot(*pose[:2]) <= companion_thresholds.EARTH_M:
                self._place = pose  # as it is, so that the companion says it; no frame is moved for it
            else:
                self._place, moved = self.odometry.place(pose, speed, publisher, now_s)
                if moved:
                    self.say(f"{name} was restarted elsewhere: the way continues from where the robot was", now_s)
        motion = next((channel for channel in _MOTION if channel in self._chosen), None)
        if motion in spoke:
            self._first_motion_s = now_s if self._first_motion_s is None else self._first_motion_s
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            stamp_s = 0.0 if stamp is None else int(stamp.sec) + 1e-9 * int(stamp.nanosec)
            on_receipt = self._chosen[motion][0].on_receipt or stamp_s <= 0.0
            self._stamp = None if on_receipt else stamp_s, now_s

    def _hear_channels(self, name: str, part: str, values: dict[str, float], now_s: float) -> set[str]:
        """Keep the values of the channels that a message gives, or one battery of it; their names."""
        battery = self._battery_of(name, part, values)
        spoke = set()
        for channel, options in self._options[name].items():
            option = self._preferred(channel, options, name, values, battery)
            if option is None:
                continue
            value = self._value(option, channel, values, battery)
            if not math.isfinite(value):
                continue
            if self._spikes.see(channel, value, now_s):
                count = self._spikes.counts[channel]
                said = f"readings of {channel} that no motion explains are left out"
                self.say(f"{said}: {count} (the last {value:.4g})", now_s, said)
                continue
            self._values.setdefault(channel, deque(maxlen=_MOST)).append(value)
            spoke.add(channel)
        return spoke

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
            self._values, self._place = {}, None
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
        """Readings since the last call without motion: the passed time, and whatever else there is."""
        return self._heard_by(self.stamps.without(now_s), 0.0, now_s)

    def warnings(self, now_s: float) -> list[str]:
        """Present warnings about messages, a line each."""
        for name, (at_s, usual_s) in self._at.items():
            allowed_s = max(thresholds.SILENT_INTERVALS * usual_s, thresholds.SHORTEST_SILENCE_S)
            if name in self.sources.values() and now_s - at_s > allowed_s:
                self.say(f"nothing on {name} for {quantities.duration(now_s - at_s)}", now_s, f"nothing on {name}")
        self._said = {
            kind: warning for kind, warning in self._said.items() if now_s - warning[1] <= companion_thresholds.STAYS_S
        }
        return [text for text, _ in self._said.values()]

    def _battery_of(self, name: str, part: str, values: dict[str, float]) -> str:
        """Name of the battery that values are of, whose readings are kept for the choice among several."""
        battery = f"{name}{PART}{part}" if part else name
        of_entry: dict[int, tuple[Topic, dict[str, float]]] = {}
        for channel in OF_BATTERY & self._options[name].keys():
            for option in self._options[name][channel]:
                if option.offer.topic == name and option.topic.takes(battery):
                    readings = of_entry.setdefault(id(option.topic), (option.topic, {}))[1]
                    readings[channel] = option.value(values)
        for topic, readings in of_entry.values():
            if math.isnan(readings.get("voltage_v", 0.0)):  # its driver knows nothing yet
                for channel in OF_BATTERY & topic.sources.keys():
                    values |= dict.fromkeys((path for path, _ in topic.sources[channel].terms), math.nan)
                continue
            self._batteries.setdefault(_key(topic), Batteries(topic)).hear(battery, readings)
        return battery

    def _value(self, option: _Option, channel: str, values: dict[str, float], battery: str) -> float:
        value = option.value(values)
        if channel not in OF_BATTERY or _key(option.topic) not in self._batteries:
            return value
        return self._batteries[_key(option.topic)].value(battery, channel, value)

    def _preferred(
        self, channel: str, options: list[_Option], name: str, values: dict[str, float], battery: str
    ) -> _Option | None:
        """The option used for a channel, if it is of this topic: the first that has had values."""
        chosen = self._chosen.get(channel)
        for option in options:
            if option[:2] == chosen:
                return option if option.offer.topic == name else None
            if option.offer.topic == name:
                value = self._value(option, channel, values, battery)
                if math.isfinite(value) and (channel not in _VOID or abs(value) > logs_thresholds.PLANAR):
                    self._chosen[channel] = option[:2]
                    self.sources[channel] = name
                    return option
        return None

    def _heard_by(self, time_s: float, dt_s: float, now_s: float) -> Heard:
        values = {
            name: several[-1] if name in _LAST else sum(several) / len(several)
            for name, several in self._values.items()
        }
        self._values = {}
        place = self._place
        self._place = None
        speed = values.get(
            "speed_mps", 0.5 * (values.get("wheel_left_mps", math.nan) + values.get("wheel_right_mps", math.nan))
        )
        reading: dict[str, Any] = {"speed_mps": speed, "sensing_hz": values.get("sensing_hz")}
        if abs(speed) > logs_thresholds.STANDSTILL_MPS:
            self._on_charger = False
        reading |= self._power(values, speed, now_s)
        if "soc" in values:
            self._per_cent |= CHANNELS["soc"].high < values["soc"] <= _PER_CENT * CHANNELS["soc"].high
            reading["soc"] = values["soc"] / (_PER_CENT if self._per_cent else 1.0)
        slope = values.get("grade_rad", values.get("grade", math.nan))
        if math.isnan(slope):
            slope = self._slope_felt(time_s, values.get(ACCELERATION, math.nan), speed)
        reading["grade_rad"] = -slope if speed < 0.0 else slope
        if place is not None:
            reading["position"] = place[:2]
        reading["heading_rad"] = self._heading(values, place, dt_s)
        # The companion says which states of charge are impossible; they show no charge either.
        possible = abs(reading.get("soc", math.nan) - 0.5) <= 0.5 + companion_thresholds.SOC_SLACK
        charged = possible and self._charge.see(reading["soc"])
        if charged:
            what = "charged" if self._on_charger else "charged or swapped"
            self.say(f"the battery was {what}: {reading['soc']:.0%}", now_s, "the battery was charged")
        return Heard(time_s, reading, reading["soc"] if charged else None, self._on_charger, values)

    def _heading(self, values: dict[str, float], place: tuple[float, float, float] | None, dt_s: float) -> float:
        """The heading by odometry, else as recorded or by an IMU, else by turning rates from east."""
        if place is not None and self._chosen.get("heading") == self._chosen["pose"]:
            return place[2]
        for name in ("heading_rad", "heading"):
            if name in values:
                return values[name]
        if place is None and "yaw_rate_radps" in values and not {"heading_rad", "heading", "pose"} & set(self._chosen):
            turned_rad = (self._turned_rad or 0.0) + values["yaw_rate_radps"] * dt_s
            if math.isfinite(turned_rad):
                self._turned_rad = math.remainder(turned_rad, math.tau)
            return self._turned_rad or 0.0
        return math.nan

    def _power(self, values: dict[str, float], speed: float, now_s: float) -> dict[str, float]:
        if "power_w" in values:
            return {"power_w": values["power_w"]}
        self._voltage_v = values.get("voltage_v", self._voltage_v)
        if "current_a" not in values:
            return {}
        current = values["current_a"]
        if self._chosen["current_a"][1].msgtype == BATTERY:
            if abs(speed) > logs_thresholds.STANDSTILL_MPS and current:
                self._as_charging += current < 0.0
                self._as_discharging += current > 0.0
            readings = self._as_charging + self._as_discharging
            if self._as_charging > self._as_discharging and readings >= thresholds.FEWEST_SIGNS:
                current = -current
                self.say(
                    f"{self.sources['current_a']} gives the current positive when discharging, against the definition "
                    "of BatteryState; it is used as discharge", now_s,
                )  # fmt: skip
        if current < 0.0 and not abs(speed) > logs_thresholds.STANDSTILL_MPS:
            self._on_charger = True
            return {}  # charging, which does not show the robot's consumption
        return {"voltage_v": self._voltage_v, "current_a": current}

    def _slope_felt(self, time_s: float, forward_mps2: float, speed: float) -> float:
        """Slope by an accelerometer less the robot's own acceleration, NaN until both were received for a while."""
        if not math.isfinite(forward_mps2 + speed):
            return math.nan
        self._past.append((time_s, forward_mps2, speed))
        while time_s - self._past[0][0] > grade.ACCELERATION_S:
            self._past.popleft()
        passed_s = time_s - self._past[0][0]
        if passed_s < thresholds.LEAST_OF_WINDOW * grade.ACCELERATION_S:
            return math.nan
        own = (speed - self._past[0][2]) / passed_s
        sine = (sum(mps2 for _, mps2, _ in self._past) / len(self._past) - own) / grade.GRAVITY_MPS2
        return math.asin(min(max(sine, -1.0), 1.0))

    def _heard(self, name: str, now_s: float) -> None:
        if name not in self._at:
            self._at[name] = now_s, math.inf  # it may arrive only once
            return
        at_s, usual_s = self._at[name]
        since_s = now_s - at_s
        # Moved towards the new interval; one gap does not become typical at once.
        if usual_s == math.inf:
            self._at[name] = now_s, since_s
            return
        new = companion_thresholds.NEW_INTERVAL
        step_s = companion_thresholds.LONGEST_INTERVAL * usual_s
        step_s = min(since_s, step_s + thresholds.SHORTEST_INTERVAL_S)
        self._at[name] = now_s, (1.0 - new) * usual_s + new * step_s

    def say(self, text: str, now_s: float, kind: str | None = None) -> None:
        """Warn for a while; a warning replaces one of the same kind."""
        self._said[kind or text] = text, now_s
