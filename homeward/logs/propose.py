"""A mapping proposed for a foreign table: which column is which channel, by its name, its unit and
its values."""

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

_BRACKETS = re.compile(r"[\[(<]\s*([^\])>]*?)\s*[\])>]")
"""What stands in brackets in a name of a column, mostly its unit."""
_ROWS = 5000  # that are read; chosen: enough to see units and signs, in a moment

_NAMES: dict[str, tuple[str, str]] = {
    # channel: words of which one names it, all of a group joined by "+"; words that exclude it
    "time_s": (
        "time timestamp stamp date datetime elapsed clock epoch t sec secs zeit zeitstempel uhrzeit",
        "rate step",
    ),
    "wheel_left_mps": (
        "left+wheel left+speed left+vel left+velocity vell",
        "current motor amps right",
    ),
    "wheel_right_mps": (
        "right+wheel right+speed right+vel right+velocity velr",
        "current motor amps left",
    ),
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
    "current_a": (
        "current amp amps ampere amperes ibat ibatt batt+a battery+a strom curr",
        "left right motor time",
    ),
    "sensing_hz": ("sensing+rate sample+rate sampling+rate camera+rate sensing fps sensing+hz", ""),
    "temperature_c": (
        "temperature temp ambient temperatur",
        "motor cpu battery cell gpu fet mosfet mos esc",
    ),
    "payload_kg": ("payload load cargo", "cpu power"),
}

_LETTERS = {"i": "current_a", "u": "voltage_v", "p": "power_w"}
"""Letters of formulas that name a channel where a unit of it follows: I mA."""
_BY_UNIT = {"voltage_v": ("V", "mV"), "current_a": ("A", "mA"), "power_w": ("W", "kW", "mW")}
"""Channels that a unit in brackets or in a line of units indicates if nothing else does and only
one column has it."""
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
"""Words of enumerations, limits, set points, phase currents and errors, which measure no
channel."""
_USED = {"used", "consumed", "drawn", "spent", "verbraucht"}
"""Words of a charge that is used, not left."""
_AVERAGED = {"avg", "average", "mean", "rms"}

_COMPOUND = ("spannung", "geschwindigkeit", "leistung", "strom")
"""German words that also name a channel as the end of a longer word: Akkuspannung."""


@dataclass(frozen=True)
class Proposal:
    """A mapping proposed for a file, and its unused columns, each with the channel that it could
    be."""

    path: Path
    guesses: tuple[Guess, ...]
    left_over: dict[str, str]
    notes: tuple[str, ...]

    @property
    def needless(self) -> bool:
        """Whether every column has the name and the unit of its channel, so that the file reads
        without a mapping."""
        return all(
            (guess.column, guess.factor, guess.offset) == (guess.channel, 1.0, 0.0)
            for guess in self.guesses
        )

    def toml(self) -> str:
        """The mapping file."""
        head = f"# Proposed for {one_line(self.path.name)}: check each line, above all signs and guesses."
        lines = [head, "", "[columns]", *(guess.entry() for guess in self.guesses)]
        if self.left_over:
            lines.append(f"# Not used: {one_line(', '.join(self.left_over))}")
        return "\n".join(lines) + "\n"


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
        offered = _by_program(header, table)
        if not offered:
            for name in header:
                offered += _guesses(name, table[name], units.get(name, ""))
            offered += _by_unit(header, table, units, offered)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    offered = [_less_sure(guess) for guess in _dated(offered, table)]
    proposed = tried_on_physics(_surest(offered), table)
    used = {name for guess in proposed.values() for name in (guess.column, guess.and_column)}
    left_over = {
        name: _why_left_over(name, offered, proposed, table[name])
        for name in header
        if name not in used
    }
    return Proposal(
        path, tuple(proposed[name] for name in CHANNELS if name in proposed), left_over, notes
    )


def _surest(offered: Sequence[Guess]) -> dict[str, Guess]:
    """The surest guess for each channel; a column is used once."""
    guesses: dict[str, Guess] = {}
    used = set()
    for guess in sorted(offered, key=_rank):
        if guess.channel not in guesses and guess.column not in used:
            guesses[guess.channel] = guess
            used.add(guess.column)
    return guesses


def propose_each(paths: Sequence[Path]) -> list[Proposal]:
    """Propose for each of several tables of one run.

    A channel that two tables may have is taken from the one of which it is surer, or from the
    first; the others say so.

    Raises:
        RecordingError: As of `propose`.
    """
    proposals = [propose(path) for path in paths]
    surest: dict[str, tuple[Guess, Path]] = {}  # guess and its table, by channel
    for proposal in proposals:
        for guess in proposal.guesses:
            if guess.channel not in surest or _rank(guess) < _rank(surest[guess.channel][0]):
                surest[guess.channel] = guess, proposal.path
    return [_without_other_tables(proposal, surest) for proposal in proposals]


