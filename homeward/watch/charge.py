"""Charge of the motors: replay of recordings with motor current only.

Motor current follows torque, not power, so there is no energy and no companion. The prediction
comes from the robot file: the charge of the rest, scaled by the run's ratio so far within the
spread between runs, and unexplained current.
"""

from __future__ import annotations

import numpy as np

from homeward.companion import CompanionError, UncertainValue
from homeward.diagnosis.fit.replay import current_a, wheels_mps
from homeward.diagnosis.read.signals import Signals, steps_s
from homeward.estimation.tails import scale_of
from homeward.physics import Robot
from homeward.physics.uncertainty import Uncertainty
from homeward.watch import thresholds
from homeward.watch.predictions import LEAST_WINDOW_S, WINDOWS, Watched, rest_of


def watch_charge(run: Signals, robot: Robot) -> Watched:
    """Replay a run with motor currents: at each moment the charge of the rest, A s, and the way
    still to drive.

    Args:
        run: A run with motor currents.
        robot: The robot of the file, with an `[uncertainty]` of charge.

    Raises:
        CompanionError: The file has no uncertainty of charge, or the robot stood.
    """
    uncertainty = robot.uncertainty
    if uncertainty is None or uncertainty.of != "charge":
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
        raise CompanionError(
            f"{run.name}: the robot stood all the time; there is no way to predict"
        )
    since_s = run.time_s - run.time_s[0]
    duration_s = float(since_s[-1])
    due_s = np.arange(0.0, duration_s, max(duration_s / WINDOWS, LEAST_WINDOW_S))
    samples = np.unique(np.searchsorted(since_s, due_s))
    samples = samples[(left_m[samples] > 0.0) & (expected_as[samples] > 0.0)]
    if not len(samples):
        raise CompanionError(
            f"{run.name}: by the robot's file its motors need no charge in this run; give a file with the charge of "
            "turning on the spot, or of the motors at rest"
        )
    spreads = []
    for sample in samples:
        expected_so_far_as = float(expected_as[0] - expected_as[sample])
        measured_so_far_as = float(took_as[0] - took_as[sample])
        driven_m = float(left_m[0] - left_m[sample])
        factor, variance = _factor_of_run(
            uncertainty, measured_so_far_as, expected_so_far_as, driven_m
        )
        way_m = max(float(left_m[sample]), thresholds.LEAST_WAY_M)
        unexplained = scale_of(uncertainty.unexplained_over(way_m))
        rest_as = float(expected_as[sample])
        scale = float(np.hypot(np.sqrt(variance), unexplained))
        spreads.append(UncertainValue(factor * rest_as, scale * rest_as))
    source = uncertainty.source or "no source given"
    return Watched(
        name=run.name,
        time_s=since_s[samples],
        left_m=left_m[samples],
        took_j=took_as[samples],
        mean_j=np.array([spread.mean for spread in spreads]),
        low_j=np.array([spread.low for spread in spreads]),
        high_j=np.array([spread.high for spread in spreads]),
        length_m=float(left_m[0]),
        rests_on=(f"charge of the motors and its uncertainty from the robot's file: {source}",),
        warnings=(),
        unit="A s",
    )


def _factor_of_run(
    uncertainty: Uncertainty, measured_as: float, expected_as: float, driven_m: float
) -> tuple[float, float]:
    """The run's own factor of the expected charge: mean and variance of a prior of mean 1, updated
    with the run so far.

    Args:
        uncertainty: That of the robot's file.
        measured_as: Charge that the run so far took, A s.
        expected_as: The same by the file, A s.
        driven_m: Way that it drove, m.
    """
    variance = thresholds.BETWEEN_RUNS**2
    if uncertainty.between_runs is not None:
        variance = scale_of(uncertainty.between_runs) ** 2
    if expected_as <= 0.0 or driven_m <= 0.0 or variance <= 0.0:
        return 1.0, variance
    noise = scale_of(uncertainty.unexplained_over(driven_m)) ** 2
    gain = variance / (variance + noise)
    return 1.0 + gain * (measured_as / expected_as - 1.0), (1.0 - gain) * variance
