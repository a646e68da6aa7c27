"""A radio whose power rises with the distance from base, in any way: its rate falls in steps, its airtime rises."""

from collections.abc import Mapping

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.diagnosis.fit.replay import Runs
from homeward.physics.effects.radio import EFFECT


def _farthest(runs: Runs) -> Mapping[str, float]:
    """Beyond what was recorded the power is taken to rise no more."""
    return {EFFECT.parameters[1].name: float(runs.context["base_distance_m"].max())}


HYPOTHESIS = Hypothesis(EFFECT, rises_with="base_distance_m", reach=_farthest)
