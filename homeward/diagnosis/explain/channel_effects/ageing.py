"""Ageing by the state of charge: a capacity that shrinks from run to run."""

import numpy as np
import pandas as pd
from numpy.random import Generator
from scipy.stats import spearmanr

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import battery
from homeward.diagnosis.explain.channel_effects.inside import matters
from homeward.diagnosis.explain.channel_effects.reading import Reading
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Value
from homeward.logs.channels import Array, Index
from homeward.physics import Robot


def fading(
    channel: Reading, runs: Runs, robot: Robot, drawn: Array, rng: Generator
) -> ChannelEffect | None:
    """A battery that fades: in each run the charge falls faster by what was drawn, (known windows,
    1), than before."""
    numbers = np.unique(channel.run)
    if len(numbers) < thresholds.FEWEST_RUNS:
        return None
    per_run = channel.per_run(drawn)
    rate, errors = channel.fit(per_run)
    slower_again = np.diff(rate) < -thresholds.CLEAR * (errors[1:] + errors[:-1])
    if slower_again.any() or rate[-1] <= rate[0]:
        return None
    proof = channel.proof(drawn, per_run[:, 1:], rng)
    if proof is None:
        return None
    # A charge that falls so many times as fast is that of a battery with one over so much of its
    # energy.
    lost_by_run = np.zeros(len(runs.signals))
    lost_by_run[numbers] = np.clip(1.0 - 1.0 / np.maximum(rate, 1e-9), 0.0, None)
    lost_now = _lost_in_last(robot, float(rate[-1]), thresholds.NORMAL_95 * float(errors[-1]))
    lost = lost_by_run[runs.run]
    lost_w = np.maximum(runs.observed, 0.0) * lost / (1.0 - lost)
    # No battery that has lost more than the effect allows drives a robot: its reading is wrong.
    switch = battery.AGEING.entry.switch
    if not matters(lost_w, runs) or max(lost_now.value, lost_by_run.max()) > switch.high:
        return None
    explained = proof.held_out_gain or 0.0
    return ChannelEffect(
        hypothesis=battery.AGEING,
        parameters={switch.name: lost_now},
        contribution=lost_w,
        proof=proof,
        rivals=_confounders(rate, runs, numbers),
        sentence="The battery fades from run to run, as the state of charge falls faster than the energy drawn "
        f"implies: in the last run {lost_now.value:.0%} of the usable energy is lost, which explains {explained:.0%} "
        "of the held-out squared error of the state of charge.",
    )


def _lost_in_last(robot: Robot, rate: float, half_width: float) -> Value:
    """Share of the usable energy that is lost in the last run, whose charge falls `rate` +-
    `half_width` times as fast."""
    usable_in_file = 1.0 - battery.AGEING.in_file(robot)[0]

    def lost(times_as_fast: float) -> float:
        return 1.0 - usable_in_file / max(times_as_fast, 1e-9)

    interval = (max(lost(rate - half_width), 0.0), lost(rate + half_width))
    return Value(lost(rate), interval, "1")


def _confounders(rate: Array, runs: Runs, numbers: Index) -> tuple[str, ...]:
    """Confounders of ageing: cold or load, where they are rank-correlated with the faster fall of
    the charge."""
    confounders: list[str] = []
    load = pd.Series(runs.observed).groupby(runs.run).mean()[numbers]
    if spearmanr(rate, load).statistic > thresholds.NEARLY_ALL:
        confounders.append(battery.CONFOUNDED_WITH_LOAD)
    air_c = runs.context.get("temperature_c")
    if air_c is None:  # it may have become colder unseen
        return (*confounders, battery.CONFOUNDED_WITH_COLD)
    warmth = pd.Series(air_c).groupby(runs.run).mean()[numbers]
    if np.ptp(warmth) > 0.0 and spearmanr(rate, warmth).statistic < -thresholds.NEARLY_ALL:
        confounders.append(battery.CONFOUNDED_WITH_COLD)
    return tuple(confounders)
