"""A mapping proposed for a foreign table: which column is which channel, by its name, its unit and its values."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from homeward.logs import tables, thresholds
from homeward.logs.channels import CHANNELS, Array
from homeward.logs.columns import RecordingError, known_columns, numeric
from homeward.logs.guess import LEAST_SURE, OFFSETS, UNITS, Guess, one_line
from homeward.logs.times import from_text
from homeward.logs.trial import tried_on_physics
from homeward.remedies import why_no_recording

_ROWS = 5000  # that are read; chosen: enough to see units and signs, in a moment

_NAMES: dict[str, tuple[str, str]] = {
    # channel: words of which one names it, all of a group joined by "+"; words that exclude it
    "time_s": (
        "time timestamp stamp date datetime elapsed clock epoch t sec secs zeit zeitstempel uhrzeit",
        "rate step",
    ),
    "wheel_left_mps": ("left+wheel left+speed left+vel left+velocity vell", "current motor amps right"),
    "wheel_right_mps": ("right+wheel right+speed right+vel right+velocity velr", "current motor amps left"),
    "motor_left_a": ("left+current left+motor left+amps curl", "speed velocity vel temp right"),
    "motor_right_a": ("right+current right+motor right+amps", "speed velocity vel temp left"),
    "yaw_rate_radps": (
        "yaw+rate turn+rate gyro+z angular+z wz omega yawrate angular+velocity rotation+rate drehrate gierrate",
        "x y",
    ),
    "speed_mps": (
        "speed velocity vel v vx groundspeed gspd spd linear+x odom+x geschwindigkeit",
        "wind angular left right fan rpm yaw set cmd vin vbat vbatt vbus",
    ),
    "grade_rad": ("grade slope incline inclination pitch gradient neigung steigung", "rate"),
    "elevation_m": ("elevation altitude alt height ele", "rate"),
    "base_distance_m": ("base+distance distance+base distance+home home+distance", ""),
    "distance_m": ("distance dist odometer odo travelled traveled mileage", "base home"),
    "heading_rad": ("heading hdg yaw course bearing azimuth", "rate"),
    "soc": (
        "soc charge+state state+charge battery+level battery+percent battery+percentage percentage bat%",
        "health",
    ),
    "power_w": ("power watt watts pwr batt+w battery+w leistung", "factor"),
    "voltage_v": ("voltage volt volts vbat vbatt vbus vin rxbt batt+v battery+v spannung", "motor"),
    "current_a": ("current amp amps ampere amperes ibat ibatt batt+a battery+a strom curr", "left right motor time"),
    "sensing_hz": ("sensing+rate sample+rate sampling+rate camera+rate sensing fps sensing+hz", ""),
    "temperature_c": ("temperature temp ambient temperatur", "motor cpu battery cell gpu fet mosfet mos esc"),
    "payload_kg": ("payload load cargo", "cpu power"),
}

_LETTERS = {"i": "current_a", "u": "voltage_v", "p": "power_w"}
"""Letters of formulas that name a channel where a unit of it follows: I mA."""
_BY_UNIT = {"voltage_v": ("V", "mV"), "current_a": ("A", "mA"), "power_w": ("W", "kW", "mW")}
"""Channels that a unit in brackets or in a line of units indicates if nothing else does and only one column has it."""
_OF_OTHERS = {
    "motor", "left", "right", "cell", "cpu", "charger", "charging", "solar", "set", "cmd", "min", "max", "limit",
}  # fmt: skip
"""Words of columns that are not of the whole battery, or not measured."""

_COUNTED = {
    "energy", "wh", "kwh", "mah", "ah", "hours", "count", "counter", "seq", "cumulative", "joule", "joules",
}  # fmt: skip
"""Words of counters."""
_COUNTERS = {"time_s", "distance_m"}
"""Channels that counters measure."""
_NOT_MEASURED = {
    "status", "mode", "flag", "flags", "health", "technology", "fault", "error", "code", "enum", "min", "max",
    "minimum", "maximum", "limit", "lim", "threshold", "cutoff", "setpoint", "set", "cmd", "command", "commanded",
    "target", "desired", "ref", "reference", "demand", "goal", "nominal", "rated", "phase", "iq", "id", "tx",
    "variance", "covariance", "std",
}  # fmt: skip
"""Words of enumerations, limits, set points, phase currents and errors, which measure no channel."""
_USED = {"used", "consumed", "drawn", "spent", "verbraucht"}
"""Words of a charge that is used, not left."""
_AVERAGED = {"avg", "average", "mean", "rms"}

_COMPOUND = ("spannung", "geschwindigkeit", "leistung", "strom")
"""German words that also name a channel as the end of a longer word: Akkuspannung."""


@dataclass(frozen=True)
class Proposal:
    """A mapping proposed for a file, and its unused columns, each with the channel that it could be."""

    path: Path
    guesses: tuple[Guess, ...]
    left_over: dict[str, str]
    notes: tuple[str, ...]

    @property
    def needless(self) -> bool:
        """Whether every column has the name and the unit of its channel, so that the file reads without a mapping."""
        return all((guess.column, guess.factor, guess.offset) == (guess.channel, 1.0, 0.0) for guess in self.guesses)

    def toml(self) -> str:
        """The mapping file."""
        head = f"# Proposed for {one_line(self.path.name)}: check each line, above all signs and guesses."
        rest = [f"# Not used: {one_line(', '.join(self.left_over))}"] if self.left_over else []
        return "\n".join([head, "", "[columns]", *(guess.entry() for guess in self.guesses), *rest]) + "\n"


def propose(path: str | Path) -> Proposal:
    """Propose which columns of a table are which channels.

    Args:
        path: A .csv, .csv.gz, .tsv, .txt or .parquet file.

    Raises:
        RecordingError: It cannot be read, or no column looks like a time.
    """
    path = Path(path)
    try:
        header, table, notes, units = _beginning(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    try:
        offered = _by_program(header, table)
        if not offered:
            offered = [guess for name in header for guess in _guesses(name, table[name], units.get(name, ""))]
            offered += _by_unit(header, table, units, offered)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    offered = _dated(offered, table)
    chosen: dict[str, Guess] = {}
    offered = [_less_sure(guess) for guess in offered]
    for guess in sorted(offered, key=_rank):
        if guess.channel not in chosen and guess.column not in {other.column for other in chosen.values()}:
            chosen[guess.channel] = guess
    chosen = tried_on_physics(chosen, table)
    used = {name for guess in chosen.values() for name in (guess.column, guess.and_column)}
    left = {name: _why_left(name, offered, chosen, table[name]) for name in header if name not in used}
    return Proposal(path, tuple(chosen[name] for name in CHANNELS if name in chosen), left, notes)


def propose_each(paths: Sequence[Path]) -> list[Proposal]:
    """Propose for each of several tables of one run.

    A channel that two tables may have is taken from the one of which it is surer, or from the first; the others say so.

    Raises:
        RecordingError: As of `propose`.
    """
    proposals = [propose(path) for path in paths]
    best: dict[str, tuple[tuple[int, int, int], Path, str]] = {}
    for proposal in proposals:
        for guess in proposal.guesses:
            rank = _rank(guess)
            if guess.channel not in best or rank < best[guess.channel][0]:
                best[guess.channel] = rank, proposal.path, guess.column
    return [_without_others(proposal, best) for proposal in proposals]


def _without_others(proposal: Proposal, best: Mapping[str, tuple[tuple[int, int, int], Path, str]]) -> Proposal:
    """The proposal for one of several tables without the channels that another has; all have a time."""
    left_over = dict(proposal.left_over)
    kept = []
    for guess in proposal.guesses:
        _, path, column = best[guess.channel]
        if guess.channel == "time_s" or path == proposal.path:
            kept.append(guess)
        else:
            left_over[guess.column] = f" (could be {guess.channel}, for which {column} of {path.name} is used)"
    return replace(proposal, guesses=tuple(kept), left_over=left_over)


def _dated(offered: list[Guess], table: pd.DataFrame) -> list[Guess]:
    """The guesses, with a date and the time of day beside it joined to one time."""
    times = [guess for guess in offered if guess.channel == "time_s"]
    days = [time for time in times if time.why.startswith("dates") and _of_few_days(table[time.column])]
    hours = [time for time in times if time.why.startswith("times of day")]
    if not days or not hours:
        return offered
    date_and_time = replace(days[0], and_column=hours[0].column, why="a date and the time of day")
    return [date_and_time, *(guess for guess in offered if guess not in times)]


def _of_few_days(column: pd.Series[Any]) -> bool:
    """Whether a column holds dates without times of day: a recording has few of them."""
    return column.nunique() <= max(thresholds.LONGEST_RUN_S / 86400.0, 1.0)


def _rank(guess: Guess) -> tuple[int, int, int]:
    """The order of guesses: the surest first, then the name that is most like the channel's and has least beside it."""
    words, _ = _words(guess.column)
    whole = next(iter(guess.channel.rsplit("_", 1)))
    return guess.sure, whole not in words, len(words)


