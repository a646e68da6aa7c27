"""A set of effects in its joint replay, and a candidate: one effect beside the others of its set.

Every number that a condition reads is computed here. A set is fitted together with the parameters,
through the replay, and scored by the windows that its fit has not seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.random import Generator

from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.explain.motion import ByMotion, largest_by_motion
from homeward.diagnosis.explain.proof import Bench
from homeward.diagnosis.fit.folds import FOLDS
from homeward.diagnosis.fit.held_out import Gain, gain, held_out
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Index, Mask


@dataclass(frozen=True)
class EffectSet:
    """Effects that are fitted together with the parameters; without any, the refit."""

    model: Refit | Corrected
    runs: Runs
    block: Index  # (windows,)
    rng: Generator

    @property
    def terms(self) -> tuple[Term, ...]:
        """The effects, each in the form that was fitted."""
        if isinstance(self.model, Corrected):
            return self.model.model.terms
        return ()

    @cached_property
    def predicted(self) -> Array:
        """Held-out prediction by replays, shape (windows,): each fold by the model fitted to the
        others."""

        def predict(training: Mask) -> Array:
            return self.model.refitted(training, self.runs).replayed(self.runs)

        return held_out(predict, self.block % FOLDS)

    @cached_property
    def squared_error(self) -> float:
        """Of the held-out prediction, summed over windows."""
        return self.runs.squared_error(self.predicted)

    @cached_property
    def by_motion(self) -> ByMotion:
        """Share of what the set leaves that the motion of the robot accounts for."""
        return largest_by_motion(self.model, self.runs, self.block, self.rng)


@dataclass(frozen=True)
class Candidate:
    """One effect of a set, beside the set without it."""

    place: int  # among the effects of the set
    with_it: EffectSet
    without: EffectSet
    noise: float  # squared error that noise of power explains; 0 beside other effects
    # the hypotheses beside `without`, and which of them it is
    find: Callable[[], tuple[Bench, int]]

    @cached_property
    def _bench_and_index(self) -> tuple[Bench, int]:
        return self.find()

    @property
    def bench(self) -> Bench:
        """The hypotheses beside the set without it."""
        bench, _ = self._bench_and_index
        return bench

    @property
    def index(self) -> int:
        """Which of them it is."""
        _, index = self._bench_and_index
        return index

    @property
    def term(self) -> Term:
        """Its form in the joint replay."""
        return self.with_it.terms[self.place]

    @property
    def runs(self) -> Runs:
        """The recordings."""
        return self.with_it.runs

    @cached_property
    def gain(self) -> Gain:
        """Share of the squared held-out error of the set without it that it explains."""
        return gain(
            self.runs.observed,
            self.without.predicted,
            self.with_it.predicted,
            self.with_it.block,
            self.with_it.rng,
        )

    @cached_property
    def searched_share(self) -> float:
        """The same with change points that are searched anew without the held-out windows."""
        if self.term.axis == "steady":
            return self.gain.share
        return min(self.gain.share, self.bench.share(self.index))

    @property
    def gain_beyond_noise(self) -> float:
        """That share of what noise of power does not explain."""
        share_of_noise = self.noise / max(self.without.squared_error, 1e-300)
        return self.searched_share / max(1.0 - share_of_noise, 1e-9)

    @property
    def explained(self) -> float:
        """Squared error that it explains, summed over windows."""
        return self.searched_share * self.without.squared_error

    @property
    def channel_error(self) -> float:
        """Squared error by errors of the channels that the effect may follow."""
        return self.bench.channel_error * followed(self.bench, self.index)

    @property
    def energy_share(self) -> float:
        """Share of the recorded energy that it adds and saves."""
        model = self.with_it.model
        assert isinstance(model, Corrected)
        changed_j = float(np.abs(model.contribution[self.place] * self.runs.duration_s).sum())
        recorded_j = float(np.abs(self.runs.observed * self.runs.duration_s).sum())
        return changed_j / max(recorded_j, 1e-300)

    @property
    def innovations_bic(self) -> float:
        """Reduction of BIC by the effect, from the innovations of the residual."""
        return self.bench.innovations_bic(self.index)

    @property
    def delta_bic(self) -> float:
        """Reduction of BIC by the effect, from what it explains of held-out windows or, in steps,
        from innovations."""
        return self.bench.delta_bic(self.index)

    @cached_property
    def p_value(self) -> float:
        """Share of placebos in which the same search scores as high."""
        return self.bench.p_value(self.index, self.bench.independent(self.index), self.with_it.rng)


def followed(bench: Bench, index: int) -> float:
    """Share of the channels' errors that a hypothesis may absorb: all by place, where they repeat,
    and all of what is like a slope; in time one independent window for each of its levels."""
    term = bench.candidates[index]
    if term.axis == "time":
        changes = 1 if term.schedule is None else term.schedule.changes
        levels = changes + 1
        return min(1.0, levels / bench.independent(index))
    if term.axis == "place" or term.hypothesis.map_channel:
        return 1.0
    return 0.0
