"""Thresholds of comparing groups that are choices, each defined once and with its origin; others:
the diagnosis."""

from homeward.diagnosis.thresholds import SIGNIFICANT

# --- Tests ----------------------------------------------------------------------------------------

LEVEL = 0.05
"""False discovery rate: expected share of false ones among the named differences, which is the
probability of any where no group differs. Chosen: the convention."""

UPPER_95 = 1.0 - 0.5 * SIGNIFICANT
"""Quantile at the upper end of a 95 % interval: half of the level that the diagnosis has for its
intervals lies beyond it."""

SMALLEST_SPREAD = 1e-6
"""Least spread between runs, as a share of the largest value; chosen: a smaller spread is
rounding."""

# --- Standing -------------------------------------------------------------------------------------

STANDSTILL_RADPS = 0.02
"""Turning rate, rad/s, up to which a robot stands; chosen: noise of a gyroscope at rest."""

STEADY = 0.2
"""Standard deviation of window means over their mean, up to which a load is that of a standing
robot. Twelve runs of ase_rover at rest have 0.02 to 0.04 and drives of husky_borealtc 0.5 to 0.7:
half or twice this limit also distinguishes them."""

BATCH_TIMES = 8.0
"""Autocorrelation times in a batch: means then hardly correlate. In autoregressive noise (0.5 to
0.97 from window to window, 2 and 10 minutes, 400 runs each) intervals of 95 % cover 93 to 96 %;
with half 91 to 96 %, with twice 93 to 96 % but up to 1.8 times as wide."""

MOST_BATCHES = 10
"""Most batches of a run; chosen: more would leave batches too short for a slow drift to show
between them."""

FEWEST_WINDOWS = 6
"""Fewest windows of a run; chosen: with fewer there is no autocorrelation to estimate."""