def _less_sure(guess: Guess) -> Guess:
    """The guess, less sure where the name is that of an average or of one of several."""
    if guess.column == guess.channel:
        return guess
    words, _ = _words(guess.column)
    if words & _AVERAGED:
        return replace(guess, sure=2, why=f"{guess.why}; an average")
    if re.search(r"[a-z]\d+([^a-z\d]|$)", re.sub(r"[\[(<].*", "", guess.column.lower())):
        return replace(guess, sure=2, why=f"{guess.why}; one of several by its number")
    return guess


def _beginning(path: Path) -> tuple[list[str], pd.DataFrame, tuple[str, ...], dict[str, str]]:
    """Names of the columns, their first rows, notes, and units by name where there is a line of them."""
    if path.suffix.lower() == ".parquet":
        with tables.opened_parquet(path) as file:
            names = file.schema_arrow.names
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise RecordingError(f"has two columns {twice}; keep one")
            table = tables.in_pandas(next(file.iter_batches(_ROWS)))
        return names, table, (), {}
    if not path.name.lower().endswith(tables.SUFFIXES):
        kinds = ", ".join(tables.SUFFIXES)
        if remedy := why_no_recording(path):
            raise RecordingError(remedy)
        raise RecordingError(f"is not a table; give a {kinds} or .parquet file (a bag has topics, not columns)")
    text = tables.sniff(path)
    names = list(dict.fromkeys(name for name in text.header if name))
    if not names:
        raise RecordingError("has no names of columns in its first line")
    pieces = text.pieces(names)
    units = dict(zip(text.header, text.units, strict=False))
    return names, next(pieces, pd.DataFrame(columns=names)).iloc[:_ROWS], text.notes, units


