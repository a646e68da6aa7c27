"""One effect instead of several wrong parameters, where the refit absorbs the effect and leaves no
residual of it.

A robot file is usually wrong in few numbers. Where a refit changes several that one effect would
replace, the effect is the simpler explanation: models of some numbers of the file, with one effect
or none, are compared by the Bayesian information criterion (Kass & Raftery, 1995). A wrong mass
also changes C_rr m, and counts once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import terms
from homeward.diagnosis.explain.hypothesis import Setting, Term
from homeward.diagnosis.fit.bounded import bounded
from homeward.diagnosis.fit.channel_errors import meter_error
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING, Parameters
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.autocorrelation import independent_windows
from homeward.logs.channels import Array, Mask


def needless(fit: Refit, runs: Runs) -> Mask | None:
    """Groups that need not differ from the robot file if one effect is at work, shape (groups,);
    None where no effect lowers BIC enough.

    The refit must have no residual that an effect would explain.
    """
    steps = _steps_by_number(fit.parameters)
    target = _residual_of_the_file(fit, runs)
    effects = _effects_of_one_size(Setting.of(fit, runs, target))
    regression = _Regression.of(fit, runs, steps, effects, target)

    numbers = range(len(steps))
    subsets = [subset for size in range(len(steps) + 1) for subset in combinations(numbers, size)]
    bic_without_effect, changed_without_effect = min(
        (regression.bic(subset), subset) for subset in subsets
    )

    # An effect counts as one number: only models that change fewer numbers in all are simpler.
    simpler = [subset for subset in subsets if len(subset) + 1 < len(changed_without_effect)]
    effect_columns = range(len(steps), len(steps) + len(effects))
    models = [
        (regression.bic((*subset, effect)), subset)
        for subset in simpler
        for effect in effect_columns
    ]
    bic_with_effect, changed = min(models, default=(np.inf, ()))
    if bic_with_effect + thresholds.STRONG_BIC > bic_without_effect:
        return None
    return np.asarray((steps[list(changed)] == 0.0).all(axis=0))


def _steps_by_number(parameters: Parameters) -> Array:
    """Steps of the groups, in units of `scale`, by each number of a robot file alone, shape
    (numbers, groups)."""
    steps = np.eye(len(parameters.start))
    # The mass also changes C_rr m.
    rolling_per_mass = parameters.start[ROLLING] / parameters.start[MASS]
    steps[MASS, ROLLING] = rolling_per_mass * parameters.scale[MASS] / parameters.scale[ROLLING]
    return steps


def _residual_of_the_file(fit: Refit, runs: Runs) -> Array:
    """What the robot file leaves of the record, by the refit's linear model, shape (windows,)."""
    to_the_file = (fit.parameters.start - fit.theta) / fit.parameters.scale
    return np.asarray(runs.observed - fit.predicted - fit.jacobian @ to_the_file)


def _effects_of_one_size(setting: Setting) -> list[Term]:
    """Physical effects that channels show and that one number describes."""
    return [
        term
        for term in terms(setting, varying=False)
        if term.columns.shape[1] == 1 and term.hypothesis.physical
    ]


@dataclass(frozen=True)
class _Regression:
    """Bounded least squares of the robot file's residual on its numbers, in units of `scale`, and
    on effects."""

    gram: Array  # (columns + 1, columns + 1): products of numbers, effects and, last, the residual
    low: Array  # (columns,)
    high: Array  # (columns,)
    independent: float  # effective sample size, windows
    # squared error that the meter's scale explains: no model is known to fit better
    meter_error: float

    @classmethod
    def of(
        cls, fit: Refit, runs: Runs, steps: Array, effects: Sequence[Term], target: Array
    ) -> _Regression:
        """Products of all columns, summed once over the windows; `target`, shape (windows,), is the
        residual."""
        problem = fit.parameters
        columns = np.column_stack(
            [fit.jacobian @ steps.T, *(effect.columns for effect in effects), target]
        )
        low = (problem.low - problem.start) / problem.scale
        high = (problem.high - problem.start) / problem.scale
        return cls(
            gram=columns.T @ columns,
            low=np.append(low, [effect.low[0] for effect in effects]),
            high=np.append(high, [effect.high[0] for effect in effects]),
            independent=independent_windows(runs.observed - fit.predicted, runs.run),
            meter_error=meter_error(runs),
        )

    def bic(self, columns: tuple[int, ...]) -> float:
        """Bayesian information criterion of the model that changes these numbers and has these
        effects."""
        index = np.array(columns, np.intp)
        gram = self.gram[np.ix_(index, index)]
        moment = self.gram[index, -1]
        weights = bounded(gram, moment, self.low[index], self.high[index])
        squared_error = float(self.gram[-1, -1] - 2.0 * weights @ moment + weights @ gram @ weights)
        misfit = self.independent * np.log(max(squared_error, 0.0) + self.meter_error)
        return float(misfit + len(columns) * np.log(self.independent))
