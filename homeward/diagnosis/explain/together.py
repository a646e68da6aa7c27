"""All named effects together, beside what else would explain the residual: motion, the place, or
another channel.

A schedule of levels in time fits any intermittent cause. Where the robot's motion alone or the
place predicts held-out stretches as well, the cause was recorded, and the effect is not named.
Every number that a condition on all of them reads is computed here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.random import Generator

from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.formula import Empirical, propose
from homeward.diagnosis.explain.hypothesis import Hypothesis, Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.explain.motion import (
    explained,
    largest_by_motion,
    motion_gain,
    place_gain,
    trees_beat,
)
from homeward.diagnosis.explain.named import Named, Naming
from homeward.diagnosis.explain.places import Location, locate
from homeward.diagnosis.explain.residual_test import Dependence, dependences, independent_blocks
from homeward.diagnosis.fit.channel_errors import is_autocorrelated, unexplained, unrecorded
from homeward.diagnosis.fit.folds import FOLDS
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Index


@dataclass(frozen=True)
class Residual:
    """The residual of a refit of some runs."""

    fit: Refit
    runs: Runs
    strongest: Dependence  # with the largest gain
    block: Index  # (windows,): windows of one block are dependent
    by_run: Index  # (windows,): whole runs that are held out together, where there are enough
    rng: Generator

    @property
    def fold(self) -> Index:
        """Stretches of all runs that are held out together, shape (windows,)."""
        return self.block % FOLDS

    @cached_property
    def by_motion(self) -> float:
        """Share of it that the robot's motion and its history explain."""
        return motion_gain(self.fit, self.runs, self.fold, self.rng)

    @cached_property
    def formula(self) -> Empirical | None:
        """The formula of a channel that fits it."""
        return propose(self.fit, self.runs, self.block, self.by_run, self.rng)


@dataclass(frozen=True)
class RemainingDependence:
    """The residual of the named effects, where it still depends on a channel."""

    channel: str
    location: Location
    formula: Empirical | None  # that fits it, beside the named effects


@dataclass(frozen=True)
class Together:
    """All named effects, one or more, fitted to the residual."""

    naming: Naming
    residual: Residual

    @property
    def runs(self) -> Runs:
        """The recordings."""
        return self.residual.runs

    @property
    def corrected(self) -> Corrected:
        """The model with the effects."""
        assert self.naming.corrected is not None
        return self.naming.corrected

    @property
    def first(self) -> Named:
        """The effect that was named first, which explains most."""
        return self.naming.named[0]

    @property
    def is_scheduled(self) -> bool:
        """Whether the first is at work by a schedule."""
        return self.first.term.axis == "time"

    @cached_property
    def share(self) -> float:
        """Share of the residual that they explain."""
        return explained(self.residual.fit, self.corrected, self.runs, self.residual.fold)

    @property
    def unrecorded_channels(self) -> int:
        """How many of the first and its rivals are maps of a channel that some run lacks."""
        possible = (self.first.term, *self.first.rivals)
        return sum(lacks_its_channel(term.hypothesis, self.runs) for term in possible)

    @cached_property
    def leaves_a_residual(self) -> bool:
        """Whether a residual is left that noise does not explain and the channels of the first do
        not show."""
        strongest = self.residual.strongest
        if strongest.found and strongest.channel.name in self.first.term.hypothesis.channels:
            return False
        if unrecorded(self.runs):
            remaining = self.runs.observed - self.corrected.predicted
            return is_autocorrelated(remaining, self.runs)
        return unexplained(self.corrected, self.runs)

    @cached_property
    def beats_trees(self) -> bool:
        """Whether trees on the motion do not predict unseen runs much better."""
        residual = self.residual
        return not trees_beat(
            self.corrected, residual.fit, self.runs, residual.by_run, residual.rng
        )

    @cached_property
    def _beside_channels(self) -> Refit | Corrected:
        """The model with the effects that channels show: of these motion may be the cause."""
        residual = self.residual
        shown = [term for term in self.corrected.model.terms if term.axis != "time"]
        if not shown:
            return residual.fit
        fit = holding(residual.fit, self.runs, self.corrected.groups.held)
        return fit_model(fit, shown, self.runs, residual.block)

    @cached_property
    def by_schedules(self) -> float:
        """Share of what the effects that channels show leave that those with a schedule explain."""
        share = explained(self._beside_channels, self.corrected, self.runs, self.residual.fold)
        no_channel_shows_any = self._beside_channels is self.residual.fit
        if no_channel_shows_any:
            return max(self.first.held_out_gain, share)
        return share

    @cached_property
    def schedules_by_motion(self) -> float:
        """The same by motion: up to it no unrecorded cause is needed."""
        by_motion = largest_by_motion(
            self._beside_channels, self.runs, self.residual.block, self.residual.rng
        )
        return by_motion.in_time

    @cached_property
    def schedules_by_place(self) -> float:
        """The same by the place and the height climbed; 0 of effects of the ground."""
        if any(effect.term.hypothesis.by_place for effect in self.naming.named):
            return 0.0
        return place_gain(self._beside_channels, self.runs, self.residual.rng)

    @cached_property
    def remaining(self) -> RemainingDependence | None:
        """The residual that they leave where, by the test of the refit's, it depends on a
        channel."""
        by_run = self.residual.by_run
        rng = self.residual.rng
        blocks = independent_blocks(self.corrected, self.runs)
        strongest = dependences(self.corrected, self.runs, blocks, by_run, rng)[0]
        if not strongest.found or strongest.channel.name == "time_s":
            return None
        formula = propose(self.corrected, self.runs, blocks.channels, by_run, rng)
        return RemainingDependence(strongest.channel.name, locate(strongest, self.runs), formula)

    @property
    def hides_another_channel(self) -> bool:
        """Whether the residual depended most on a channel that shows none of them, and still does.

        A state of charge that falls in every run is confounded with time.
        """
        strongest = self.residual.strongest
        channel = strongest.channel.name
        if not strongest.found or channel == "soc" or self.remaining is None:
            return False
        if self.remaining.channel != channel:
            return False
        possible: list[Term] = []
        for effect in self.naming.named:
            possible += [effect.term, *effect.rivals]
        return not any(channel in term.hypothesis.channels for term in possible)

    @property
    def by_each(self) -> float:
        """Share of the residual that they explain one after the other."""
        remaining = [1.0 - effect.held_out_gain for effect in self.naming.named]
        return 1.0 - float(np.prod(remaining))


def lacks_its_channel(hypothesis: Hypothesis, runs: Runs) -> bool:
    """Whether an effect is a map of a channel that some run lacks."""
    return bool(hypothesis.map_channel) and not runs.has(hypothesis.map_channel)


def only_unrecorded_channels(shown_by: list[str], runs: Runs) -> bool:
    """Whether effects of channels that some run lacks would explain a dependence on all these
    channels."""
    lacking = [effect for effect in CATALOGUE.values() if lacks_its_channel(effect, runs)]
    if not shown_by:
        return False
    unrecorded_channels = {channel for effect in lacking for channel in effect.channels}
    return set(shown_by) <= unrecorded_channels