def _without_other_tables(proposal: Proposal, surest: Mapping[str, tuple[Guess, Path]]) -> Proposal:
    """The proposal for one of several tables without the channels that another has; all have a
    time."""
    left_over = dict(proposal.left_over)
    guesses = []
    for guess in proposal.guesses:
        used, path = surest[guess.channel]
        if guess.channel == "time_s" or path == proposal.path:
            guesses.append(guess)
        else:
            left_over[guess.column] = (
                f" (could be {guess.channel}, for which {used.column} of {path.name} is used)"
            )
    return replace(proposal, guesses=tuple(guesses), left_over=left_over)


def _dated(offered: list[Guess], table: pd.DataFrame) -> list[Guess]:
    """The guesses, with a date and the time of day beside it joined to one time."""
    times = [guess for guess in offered if guess.channel == "time_s"]
    days = [
        time for time in times if time.why.startswith("dates") and _of_few_days(table[time.column])
    ]
    hours = [time for time in times if time.why.startswith("times of day")]
    if not days or not hours:
        return offered
    date_and_time = replace(days[0], and_column=hours[0].column, why="a date and the time of day")
    return [date_and_time, *(guess for guess in offered if guess not in times)]


def _of_few_days(column: pd.Series[Any]) -> bool:
    """Whether a column holds dates without times of day: a recording has few of them."""
    return column.nunique() <= max(thresholds.LONGEST_RUN_S / 86400.0, 1.0)


def _rank(guess: Guess) -> tuple[int, int, int]:
    """The order of guesses: the surest first, then the name that is most like the channel's and has
    least beside it."""
    words, _ = _words(guess.column)
    channel_without_unit = guess.channel.rsplit("_", 1)[0]
    return guess.sure, int(channel_without_unit not in words), len(words)


def _less_sure(guess: Guess) -> Guess:
    """The guess, less sure where the name is that of an average or of one of several."""
    if guess.column == guess.channel:
        return guess
    words, _ = _words(guess.column)
    if words & _AVERAGED:
        return replace(guess, sure=LEAST_SURE, why=f"{guess.why}; an average")
    name = re.sub(r"[\[(<].*", "", guess.column.lower())  # without its unit
    if re.search(r"[a-z]\d+([^a-z\d]|$)", name):
        return replace(guess, sure=LEAST_SURE, why=f"{guess.why}; one of several by its number")
    return guess


def _beginning(path: Path) -> tuple[list[str], pd.DataFrame, tuple[str, ...], dict[str, str]]:
    """Names of the columns, their first rows, notes, and units by name where there is a line of
    them."""
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
        no_table = (
            f"is not a table; give a {kinds} or .parquet file (a bag has topics, not columns)"
        )
        raise RecordingError(why_no_recording(path) or no_table)
    text = tables.sniff(path)
    names = list(dict.fromkeys(name for name in text.header if name))
    if not names:
        raise RecordingError("has no names of columns in its first line")
    beginning = next(text.pieces(names), pd.DataFrame(columns=names)).iloc[:_ROWS]
    units = dict(zip(text.header, text.units, strict=False))
    return names, beginning, text.notes, units


def _by_program(header: list[str], table: pd.DataFrame) -> list[Guess]:
    """The columns of the program that wrote the table, where its mapping ships."""
    mapping = known_columns(header)
    if mapping is None:
        return []
    why = f"the mapping {mapping.name} that ships"
    guesses = []
    for channel, source in mapping.sources.items():
        for column, factor in source.terms:
            if channel not in mapping.unknown_if_zero or table[column].any():
                guesses.append(Guess(column, channel, factor, source.offset, sure=0, why=why))
    return guesses


def _guesses(name: str, column: pd.Series[Any], unit: str) -> list[Guess]:
    """The channels that a column may be, by its name."""
    name_and_unit = f"{name} [{unit}]" if unit else name
    words, unit_words = _words(name_and_unit)
    dated = from_text(column)
    numbers = numeric(column) if dated is None else dated[0]
    values = numbers.to_numpy(np.float64, na_value=np.nan)
    if not np.isfinite(values).any():
        return []
    if dated is not None:
        if name in _NAMES:
            return [_by_exact_name(name, values)]
        if _names_channel(words, "time_s"):
            _, taken_for = dated
            return [Guess(name, "time_s", factor=1.0, offset=0.0, sure=0, why=taken_for)]
        return []
    by_letter = _by_letter(name, name_and_unit, values)
    if by_letter is not None:
        return [by_letter]
    guesses: list[Guess | None] = []
    if name == "curR":  # beside curL; in other cases it is short for current
        guesses.append(_in_unit(name, "motor_right_a", values, unit_words))
    for channel in _NAMES:
        if name == channel:
            guesses.append(_by_exact_name(name, values))
        elif _names_channel(words, channel):
            guess = _in_unit(name, channel, values, unit_words)
            if guess is not None and channel == "soc" and words & _USED:
                guess = _turned(guess)
            guesses.append(guess)
    return [guess for guess in guesses if guess is not None]


