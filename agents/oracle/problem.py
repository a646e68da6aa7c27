"""One mission at its start, with the variables that are hidden from its robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.agents.oracle import kernel
from homeward.envs.batch import Batch


@dataclass(frozen=True)
class Problem:
    """Records of one mission, each of shape (1,).

    Attributes:
        constants: Constants of the environment, `CONSTANTS_DTYPE`.
        robot: True robot, `ROBOT_DTYPE`.
        route: Route with every place seen, `ROUTE_DTYPE`.
        start: Mission at its start, `MISSION_DTYPE`.
    """

    constants: NDArray[np.void]
    robot: NDArray[np.void]
    route: NDArray[np.void]
    start: NDArray[np.void]

    @property
    def shared(self) -> Any:
        """Record of what all missions share."""
        return self.constants["shared"][0]

    def copy(self) -> Problem:
        """Copy with its own records."""
        return Problem(
            self.constants.copy(), self.robot.copy(), self.route.copy(), self.start.copy()
        )


def problem_of(batch: Batch, index: int) -> Problem:
    """Take a mission that has just begun out of a batch."""
    mission = slice(index, index + 1)
    case = Problem(
        batch.constants.copy(),
        batch.robots[mission].copy(),
        batch.routes[mission].copy(),
        batch.records[mission].copy(),
    )
    kernel.see_route(case.constants, case.start, case.route)
    return case
