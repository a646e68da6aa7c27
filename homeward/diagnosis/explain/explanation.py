"""Which explanation of a mismatch stands: named effects, a formula of the channels, or neither; and what remains."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.conditions import TOGETHER, judge, passes
from homeward.diagnosis.explain.formula import Empirical
from homeward.diagnosis.explain.naming import Naming, name_missing
from homeward.diagnosis.explain.parsimony import needless
from homeward.diagnosis.explain.places import Location, locate, where_at_work
from homeward.diagnosis.explain.residual_test import Dependence
from homeward.diagnosis.explain.together import RemainingDependence, Residual, Together, only_unrecorded_channels
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
    empirical: Empirical | None = None  # the formula that fits the mismatch, where no effect is named
    remaining: RemainingDependence | None = None


def explain(
    fit: Refit,
    runs: Runs,
    found: list[Dependence],
    block: Index,
    fold: Index,
    rng: np.random.Generator,
    progress: Callable[[str], None],
    without: Collection[str] = (),
) -> Explanation:
    """Explain the residual of a refit by `found`, its dependences on channels and time, significant ones first.

    Windows of one `block` are dependent, those of one `fold` are held out together, shape (windows,) each. An empty
    `found` gives an empty explanation.
    """
    if not found:
        return Explanation()
    progress("locating")
    search = _Search(Residual(fit, runs, found[0], block, fold, rng), found, progress, without)
    naming = search.naming()
    return search.with_effects(naming) if naming.named else search.without_effects(naming)


@dataclass(frozen=True)
class _Search:
    """The search for an explanation of a residual."""

    residual: Residual
    found: list[Dependence]
    progress: Callable[[str], None]
    without: Collection[str]  # conditions that refuse nothing

    def naming(self, varying: bool = True) -> Naming:
        """The effects that meet their own conditions."""
        its = self.residual
        return name_missing(its.fit, its.runs, its.block, its.rng, self.progress, varying, self.without)

    @cached_property
    def location(self) -> Location | None:
        """Where the residual depends most on a channel, if it does."""
        most = self.residual.most
        return locate(most, self.residual.runs) if most.found else None

    def with_effects(self, naming: Naming) -> Explanation:
        """The named effects if all together meet their conditions; otherwise what else explains the residual."""
        together = Together(naming, self.residual)
        checks = judge(together, self.without, TOGETHER)
        if not passes(checks, self.without):
            return self._refused(together, checks)
        remaining = together.remaining
        return Explanation(replace(naming, together=checks), self.location, remaining=remaining)

    def _refused(self, together: Together, checks: tuple[Checked, ...]) -> Explanation:
        """What stands where the named effects do not meet the condition that was checked last."""
        naming, runs, failed = together.naming, self.residual.runs, checks[-1].condition
        nothing = replace(naming.nothing_named(), together=checks)
        if failed == "recorded" or (failed == "rest" and unrecorded(runs)):
            return Explanation(replace(nothing, unrecorded=True))
        if together.is_scheduled and failed in ("motion together", "place"):
            # The cause was recorded: what channels show may be nearly all of it.
            again = self.naming(varying=False)
            if again.named:
                shown = Together(again, self.residual)
                if shown.share >= thresholds.SIMPLER * together.first.held_out_gain:
                    again = replace(again, ranking=naming.ranking, absorbed=naming.absorbed, together=checks)
                    return Explanation(again, self.location, remaining=shown.remaining)
        if not together.is_scheduled:
            return self.without_effects(nothing)
        where = self.location or where_at_work(together.first.term, together.corrected.contribution[0], runs)
        return Explanation(nothing, where, self.residual.formula)

    def without_effects(self, naming: Naming) -> Explanation:
        """What explains the residual where no effect is named."""
        its = self.residual
        shown_by = [dependence.channel.name for dependence in self.found if dependence.found]
        if only_unrecorded_channels(shown_by, its.runs):
            return Explanation(replace(naming, unrecorded=True))
        if self.location is not None:
            return Explanation(naming, self.location, its.formula)
        if its.by_motion >= thresholds.HALF:
            if not is_material(its.fit, its.runs):
                return Explanation(naming)
            # Where most of what motion explains shows.
            return Explanation(naming, locate(its.most, its.runs), its.formula)
        in_time = [dependence for dependence in self.found if dependence.channel.name == "time_s"]
        if in_time and unexplained(its.fit, its.runs):
            return Explanation(naming, locate(in_time[0], its.runs))
        return Explanation(self._instead_of_parameters(naming))

    def _instead_of_parameters(self, naming: Naming) -> Naming:
        """The effects named if groups that one effect would replace are held at the robot file's values.

        It is tried where the refit absorbs all that is missing.
        """
        its = self.residual
        taken_up = not is_material(its.fit, its.runs) or times_noise(its.fit, its.runs) <= 1.0
        held = needless(its.fit, its.runs) if taken_up else None
        if held is None:
            return naming
        restricted = replace(its, fit=holding(its.fit, its.runs, held))
        again = replace(self, residual=restricted).naming(varying=False)
        if not again.named:
            return naming
        checks = judge(Together(again, restricted), self.without, TOGETHER)
        if not passes(checks, self.without):
            return naming
        return replace(again, ranking=naming.ranking, absorbed=naming.absorbed, together=checks)
