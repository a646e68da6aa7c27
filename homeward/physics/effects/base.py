"""An effect: physics that the paper's model omits, in one file, and zero unless switched on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Kind = Literal["force", "drive", "ancillary", "battery"]
"""Where an effect enters the model."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect: unit, bounds, default, and meaning in one sentence."""

    name: str
    unit: str
    low: float
    high: float
    meaning: str
    default: float = 0.0


@dataclass(frozen=True)
class Effect:
    """One effect: its function, parameters and how a recording shows it.

    The function takes `(p, s, x, load)`: robot record, state record, `Conditions` and the load so
    far, and returns what the effect adds to it. The load is the force at the wheels (N) for `force`
    effects, and for `drive` effects too, which return power (W); for `ancillary` and `battery`
    effects it is the power drawn so far (W).

    Attributes:
        id: Name from the fixed vocabulary of effect ids.
        kind: Where it enters: force at the wheels, electrical power of the drive, ancillary power,
            battery.
        function: The formula; numpy arrays broadcast through it.
        parameters: The first is the magnitude: at zero the effect is off.
        sentence: Description in one sentence, in terms of robotics.
        equation: The formula in plain text.
        source: Where the formula comes from.
        needs: Recording channels without which it cannot be seen.
        confused_with: Effects that most drives cannot distinguish from it.
    """

    id: str
    kind: Kind
    function: Callable[..., float]
    parameters: tuple[Parameter, ...]
    sentence: str
    equation: str
    source: str
    needs: tuple[str, ...]
    confused_with: tuple[str, ...] = ()

    @property
    def switch(self) -> Parameter:
        """The magnitude: the parameter that switches the effect off at zero."""
        return self.parameters[0]

    def field(self, parameter: Parameter) -> str:
        """Name of a parameter in the robot record."""
        return f"{self.id}_{parameter.name}"
