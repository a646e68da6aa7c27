"""Range left by the robot's own model: the point of no return."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.options import Known
from homeward.envs.routes import thresholds as routes_thresholds
from homeward.envs.state import IN_SIGHT
from homeward.physics import ancillary_power, d_max

# Chosen: steps of 0.025, linear in between.
_SINES = np.linspace(-routes_thresholds.STEEPEST_SINE, routes_thresholds.STEEPEST_SINE, 57)
_HOPELESS_J_PER_M = 1e12  # of a slope that no battery can climb; chosen: finite, and far above any


class PointOfNoReturn:
    """Energy of the ground by the robot's own model, and what follows from it for a mission.

    Driven ground has the energy that the environment stored there. For ground ahead Eq. 8 gives the
    energy per metre at cruise, without sensing, on the slope that the robot knows: that of each
    place if the route is known, otherwise that of the next two places and beyond them the mean. A
    mission that shuttles has no point of no return.

    Args:
        known: Constants of the environment.
    """

    def __init__(self, known: Known) -> None:
        self._known = known
        s = known.shared[0]
        robot = known.robot.without_cutoff()
        range_m = np.asarray(d_max(robot, float(s["cruise_mps"]), np.arcsin(_SINES)))
        with np.errstate(divide="ignore"):
            self._j_per_m = np.minimum(s["usable_j"] / range_m, _HOPELESS_J_PER_M)
        self._pit_stops_j = 2.0 * float(s["pit_stop_s"] * ancillary_power(known.robot, 0.0))

    def no_return_m(self, m: Any, places: NDArray[np.void], margin_j: float) -> float | None:
        """Furthest point from which the robot, driving on and turning there, still gets home.

        If the energy no longer suffices, this is a point behind the robot, where it should have
        turned.

        Args:
            m: Mission record.
            places: Its route, `PLACE_DTYPE`, shape (places,).
            margin_j: Energy by the power meter beyond what the way home consumes, J.

        Returns:
            Distance along the route, m; None if it lies beyond the end of the route.
        """
        place_m = float(self._known.shared[0]["place_m"])
        sines = self._known_sines(m, places)
        there_and_back_j_per_m = self._cost(sines) + self._cost(-sines)
        edges_m = np.arange(len(places) + 1) * place_m
        needed_j = np.concatenate(([0.0], np.cumsum(there_and_back_j_per_m * place_m)))
        affordable_j = float(np.interp(m["position_m"], edges_m, needed_j)) + margin_j
        if affordable_j >= needed_j[-1]:
            return None
        return float(np.interp(affordable_j, needed_j, edges_m))

    def runs_out_m(self, m: Any, places: NDArray[np.void], margin_j: float) -> float | None:
        """Place on the way home where the battery will be empty, by the robot's own model; None if
        it gets home.

        Arguments as in `no_return_m`.
        """
        if margin_j >= 0.0:
            return None
        driven = places[: int(m["mapped"])]
        place_m = float(self._known.shared[0]["place_m"])
        edges_m = np.arange(len(driven) + 1) * place_m
        end_cost_j = driven[-1]["home_cost_j"] + driven[-1]["home_j_per_m"] * place_m
        home_cost_j = np.append(driven["home_cost_j"], end_cost_j)
        # The uncovered part is the distance left when the battery ends; what stays in it below its
        # cut-off drives no metre.
        return float(np.interp(-margin_j, home_cost_j - home_cost_j[0], edges_m))

    def laps_left(self, m: Any, places: NDArray[np.void], margin_j: float) -> float:
        """Laps of a patrol for which the margin is enough; arguments as in `no_return_m`."""
        s = self._known.shared[0]
        sines = self._known_sines(m, places)
        there_and_back_j_per_m = self._cost(sines) + self._cost(-sines)
        lap_j = float(there_and_back_j_per_m.sum() * s["place_m"]) + self._pit_stops_j
        return max(margin_j, 0.0) / lap_j

    def _known_sines(self, m: Any, places: NDArray[np.void]) -> NDArray[np.float64]:
        sines = places["sine_read"].astype(np.float64)
        if not self._known.shared[0]["route_is_known"]:
            first_unseen = max(int(m["mapped"]), int(m["place"]) + 1 + IN_SIGHT)
            sines[first_unseen:] = m["mean_grade"]
        return sines

    def _cost(self, sines: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.interp(sines, _SINES, self._j_per_m))
