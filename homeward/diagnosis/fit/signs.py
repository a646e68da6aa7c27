"""Signs of power and of slopes, judged over all runs: by the energy that a descent can give and
that a climb takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.read.signals import Signals, steps_s
from homeward.logs.doubts import turned_slopes
from homeward.physics import Robot
from homeward.physics.model import GRAVITY_MPS2


class Sign(NamedTuple):
    """What the sign of a run's power comes to; one that is `refused` is wrong."""

    text: str
    refused: bool


def signs_of_power(runs: Sequence[Signals], robot: Robot) -> dict[int, Sign]:
    """Runs whose power is negative while they drive, by their number: driven downhill, or of the
    wrong sign.

    A descent gives back no more than the height lost, so a run whose slopes are known shows it
    alone. Where they are not, the runs decide together: an instrument has one sign in all of them.
    """
    drawn_j = np.array([_drawn_j(run) for run in runs])
    negative = np.flatnonzero(drawn_j < 0.0)
    negative_kj = -drawn_j[negative].sum() / 1e3
    is_negative = f"power is negative while it drives (in {len(negative)} of {len(runs)} runs, by {negative_kj:.3g} kJ)"
    signs: dict[int, Sign] = {}
    for number in negative.tolist():
        recovered_j = -drawn_j[number]
        descent_j = _descent_j(runs[number], robot)
        if descent_j is not None and recovered_j <= descent_j:
            text = (
                f"{recovered_j / 1e3:.3g} kJ more are recovered than drawn, of {descent_j / 1e3:.3g} kJ that its "
                "descent gives"
            )
            signs[number] = Sign(text, refused=False)
        elif descent_j is None and drawn_j.sum() > 0.0:
            text = f"{is_negative}, and positive over all runs together: assumed to be recovered downhill"
            signs[number] = Sign(text, refused=False)
        else:
            text = f"{is_negative}: power drawn must be positive (factor -1 in a mapping file)"
            signs[number] = Sign(text, refused=True)
    return signs


def _drawn_j(run: Signals) -> float:
    """Energy drawn while driving, less the energy recovered, J; of motor current, which has no
    sign, 0."""
    if run.unit != "W":
        return 0.0
    drives = run.speed_mps[:-1] != 0.0
    energy_j = run.observed[:-1] * steps_s(run.time_s)
    return float(energy_j[drives].sum())


def _descent_j(run: Signals, robot: Robot) -> float | None:
    """Potential energy that a run's descents give, less that of its climbs, J; None where slopes
    are unknown."""
    if "grade_rad" not in run.context:
        return None
    climb_mps = run.speed_mps * np.sin(run.grade_rad)
    rise_m = climb_mps[:-1] * steps_s(run.time_s)
    return float(-robot.mass_kg * GRAVITY_MPS2 * rise_m.sum())


def wrong_slopes(signals: Sequence[Signals], robot: Robot) -> str | None:
    """Whether the energy of climbs shows that slopes have the wrong sign, in all runs together; a
    phrase, or None."""
    sloped = [run for run in signals if "grade_rad" in run.context and run.unit == "W"]
    if not sloped:
        return None
    runs = average(sloped)
    pairs = list(zip(runs.signals, runs.windows, strict=True))
    speed_mps = np.concatenate([cut.means(np.abs(run.speed_mps)) for run, cut in pairs])
    climb_mps = np.concatenate(
        [cut.means(run.speed_mps * np.sin(run.grade_rad)) for run, cut in pairs]
    )
    weight_n = robot.mass_kg * GRAVITY_MPS2
    return turned_slopes(climb_mps, speed_mps, runs.observed, runs.run, weight_n, robot.name)
