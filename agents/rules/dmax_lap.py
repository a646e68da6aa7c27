"""The rule of a patrol that measures its laps: the next one is predicted from the earlier ones,
with a reserve."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from homeward.agents import thresholds
from homeward.agents.base import Observations, feature
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.turn_back import BelievingRule, Outlook
from homeward.envs.options import Known
from homeward.physics import ancillary_power


@final
class LapRule(BelievingRule):
    """Measures laps from one arrival at the home post to the next, and continues while another lap
    fits.

    All laps have the same ground, wind and battery. The first one, which begins without a pit stop,
    is used until there is another. At the far post the robot returns for good if no other lap fits
    after this one, which saves the rest of the pit stop once the return is final. The standard
    deviation is that of the laps and of the state-of-charge reading. What chargers supply is left
    out of a lap, and so is standing at a dock.

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        deviations: Reserve in standard deviations k, 0 or above.
    """

    def __init__(self, known: Known, pace: Pace, deviations: float) -> None:
        super().__init__(known, pace, deviations)
        s = known.shared[0]
        # By the file: hidden variables only increase it, so that shortening the stop saves at least
        # this. With docks the mission goes on to the next one instead.
        saved_s = 0.0
        if s["dock_count"] == 0:
            until_final_s = (s["return_decisions"] - 1) * s["decision_s"]
            saved_s = max(float(s["pit_stop_s"] - until_final_s), 0.0)
        idle_w = ancillary_power(known.robot, 0.0)
        self._stop_share = saved_s * float(idle_w / s["usable_j"])
        self._decision_share = float(s["decision_s"] * idle_w / s["usable_j"])
        self._gauge_error = float((known.instruments.soc_variance + s["soc_error"] ** 2) ** 0.5)
        self._forget(0)

    def look(self, observations: Observations, begun: NDArray[np.bool_]) -> Outlook:
        """Mean and standard deviation of the energies at a post, see `BelievingRule.look`."""
        energy = feature(observations, "metered")
        uncharged = energy - self.charged(observations)
        self._measure(observations, begun, uncharged)
        count, total, squares = self._laps
        lap = np.where(count > 0.0, total / np.maximum(count, 1.0), self._first)
        variance = np.maximum(squares - count * lap * lap, 0.0) / np.maximum(count - 1.0, 1.0)
        deviation = np.where(count > 1.0, np.sqrt(variance), thresholds.UNSEEN_LAP * lap)
        return Outlook(
            energy_left=energy - self.kept_on_average(observations),
            home=np.where(self._away, self._back, 0.0) - (self._arrival - uncharged),
            onwards=lap - self._stop_share,
            deviation=np.hypot(deviation, self._gauge_error * (1.0 - energy + lap)),
        )

    def round_trip(self, observations: Observations) -> NDArray[np.float64]:
        """Energy of a lap, as measured, see `TurnBackRule.round_trip`."""
        return self.outlook.onwards

    def _may_turn(self, distance_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        at_far_post = distance_m >= thresholds.AT_END * float(self._known.shared["length_m"][0])
        return np.asarray(super()._may_turn(distance_m) | at_far_post)

    def _forget(self, count: int) -> None:
        self.charges = np.zeros(count, np.bool_)
        self._laps = np.zeros((3, count))  # number, sum of their energy, and of its squares
        self._first = np.zeros(count)  # energy of the first lap
        self._back = np.zeros(count)  # energy of the last way home
        self._arrival = np.ones(count)  # energy on arrival at the last post
        self._left = np.ones(count)  # energy on arrival at the home post
        self._away = np.zeros(count, np.bool_)  # whether the last post is the far one
        # energy of standing at a dock since the home post, beyond pit stops
        self._stood = np.zeros(count)
        self._waited = np.zeros(count)  # pit stop in a decision, as a share of it

    def _measure(
        self, observations: Observations, begun: NDArray[np.bool_], energy: NDArray[np.float64]
    ) -> None:
        """Process arrivals at posts; energies are shares of the usable energy, `energy` without
        what was charged."""
        if len(begun) != len(self._away):
            self._forget(len(begun))
        self._laps[:, begun] = 0.0
        self._arrival[begun] = 1.0
        self._left[begun] = 1.0
        self._away[begun] = False
        stood_now = self._decision_share * (1.0 - self._waited) * self.charges
        self._stood = np.where(begun, 0.0, self._stood + stood_now)
        self._waited = np.minimum(feature(observations, "pit_stop"), 1.0)
        lap = self.cost_of_going_on(observations)
        self._first = np.where(begun, lap, self._first)
        self._back = np.where(begun, 0.5 * lap, self._back)
        distance_m = feature(observations, "distance") * self._reach_m
        # Arrivals: the first decision at a post after the other one.
        comes_home = self._away & (distance_m <= 0.0)
        comes_far = ~self._away & (distance_m > 0.0) & self._may_turn(distance_m)
        is_first = comes_home & (self._left == 1.0)
        took = self._left - energy - self._stood
        self._first = np.where(is_first, took, self._first)
        moments = np.stack((np.ones(len(took)), took, took * took))
        self._laps += np.where(comes_home & ~is_first, moments, 0.0)
        self._back = np.where(comes_home, self._arrival - energy, self._back)
        self._arrival = np.where(comes_home | comes_far, energy, self._arrival)
        self._left = np.where(comes_home, energy, self._left)
        self._stood = np.where(comes_home, 0.0, self._stood)
        self._away = (self._away | comes_far) & ~comes_home
