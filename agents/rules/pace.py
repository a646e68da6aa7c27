"""Speed, sensing rate and stops: one rule for all baselines, so that they differ only in when they
turn back.

Drive at cruise, the speed with the longest range. On the way out sense at one rate wherever the
interest reaches a threshold; when the memory is nearly full there, stop without sensing until the
radio has made room. On the way home do not sense.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, feature
from homeward.envs.actions import encode_actions
from homeward.envs.features import INTEREST_UNIT
from homeward.envs.options import Known
from homeward.envs.state import GO, RETURN, STOP


@final
@dataclass(frozen=True)
class Pace:
    """Parameters of the rule, tuned by `benchmarks/agents/tune.py`.

    Attributes:
        rate: Sensing rate as a share of the fastest, within [0, 1].
        interest: Interest from which the robot senses, 0 or above.
        full: Share of the memory in use from which to stop for the radio, above 0.
    """

    rate: float
    interest: float
    full: float

    def act(
        self,
        known: Known,
        observations: Observations,
        homebound: NDArray[np.bool_],
        charges: NDArray[np.bool_],
    ) -> NDArray[Any]:
        """Actions of missions that go on, head home (`homebound`) or stop at a dock (`charges`),
        both shape (n,); shape (n, 3)."""
        s = known.shared[0]
        interesting = INTEREST_UNIT * feature(observations, "interest") >= self.interest
        worth = interesting & ~homebound & ~charges
        waits = worth & (feature(observations, "backlog") >= self.full)
        sensing_hz = np.where(worth & ~waits, self.rate * s["max_sensing_hz"], 0.0)
        drives = np.where(homebound, RETURN, GO)
        mode = np.where(charges | waits, STOP, drives)
        return encode_actions(known, s["cruise_mps"], sensing_hz, mode)


NO_SENSING = Pace(rate=0.0, interest=0.0, full=1.0)
"""For missions whose score does not depend on information."""
