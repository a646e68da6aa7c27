"""A policy that turns when the companion advises it, to measure its stranding rate and distances.

`homeward evaluate` compares it with the shield of a policy that never turns (docs/results.md has
the command).
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents import Policy
from homeward.agents.base import Observations, feature
from homeward.companion import Companion
from homeward.envs.actions import encode_actions
from homeward.envs.features import INDEX
from homeward.envs.options import Known
from homeward.envs.state import GO, RETURN

RISK = 1e-3
"""Probability of not getting home that the companion accepts."""
LAG_S = 60.0
"""Time constant of the lag in `AdvisedByGauge`."""


@final
class Advised(Policy):
    """Drives out at cruise, and home when its companion advises it; it also makes the advised
    excitation steps.

    The companion gets readings in SI units and the robot's file, but no forecast or other constants
    of the environment.

    Args:
        known: Constants of the environment.
    """

    def __init__(self, known: Known) -> None:
        self._known = known
        cruise = known.shared["cruise_mps"][0]
        self._on, self._home = (
            encode_actions(known, cruise, 0.0, mode)[0] for mode in (GO, RETURN)
        )
        self._back = encode_actions(known, known.shared["min_speed_mps"][0], 0.0, RETURN)[0]
        self._companions: list[Companion] = []

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        if begun.all():  # all missions of a batch begin together
            window_s = float(self._known.shared["decision_s"][0])
            self._companions = [
                Companion(self._known.robot, risk=RISK, window_s=window_s) for _ in begun
            ]
        readings = self._readings(observations)
        actions = np.repeat(self._on[None], len(begun), axis=0)
        for k, companion in enumerate(self._companions):
            advice = companion.update(
                **{name: float(values[k]) for name, values in readings.items()}
            )
            if advice.turn_now:
                actions[k] = self._home
            elif advice.looks_back:
                actions[k] = self._back
        return actions

    def _readings(self, observations: Observations) -> dict[str, NDArray[np.float64]]:
        s = self._known.shared[0]
        return {
            "time_s": np.rint(feature(observations, "time") * s["max_decisions"]) * s["decision_s"],
            "speed_mps": feature(observations, "speed") * s["max_speed_mps"],
            "power_w": feature(observations, "power") * s["cruise_w"],
            "soc": feature(observations, "energy"),
            "grade_rad": np.arcsin(0.1 * feature(observations, "grade")),
            "heading_rad": np.arctan2(
                feature(observations, "north"), feature(observations, "east")
            ),
            "position": feature(observations, "distance") * s["reach_m"],
        }


@final
class AdvisedByGauge(Policy):
    """`Advised` by a state of charge in whole per cents that lags, which the companion's settings
    do not include.

    Args:
        known: Constants of the environment.
    """

    def __init__(self, known: Known) -> None:
        self._advised = Advised(known)
        self._soc = np.zeros(0)
        self._kept = float(np.exp(-known.shared["decision_s"][0] / LAG_S))

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        soc = feature(observations, "energy")
        self._soc = soc if begun.all() else soc + self._kept * (self._soc - soc)
        read = observations.copy()
        read[:, INDEX["energy"]] = np.round(self._soc, 2)
        return self._advised.act(read, begun)
