"""What a recorded distance shows of the speed."""

import numpy as np
from scipy.stats import binom

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import instruments
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.diagnosis.result import Proof, Value


def odometer(fit: Refit, runs: Runs) -> ChannelEffect | None:
    """Speeds that a recorded distance contradicts; they were corrected when the runs were read."""
    scales = np.array([run.odometer_scale for run in runs.signals])
    if not scales.any():
        return None
    # Probability that as many runs disagree in all parts of their way, if the sign of each part is
    # random.
    disagreeing = scales[scales != 0.0]
    p_value = float(
        binom.sf(len(disagreeing) - 1, len(scales), 2.0 ** (1 - thresholds.FEWEST_BLOCKS))
    )
    if p_value > thresholds.FALSE_ALARM_RATE:
        return None
    as_recorded = WithEffects(speed_factors=(1.0 + scales).tolist())
    added_w = fit.parameters.predict(runs, fit.theta, as_recorded) - fit.parameters.predict(
        runs, fit.theta
    )
    switch = instruments.ODOMETRY_SCALE.entry.switch
    interval = (float(disagreeing.min()), float(disagreeing.max()))
    size = Value(float(np.mean(disagreeing)), interval, switch.unit)
    in_runs = f"{len(disagreeing)} of {len(scales)} runs"
    if scales.all():
        in_runs = "all runs"
    return ChannelEffect(
        hypothesis=instruments.ODOMETRY_SCALE,
        parameters={switch.name: size},
        contribution=added_w,
        proof=Proof(None, None, p_value),
        rivals=(),
        sentence=f"In {in_runs} the speed adds up to {1.0 + size.value:.3g} times the recorded distance: it is set "
        "right by that.",
    )
