"""Charge of the motors: replay of recordings with motor current only.

Motor current follows torque, not power, so there is no energy and no companion. The prediction comes from the robot
file: the charge of the rest, scaled by the run's ratio so far within the spread between runs, and unexplained current.
"""

from __future__ import annotations

import numpy as np

from homeward.companion import CompanionError, UncertainValue
from homeward.diagnosis.fit.replay import current_a, wheels_mps
from homeward.diagnosis.read.signals import Signals, steps_s
from homeward.estimation.tails import scale_of
from homeward.physics import Robot
from homeward.watch import thresholds
from homeward.watch.predictions import LEAST_WINDOW_S, WINDOWS, Watched, rest_of


def watch_charge(run: Signals, robot: Robot) -> Watched:
    """Replay a run with motor currents: at each moment the charge of the rest, A s, and the way still to drive.

    Args:
        run: A run with motor currents.
        robot: The robot of the file, with an `[uncertainty]` of charge.

    Raises:
        CompanionError: The file has no uncertainty of charge, or the robot stood.
    """
    sure = robot.uncertainty
    if sure is None or sure.of != "charge":
        raise CompanionError(
            f"{run.name}: has motor currents only, which show torque and not the energy of the way home; "
            "record power_w, or voltage_v and current_a. To predict the motors' charge, give the corrected.toml of "
            "such recordings"
        )
    step_s = np.append(steps_s(run.time_s), 0.0)
    left_m = rest_of(wheels_mps(run, robot) * step_s)
    took_as = rest_of(run.observed * step_s)
    expected_as = rest_of(current_a(run, robot) * step_s)
    if left_m[0] <= 0.0:
        raise CompanionError(f"{run.name}: the robot stood all the time; there is no way to predict")
    duration_s = float(run.time_s[-1] - run.time_s[0])
    since_s = run.time_s - run.time_s[0]
    due = np.arange(0.0, duration_s, max(duration_s / WINDOWS, LEAST_WINDOW_S))
    samples = np.unique(np.searchsorted(since_s, due))
    samples = samples[(left_m[samples] > 0.0) & (expected_as[samples] > 0.0)]
    if not len(samples):
        raise CompanionError(
            f"{run.name}: by the robot's file its motors need no charge in this run; give a file with the charge of "
            "turning on the spot, or of the motors at rest"
        )
    variance = thresholds.BETWEEN_RUNS**2 if sure.between_runs is None else scale_of(sure.between_runs) ** 2
    spreads = []
    for sample in samples:
        # The run's own factor: its prior has mean 1, updated with the run so far.
        seen_as, driven_m = expected_as[0] - expected_as[sample], left_m[0] - left_m[sample]
        factor, unsure = 1.0, variance
        if seen_as > 0.0 and driven_m > 0.0:
            shown = (took_as[0] - took_as[sample]) / seen_as
            noise = scale_of(sure.unexplained_over(driven_m)) ** 2
            share = variance / (variance + noise) if variance > 0.0 else 0.0
            factor, unsure = 1.0 + share * (shown - 1.0), (1.0 - share) * variance
        rest_scale = scale_of(sure.unexplained_over(max(left_m[sample], thresholds.LEAST_WAY_M)))
        rest_as = float(expected_as[sample])
        spreads.append(UncertainValue(factor * rest_as, float(np.hypot(np.sqrt(unsure), rest_scale)) * rest_as))
    mean = np.array([spread.mean for spread in spreads])
    low = np.array([spread.low for spread in spreads])
    high = np.array([spread.high for spread in spreads])
    words = (f"charge of the motors and its uncertainty from the robot's file: {sure.source or 'no source given'}",)
    return Watched(
        run.name, since_s[samples], left_m[samples], took_as[samples], mean, low, high, float(left_m[0]), words, (),
        unit="A s",
    )  # fmt: skip
