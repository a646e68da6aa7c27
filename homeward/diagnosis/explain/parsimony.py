"""One effect instead of several wrong parameters, where the refit absorbs the effect and leaves no residual of it.

A robot file is usually wrong in few numbers. Where a refit changes several that one effect would replace, the effect is
the simpler explanation: models of some numbers of the file, with one effect or none, are compared by the Bayesian
information criterion (Kass & Raftery, 1995). A wrong mass also changes C_rr m, and counts once.
"""

from itertools import combinations

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import terms
from homeward.diagnosis.explain.hypothesis import Setting
from homeward.diagnosis.fit.channel_errors import meter_error
from homeward.diagnosis.fit.fitted import bounded
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.autocorrelation import independent_windows
from homeward.logs.channels import Mask


def needless(fit: Refit, runs: Runs) -> Mask | None:
    """Groups that need not differ from the robot file if one effect is at work, shape (groups,); None where no
    effect lowers BIC enough.

    The refit must have no residual that an effect would explain.
    """
    problem = fit.parameters
    start = (problem.start - fit.theta) / problem.scale
    target = runs.observed - fit.predicted - fit.jacobian @ start
    effects = [
        one
        for one in terms(Setting.of(fit, runs, target), varying=False)
        if one.columns.shape[1] == 1 and one.hypothesis.physical
    ]
    # Steps of the groups by each number of a robot file alone, (numbers, groups): the mass also changes C_rr m.
    numbers = np.eye(len(fit.theta))
    per_mass = problem.start[ROLLING] / problem.start[MASS]
    numbers[MASS, ROLLING] = per_mass * problem.scale[MASS] / problem.scale[ROLLING]
    columns = np.column_stack([fit.jacobian @ numbers.T, *(one.columns for one in effects), target])
    gram = columns.T @ columns
    low, high = ((bound - problem.start) / problem.scale for bound in (problem.low, problem.high))
    low, high = np.append(low, [one.low[0] for one in effects]), np.append(high, [one.high[0] for one in effects])
    independent = independent_windows(runs.observed - fit.predicted, runs.run)
    least = meter_error(runs)

    def criterion(chosen: tuple[int, ...]) -> float:
        own = np.array(chosen, np.intp)
        weights = bounded(gram[np.ix_(own, own)], gram[own, -1], low[own], high[own])
        error = float(gram[-1, -1] - 2.0 * weights @ gram[own, -1] + weights @ gram[np.ix_(own, own)] @ weights)
        return float(independent * np.log(max(error, 0.0) + least) + len(chosen) * np.log(independent))

    count = len(numbers)
    subsets = [one for size in range(count + 1) for one in combinations(range(count), size)]
    without, off = min((criterion(one), one) for one in subsets)
    fewer = [one for one in subsets if len(one) + 1 < len(off)]
    with_one = [(criterion((*one, count + index)), one) for one in fewer for index in range(len(effects))]
    best, changed = min(with_one, default=(np.inf, ()))
    if best + thresholds.STRONG_BIC > without:
        return None
    return np.asarray((numbers[list(changed)] == 0.0).all(axis=0))
