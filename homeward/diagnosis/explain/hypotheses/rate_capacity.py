"""Capacity that is lost at high power, above one of two references."""

from collections.abc import Iterator

import numpy as np

from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting
from homeward.physics.effects.rate_capacity import EFFECT


def _references(setting: Setting) -> Iterator[dict[str, float]]:
    drawn = setting.runs.observed[setting.runs.observed > 0.0]
    for value in np.unique(np.quantile(drawn, [0.02, 0.5])) if len(drawn) else []:
        yield {"reference_w": float(value)}


HYPOTHESIS = Hypothesis(
    EFFECT,
    needs=(),
    shapes=_references,
    otherwise="at high power",
    check="discharge a full battery once slowly and once fast through known loads",
)
