"""Intervals of allowed values, and the check of arguments against them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Bounds:
    """Allowed interval of a number; `open_low` and `open_high` exclude the ends."""

    low: float
    high: float
    open_low: bool = False
    open_high: bool = False

    def hold(self, value: Any) -> Any:
        """Whether a number, or each of an array, lies within; NaN does not."""
        above = value > self.low if self.open_low else value >= self.low
        below = value < self.high if self.open_high else value <= self.high
        return above & below

    def __str__(self) -> str:
        left = "(" if self.open_low else "["
        right = ")" if self.open_high else "]"
        return f"{left}{self.low:g}, {self.high:g}{right}"


FINITE = Bounds(-np.inf, np.inf, open_low=True, open_high=True)
NOT_NEGATIVE = Bounds(0.0, np.inf, open_high=True)


def checked(name: str, value: Any, bounds: Bounds) -> Any:
    """Turn an argument that may be a number or anything like an array into float64, within its
    bounds.

    Args:
        name: Name of the argument, for the message.
        value: Number or array-like, any shape.
        bounds: What is allowed.

    Raises:
        ValueError: It is not a number, or one of its numbers is outside the bounds.
    """
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} = {value!r} is not a number or an array of numbers; allowed: {bounds}"
        ) from None
    good = bounds.hold(array)
    if not good.all():
        raise ValueError(
            f"{name} = {array[~good].flat[0]} is not allowed; allowed: a number in {bounds}"
        )
    return array[()]
