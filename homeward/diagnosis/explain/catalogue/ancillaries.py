"""Loads beside the drive: standby, computing, radio, heater, and intermittent devices."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from homeward.diagnosis.explain.change_points import Schedule
from homeward.diagnosis.explain.hypothesis import (
    Hypothesis,
    Numbers,
    Setting,
    Spread,
    everywhere,
    temperatures,
)
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array
from homeward.physics.effects import compute, cooler, heater, intermittent_load, radio, standby

_ON_BELOW_C = heater.EFFECT.parameters[1]
_ON_ABOVE_C = cooler.EFFECT.parameters[1]
_UP_TO_M = radio.EFFECT.parameters[1]
# thermostats of outdoor enclosures switch on at 5 and off at 15 degC (Stego KTO 011, data sheet)
_OFF_ABOVE_C = 15.0


def _while_cold(hypothesis: Hypothesis, setting: Setting) -> Array | None:
    """Full power while cold enough for a thermostat, with the mean of a proportional heater."""
    temperature_c = setting.runs.context.get("temperature_c")
    if temperature_c is None:
        return None
    return _full_power(_OFF_ABOVE_C - temperature_c)


def _while_hot(hypothesis: Hypothesis, setting: Setting) -> Array | None:
    """Full power while hot enough for a thermostat, with the mean of a proportional cooler."""
    temperature_c = setting.runs.context.get("temperature_c")
    if temperature_c is None:
        return None
    return _full_power(temperature_c - _ON_ABOVE_C.default)


def _full_power(beyond_k: Array) -> Array | None:
    """The mean of positive temperature differences where they are positive, else 0, shape
    (windows,); None where they never are."""
    is_beyond = beyond_k > 0.0
    if not is_beyond.any():
        return None
    return np.asarray(is_beyond * float(np.mean(beyond_k[is_beyond])))


def _at_any_rate(setting: Setting) -> Iterator[Numbers]:
    """All of the computer's power at any sensing rate above zero."""
    yield {"base_share": 1.0}


def _farthest(runs: Runs) -> Numbers:
    """The largest recorded distance, up to which the radio's power is known."""
    return {_UP_TO_M.name: float(np.nanmax(runs.context["base_distance_m"]))}


def _rhythm(schedule: Schedule, runs: Runs) -> tuple[Numbers, Spread]:
    """Mean period and duty cycle of an intermittent load, and their intervals over the cycles."""
    on = schedule.level > 0
    switches_on = (np.diff(on.astype(int)) > 0) & (np.diff(runs.run) == 0)
    starts = np.flatnonzero(switches_on) + 1
    periods_s: list[float] = []
    duties: list[float] = []
    for start, end in pairwise(starts):
        if runs.run[start] == runs.run[end]:
            periods_s.append(float(runs.time_s[end] - runs.time_s[start]))
            duties.append(float(on[start:end].mean()))
    if not periods_s:  # no whole cycle: two changes make one
        periods_s.append(2.0 * float(runs.duration_s.sum()) / max(schedule.changes, 1))
        duties.append(float(on.mean()))
    window_s = float(np.median(runs.duration_s))  # resolution of a moment
    period_s, period_interval = _mean_within(periods_s, window_s, 1.0, 1e5)
    duty, duty_interval = _mean_within(duties, window_s / float(np.mean(periods_s)), 0.01, 0.99)
    return {"period_s": period_s, "duty": duty}, {
        "period_s": period_interval,
        "duty": duty_interval,
    }


def _mean_within(
    values: Sequence[float], resolution: float, low: float, high: float
) -> tuple[float, tuple[float, float]]:
    """Mean of the cycles and its interval, within the bounds of the parameter."""
    mean = float(np.mean(values))
    half_width = 2.0 * float(np.hypot(np.std(values), resolution) / np.sqrt(len(values)))
    return float(np.clip(mean, low, high)), (
        max(mean - half_width, low),
        min(mean + half_width, high),
    )


HYPOTHESES = (
    # On from some moment on: a constant load is confounded with the idle power.
    Hypothesis(
        standby.EFFECT,
        steady=None,
        changes="once",
        load=everywhere,
        check="unplug one device after the other with a clamp meter on the battery lead",
    ),
    # Constant at any sensing rate above zero, proportional to the rate, or any rising function of
    # it.
    Hypothesis(
        compute.EFFECT,
        shapes=_at_any_rate,
        rises_with="sensing_hz",
        check="put a clamp meter on the lead of the computer",
    ),
    # The data rate falls in steps with distance, and the airtime rises; constant beyond the
    # recorded distance.
    Hypothesis(
        radio.EFFECT,
        rises_with="base_distance_m",
        reach=_farthest,
    ),
    # Proportional to the cold, any rising function of it, or switched by a thermostat while it is
    # cold.
    Hypothesis(
        heater.EFFECT,
        shapes=temperatures(_ON_BELOW_C),
        rises_with="-temperature_c",
        changes="in the cold",
        load=_while_cold,
        searched=(_ON_BELOW_C,),
    ),
    # Proportional to the heat above a set point, any rising function of it, or switched by a
    # thermostat while it is hot.
    Hypothesis(
        cooler.EFFECT,
        shapes=temperatures(_ON_ABOVE_C),
        rises_with="temperature_c",
        changes="in the heat",
        load=_while_hot,
        searched=(_ON_ABOVE_C,),
    ),
    Hypothesis(
        intermittent_load.EFFECT,
        steady=None,
        changes="repeatedly",
        load=everywhere,
        rhythm=_rhythm,
        otherwise="in stretches that repeat",
        check="log a clamp meter on each device for the length of a drive",
    ),
)
