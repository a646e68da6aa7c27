"""What stresses the shield, for `evaluate.py`: a policy that draws speed, sensing and stops, and never turns back.

docs/evaluation.md has the command. `homeward.agents.shield.reckless.Onward`, which never turns either, needs no help.
"""

from __future__ import annotations

import numpy as np

from homeward.agents import Policy
from homeward.agents.shield.reckless import Wanderer
from homeward.envs.options import Known


def wanderer(known: Known) -> Policy:
    """The policy, which draws alike with and without a shield."""
    return Wanderer(known, np.random.default_rng(0))
