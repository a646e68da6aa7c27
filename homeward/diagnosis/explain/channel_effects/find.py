"""All effects that voltage, state of charge and distance identify."""

import numpy as np
from numpy.random import Generator

from homeward.diagnosis.explain.channel_effects.charge import state_of_charge
from homeward.diagnosis.explain.channel_effects.inside import inside_w
from homeward.diagnosis.explain.channel_effects.odometer import odometer
from homeward.diagnosis.explain.channel_effects.shown import Capacity, ChannelEffect
from homeward.diagnosis.explain.channel_effects.voltage import sag
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Index


def find_effects(
    fit: Refit, runs: Runs, block: Index, rng: Generator
) -> tuple[Capacity | None, tuple[ChannelEffect, ...]]:
    """Effects identified by voltage, state of charge and distance; windows of a `block`,
    (windows,), are dependent."""
    robot = fit.parameters.nominal
    by_voltage = sag(robot, runs, block, rng)
    # A recorded `power_w` counts as what the battery gives and loses, as it does in the replay,
    # unless the charge showed that it does not (`gauge.weigh_gauge`).
    at_terminals = np.array([run.at_terminals for run in runs.signals])[runs.run]
    lost_w = at_terminals * inside_w(robot, runs)
    if by_voltage is not None:
        lost_w = lost_w + by_voltage.contribution
    capacity, by_charge = state_of_charge(fit, runs, lost_w, by_voltage, block, rng)
    by_distance = odometer(fit, runs)
    effects = (by_voltage, by_charge, by_distance)
    return capacity, tuple(effect for effect in effects if effect is not None)
