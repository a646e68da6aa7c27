"""Thresholds of the agents that are choices, each defined once and with its origin.

The folder `agents/rules` holds the rules for turning back. Tuned paces and reserves are in options
(`homeward.agents.rules.reserves`), the settings of training in `homeward.agents.learning.settings`.
Grids, priors and rounding stand beside their code.
"""

# --- Turning back ---------------------------------------------------------------------------------

AT_END = 1.0 - 1e-6
"""Share of the length of a route from which a robot is at its end. Chosen: positions are rounded by
less."""

HOME_TIME = 1.25
"""Ratio of the time kept for the way home to that at cruise. Chosen: the nearest speed level may be
below cruise, by 17 % at most for the robots that ship (f1tenth)."""

UNSEEN_LAP = 0.1
"""Relative standard deviation of a lap's energy, assumed until two laps are measured. Chosen: with
0.05 or 0.2 instead neither mean score nor stranding rate of 1,000 patrols (seed 31, k = 1) changes;
the battery lasts longer."""

UNSEEN_HOME = 0.1
"""Standard deviation of the ratio of measured over modelled energy on the way home about that on
the way out, due to a cause that is not observable on the way out: wind. Chosen, and the reserve k
was tuned with it (`homeward.agents.rules.reserves`): on 2,000 missions of OutAndBack (seed 31),
0.05 with k = 3 or 0.2 with k = 1 change the mean score by less than 0.4 %."""

MISSED = 0.02
"""Prior probability of the belief rule that the forecast is of another wind. Chosen so that one
reading in fifty that the forecast cannot explain is enough to doubt it."""

# --- Shield ---------------------------------------------------------------------------------------

RISK = 1e-6
"""Probability of stranding in the chance constraint of each decision: at least 99.8 % of missions
get home, see docs/results.md."""

SPARE_DECISIONS = 3.0
"""Time kept in reserve before the time limit, in decisions: one for the action, one because a
mission ends with a whole decision, and one as a margin."""

# --- Trained policies -----------------------------------------------------------------------------

SAME_OUTPUT = 1e-4
"""Difference of two outputs of the network below which either action is right: runtimes add in
different order. Chosen: far above the rounding of single precision (1e-7), and too small to matter
for an action."""

LARGEST_WEIGHT = 1e6
"""Largest weight of a checkpoint. Chosen: far beyond any in training, with a finite square."""