def _by_program(header: list[str], table: pd.DataFrame) -> list[Guess]:
    """The columns of the program that wrote the table, where its mapping ships."""
    mapping = known_columns(header)
    if mapping is None:
        return []
    return [
        Guess(column, channel, factor, source.offset, 0, f"the mapping {mapping.name} that ships")
        for channel, source in mapping.sources.items()
        for column, factor in source.terms
        if channel not in mapping.unknown_if_zero or table[column].any()
    ]


def _guesses(name: str, column: pd.Series[Any], unit: str) -> list[Guess]:
    """The channels that a column may be, by its name."""
    words, unit_words = _words(f"{name} [{unit}]" if unit else name)
    dated = from_text(column)
    values = (numeric(column) if dated is None else dated[0]).to_numpy(np.float64, na_value=np.nan)
    if not np.isfinite(values).any():
        return []
    by_letter = None if dated is not None else _by_letter(name, values, unit)
    if by_letter is not None:
        return [by_letter]
    guesses = []
    if name == "curR":  # beside curL; in other cases it is short for current
        guesses += _in_unit_or_none(name, "motor_right_a", values, unit_words)
    for channel, (groups, against) in _NAMES.items():
        if name == channel:
            guesses.append(_signed(Guess(name, channel, 1.0, 0.0, 0, "it has the channel's name"), values))
        elif (words & _COUNTED and channel not in _COUNTERS) or (words & _NOT_MEASURED and channel != "time_s"):
            continue
        elif any(set(group.split("+")) <= words for group in groups.split()) and not words & set(against.split()):
            if dated is None:
                of_channel = _in_unit_or_none(name, channel, values, unit_words)
                guesses += [_left_of(guess, words) if channel == "soc" else guess for guess in of_channel]
            elif channel == "time_s":
                guesses.append(Guess(name, channel, 1.0, 0.0, 0, dated[1]))
    return guesses


