"""What only the critic sees while a policy learns: what is hidden, and the route ahead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from homeward.envs.batch import Batch
from homeward.envs.state import MAX_PLACES
from homeward.physics import model

HIDDEN = ("energy", "capacity", "rolling", "payload", "meter_gain")
"""Hidden columns: true energy over the usable energy, and what differs from the robot's file, as shares."""
AHEAD_PLACES = (2, 4, 8, 16, 32, MAX_PLACES)
"""Places ahead of which the means are shown, as of all places behind."""
_OF_PLACES = ("sin_grade", "interest", "headwind")
_SCALES = (10.0, 0.5, 0.1)  # as those of the observed features


class Insight:
    """Columns for the critic alone: with them it tells luck from skill, so that fewer missions teach the policy more.

    The policy never sees them, so it acts on the robot without (asymmetric actor-critic: Pinto et al. 2017,
    arXiv 1710.06542). The critic sees the observation too, without which it would mislead (Baisero & Amato 2022).

    Args:
        batch: Missions that it looks into.
    """

    columns = len(HIDDEN) + len(_OF_PLACES) * (len(AHEAD_PLACES) + 1)

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._places = int(batch.known.shared["places"][0])
        self._until = np.zeros((batch.count, len(_OF_PLACES), self._places + 1))  # sums over the places up to each
        self._hidden = np.zeros((batch.count, len(HIDDEN) - 1))

    def see(self, begun: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Columns of all missions as they are now, shape (n, columns).

        Args:
            begun: Missions that have begun since the call before, shape (n,).
        """
        if begun.any():
            self._look(begun)
        records, known = self._batch.records, self._batch.known
        energy = records["energy_j"] / known.shared["usable_j"]
        rows, place = np.arange(len(records))[:, None], records["place"][:, None]
        ends = np.minimum(place + np.array((0, *AHEAD_PLACES)), self._places)
        starts = np.concatenate((np.zeros_like(place), np.repeat(place, len(AHEAD_PLACES), axis=1)), axis=1)
        sums = self._until[rows, :, ends] - self._until[rows, :, starts]
        means = sums / np.maximum(ends - starts, 1)[..., None] * _SCALES
        columns = (energy[:, None], self._hidden, means.reshape(len(records), -1))
        return np.concatenate(columns, axis=1, dtype=np.float32)

    def _look(self, begun: NDArray[np.bool_]) -> None:
        batch, robot = self._batch, self._batch.known.robot
        m, p = batch.records[begun], batch.robots[begun]
        places = batch.routes[begun]["places"][:, : self._places]
        from_rad = m["wind_from_rad"]
        east_mps, north_mps = (m["wind_mps"] * part(from_rad) for part in (np.cos, np.sin))
        headwind_mps = model.headwind(east_mps[:, None], north_mps[:, None], places["east"], places["north"])
        along = (places["sin_grade"], places["interest"], headwind_mps)
        self._until[begun, :, 1:] = np.cumsum(np.stack(along, axis=1), axis=2)
        hidden = (
            m["capacity_j"] / batch.known.shared["usable_j"] - 0.9,
            p["rolling_resistance"] / robot.rolling_resistance - 1.0,
            p["payload_mass_kg"] / robot.mass_kg,
            m["meter_gain"] - 1.0,
        )
        self._hidden[begun] = 5.0 * np.stack(hidden, axis=1)
