"""Which explanation of a mismatch stands: named effects, a formula of the channels, or neither; and
what remains."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.conditions import TOGETHER, judge, passes
from homeward.diagnosis.explain.formula import Empirical
from homeward.diagnosis.explain.named import Naming
from homeward.diagnosis.explain.naming import name_missing
from homeward.diagnosis.explain.parsimony import needless
from homeward.diagnosis.explain.places import Location, locate, where_at_work
from homeward.diagnosis.explain.residual_test import Dependence
from homeward.diagnosis.explain.together import (
    RemainingDependence,
    Residual,
    Together,
    only_unrecorded_channels,
)
from homeward.diagnosis.fit.channel_errors import is_material, times_noise, unexplained, unrecorded
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Checked
from homeward.logs.channels import Index


@dataclass(frozen=True)
class Explanation:
    """What explains the mismatch, where it is, and the remaining residual."""

    naming: Naming = field(default_factory=Naming)
    location: Location | None = None
    # the formula that fits the mismatch, where no effect is named
    empirical: Empirical | None = None
    remaining: RemainingDependence | None = None


def explain(
    fit: Refit,
    runs: Runs,
    tested: list[Dependence],
    block: Index,
    fold: Index,
    rng: np.random.Generator,
    progress: Callable[[str], None],
    waived: Collection[str] = (),
) -> Explanation:
    """Explain the residual of a refit by `tested`, its dependences on channels and time,
    significant ones first.

    Windows of one `block` are dependent, those of one `fold` are held out together, shape
    (windows,) each. Conditions that an experiment has `waived` refuse nothing. An empty `tested`
    gives an empty explanation.
    """
    if not tested:
        return Explanation()
    progress("locating")
    residual = Residual(fit=fit, runs=runs, strongest=tested[0], block=block, by_run=fold, rng=rng)
    search = _Search(residual, tested, progress, waived)
    naming = search.naming()
    if naming.named:
        return search.with_effects(naming)
    return search.without_effects(naming)


@dataclass(frozen=True)
class _Search:
    """The search for an explanation of a residual."""

    residual: Residual
    tested: list[Dependence]
    progress: Callable[[str], None]
    waived: Collection[str]  # conditions that refuse nothing

    def naming(self, varying: bool = True) -> Naming:
        """The effects that meet their own conditions."""
        residual = self.residual
        return name_missing(
            residual.fit,
            residual.runs,
            residual.block,
            residual.rng,
            self.progress,
            varying,
            self.waived,
        )

    @cached_property
    def location(self) -> Location | None:
        """Where the residual depends most on a channel, if it does."""
        strongest = self.residual.strongest
        if not strongest.found:
            return None
        return locate(strongest, self.residual.runs)

    def with_effects(self, naming: Naming) -> Explanation:
        """The named effects if all together meet their conditions; otherwise what else explains the
        residual."""
        together = Together(naming, self.residual)
        checks = judge(together, self.waived, TOGETHER)
        if not passes(checks, self.waived):
            return self._refused(together, checks)
        remaining = together.remaining
        return Explanation(replace(naming, together=checks), self.location, remaining=remaining)

    def _refused(self, together: Together, checks: tuple[Checked, ...]) -> Explanation:
        """What stands where the named effects do not meet the condition that was checked last."""
        runs = self.residual.runs
        failed = checks[-1].condition
        nothing_named = replace(together.naming.nothing_named(), together=checks)
        if failed == "recorded" or (failed == "rest" and unrecorded(runs)):
            return Explanation(replace(nothing_named, unrecorded=True))
        if together.is_scheduled and failed in ("motion together", "place"):
            explanation = self._by_channels(together, checks)
            if explanation is not None:
                return explanation
        if not together.is_scheduled:
            return self.without_effects(nothing_named)
        location = self.location
        if location is None:
            location = where_at_work(together.first.term, together.corrected.contribution[0], runs)
        return Explanation(nothing_named, location, self.residual.formula)

    def _by_channels(self, together: Together, checks: tuple[Checked, ...]) -> Explanation | None:
        """The effects that channels show, where they explain nearly as much as a refused schedule
        did.

        The cause of the schedule was recorded, so that they may be nearly all of it.
        """
        shown_naming = self.naming(varying=False)
        if not shown_naming.named:
            return None
        shown = Together(shown_naming, self.residual)
        is_nearly_as_much = shown.share >= thresholds.SIMPLER * together.first.held_out_gain
        if not is_nearly_as_much:
            return None
        naming = _with_scores_of(together.naming, shown_naming, checks)
        return Explanation(naming, self.location, remaining=shown.remaining)

    def without_effects(self, naming: Naming) -> Explanation:
        """What explains the residual where no effect is named."""
        residual = self.residual
        shown_by = [dependence.channel.name for dependence in self.tested if dependence.found]
        if only_unrecorded_channels(shown_by, residual.runs):
            return Explanation(replace(naming, unrecorded=True))
        if self.location is not None:
            return Explanation(naming, self.location, residual.formula)
        if residual.by_motion >= thresholds.HALF:
            if not is_material(residual.fit, residual.runs):
                return Explanation(naming)
            # Where most of what motion explains shows.
            location = locate(residual.strongest, residual.runs)
            return Explanation(naming, location, residual.formula)
        in_time = [dependence for dependence in self.tested if dependence.channel.name == "time_s"]
        if in_time and unexplained(residual.fit, residual.runs):
            return Explanation(naming, locate(in_time[0], residual.runs))
        return Explanation(self._instead_of_parameters(naming))

    def _instead_of_parameters(self, naming: Naming) -> Naming:
        """The effects named if groups that one effect would replace are held at the robot file's
        values.

        It is tried where the refit absorbs all that is missing.
        """
        fit = self.residual.fit
        runs = self.residual.runs
        is_absorbed = not is_material(fit, runs) or times_noise(fit, runs) <= 1.0
        if not is_absorbed:
            return naming
        needless_groups = needless(fit, runs)
        if needless_groups is None:
            return naming
        restricted = replace(self.residual, fit=holding(fit, runs, needless_groups))
        effects_instead = replace(self, residual=restricted).naming(varying=False)
        if not effects_instead.named:
            return naming
        checks = judge(Together(effects_instead, restricted), self.waived, TOGETHER)
        if not passes(checks, self.waived):
            return naming
        return _with_scores_of(naming, effects_instead, checks)


def _with_scores_of(scored: Naming, naming: Naming, checks: tuple[Checked, ...]) -> Naming:
    """A second naming with the scores of the first, in which all hypotheses were tried."""
    return replace(naming, ranking=scored.ranking, absorbed=scored.absorbed, together=checks)