def _left_of(guess: Guess, words: set[str]) -> Guess:
    """The guess for a state of charge, turned where its name is that of the charge used."""
    if not words & _USED:
        return guess
    return replace(guess, factor=-guess.factor, offset=1.0, sure=LEAST_SURE, why=f"{guess.why}; 1 minus what is used")


def _in_unit_or_none(name: str, channel: str, values: Array, unit_words: list[str]) -> list[Guess]:
    guess = _in_unit(name, channel, values, unit_words)
    return [] if guess is None else [guess]


def _by_letter(name: str, values: Array, unit: str) -> Guess | None:
    """The guess for a name that is a letter of formulas and a unit, such as "I mA" or "U [V]"."""
    parts = re.fullmatch(r"\s*([a-z])[\s_.\[(<]+([a-z]+)\s*[\])>]?\s*", f"{name} [{unit}]" if unit else name, re.I)
    channel = _LETTERS.get(parts[1].lower()) if parts else None
    if parts is None or channel is None:
        return None
    factor = UNITS[CHANNELS[channel].unit].get(parts[2].lower())
    if factor is None or not _possible(channel, values * factor):
        return None
    return _signed(Guess(name, channel, factor, 0.0, 2, f"a letter and {parts[2]}"), values)


def _by_unit(header: list[str], table: pd.DataFrame, units: dict[str, str], offered: list[Guess]) -> list[Guess]:
    """Guesses by the unit alone, for channels and columns of which nothing else says anything."""
    explained = {guess.channel for guess in offered} | {guess.column for guess in offered}
    guesses = []
    for channel, of_channel in _BY_UNIT.items():
        columns = {name: units.get(name) or _bracket(name) for name in header if name not in explained}
        having = [name for name, unit in columns.items() if unit in of_channel and not _words(name)[0] & _OF_OTHERS]
        if channel in explained or len(having) != 1:
            continue
        (name,) = having
        unit = columns[name]
        values = numeric(table[name]).to_numpy(np.float64, na_value=np.nan)
        factor = UNITS[of_channel[0]][unit.lower()]
        if np.isfinite(values).any() and _possible(channel, values * factor):
            guesses.append(_signed(Guess(name, channel, factor, 0.0, 2, f"only its unit, {unit}, says so"), values))
    return guesses


def _bracket(name: str) -> str:
    return next(iter(re.findall(r"[\[(<]\s*([^\])>]*?)\s*[\])>]", name)), "")


def _in_unit(name: str, channel: str, values: Array, unit_words: list[str]) -> Guess | None:
    """The guess with the unit that the name gives or, failing that, the values; None where neither is possible."""
    channel_info = CHANNELS[channel]
    units = UNITS[channel_info.unit]
    for word in unit_words:
        if word in units:
            factor = units[word]
            offset = OFFSETS.get(word, 0.0) if channel == "temperature_c" else 0.0
            if channel == "soc" and np.nanmax(values) <= channel_info.high:
                return Guess(name, channel, 1.0, 0.0, 1, f"its name says {word}, and its values lie in 0 to 1")
            if _possible(channel, values * factor + offset):
                return _signed(Guess(name, channel, factor, offset, 0, f"its name says {word}"), values)
    for word, factor in [(channel_info.unit, 1.0), *channel_info.mistaken]:
        if _possible(channel, values * factor) and _plausible(channel, values * factor):
            sure = 1 if factor == 1.0 else 2
            why = (
                f"its name says no unit; values fit {word}" if channel_info.unit != "1" else "its values lie in 0 to 1"
            )
            why = why if sure == 1 else f"values fit {word}"
            if channel == "time_s" and values[0] > thresholds.EPOCH_COUNT:
                why = "its name says no unit; a count since 1970, whose size shows its unit"
            step = float(np.median(np.diff(values))) if channel == "time_s" and len(values) > 1 else 0.0
            if factor != 1.0 and thresholds.SLOW_STEP_S < step < thresholds.LONGEST_STEP_S:
                why = f"{why}, or seconds with a sample every {step:.3g} s"
            return _signed(Guess(name, channel, factor, 0.0, sure, why, by_values=True), values)
    return None


