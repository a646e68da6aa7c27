"""What the state of charge shows: the capacity of the battery, and an effect that changes its
fall."""

import dataclasses

import numpy as np
import pandas as pd
from numpy.random import Generator
from scipy.stats import norm

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import battery
from homeward.diagnosis.explain.channel_effects.ageing import fading
from homeward.diagnosis.explain.channel_effects.losses import Losses
from homeward.diagnosis.explain.channel_effects.meter import misread
from homeward.diagnosis.explain.channel_effects.reading import Reading
from homeward.diagnosis.explain.channel_effects.shown import Capacity, ChannelEffect
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Index
from homeward.physics import Robot
from homeward.physics.battery import CHEMISTRIES, curve_of, energy_share


def state_of_charge(
    fit: Refit, runs: Runs, lost_w: Array, sag: ChannelEffect | None, block: Index, rng: Generator
) -> tuple[Capacity | None, ChannelEffect | None]:
    """Capacity by the state of charge, and an effect that changes its fall; None of both where it
    hardly fell.

    The capacity is one for all runs, of an aged battery that of the last; the effect is not that of
    the voltage's sag.
    """
    robot = fit.parameters.nominal
    soc = runs.context.get("soc")
    if soc is None or runs.unit != "W" or _fall(soc, runs.run) < thresholds.LEAST_FALL:
        return None, None
    channel = Reading(-energy_share(robot.curve, soc), runs, block)
    drawn = channel.summed((runs.observed + lost_w) / robot.usable_energy_j)[:, None]
    design = drawn
    if battery.AGEING.in_file(robot)[0]:  # the file's age is that of the last run
        design = channel.per_run(drawn)
    rates, errors = channel.fit(design)
    rate = float(rates[-1])
    if rate <= 0.0:
        return None, None
    capacity = capacity_of(robot, rate, float(errors[-1]), covered(soc, runs.run))
    # Where an effect changes the fall of the charge, a capacity that is off explains nothing more.
    unexplained = None
    if capacity is not None:
        unexplained = dataclasses.replace(capacity, off=False)
    fault = misread(fit, runs, channel, drawn, block, rng)
    if fault is not None:
        return unexplained, fault
    losses = Losses(fit, runs, channel, drawn, sag)
    shown = _shown(losses, rng)
    if shown:
        return unexplained, _with_rivals(shown)
    if capacity is None or not capacity.off:
        return capacity, None
    return dataclasses.replace(capacity, rivals=losses.instead(rate)), None


def _fall(soc: Array, run: Index) -> float:
    """By how much the state of charge, (windows,), changes in all runs together; a run that lacks
    it adds nothing."""
    soc_of_run = pd.Series(soc).groupby(run)
    return float((soc_of_run.max() - soc_of_run.min()).sum())


def _shown(losses: Losses, rng: Generator) -> list[ChannelEffect]:
    """Effects that the fall of the charge shows: a loss inside or a battery that fades, what
    explains more first."""
    effects = [
        losses.proven(rng),
        fading(losses.channel, losses.runs, losses.robot, losses.drawn, rng),
    ]
    shown = [effect for effect in effects if effect is not None]
    return sorted(shown, key=lambda effect: -effect.gained)


def _with_rivals(shown: list[ChannelEffect]) -> ChannelEffect:
    """The first of some effects, with those as rivals that explain as much."""
    likeliest = shown[0]
    rivals = list(likeliest.rivals)
    for effect in shown[1:]:
        if effect.gained > thresholds.RIVAL_SHARE * likeliest.gained:
            rivals.append(effect.hypothesis.id)
    return dataclasses.replace(likeliest, rivals=tuple(dict.fromkeys(rivals)))


def covered(soc: Array, run: Index) -> tuple[float, float]:
    """Lowest and highest state of charge, (windows,), of the widest part of a battery that runs
    cover together."""
    is_known = np.isfinite(soc)
    soc_of_run = pd.Series(soc[is_known]).clip(0.0, 1.0).groupby(run[is_known])
    # From the emptiest on: runs whose parts overlap cover one part together.
    low = 0.0
    high = 0.0
    widest = (low, high)
    for lowest, highest in sorted(zip(soc_of_run.min(), soc_of_run.max(), strict=True)):
        if lowest > high:  # a part that no run before reaches
            low = lowest
            high = highest
        high = max(high, highest)
        widest = max(widest, (low, high), key=lambda part: part[1] - part[0])
    return widest


def capacity_of(
    robot: Robot, rate: float, error: float, part: tuple[float, float]
) -> Capacity | None:
    """Capacity of a battery whose charge falls `rate` times as fast as its file implies, with a
    standard error of the regression, from a part of its charge; None from less than half."""
    if part[1] - part[0] < thresholds.HALF:
        return None
    error_of_instruments = rate * np.hypot(thresholds.GAUGE_GAIN_SD, _curve_error(robot, part))
    total_error = float(np.hypot(error, error_of_instruments))
    normal_quantile = float(norm.ppf(1.0 - thresholds.FALSE_ALARM_RATE / 2.0))
    assumed_j = robot.usable_energy_j
    fitted_j = assumed_j / rate
    low_j = assumed_j / max(rate + thresholds.NORMAL_95 * total_error, 1e-9)
    high_j = assumed_j / max(rate - thresholds.NORMAL_95 * total_error, 1e-9)
    return Capacity(
        assumed_j=assumed_j,
        fitted_j=fitted_j,
        ci95=(low_j, high_j),
        off=abs(rate - 1.0) > normal_quantile * total_error,
        above_rated=fitted_j > robot.rated_energy_j,
    )


def _curve_error(robot: Robot, part: tuple[float, float]) -> float:
    """Relative standard error of the energy of a part of the charge, as the open-circuit curve may
    be another one: any of the known ones where the robot's file has none."""
    low, high = part
    if robot.curve.mean_v > 0.0:
        return thresholds.CURVE_SD * (1.0 - (high - low))
    errors = []
    for points in CHEMISTRIES.values():
        curve = curve_of(points)
        energy = float(energy_share(curve, high) - energy_share(curve, low))
        errors.append(abs(energy / (high - low) - 1.0))
    return max(errors) / thresholds.NORMAL_95  # the largest counts as the end of a 95 % interval
