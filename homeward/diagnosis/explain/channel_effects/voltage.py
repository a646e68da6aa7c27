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
    """Resistance by the voltage, beside the file's, where it loses a material share of the
    energy."""
    voltage_v = runs.context.get("voltage_v", np.zeros(1))
    is_known = voltage_v > 0.0
    if runs.unit != "W" or not is_known.any():
        return None
    resistance = battery.INTERNAL_RESISTANCE
    in_file_ohm = resistance.in_file(robot)[0]
    current_a = np.where(is_known, runs.observed / np.where(is_known, voltage_v, 1.0), 0.0)
    in_file_v = in_file_ohm * current_a + _cold_in_file_v(robot, runs, current_a)
    channel = Reading(np.where(is_known, voltage_v + in_file_v, np.nan), runs, block)
    # Open-circuit voltage falls with the charge drawn, and the terminals' with the current.
    base = channel.summed(current_a)[:, None]
    drawn = -channel.within(current_a)[:, None]
    coefficients, errors = channel.fit(np.hstack([base, drawn]))
    added_ohm = float(coefficients[-1])
    half_width = thresholds.NORMAL_95 * float(errors[-1])
    lost_w = max(added_ohm, 0.0) * current_a**2
    if not matters(lost_w, runs):
        return None
    proof = channel.proof(base, drawn, rng)
    total_ohm = in_file_ohm + added_ohm
    if proof is None or total_ohm > resistance.entry.switch.high:
        return None
    by_warmth = _Warmth.of(channel, base, drawn, current_a, runs)
    cold_battery = None if by_warmth is None else by_warmth.effect(robot, rng)
    if cold_battery is not None:
        return cold_battery
    air_c = runs.context.get("temperature_c")
    rivals: tuple[str, ...] = ()
    if air_c is None or float(np.nanmean(air_c)) < thresholds.COLD_C:
        rivals = (battery.COLD_BATTERY.id,)
    return ChannelEffect(
        hypothesis=resistance,
        parameters=values_of(
            resistance, total_ohm, (total_ohm - half_width, total_ohm + half_width), {}
        ),
        contribution=lost_w,
        proof=proof,
        rivals=rivals,
        sentence=f"The voltage sags by {total_ohm:.3g} ohm times the current.",
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
    def of(
        cls, channel: Reading, base: Array, drawn: Array, current_a: Array, runs: Runs
    ) -> "_Warmth | None":
        """The designs; None without an air temperature."""
        air_c = runs.context.get("temperature_c", np.full(1, np.nan))
        if not np.isfinite(air_c).all():
            return None
        warmth_k = air_c - np.mean(air_c)
        warmer = channel.within(current_a * warmth_k)[:, None]
        return cls(
            channel=channel,
            runs=runs,
            current_a=current_a,
            warmth_k=warmth_k,
            base=base,
            drawn=drawn,
            warmer=warmer,
        )

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
        """A resistance that differs from run to run, and one that changes as the battery
        empties."""
        drawn_as = pd.Series(self.current_a * self.runs.duration_s)
        emptied_as = drawn_as.groupby(self.runs.run).cumsum().to_numpy()
        later = self.channel.within(self.current_a * emptied_as)[:, None]
        by_run = np.hstack([self.base, self.channel.per_run(self.drawn)])
        by_charge = np.hstack([self.base, self.drawn, later])
        return by_run, by_charge

    @property
    def gained_by_a_rival(self) -> float:
        """Reduction of BIC by the better rival, over the better form of warmth."""
        gains = []
        for rival in self.rivals:
            over_forms = [
                self.channel.delta_bic(design, rival) for design in (self.by_warmth, self.bent)
            ]
            gains.append(min(over_forms))
        return max(gains)

    def effect(self, robot: Robot, rng: Generator) -> ChannelEffect | None:
        """A cold battery, where the resistance falls with warmth, and explains the voltage no worse
        than its rivals.

        The resistance is named as a rival where it explains the voltage no better than one of
        these.
        """
        cold = battery.COLD_BATTERY
        channel = self.channel
        if cold.in_file(robot)[0]:
            return None
        coefficients, errors = channel.fit(self.by_warmth)
        ohm = float(coefficients[-2])
        ohm_per_k = float(coefficients[-1])
        mean_c = float(np.mean(self.runs.context["temperature_c"]))
        warm_c = mean_c + ohm / max(ohm_per_k, TINY)  # where the resistance would reach zero
        # At a reference power P, an ohm more loses (P / V)^2, a share of the P + R (P / V)^2 that
        # the cells give.
        reference_w = float(np.median(self.runs.observed[self.runs.observed > 0.0]))
        voltage_v = self.runs.context["voltage_v"]
        mean_v = np.mean(voltage_v[voltage_v > 0.0])
        share_per_ohm = reference_w / float(mean_v**2 + ohm * reference_w)
        size = share_per_ohm * ohm_per_k
        half_width = share_per_ohm * thresholds.NORMAL_95 * float(errors[-1])
        if size > cold.entry.switch.high or not battery.WARM_C.low <= warm_c <= battery.WARM_C.high:
            return None
        if self.gained_by_a_rival >= thresholds.STRONG_BIC:
            return None
        if channel.proof(np.hstack([self.base, self.drawn]), self.warmer, rng) is None:
            return None
        proof = channel.proof(self.base, np.hstack([self.drawn, self.warmer]), rng)
        if proof is None:
            return None
        is_clear = all(
            channel.delta_bic(rival, self.by_warmth) >= thresholds.STRONG_BIC
            for rival in self.rivals
        )
        rivals = () if is_clear else (battery.INTERNAL_RESISTANCE.id,)
        shape = {battery.WARM_C.name: warm_c, battery.COLD_W.name: reference_w}
        return ChannelEffect(
            hypothesis=cold,
            parameters=values_of(cold, size, (size - half_width, size + half_width), shape),
            contribution=np.maximum(ohm - ohm_per_k * self.warmth_k, 0.0) * self.current_a**2,
            proof=proof,
            rivals=rivals,
            sentence=f"The voltage sags by {ohm:.3g} ohm times the current, and by {ohm_per_k:.2g} ohm less for each "
            "kelvin of warmth.",
        )
