"""A stress test of the shield, for `evaluate.py`: a policy with random speed, sensing and stops that never turns back.

docs/results.md has the command. `homeward.agents.shield.reckless.Onward` never turns either.
"""

from __future__ import annotations

import numpy as np

from homeward.agents import Policy
from homeward.agents.shield.reckless import Wanderer
from homeward.envs.options import Known


def wanderer(known: Known) -> Policy:
    """The policy; its random numbers are the same with and without a shield."""
    return Wanderer(known, np.random.default_rng(0))
