"""Checks of readings: missing, late, repeated and impossible readings are left out with a
warning."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

from homeward import thresholds as shared
from homeward.companion import thresholds
from homeward.companion.limits import Limits

Position = float | tuple[float, float]
POSITIONS = (0.0, (0.0, 0.0))
"""A position of each kind."""
_MOST_SAID = 8
"""Number of warnings kept. Chosen: more than a robot has instruments that fail at a time."""


class CompanionError(ValueError):
    """An invalid argument or reading of a companion; the message says what to give."""


class Reading(NamedTuple):
    """Readings of a moment, NaN (or None) where an instrument was not read."""

    dt_s: float
    speed_mps: float
    power_w: float
    soc: float
    grade_rad: float
    heading_rad: float
    voltage_v: float
    current_a: float
    sensing_hz: float
    temperature_c: float
    interest: float
    position: Position | None


class _Held:
    """The last value of an instrument, and its typical interval."""

    SAVED: ClassVar = ("value", "at_s", "every_s")

    def __init__(self) -> None:
        self.value = math.nan
        self.at_s = math.nan
        self.every_s = math.nan

    def see(self, value: float, now_s: float) -> None:
        if not math.isfinite(value):
            return
        since_s = now_s - self.at_s
        if since_s > 0.0:
            if math.isnan(self.every_s):
                self.every_s = since_s
            else:
                # Moved towards the new interval; one gap does not become typical at once.
                weight = thresholds.NEW_INTERVAL
                interval_s = min(since_s, thresholds.LONGEST_INTERVAL * self.every_s)
                self.every_s = (1.0 - weight) * self.every_s + weight * interval_s
        self.value = value
        self.at_s = now_s

    def now(self, now_s: float, dt_s: float) -> float:
        """The value for the time since the last reading, NaN if it is too old or held for too
        long."""
        typical_s = dt_s
        if math.isfinite(self.every_s):
            typical_s = self.every_s
        allowed_s = max(thresholds.HELD_INTERVALS * typical_s, thresholds.LEAST_HOLD_S) * (
            1.0 + 1e-9
        )
        if now_s - self.at_s <= allowed_s and dt_s <= allowed_s:
            return self.value
        return math.nan


class Readings:
    """Checks readings as they arrive.

    Args:
        limits: What the robot cannot exceed.
        is_possible: Whether the robot can be at a position at all.
        noise_m: Standard deviation of the positions along an axis, as learned so far, m.

    Attributes:
        clock_s: Time since the first reading, s: it never goes back.
        counts: How many readings were left out, by reason.
    """

    SAVED: ClassVar = (
        "clock_s", "counts", "_last_s", "_ignored_s", "_back", "_power", "_grade", "_heading", "_clock", "_motion",
        "_place", "_place_at_s", "_jumps", "_anchor", "_driven_m", "_said", "_charges",
    )  # fmt: skip
    MAY_BE: ClassVar = {
        "counts": ([0],),
        "_place": POSITIONS,
        "_anchor": POSITIONS,
        "_said": ([(0.0, "a warning")],),
    }
    # Whatever a clock shows.
    WITHIN: ClassVar = {"_last_s": (-math.inf, math.inf), "_ignored_s": (-math.inf, math.inf)}

    def __init__(
        self, limits: Limits, is_possible: Callable[[Position], bool], noise_m: Callable[[], float]
    ) -> None:
        self._limits = limits
        self._is_possible = is_possible
        self._noise_m = noise_m
        self.clock_s = 0.0
        self.counts = dict[str, int]()
        self._last_s = math.nan
        self._ignored_s = math.nan
        self._back = 0
        self._charges = False
        self._power = _Held()
        self._grade = _Held()
        self._heading = _Held()
        self._clock = _Held()
        self._motion = _Held()
        self._place: Position | None = None
        self._place_at_s = 0.0
        self._jumps = 0
        self._anchor: Position | None = None
        self._driven_m = 0.0
        self._said: tuple[tuple[float, str], ...] = ()

    @property
    def last_s(self) -> float:
        """Time of the last reading, s; 0 before the first."""
        if math.isnan(self._last_s):
            return 0.0
        return self._last_s

    def take(self, time_s: float, values: dict[str, Any]) -> Reading | None:
        """Check the readings of a moment; None if nothing is new.

        Args:
            time_s: Time, s.
            values: Values by name, None where an instrument was not read.

        Raises:
            CompanionError: A value is not a number, or neither position nor speed was read in the
                first minute.
        """
        position = checked_position("position", values["position"])
        read = {name: _number(name, value) for name, value in values.items() if name != "position"}
        number_s = _number("time_s", time_s)
        if self._charges and math.isfinite(number_s):
            self._end_charge(number_s)
            dt_s: float | None = 0.0
        else:
            dt_s = self._passed_s(number_s, read["speed_mps"], position)
        if dt_s is None:
            return None
        self.clock_s += dt_s
        typical_s = self._clock.every_s
        self._clock.see(0.0, self.clock_s)
        if dt_s > thresholds.GAP_INTERVALS * typical_s and dt_s > thresholds.LEAST_HOLD_S:
            self.say(f"no reading for {dt_s:.0f} s")

        speed_mps = self._within_either_way(
            "speed_mps", read["speed_mps"], self._limits.speed_mps, "km/h?"
        )
        voltage_v = self._within(
            "voltage_v", read["voltage_v"], thresholds.LEAST_VOLTAGE_V, shared.MOST_VOLTAGE_V, "mV?"
        )
        current_a = self._within_either_way(
            "current_a", read["current_a"], shared.MOST_CURRENT_A, "mA?"
        )
        power_w = read["power_w"]
        if not math.isfinite(power_w):
            power_w = voltage_v * current_a
        power_w = self._within_either_way("power_w", power_w, self._limits.power_w, "mW?")
        soc = self._within(
            "soc", read["soc"], -thresholds.SOC_SLACK, 1.0 + thresholds.SOC_SLACK, "per cent?"
        )
        if math.isfinite(soc):
            soc = min(max(soc, 0.0), 1.0)
        grade_rad = self._within_either_way(
            "grade_rad", read["grade_rad"], shared.STEEPEST_RAD, "degrees?"
        )
        heading_rad = self._within_either_way(
            "heading_rad", read["heading_rad"], shared.MOST_HEADING_RAD, "degrees?"
        )
        self._power.see(power_w, self.clock_s)
        self._grade.see(grade_rad, self.clock_s)
        self._heading.see(heading_rad, self.clock_s)

        had_power = math.isfinite(self._power.value)
        power_w = self._power.now(self.clock_s, dt_s)
        if had_power and math.isnan(power_w):
            silent_s = max(self.clock_s - self._power.at_s, dt_s)
            self.say(f"no power for {silent_s:.0f} s: predicted by the model", "no power")
        self._check_motion(speed_mps, position, dt_s)
        sensing_hz = self._within(
            "sensing_hz", read["sensing_hz"], 0.0, shared.MOST_SENSING_HZ, "Hz"
        )
        if math.isnan(sensing_hz):  # what was not read is taken not to sense
            sensing_hz = 0.0
        temperature_c = self._within_either_way(
            "temperature_c", read["temperature_c"], shared.MOST_TEMPERATURE_C, "kelvin?"
        )
        interest = self._within("interest", read["interest"], 0.0, shared.MOST_INTEREST, "a weight")
        driven_m = 0.0
        if math.isfinite(speed_mps):
            driven_m = abs(speed_mps) * dt_s
        return Reading(
            dt_s=dt_s,
            speed_mps=speed_mps,
            power_w=power_w,
            soc=soc,
            grade_rad=self._grade.now(self.clock_s, dt_s),
            heading_rad=self._heading.now(self.clock_s, dt_s),
            voltage_v=voltage_v,
            current_a=current_a,
            sensing_hz=sensing_hz,
            temperature_c=temperature_c,
            interest=interest,
            position=self._place_now(position, driven_m),
        )

    def charge(self) -> None:
        """The time until the next reading passes at a charger: no energy is drawn in it."""
        self._charges = True

    def _end_charge(self, time_s: float) -> None:
        """Pass the time at the charger, in which no instrument was due."""
        passed_s = time_s - self._last_s
        # Before the first reading (NaN), and where the clock was set meanwhile, the time is not
        # known.
        charged_s = 0.0
        if 0.0 <= passed_s <= self._limits.gap_s:
            charged_s = passed_s
        self._charges = False
        self._last_s = time_s
        self._back = 0
        self.clock_s += charged_s
        for instrument in (self._power, self._grade, self._heading, self._clock, self._motion):
            instrument.at_s += charged_s

    def _check_motion(self, speed: float, position: Position | None, dt_s: float) -> None:
        """Warn if neither speed nor position is read, and raise an error if neither ever was."""
        kind = "neither speed nor position"
        moves = speed
        if position is not None:  # that is enough, whatever the speed
            moves = 0.0
        self._motion.see(moves, self.clock_s)
        if math.isfinite(self._motion.now(self.clock_s, dt_s)):
            return
        if math.isfinite(self._motion.value):
            silent_s = max(self.clock_s - self._motion.at_s, dt_s)
            self.say(f"{kind} for {silent_s:.0f} s: assumed to drive on as before", kind)
        elif self.clock_s <= thresholds.STAYS_S:
            self.say(f"{kind} was read yet: assumed to stand", kind)
        else:
            raise CompanionError(
                f"{kind} was read in {self.clock_s:.0f} s: give position= (metres from home, or east and north) "
                "or speed_mps="
            )

    def say(self, text: str, kind: str | None = None) -> None:
        """Warn for a while; a warning replaces one of the same kind."""
        kind = kind or text
        of_other_kinds = [(at_s, said) for at_s, said in self._said if not said.startswith(kind)]
        self._said = (*of_other_kinds, (self.clock_s, text))[-_MOST_SAID:]

    def warnings(self) -> tuple[str, ...]:
        """Present warnings, a sentence each."""
        return tuple(text for at_s, text in self._said if self.clock_s - at_s <= thresholds.STAYS_S)

    def _passed_s(self, time_s: float, speed_mps: float, position: Position | None) -> float | None:
        """Time since the last reading; None if this one is not later."""
        if not math.isfinite(time_s):
            self._leave_out("readings without a time")
            return None
        if math.isnan(self._last_s):
            self._last_s = time_s
            return 0.0
        dt_s = time_s - self._last_s
        if dt_s > self._limits.gap_s or self._drove_less(dt_s, speed_mps, position):
            return self._clock_was_set("forward", time_s, 1)
        if dt_s >= thresholds.LEAST_STEP_S:
            self._last_s = time_s
            self._back = 0
            return dt_s
        if dt_s >= 0.0:
            self._leave_out("repeated readings")
            return None
        # Readings that are earlier and rise among themselves are those of a clock that was set
        # back.
        if time_s > self._ignored_s or self._back == 0:
            self._back += 1
        else:
            self._back = 1
        self._ignored_s = time_s
        if self._back < thresholds.LATE:
            self._leave_out("late readings")
            return None
        return self._clock_was_set("back", time_s, thresholds.LATE)

    def _drove_less(self, dt_s: float, speed_mps: float, position: Position | None) -> bool:
        """Whether the position contradicts the speed over a gap: then it is the clock that moved
        on."""
        typical_s = self._clock.every_s
        if dt_s <= thresholds.GAP_INTERVALS * typical_s or position is None or self._place is None:
            return False
        if isinstance(position, float) != isinstance(self._place, float):
            return False
        driven_m = abs(speed_mps) * dt_s
        return driven_m > thresholds.CLOCK_SET * (
            _apart_m(position, self._place) + 2.0 * shared.POSITION_M
        )

    def _clock_was_set(self, way: str, time_s: float, readings: int) -> float:
        """Time since the last reading if the clock cannot say it: that of so many readings."""
        by_s = abs(time_s - self._last_s)
        self.say(
            f"the clock was set {way} by {_size(by_s)} s: time continues as before",
            f"the clock was set {way}",
        )
        self._last_s = time_s
        self._back = 0
        every_s = self._clock.every_s
        if not math.isfinite(every_s):
            return 0.0
        return readings * every_s

    def _within_either_way(self, name: str, value: float, largest: float, hint: str) -> float:
        """The value if it is within a limit in both directions, otherwise NaN and a warning."""
        return self._within(name, value, -largest, largest, hint)

    def _within(self, name: str, value: float, low: float, high: float, hint: str) -> float:
        """The value if it is possible, otherwise NaN and a warning."""
        if math.isnan(value) or low <= value <= high:
            return value
        self._leave_out(
            f"impossible {name}",
            f" (the last {value:.4g}; allowed {low:.4g} to {high:.4g}; {hint})",
        )
        return math.nan

    def _leave_out(self, what: str, detail: str = "") -> None:
        self.counts[what] = self.counts.get(what, 0) + 1
        self.say(f"{what} left out: {self.counts[what]}{detail}", what)

    def _place_now(self, position: Position | None, driven_m: float) -> Position | None:
        """The position, None if there is none or the robot cannot have come there."""
        if position is None:
            if (
                self._place is not None
                and self.clock_s - self._place_at_s > thresholds.LEAST_HOLD_S
            ):
                away_s = self.clock_s - self._place_at_s
                self.say(f"no position for {away_s:.0f} s: dead reckoning", "no position")
            return None
        if not self._is_possible(position):
            self._leave_out(
                "impossible position",
                f" (the last {_said(position)}: farther than the robot can drive)",
            )
            return None
        if self._place is not None and isinstance(position, float) == isinstance(
            self._place, float
        ):
            apart_m = _apart_m(position, self._place)
            error_m = max(2.0 * shared.POSITION_M, thresholds.NOISY * self._noise_m())
            most_m = self._limits.speed_mps * (self.clock_s - self._place_at_s) + error_m
            if apart_m > most_m and self._jumps < thresholds.JUMPS:
                self._jumps += 1
                self._leave_out(
                    "impossible position", f" (the last {apart_m:.0f} m away from the one before)"
                )
                return None
            if apart_m > most_m:
                self.say(
                    f"{thresholds.JUMPS + 1} positions in a row are {apart_m:.0f} m away: accepted as a jump"
                )
        if self._stays(position, driven_m):
            return None
        self._place = position
        self._place_at_s = self.clock_s
        self._jumps = 0
        return position

    def _stays(self, position: Position, driven_m: float) -> bool:
        """Whether positions stay while the speed is not 0: dead reckoning is then the safer of
        both."""
        self._driven_m += driven_m
        same_kind = isinstance(position, float) == isinstance(self._anchor, float)
        if (
            self._anchor is None
            or not same_kind
            or _apart_m(position, self._anchor) > thresholds.STILL_M
        ):
            self._anchor = position
            self._driven_m = 0.0
        elif self._driven_m > thresholds.DRIVEN_M:
            still = f"the positions stay within {thresholds.STILL_M:g} m"
            driven = f"the speed integrates to {self._driven_m:.0f} m"
            self.say(
                f"{still} while {driven}: degrees, or spinning wheels? Dead reckoning is used",
                "the positions stay",
            )
        return self._driven_m > thresholds.DRIVEN_M


def _number(name: str, value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise CompanionError(
            f"{name} = {value!r} is not a number; give a number, or None if nothing was read"
        )
    number = as_float(value)
    if math.isinf(number):
        return math.nan
    return number


def as_float(value: Any) -> float:
    """A number as a float, infinite if it is a whole number beyond all floats."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _apart_m(position: Position, other_position: Position) -> float:
    """Distance of two positions of one kind, m."""
    if isinstance(position, tuple) and isinstance(other_position, tuple):
        return math.dist(position, other_position)
    assert isinstance(position, float) and isinstance(other_position, float)
    return abs(position - other_position)


def _said(position: Position) -> str:
    """A position in a few characters, whatever its size."""
    if isinstance(position, float):
        return f"{_size(position)} m"
    return f"({_size(position[0])}, {_size(position[1])}) m"


def _size(number: float) -> str:
    """A whole number where that is short."""
    if abs(number) < _LONG:
        return f"{number:.0f}"
    return f"{number:.3g}"


# from which a number is written with an exponent; chosen: ten digits are read at a glance
_LONG = 1e9
_PLACE = "metres from home along the way, or (east, north) in metres"
_ALLOWED = {"home": "(east, north) in metres, or 'here'", "forecast_mps": "(east, north) in m/s"}


def checked_position(name: str, value: Any) -> Position | None:
    """A position as metres or (east, north), None where there is none or it is not finite.

    Raises:
        CompanionError: It is neither.
    """
    if value is None:
        return None
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        metres = as_float(value)
        if not math.isfinite(metres):
            return None
        return metres
    try:
        east_m, north_m = map(as_float, value)
    except (TypeError, ValueError):
        raise CompanionError(
            f"{name} = {value!r} is not allowed; give {_ALLOWED.get(name, _PLACE)}"
        ) from None
    if not math.isfinite(east_m + north_m):
        return None
    return east_m, north_m
