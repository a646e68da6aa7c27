"""Guesses tried on physics before they are called certain: ways, powers and changes of speed that they would give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from homeward.logs import thresholds, unknown
from homeward.logs.channels import CHANNELS, Array
from homeward.logs.columns import numeric
from homeward.logs.contradictions import Twice, measured_twice
from homeward.logs.doubts import doubts
from homeward.logs.guess import LEAST_SURE, UNITS, Guess
from homeward.logs.times import from_epoch, from_text, is_epoch

_ANGLES = {"heading_rad", "yaw_rate_radps"}
"""Channels whose noise adds to the angle turned, so that only a ratio that is a unit counts."""


def tried_on_physics(guesses: Mapping[str, Guess], table: pd.DataFrame) -> dict[str, Guess]:
    """The guesses by channel: with the unit that physics shows where the name gives none, and less sure in doubt.

    Args:
        guesses: The guess for each channel.
        table: First rows of the file.
    """
    tried = dict(guesses)
    if "time_s" not in tried:
        return tried
    tried |= _by_changes_of_speed(tried, table)
    for pair in measured_twice(_channels(tried, table)):
        tried |= _by_ratio(pair, tried, _channels(tried, table))
    for name, line in doubts(_channels(tried, table)).items():
        tried[name] = _doubted(tried[name], line)
    return tried


def _channels(guesses: Mapping[str, Guess], table: pd.DataFrame) -> dict[str, Array]:
    """Values of the guessed channels in the rows whose time is known, as the reader would take them."""
    time_s = _values(guesses["time_s"], table)
    is_finite = np.isfinite(time_s)
    channels = {"time_s": from_epoch(time_s[is_finite])[0]}
    for name, guess in guesses.items():
        if name != "time_s":
            values = _values(guess, table)[is_finite]
            unknown.left_out(name, values)
            values[CHANNELS[name].impossible(values)] = np.nan
            channels[name] = values
    return channels


def _values(guess: Guess, table: pd.DataFrame) -> Array:
    total = np.zeros(len(table))
    for name in filter(None, (guess.column, guess.and_column)):
        as_time = from_text(table[name]) if guess.channel == "time_s" else None
        column = numeric(table[name]) if as_time is None else as_time[0]
        total += column.to_numpy(np.float64, na_value=np.nan) * guess.factor
    return total + guess.offset


def _by_changes_of_speed(guesses: Mapping[str, Guess], table: pd.DataFrame) -> dict[str, Guess]:
    """The time in a longer unit where its name gives none, and the speed would typically change faster than wheels'
    grip allows: seconds that look like milliseconds."""
    time = guesses["time_s"]
    if not time.by_values or "speed_mps" not in guesses:
        return {}
    channels = _channels(guesses, table)
    is_known = np.isfinite(channels["speed_mps"])
    time_s, speed_mps = channels["time_s"][is_known], channels["speed_mps"][is_known]
    steps_s, changes_mps = np.diff(time_s), np.abs(np.diff(speed_mps))
    moving = (steps_s > 0.0) & (changes_mps > 0.0)
    if not moving.any() or is_epoch(float(time_s[0])):
        return {}
    typical_mps2 = float(np.median(changes_mps[moving] / steps_s[moving]))
    most_mps2 = thresholds.FASTEST_CHANGES["speed_mps"]
    if typical_mps2 <= most_mps2:
        return {}
    for word, factor in sorted(UNITS["s"].items(), key=lambda unit: unit[1]):
        if factor > time.factor and typical_mps2 * time.factor / factor <= most_mps2:
            why = f"as {_unit_of(time)} the speed would change by {typical_mps2:.3g} m/s2, so it is in {word}"
            return {"time_s": replace(time, factor=factor, sure=1, why=why)}
    return {}


def _by_ratio(pair: Twice, guesses: Mapping[str, Guess], channels: Mapping[str, Array]) -> dict[str, Guess]:
    """What the ratio of an amount that is measured twice says of the guesses."""
    now = next((twice for twice in measured_twice(channels) if twice[:2] == pair[:2]), None)
    if now is None or (_ANGLES & {*now.channels} and now.unit is None):
        return {}
    of_pair = [guesses[name] for name in now.channels]
    if now.agree:
        others = {now.what: now.reference, now.reference: now.what}
        return {guess.channel: replace(guess, why=f"{guess.why}; agrees with {others[guess.channel]}")
                for guess in of_pair if guess.channel in others}  # fmt: skip
    repaired = list(_repairs(now, guesses))
    said = f"{now.what} is {now.ratio:.3g} times that of {now.reference}"
    if len(repaired) == 1:
        guess, word = repaired[0]
        sure = LEAST_SURE if guess.factor < 0.0 else 1  # sizes agree, whatever the sign
        return {guess.channel: replace(guess, sure=sure, why=f"{guess.why}; yet in {word}, as {said} otherwise")}
    if not now.is_long_enough:
        return {}
    return {guess.channel: _doubted(guess, f"{said}: one has another unit, or is another amount") for guess in of_pair}


def _repairs(pair: Twice, guesses: Mapping[str, Guess]) -> list[tuple[Guess, str]]:
    """Guesses whose unit their values gave, each with another unit by which the pair agrees, and its name."""
    repairs = []
    for name, power in pair.powers.items():
        guess = guesses[name]
        if not guess.by_values or power == 0:
            continue
        size = abs(guess.factor)
        by_factor = {factor: word for word, factor in reversed(UNITS[CHANNELS[name].unit].items())}
        for factor, word in by_factor.items():
            ratio = pair.ratio * (factor / size) ** power
            if factor != size and abs(np.log(ratio)) < thresholds.UNIT_LOG_RATIO:
                repairs.append((replace(guess, factor=float(np.copysign(factor, guess.factor))), word))
    return repairs


def _unit_of(guess: Guess) -> str:
    units = UNITS[CHANNELS[guess.channel].unit].items()
    return next((word for word, factor in units if factor == guess.factor), CHANNELS[guess.channel].unit)


def _doubted(guess: Guess, line: str) -> Guess:
    return replace(guess, sure=LEAST_SURE, why=f"{guess.why}; {line}")
