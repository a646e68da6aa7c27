"""What a battery loses inside, which power at its terminals does not show."""

from types import SimpleNamespace

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array
from homeward.physics import Robot
from homeward.physics.battery import energy_share
from homeward.physics.effects import EFFECTS
from homeward.physics.terminal_power import lost_inside

_MILD_C = 20.0  # air where it is unknown; chosen: room temperature, as in the replay


def matters(lost_w: Array, runs: Runs) -> bool:
    """Whether a loss exceeds `MATERIAL_SHARE` of the energy drawn."""
    lost_j = float(lost_w @ runs.duration_s)
    drawn_j = float(runs.observed @ runs.duration_s)
    return lost_j >= thresholds.MATERIAL_SHARE * drawn_j


def inside_w(robot: Robot, runs: Runs) -> Array:
    """What the effects of a robot's file lose inside its battery, W, shape (windows,)."""
    unknown_c = np.full(len(runs.observed), _MILD_C)
    air_c = np.nan_to_num(runs.context.get("temperature_c", unknown_c), nan=_MILD_C)
    conditions = SimpleNamespace(temperature_c=air_c)
    # The voltage is that at the state of charge; where none was recorded, that of a full battery,
    # as a replay begins.
    soc = np.nan_to_num(runs.context.get("soc", np.ones(len(runs.observed))), nan=1.0)
    state = SimpleNamespace(
        energy_j=energy_share(robot.curve, np.clip(soc, 0.0, 1.0)), capacity_j=1.0
    )
    record = robot.record().view(np.recarray)[0]
    drawn_w = np.maximum(runs.observed, 0.0)
    total_w = drawn_w
    for effect in EFFECTS:
        if lost_inside(effect) and effect.id in robot.effects:
            total_w = total_w + np.asarray(effect.function(record, state, conditions, total_w))
    return np.asarray(total_w - drawn_w)
