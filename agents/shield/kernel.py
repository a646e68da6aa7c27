"""The shield's arithmetic, compiled: what is left beyond a decision and the way home after it, by all that may be."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.agents.identification_kernel import Ground, driving, way_home
from homeward.physics.jit import compiled

PLAN_DTYPE = np.dtype([("in_doubt", np.bool_)] + [(name, np.float64) for name in (
    "energy_j", "home_cost_j", "position_m", "ends_m", "moves_m", "speed_mps", "ancillary_j", "sine_near",
)])  # fmt: skip
"""What a decision is to be: energy that is there for sure, the way home by the robot's own model, where the robot is
and ends, how far it moves and how fast, what all but driving takes, and the slope ahead."""


@compiled
def spare(
    v: Any, slower_j_per_m: float, plans: Any, grounds: Any, guesses: Any, deviations: float, share: float, spare_j: Any
) -> None:
    """Least energy that a plan leaves beyond the way home, by any guess that explains the drive.

    Args:
        v: `homeward.agents.identification_kernel.Vehicle`.
        slower_j_per_m: What a metre home takes beyond that at cruise.
        plans: `PLAN_DTYPE`, shape (n,).
        grounds: Of `homeward.agents.identification`, shape (n, places).
        guesses: The same, shape (n, guesses).
        deviations: Standard deviations of the way home kept back.
        share: Share of the way home kept back beside them.
        spare_j: Written where a plan is in doubt, shape (n,).
    """
    slopes, metre = np.empty(5), np.empty(5)
    for i in range(len(plans)):
        p = plans[i]
        if not p.in_doubt:
            continue
        place = grounds[i, min(int(p.position_m / v.place_m), len(grounds[i]) - 1)]
        here = Ground(float(place.sine), float(place.east), float(place.north))
        outwards = p.ends_m > p.position_m
        ahead = 1.0 if outwards else -1.0
        # Ground ahead may be as steep as what is seen of it, on the way out as on the way home.
        near = Ground(p.sine_near if outwards else here.sine, here.east, here.north)
        least_j = np.inf
        for k in range(guesses.shape[1]):
            guess = guesses[i, k]
            if guess.weight > 0.0:
                home_j, variance = way_home(v, p.position_m, p.home_cost_j, grounds[i], guess, (slopes, metre))
                home_j += guess.unknown[0] * slower_j_per_m * p.position_m
                # What a guess does not explain of a decision may be its fault, and come again on all of the way.
                deviation_j = np.sqrt(variance + (guess.error * home_j) ** 2)
                drive_j, back_j = 0.0, 0.0
                for ground in (here, near):
                    drive_j = max(drive_j, driving(v, guess.unknown, ground, ahead, p.speed_mps, 0.0, metre))
                    back_j = max(back_j, driving(v, guess.unknown, ground, -1.0, v.cruise_mps, 0.0, metre))
                back_j += guess.unknown[0] * (v.idle_w / v.cruise_mps + slower_j_per_m)
                ends_j = max(home_j + back_j * (p.ends_m - p.position_m), 0.0)
                if home_j > 0.0:
                    deviation_j *= ends_j / home_j
                takes_j = guess.unknown[0] * p.ancillary_j + drive_j * p.moves_m
                left_j = p.energy_j - takes_j - (1.0 + share) * ends_j - deviations * deviation_j
                least_j = min(least_j, left_j)
        spare_j[i] = least_j