def _possible(channel: str, values: Array) -> bool:
    if channel == "time_s":
        steps = np.diff(values[np.isfinite(values)])
        return bool(
            len(steps) and (steps >= 0.0).mean() > thresholds.INCREASING_SHARE and values[0] > thresholds.EARLIEST_S
        )
    return float(np.mean(CHANNELS[channel].impossible(values[np.isfinite(values)]))) <= thresholds.STRAY_SHARE


def _plausible(channel: str, values: Array) -> bool:
    """Whether values without a unit are in the typical range of a ground robot, beyond being possible."""
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max())
    step = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
    if channel == "time_s":
        # The reader infers the unit of an epoch in ms to ns.
        return 0.0 < step < thresholds.SLOW_STEP_S or values[0] > thresholds.EPOCH_COUNT
    return largest <= thresholds.TYPICAL_SIZES.get(channel, np.inf)


def _signed(guess: Guess, values: Array) -> Guess:
    """The guess with the sign of battery current or power turned where it is mostly negative."""
    if guess.channel in ("current_a", "power_w") and float(np.nanmedian(values)) < 0.0:
        why = f"{guess.why}; mostly negative, so assumed to be negative when discharging"
        return replace(guess, factor=-guess.factor, sure=2, why=why)
    if guess.channel in ("grade_rad", "heading_rad") and "pitch" in guess.column.lower():
        return replace(guess, sure=2, why=f"{guess.why}; uphill must be positive")
    return guess


def _words(name: str) -> tuple[set[str], list[str]]:
    """Words of a column's name, and those that may be its unit: what is in brackets, and its last words."""
    bracket = re.findall(r"[\[(<]\s*([^\])>]*?)\s*[\])>]", name)
    plain = re.sub(r"[\[(<][^\])>]*[\])>]", " ", name)
    split = re.sub(r"([a-z])([A-Z])", r"\1 \2", plain)
    words = [word for word in re.split(r"[^a-zA-Z°%µ/]+", split) if word]
    lower = [word.lower() for word in words]
    units = [unit.replace("µ", "u").replace("^-1", "").replace(".", "").lower() for unit in bracket]
    whole = [word.lower() for word in re.split(r"[^a-zA-Z°%µ/]+", plain) if word]  # mA, which was split as m and A
    ends = ["/".join(lower[-2:]), *whole[::-1], *lower[::-1]] if len(lower) > 1 or len(whole) > 1 else []
    joined = [word.replace("_", "").lower() for word in re.split(r"[^a-zA-Z_]+", plain)]  # v_in is vin
    parts = {part for word in (*lower, *whole, *joined) for part in (word, *word.split("/"))}
    return parts | {end for end in _COMPOUND for part in parts if part.endswith(end)}, [*units, *ends]


def _why_left(name: str, offered: list[Guess], chosen: dict[str, Guess], column: pd.Series[Any]) -> str:
    mine = [guess for guess in offered if guess.column == name]
    if not mine and _words(name)[0] & set(_NAMES["time_s"][0].split()) and not pd.api.types.is_numeric_dtype(column):
        return " (neither numbers nor times such as 2024-05-01T12:00:00.1)"
    if not mine:
        return ""
    return f" (could be {mine[0].channel}, for which {chosen[mine[0].channel].column} is used)"
