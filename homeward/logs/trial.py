"""Guesses tried on physics before they are called certain: ways, powers and changes of speed that
they would give."""

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
    """The guesses by channel: with the unit that physics shows where the name gives none, and less
    sure in doubt.

    Args:
        guesses: The guess for each channel.
        table: First rows of the file.
    """
    revised = dict(guesses)
    if "time_s" not in revised:
        return revised
    revised |= _by_changes_of_speed(revised, table)
    for pair in measured_twice(_channels(revised, table)):
        revised |= _by_ratio(pair, revised, _channels(revised, table))
    for name, line in doubts(_channels(revised, table)).items():
        revised[name] = _doubted(revised[name], line)
    return revised


def _channels(guesses: Mapping[str, Guess], table: pd.DataFrame) -> dict[str, Array]:
    """Values of the guessed channels in the rows whose time is known, as the reader would take
    them."""
    times = _values(guesses["time_s"], table)
    is_known = np.isfinite(times)
    time_s, _ = from_epoch(times[is_known])
    channels = {"time_s": time_s}
    for name, guess in guesses.items():
        if name == "time_s":
            continue
        values = _values(guess, table)[is_known]
        unknown.left_out(name, values)
        values[CHANNELS[name].impossible(values)] = np.nan
        channels[name] = values
    return channels


def _values(guess: Guess, table: pd.DataFrame) -> Array:
    """Values of a guessed channel, SI, in all rows."""
    total = np.zeros(len(table))
    for name in (guess.column, guess.and_column):
        if not name:
            continue
        dated = from_text(table[name]) if guess.channel == "time_s" else None
        column = numeric(table[name]) if dated is None else dated[0]
        total += column.to_numpy(np.float64, na_value=np.nan) * guess.factor
    return total + guess.offset


def _by_changes_of_speed(guesses: Mapping[str, Guess], table: pd.DataFrame) -> dict[str, Guess]:
    """The time in a longer unit where its name gives none, and the speed would typically change
    faster than wheels' grip allows: seconds that look like milliseconds."""
    time = guesses["time_s"]
    if not time.by_values or "speed_mps" not in guesses:
        return {}
    channels = _channels(guesses, table)
    is_known = np.isfinite(channels["speed_mps"])
    time_s = channels["time_s"][is_known]
    steps_s = np.diff(time_s)
    changes_mps = np.abs(np.diff(channels["speed_mps"][is_known]))
    is_change = (steps_s > 0.0) & (changes_mps > 0.0)
    if not is_change.any() or is_epoch(float(time_s[0])):
        return {}
    typical_mps2 = float(np.median(changes_mps[is_change] / steps_s[is_change]))
    largest_mps2 = thresholds.FASTEST_CHANGES["speed_mps"]
    if typical_mps2 <= largest_mps2:
        return {}
    for word, factor in sorted(UNITS["s"].items(), key=lambda unit: unit[1]):
        if factor > time.factor and typical_mps2 * time.factor / factor <= largest_mps2:
            why = f"as {_unit_of(time)} the speed would change by {typical_mps2:.3g} m/s2, so it is in {word}"
            return {"time_s": replace(time, factor=factor, sure=1, why=why)}
    return {}


def _by_ratio(
    pair: Twice, guesses: Mapping[str, Guess], channels: Mapping[str, Array]
) -> dict[str, Guess]:
    """What the ratio of an amount that is measured twice says of the guesses."""
    # An earlier pair may have changed a unit since this one was compared.
    pairs = {(twice.what, twice.reference): twice for twice in measured_twice(channels)}
    now = pairs.get((pair.what, pair.reference))
    if now is None:
        return {}
    has_angle = not _ANGLES.isdisjoint(now.channels)
    if has_angle and now.unit is None:
        return {}
    if now.agree:
        return _agreeing(now, guesses)
    repairs = _repairs(now, guesses)
    ratio = f"{now.what} is {now.ratio:.3g} times that of {now.reference}"
    if len(repairs) == 1:
        guess, word = repairs[0]
        sure = LEAST_SURE if guess.factor < 0.0 else 1  # sizes agree, whatever the sign
        return {
            guess.channel: replace(
                guess, sure=sure, why=f"{guess.why}; yet in {word}, as {ratio} otherwise"
            )
        }
    if not now.is_long_enough:
        return {}
    doubt = f"{ratio}: one has another unit, or is another amount"
    return {name: _doubted(guesses[name], doubt) for name in now.channels}


def _agreeing(pair: Twice, guesses: Mapping[str, Guess]) -> dict[str, Guess]:
    """The guesses that a pair confirms, which say so; not those of wheels or a product, which are
    two each."""
    confirmed = {}
    for name, reference in ((pair.what, pair.reference), (pair.reference, pair.what)):
        if name in guesses:
            confirmed[name] = replace(
                guesses[name], why=f"{guesses[name].why}; agrees with {reference}"
            )
    return confirmed


def _repairs(pair: Twice, guesses: Mapping[str, Guess]) -> list[tuple[Guess, str]]:
    """Guesses whose unit their values gave, each with another unit by which the pair agrees, and
    its name."""
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
                repairs.append(
                    (replace(guess, factor=float(np.copysign(factor, guess.factor))), word)
                )
    return repairs


def _unit_of(guess: Guess) -> str:
    units = UNITS[CHANNELS[guess.channel].unit].items()
    return next(
        (word for word, factor in units if factor == guess.factor), CHANNELS[guess.channel].unit
    )


def _doubted(guess: Guess, line: str) -> Guess:
    return replace(guess, sure=LEAST_SURE, why=f"{guess.why}; {line}")
