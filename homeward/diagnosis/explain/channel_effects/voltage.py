"""What the voltage shows: it sags by the current times a resistance, which may fall with warmth."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.random import Generator

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import battery
from homeward.diagnosis.explain.channel_effects.inside import inside_w, matters
from homeward.diagnosis.explain.channel_effects.reading import Reading
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect, values_of
from homeward.diagnosis.explain.hypothesis import TINY
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Index
from homeward.physics import Robot


def sag(robot: Robot, runs: Runs, block: Index, rng: Generator) -> ChannelEffect | None:
    """Resistance by the voltage, beside the file's, where it loses a material share of the energy."""
    voltage_v = runs.context.get("voltage_v", np.zeros(1))
    known = voltage_v > 0.0
    if runs.unit != "W" or not known.any():
        return None
    resistance, cold = battery.INTERNAL_RESISTANCE, battery.COLD_BATTERY.id
    given_ohm = resistance.in_file(robot)[0]
    current_a = np.where(known, runs.observed / np.where(known, voltage_v, 1.0), 0.0)
    in_file_v = given_ohm * current_a + _cold_in_file_v(robot, runs, current_a)
    channel = Reading(np.where(known, voltage_v + in_file_v, np.nan), runs, block)
    # Open-circuit voltage falls with the charge drawn, and the terminals' with the current.
    base, drawn = channel.summed(current_a)[:, None], -channel.within(current_a)[:, None]
    coefficients, errors = channel.fit(np.hstack([base, drawn]))
    ohm, wide = float(coefficients[-1]), thresholds.NORMAL_95 * float(errors[-1])
    lost_w = max(ohm, 0.0) * current_a**2
    proof = channel.proof(base, drawn, rng) if matters(lost_w, runs) else None
    total_ohm = given_ohm + ohm
    if proof is None or total_ohm > resistance.entry.switch.high:
        return None
    by_warmth = _Warmth.of(channel, base, drawn, current_a, runs)
    shown = None if by_warmth is None else by_warmth.effect(robot, rng)
    if shown is not None:
        return shown
    air_c = runs.context.get("temperature_c")
    may_be_cold = air_c is None or float(np.nanmean(air_c)) < thresholds.COLD_C
    return ChannelEffect(
        resistance,
        values_of(resistance, total_ohm, (total_ohm - wide, total_ohm + wide), {}),
        lost_w,
        proof,
        (cold,) if may_be_cold else (),
        f"The voltage sags by {total_ohm:.3g} ohm times the current.",
    )


def _cold_in_file_v(robot: Robot, runs: Runs, current_a: Array) -> Array:
    """Sag by a cold battery that the file has, V, shape (windows,), where it grows with power."""
    cold = battery.COLD_BATTERY.id
    numbers = robot.effects.get(cold, {})
    if not numbers.get(battery.COLD_W.name):
        return np.zeros(len(current_a))
    lost_w = inside_w(dataclasses.replace(robot, effects={cold: numbers}), runs)
    return np.asarray(lost_w / np.where(current_a > 0.0, current_a, np.inf))


@dataclass(frozen=True)
class _Warmth:
    """Designs of the voltage with a resistance that falls with warmth, and its rivals."""

    channel: Reading
    runs: Runs
    current_a: Array  # (windows,)
    warmth_k: Array  # over the mean of the runs, (windows,)
    base: Array
    drawn: Array
    warmer: Array

    @classmethod
    def of(cls, channel: Reading, base: Array, drawn: Array, current_a: Array, runs: Runs) -> "_Warmth | None":
        """The designs; None without an air temperature."""
        air_c = runs.context.get("temperature_c", np.full(1, np.nan))
        if not np.isfinite(air_c).all():
            return None
        warmth_k = air_c - np.mean(air_c)
        warmer = channel.within(current_a * warmth_k)[:, None]
        return cls(channel, runs, current_a, warmth_k, base, drawn, warmer)

    @property
    def by_warmth(self) -> Array:
        """The resistance falls in proportion to warmth."""
        return np.hstack([self.base, self.drawn, self.warmer])

    @property
    def bent(self) -> Array:
        """The same with a bend."""
        bend = self.channel.within(self.current_a * self.warmth_k**2)[:, None]
        return np.hstack([self.by_warmth, bend])

    @property
    def rivals(self) -> tuple[Array, Array]:
        """A resistance that differs from run to run, and one that changes as the battery empties."""
        emptied = pd.Series(self.current_a * self.runs.duration_s).groupby(self.runs.run).cumsum().to_numpy()
        later = self.channel.within(self.current_a * emptied)[:, None]
        return np.hstack([self.base, self.channel.per_run(self.drawn)]), np.hstack([self.base, self.drawn, later])

    def effect(self, robot: Robot, rng: Generator) -> ChannelEffect | None:
        """A cold battery, where the resistance falls with warmth, and explains the voltage no worse than its rivals.

        The resistance is named as a rival where it explains the voltage no better than one of these.
        """
        cold, channel = battery.COLD_BATTERY, self.channel
        if cold.in_file(robot)[0]:
            return None
        coefficients, errors = channel.fit(self.by_warmth)
        ohm, per_k = float(coefficients[-2]), float(coefficients[-1])
        mean_c = float(np.mean(self.runs.context["temperature_c"]))
        warm_c = mean_c + ohm / max(per_k, TINY)
        reference_w = float(np.median(self.runs.observed[self.runs.observed > 0.0]))
        voltage_v = self.runs.context["voltage_v"]
        share_per_ohm = reference_w / float(np.mean(voltage_v[voltage_v > 0.0]) ** 2 + ohm * reference_w)
        size, wide = share_per_ohm * per_k, share_per_ohm * thresholds.NORMAL_95 * float(errors[-1])
        if size > cold.entry.switch.high or not battery.WARM_C.low <= warm_c <= battery.WARM_C.high:
            return None
        rivals, own = self.rivals, (self.by_warmth, self.bent)
        better = max(min(channel.delta_bic(design, rival) for design in own) for rival in rivals)
        if better >= thresholds.STRONG_BIC:
            return None
        if channel.proof(np.hstack([self.base, self.drawn]), self.warmer, rng) is None:
            return None
        proof = channel.proof(self.base, np.hstack([self.drawn, self.warmer]), rng)
        if proof is None:
            return None
        clear = all(channel.delta_bic(rival, self.by_warmth) >= thresholds.STRONG_BIC for rival in rivals)
        shape = {battery.WARM_C.name: warm_c, battery.COLD_W.name: reference_w}
        return ChannelEffect(
            cold,
            values_of(cold, size, (size - wide, size + wide), shape),
            np.maximum(ohm - per_k * self.warmth_k, 0.0) * self.current_a**2,
            proof,
            () if clear else (battery.INTERNAL_RESISTANCE.id,),
            f"The voltage sags by {ohm:.3g} ohm times the current, and by {per_k:.2g} ohm less for each kelvin of "
            "warmth.",
        )