def _by_exact_name(name: str, values: Array) -> Guess:
    guess = Guess(
        name, channel=name, factor=1.0, offset=0.0, sure=0, why="it has the channel's name"
    )
    return _signed(guess, values)


def _names_channel(words: set[str], channel: str) -> bool:
    """Whether the words of a column's name are those of a channel, and not of a counter or a limit
    of it."""
    if words & _COUNTED and channel not in _COUNTERS:
        return False
    if words & _NOT_MEASURED and channel != "time_s":
        return False
    groups, excluding = _NAMES[channel]
    if words & set(excluding.split()):
        return False
    return any(set(group.split("+")) <= words for group in groups.split())


def _turned(guess: Guess) -> Guess:
    """The guess for a state of charge whose column is the charge used."""
    return replace(
        guess,
        factor=-guess.factor,
        offset=1.0,
        sure=LEAST_SURE,
        why=f"{guess.why}; 1 minus what is used",
    )


def _by_letter(name: str, name_and_unit: str, values: Array) -> Guess | None:
    """The guess for a name that is a letter of formulas and a unit, such as "I mA" or "U [V]"."""
    parts = re.fullmatch(
        r"\s*([a-z])[\s_.\[(<]+([a-z]+)\s*[\])>]?\s*", name_and_unit, re.IGNORECASE
    )
    if parts is None:
        return None
    letter, unit = parts.groups()
    channel = _LETTERS.get(letter.lower())
    if channel is None:
        return None
    factor = UNITS[CHANNELS[channel].unit].get(unit.lower())
    if factor is None or not _possible(channel, values * factor):
        return None
    guess = Guess(name, channel, factor, offset=0.0, sure=LEAST_SURE, why=f"a letter and {unit}")
    return _signed(guess, values)


def _by_unit(
    header: list[str], table: pd.DataFrame, units: dict[str, str], offered: list[Guess]
) -> list[Guess]:
    """Guesses by the unit alone, for channels and columns of which nothing else says anything."""
    explained = {guess.channel for guess in offered} | {guess.column for guess in offered}
    unit_of = {name: units.get(name) or _bracket(name) for name in header if name not in explained}
    guesses = []
    for channel, units_of_channel in _BY_UNIT.items():
        names = [
            name
            for name, unit in unit_of.items()
            if unit in units_of_channel and not _is_of_other(name)
        ]
        if channel in explained or len(names) != 1:
            continue
        name = names[0]
        unit = unit_of[name]
        values = numeric(table[name]).to_numpy(np.float64, na_value=np.nan)
        factor = UNITS[units_of_channel[0]][unit.lower()]
        if np.isfinite(values).any() and _possible(channel, values * factor):
            why = f"only its unit, {unit}, says so"
            guesses.append(
                _signed(Guess(name, channel, factor, offset=0.0, sure=LEAST_SURE, why=why), values)
            )
    return guesses


def _is_of_other(name: str) -> bool:
    """Whether a column is of something else than the whole battery, or not measured."""
    words, _ = _words(name)
    return bool(words & _OF_OTHERS)


def _bracket(name: str) -> str:
    """What stands in the first brackets of a name; "" where there are none."""
    brackets = _BRACKETS.findall(name)
    return str(brackets[0]) if brackets else ""


def _in_unit(name: str, channel: str, values: Array, unit_words: list[str]) -> Guess | None:
    """The guess with the unit that the name gives or, failing that, the values; None where neither
    is possible."""
    for word in unit_words:
        if word in UNITS[CHANNELS[channel].unit]:
            guess = _in_named_unit(name, channel, values, word)
            if guess is not None:
                return guess
    return _in_unit_of_values(name, channel, values)


def _in_named_unit(name: str, channel: str, values: Array, word: str) -> Guess | None:
    """The guess with the unit that a word of the name gives; None where the values are impossible
    in it."""
    info = CHANNELS[channel]
    factor = UNITS[info.unit][word]
    offset = OFFSETS.get(word, 0.0) if channel == "temperature_c" else 0.0
    if channel == "soc" and np.nanmax(values) <= info.high:
        why = f"its name says {word}, and its values lie in 0 to 1"
        return Guess(name, channel, factor=1.0, offset=0.0, sure=1, why=why)
    if not _possible(channel, values * factor + offset):
        return None
    return _signed(
        Guess(name, channel, factor, offset, sure=0, why=f"its name says {word}"), values
    )


