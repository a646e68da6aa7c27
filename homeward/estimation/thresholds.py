"""Thresholds and tuned numbers of the estimator that are choices, each defined once and with its
origin.

The prior is an options class (`homeward.estimation.prior`). The grid of hypotheses, iterations and
the tolerance of a search decide nothing by themselves and stand beside their code.
"""

# --- Probabilities --------------------------------------------------------------------------------

DEGREES = 7.0
"""Degrees of freedom of Student's t. Chosen: those at which the shield's confidence of 0.999
corresponds to its risk of 1e-6."""

LEAST_LOG_WEIGHT = -14.0
"""Lower limit of the logarithm of a hypothesis' weight: one in a million, so that a hypothesis can
recover if ground and wind differ from those assumed."""

OUTLIER = 1e-3
"""Probability that a reading of power is an outlier; chosen: none or one of the readings of a
mission."""

MOST_LOADS = 20.0
"""Energy, over that of the file's robot standing and rolling on level ground, up to which an
outlier is a load that the model lacks, and not a fault of the meter. Chosen as POWERS of the
companion, beyond which a power is impossible."""

LEAST_CHANCE = OUTLIER
"""Least probability of coasting for a robot that seems to coast: a slope may have been misread;
chosen as OUTLIER."""

LEAST_SKEWNESS = 1e-3
"""Skewness below which a distribution counts as normal; chosen: moves no quantile by 0.01
deviations."""

MODEL_ERRORS = 0.001, 0.0015, 0.006
"""Errors of the model that are always assumed, as shares of a decision's energy and of that of the
way home: where nothing is hidden, in still weather, and in changing weather. Of 0.001 to 0.01, the
last gives intervals of the way home with about the right coverage at `uncertain` with its meter
(`benchmarks/agents/identification.py`), and the second the highest score."""

MISSED = 0.2
"""Prior probability that the forecast is of another wind, where safety counts: in the shield and
the companion. Chosen: ten times that of the belief rule (MISSED in `homeward.agents.thresholds`),
as on the routes `hidden_wind`."""

# --- Wind and ground ------------------------------------------------------------------------------

TEMPER = 0.5
"""Exponent of the likelihood in the weights of hypotheses: errors are correlated, but the filter
assumes independence. With 1 the margin is below its 1e-3 quantile twice as often, with 0.35 the
quantile is lower. Chosen by trial, like the next two, on seeds 1, 3 and 5 of
tests/estimation/world.py."""

ADAPT = 0.15
"""Change of the logarithm of the gusts' correlation time for a squared error that is 1 above its
expectation. Chosen as TEMPER."""

UNEVEN = 0.3
"""Error of the rolling of one place on the way home, over the standard deviation of a change of the
ground. Chosen as TEMPER."""

COASTS = 0.01
"""Ratio of the energy to that of rolling on level ground, below which the robot coasted; chosen:
above rounding."""

SURELY_CONSUMES = 0.7
"""Ratio of the energy of a stretch to that of rolling, above which the stretch surely consumes
energy: five prior deviations (0.144) from none."""

LEAST_ROLLING = 0.1
"""Least ratio of the rolling resistance to the file's, as stored for the way home; chosen:
positive."""

STOOD = 1.05
"""Ratio of the speed while moving to the mean speed, the way over the time, above which the robot
stood for a part of the time. Chosen: 5 % and more."""

# --- State of charge ------------------------------------------------------------------------------

DOUBT = 9.0
"""Squared standard deviations above which a state of charge counts less, and errors do not update
gusts: three standard deviations. Chosen."""

LEAST_SOC_ERROR = 1e-5
"""Least standard deviation of a state of charge: single precision and accumulated rounding."""

LEAST_INDEPENDENT = 1e-3
"""Least share of the information of a new reading in one that is rounded as the last. Chosen: above
0, because the variance is divided by it."""

STUCK_STEPS, STUCK_NOISE, STUCK = 3.0, 5.0, 0.005
"""Steps, standard deviations and share of the battery by which an unchanged state of charge must be
off together before it is ignored. Chosen: none of them alone may end the use of a reading that is
right."""

# --- Excitation -----------------------------------------------------------------------------------

EXCITATION_EVERY, EXCITATION_AT = (40, 20), 10
"""Decisions per excitation step (driven towards home at the lowest speed) in still and in changing
weather, and the first one: of 10 to 50 by trial on OutAndBack. Each lowers the planner's score by
0.1 to 0.2 %. Without any, 19 % of its missions strand in winds that the forecast lacks, with them
1.1 % (docs/results.md)."""

EXCITATION_FAR = 1.5
"""Distance from home, in decisions at cruise, from which an excitation step is useful. Chosen:
nearer, the robot is almost home."""
