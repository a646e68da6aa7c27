"""What the state of charge shows: the capacity of the battery, and an effect that changes its fall."""

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
    """Capacity by the state of charge, and an effect that changes its fall; None of both where it hardly fell.

    The capacity is one for all runs, of an aged battery that of the last; the effect is not that of the voltage's sag.
    """
    robot, soc = fit.parameters.nominal, runs.context.get("soc")
    if soc is None or runs.unit != "W":
        return None, None
    of_run = pd.Series(soc).groupby(runs.run)  # NaN of a run that lacks it
    if float((of_run.max() - of_run.min()).sum()) < thresholds.LEAST_FALL:
        return None, None
    channel = Reading(-energy_share(robot.curve, soc), runs, block)
    drawn = channel.summed((runs.observed + lost_w) / robot.usable_energy_j)[:, None]
    is_aged = bool(battery.AGEING.in_file(robot)[0])
    rates, errors = channel.fit(channel.per_run(drawn) if is_aged else drawn)
    rate, error = float(rates[-1]), float(errors[-1])
    if rate <= 0.0:
        return None, None
    capacity = capacity_of(robot, rate, error, covered(soc, runs.run))
    unexplained = None if capacity is None else dataclasses.replace(capacity, off=False)
    fault = misread(fit, runs, channel, drawn, block, rng)
    if fault is not None:
        return unexplained, fault
    losses = Losses(fit, runs, channel, drawn, sag)
    effects = [losses.proven(rng), fading(channel, runs, robot, drawn, rng)]
    shown = sorted((effect for effect in effects if effect is not None), key=lambda effect: -effect.gained)
    if shown:
        return unexplained, _with_rivals(shown)
    if capacity is None or not capacity.off:
        return capacity, None
    return dataclasses.replace(capacity, rivals=losses.instead(rate)), None


def _with_rivals(shown: list[ChannelEffect]) -> ChannelEffect:
    """The first of some effects, with those as rivals that explain as much."""
    best = shown[0]
    alike = [other.hypothesis.id for other in shown[1:] if other.gained > thresholds.RIVAL_SHARE * best.gained]
    return dataclasses.replace(best, rivals=tuple(dict.fromkeys([*best.rivals, *alike])))


def covered(soc: Array, run: Index) -> tuple[float, float]:
    """Lowest and highest state of charge, (windows,), of the widest part of a battery that runs cover together."""
    known = np.isfinite(soc)
    of_run = pd.Series(soc[known]).clip(0.0, 1.0).groupby(run[known])
    widest = low, high = 0.0, 0.0
    for least, most in sorted(zip(of_run.min(), of_run.max(), strict=True)):
        if least <= high:
            high = max(high, most)
        else:
            low, high = least, most
        widest = max(widest, (low, high), key=lambda part: part[1] - part[0])
    return widest


def capacity_of(robot: Robot, rate: float, error: float, part: tuple[float, float]) -> Capacity | None:
    """Capacity of a battery whose charge falls `rate` times as fast as its file implies, with a standard error of the
    regression, from a part of its charge; None from less than half."""
    if part[1] - part[0] < thresholds.HALF:
        return None
    of_instruments = rate * np.hypot(thresholds.GAUGE_GAIN_SD, _curve_error(robot, part))
    total = float(np.hypot(error, of_instruments))
    off = abs(rate - 1.0) > float(norm.ppf(1.0 - thresholds.FALSE_ALARM_RATE / 2.0)) * total
    low_j = robot.usable_energy_j / max(rate + thresholds.NORMAL_95 * total, 1e-9)
    high_j = robot.usable_energy_j / max(rate - thresholds.NORMAL_95 * total, 1e-9)
    fitted_j = robot.usable_energy_j / rate
    above_rated = fitted_j > robot.rated_energy_j
    return Capacity(robot.usable_energy_j, fitted_j, (low_j, high_j), off, above_rated=above_rated)


def _curve_error(robot: Robot, part: tuple[float, float]) -> float:
    """Relative standard error of the energy of a part of the charge, as the open-circuit curve may be another one: any
    of the known ones where the robot's file has none."""
    low, high = part
    if robot.curve.mean_v > 0.0:
        return thresholds.CURVE_SD * (1.0 - (high - low))
    curves = [curve_of(points) for points in CHEMISTRIES.values()]
    energies = [float(energy_share(curve, high) - energy_share(curve, low)) for curve in curves]
    return max(abs(energy / (high - low) - 1.0) for energy in energies) / thresholds.NORMAL_95
