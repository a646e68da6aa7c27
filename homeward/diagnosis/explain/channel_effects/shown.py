"""What another channel than power shows: an effect, or the capacity of the battery."""

from collections.abc import Mapping
from dataclasses import dataclass

from homeward.diagnosis.explain.hypothesis import Hypothesis, Numbers
from homeward.diagnosis.result import Proof, Value
from homeward.logs.channels import Array

USABLE_ENERGY = "usable energy"
"""Name of the parameter identified from the state of charge."""


@dataclass(frozen=True)
class ChannelEffect:
    """An effect that another channel than power identifies."""

    hypothesis: Hypothesis
    parameters: Mapping[str, Value]
    contribution: Array  # (windows,), W
    proof: Proof  # in the channel that identifies it
    rivals: tuple[str, ...]  # effects that are confounded with it in that channel
    sentence: str  # the evidence, in words

    @property
    def in_file(self) -> Mapping[str, Numbers]:
        """Its entry in a robot file; empty for a fault of an instrument."""
        if not self.hypothesis.physical:
            return {}
        return {self.hypothesis.id: {name: value.value for name, value in self.parameters.items()}}

    @property
    def gained(self) -> float:
        """Share of the channel's held-out squared error that it explains; 0 where no model was
        compared."""
        return self.proof.held_out_gain or 0.0


@dataclass(frozen=True)
class Capacity:
    """Energy of a full battery by a recorded state of charge, J; `ci95` has the errors of gauge and
    curve."""

    assumed_j: float
    fitted_j: float  # one for all runs
    ci95: tuple[float, float]
    off: bool  # significantly differs from assumed, and is the same in all runs
    rivals: tuple[str, ...] = ()  # losses that explain the charge as well, with the file's capacity
    above_rated: bool = False  # above that of a new battery by the robot's file

    @property
    def asked(self) -> bool:
        """Whether it is off, and above what the battery's maker rates: asked about, and not written
        to a file."""
        return self.off and self.above_rated

    @property
    def written(self) -> bool:
        """Whether it is off, and a file may have it."""
        return self.off and not self.above_rated


def values_of(
    hypothesis: Hypothesis, size: float, ci95: tuple[float, float], shape: Numbers
) -> dict[str, Value]:
    """The parameters of an effect: its fitted size, and the others of its form."""
    units = {parameter.name: parameter.unit for parameter in hypothesis.entry.parameters}
    switch = hypothesis.entry.switch
    of_shape = {name: Value(number, None, units[name]) for name, number in shape.items()}
    return {switch.name: Value(size, ci95, switch.unit), **of_shape}
