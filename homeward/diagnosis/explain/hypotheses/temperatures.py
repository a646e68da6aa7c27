"""Temperatures above or below which an effect may be at work."""

from collections.abc import Callable, Iterator

import numpy as np

from homeward.diagnosis.explain.hypothesis import Setting
from homeward.physics.effects import Parameter


def temperatures(of: Parameter) -> Callable[[Setting], Iterator[dict[str, float]]]:
    """Values of a temperature that are tried: among those recorded, above all of them, and 20 degC."""

    def shapes(setting: Setting) -> Iterator[dict[str, float]]:
        temperature_c = setting.runs.context["temperature_c"]
        known = temperature_c[np.isfinite(temperature_c)]
        quantiles = np.round(np.quantile(known, [0.3, 0.5, 0.7, 0.85]), 1).tolist() if len(known) else []
        for value in dict.fromkeys([*quantiles, float(np.max(known, initial=-100.0)) + 0.1, 20.0]):
            if of.low <= value <= of.high:
                yield {of.name: float(value)}

    return shapes