def _in_unit_of_values(name: str, channel: str, values: Array) -> Guess | None:
    """The guess with the unit that the values fit, the channel's own first; None where they fit
    none."""
    info = CHANNELS[channel]
    for unit, factor in [(info.unit, 1.0), *info.mistaken]:
        if not _possible(channel, values * factor) or not _plausible(channel, values * factor):
            continue
        is_own_unit = factor == 1.0
        why = f"values fit {unit}"
        if is_own_unit:
            why = (
                "its values lie in 0 to 1"
                if info.unit == "1"
                else f"its name says no unit; values fit {unit}"
            )
        if channel == "time_s" and values[0] > thresholds.EPOCH_COUNT:
            why = "its name says no unit; a count since 1970, whose size shows its unit"
        step_s = (
            float(np.median(np.diff(values))) if channel == "time_s" and len(values) > 1 else 0.0
        )
        if not is_own_unit and thresholds.SLOW_STEP_S < step_s < thresholds.LONGEST_STEP_S:
            why = f"{why}, or seconds with a sample every {step_s:.3g} s"
        sure = 1 if is_own_unit else LEAST_SURE
        return _signed(Guess(name, channel, factor, 0.0, sure, why, by_values=True), values)
    return None


def _possible(channel: str, values: Array) -> bool:
    """Whether values in SI units are within the limits of a channel, but for strays; a time
    increases."""
    finite = values[np.isfinite(values)]
    if channel == "time_s":
        steps_s = np.diff(finite)
        if not len(steps_s):
            return False
        increases = (steps_s >= 0.0).mean() > thresholds.INCREASING_SHARE
        return bool(increases and values[0] > thresholds.EARLIEST_S)
    return float(np.mean(CHANNELS[channel].impossible(finite))) <= thresholds.STRAY_SHARE


def _plausible(channel: str, values: Array) -> bool:
    """Whether values without a unit are in the typical range of a ground robot, beyond being
    possible."""
    if channel == "time_s":
        step_s = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
        # The reader infers the unit of an epoch in ms to ns.
        return 0.0 < step_s < thresholds.SLOW_STEP_S or values[0] > thresholds.EPOCH_COUNT
    largest = float(np.abs(values[np.isfinite(values)]).max())
    return largest <= thresholds.TYPICAL_SIZES.get(channel, np.inf)


def _signed(guess: Guess, values: Array) -> Guess:
    """The guess with the sign of battery current or power turned where it is mostly negative."""
    if guess.channel in ("current_a", "power_w") and float(np.nanmedian(values)) < 0.0:
        why = f"{guess.why}; mostly negative, so assumed to be negative when discharging"
        return replace(guess, factor=-guess.factor, sure=LEAST_SURE, why=why)
    if guess.channel in ("grade_rad", "heading_rad") and "pitch" in guess.column.lower():
        return replace(guess, sure=LEAST_SURE, why=f"{guess.why}; uphill must be positive")
    return guess


def _words(name: str) -> tuple[set[str], list[str]]:
    """Words of a column's name, and those that may be its unit: what is in brackets, and its last
    words."""
    plain = re.sub(r"[\[(<][^\])>]*[\])>]", " ", name)  # without what is in brackets
    with_spaces = re.sub(r"([a-z])([A-Z])", r"\1 \2", plain)  # motorTemp is motor temp
    parts = _lower_words(with_spaces)
    unsplit = _lower_words(plain)  # mA, which was split as m and A
    # v_in is vin
    joined = [word.replace("_", "").lower() for word in re.split(r"[^a-zA-Z_]+", plain)]
    words = {*parts, *unsplit, *joined}
    for word in (*parts, *unsplit, *joined):
        words.update(word.split("/"))
    for ending in _COMPOUND:
        if any(word.endswith(ending) for word in words):
            words.add(ending)
    units = [
        unit.replace("µ", "u").replace("^-1", "").replace(".", "").lower()
        for unit in _BRACKETS.findall(name)
    ]
    if len(parts) > 1 or len(unsplit) > 1:
        # the last words first
        units += ["/".join(parts[-2:]), *reversed(unsplit), *reversed(parts)]
    return words, units


def _lower_words(text: str) -> list[str]:
    return [word.lower() for word in re.split(r"[^a-zA-Z°%µ/]+", text) if word]


def _why_left_over(
    name: str, offered: list[Guess], proposed: dict[str, Guess], column: pd.Series[Any]
) -> str:
    """What a column that is not used could be, in brackets; "" where nothing is known of it."""
    could_be = [guess.channel for guess in offered if guess.column == name]
    if could_be:
        return f" (could be {could_be[0]}, for which {proposed[could_be[0]].column} is used)"
    words, _ = _words(name)
    time_words, _ = _NAMES["time_s"]
    if words & set(time_words.split()) and not pd.api.types.is_numeric_dtype(column):
        return " (neither numbers nor times such as 2024-05-01T12:00:00.1)"
    return ""
