"""Which explanation of a mismatch stands: named effects, a formula of the channels, or neither; and what remains.

An effect that needs a schedule is compared with recorded confounders: where the robot's motion alone, or a formula of a
channel, predicts held-out stretches as well, the cause was recorded and the effect is not named.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.formula import Empirical, propose
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.explain.motion import explained, largest_by_motion, motion_gain, place_gain, trees_beat
from homeward.diagnosis.explain.naming import Naming, name_missing
from homeward.diagnosis.explain.parsimony import needless
from homeward.diagnosis.explain.places import Location, locate, where_at_work
from homeward.diagnosis.explain.residual_test import Dependence, dependences, independent_blocks
from homeward.diagnosis.fit.channel_errors import is_autocorrelated, is_material, times_noise, unexplained, unrecorded
from homeward.diagnosis.fit.folds import FOLDS
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Index


@dataclass(frozen=True)
class RemainingDependence:
    """The residual of the named effects, where it still depends on a channel."""

    channel: str
    location: Location
    formula: Empirical | None  # that fits it, beside the named effects


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
    residual = _Residual(fit, runs, found[0], block, fold, rng, progress, without)
    most, in_time = found[0], [one for one in found if one.channel.name == "time_s"]
    location = locate(most, runs) if most.found else None
    naming = residual.naming()
    shown_by = [one.channel.name for one in found if one.found]
    if naming.needs_unrecorded_channel(runs, shown_by) or residual.lacks_a_channel(naming):
        return Explanation(replace(naming.nothing_named(), unrecorded=True))
    naming, location = residual.checked_against_motion(naming, location)
    if not naming.named and location is None:
        if residual.by_motion() < thresholds.BY_MOTION:
            if in_time and unexplained(fit, runs):
                return Explanation(naming, locate(in_time[0], runs))
            return Explanation(residual.instead_of_parameters(naming))
        if is_material(fit, runs):
            location = locate(most, runs)  # where most of what motion explains shows
    empirical = None
    scheduled = bool(naming.named) and naming.named[0].term.axis == "time" and most.channel.name != "time_s"
    if location is not None and (not naming.named or scheduled):
        empirical = propose(fit, runs, block, fold, rng)
    if naming.named and empirical is not None:
        if empirical.held_out_gain > max(naming.named[0].held_out_gain, residual.by(naming)):
            # A recorded channel explains more than what is named with a schedule, which is for unrecorded causes.
            naming = naming.nothing_named()
        else:
            empirical = None
    remaining = None if naming.corrected is None else residual.remaining(naming.corrected)
    if remaining is not None and most.found and _of_another_channel(naming, remaining, most):
        naming, remaining = naming.nothing_named(), None
        empirical = propose(fit, runs, block, fold, rng)
    return Explanation(naming, location, empirical, remaining)


@dataclass(frozen=True)
class _Residual:
    """The residual of a refit of some runs, and the tests of what explains it."""

    fit: Refit
    runs: Runs
    most: Dependence  # with the largest gain
    block: Index  # (windows,)
    by_run: Index  # (windows,)
    rng: np.random.Generator
    progress: Callable[[str], None]
    without: Collection[str]  # conditions that refuse nothing

    @property
    def fold(self) -> Index:
        """Stretches of all runs that are held out together, shape (windows,)."""
        return self.block % FOLDS

    def naming(self, varying: bool = True) -> Naming:
        """The effects that are named."""
        return name_missing(self.fit, self.runs, self.block, self.rng, self.progress, varying, self.without)

    def by_motion(self) -> float:
        """Share of the residual that motion explains."""
        return motion_gain(self.fit, self.runs, self.fold, self.rng)

    def by(self, naming: Naming) -> float:
        """Share of the residual that the named effects explain."""
        return 0.0 if naming.corrected is None else explained(self.fit, naming.corrected, self.runs, self.fold)

    def shows(self, naming: Naming) -> bool:
        """Whether the residual depends most on a channel of the first named effect."""
        return self.most.found and self.most.channel.name in naming.named[0].term.hypothesis.channels

    def lacks_a_channel(self, naming: Naming) -> bool:
        """Whether a channel was not recorded, and effects that theirs does not show leave most of the residual."""
        if naming.corrected is None or self.shows(naming) or not unrecorded(self.runs):
            return False
        left = self.runs.observed - naming.corrected.predicted
        return self.by(naming) < thresholds.BY_NAMED and is_autocorrelated(left, self.runs)

    def remaining(self, corrected: Corrected) -> RemainingDependence | None:
        """The residual of the corrected model where, by the test of the refit's, it depends on a channel."""
        blocks = independent_blocks(corrected, self.runs)
        most = dependences(corrected, self.runs, blocks, self.by_run, self.rng)[0]
        if not most.found or most.channel.name == "time_s":
            return None
        formula = propose(corrected, self.runs, blocks.channels, self.by_run, self.rng)
        return RemainingDependence(most.channel.name, locate(most, self.runs), formula)

    def instead_of_parameters(self, naming: Naming) -> Naming:
        """The effects named if groups that one effect would replace are held at the robot file's values.

        It is tried where the refit absorbs all that is missing.
        """
        taken_up = not is_material(self.fit, self.runs) or times_noise(self.fit, self.runs) <= 1.0
        held = needless(self.fit, self.runs) if taken_up else None
        if held is None:
            return naming
        restricted = replace(self, fit=holding(self.fit, self.runs, held))
        again = restricted.checked_against_motion(restricted.naming(varying=False), None)[0]
        if not again.named or again.needs_unrecorded_channel(self.runs):
            return naming
        return replace(again, ranking=naming.ranking, absorbed=naming.absorbed)

    def checked_against_motion(self, naming: Naming, location: Location | None) -> tuple[Naming, Location | None]:
        """Name nothing where the effects explain too little of the residual, or where a confounder (motion, its
        history, the place) explains as much as the schedule of the first.

        Where no other effect explains the residual either, return where it is.
        """
        if naming.corrected is None:
            return naming, location
        first, corrected = naming.named[0], naming.corrected
        where = location or where_at_work(first.term, corrected.contribution[0], self.runs)
        if unexplained(corrected, self.runs) and not self.shows(naming) and self.by(naming) < thresholds.BY_NAMED:
            return naming.nothing_named(), where
        if first.term.axis != "time":
            return (naming if self._is_adequate(naming) else naming.nothing_named()), location
        others = [one for one in corrected.model.terms if one.axis != "time"]  # of these motion may be the cause
        held = holding(self.fit, self.runs, corrected.groups.held) if others else self.fit
        base = fit_model(held, others, self.runs, self.block) if others else self.fit
        on_ground = any(one.term.hypothesis.by_place for one in naming.named)
        by_place = 0.0 if on_ground else place_gain(base, self.runs, self.rng)
        by_named = max(0.0 if others else first.held_out_gain, explained(base, corrected, self.runs, self.fold))
        by_motion = largest_by_motion(base, self.runs, self.block, self.rng)
        if by_motion < by_named and by_place < thresholds.BY_PLACE * by_named:
            return naming, location
        again = self.naming(varying=False)
        if self.by(again) >= thresholds.SIMPLER * first.held_out_gain:
            return replace(again, ranking=naming.ranking, absorbed=naming.absorbed), location
        return naming.nothing_named(), where

    def _is_adequate(self, naming: Naming) -> bool:
        """Whether the named effects, or the first alone, explain most of what motion and its history do."""
        share, by_motion = self.by(naming), self.by_motion()
        if (
            naming.named[0].held_out_gain >= thresholds.SIMPLER * by_motion
            or share >= thresholds.EQUIVALENT * by_motion
        ):
            return True
        if naming.corrected is None or share < thresholds.OF_TREES * by_motion:
            return False
        return not trees_beat(naming.corrected, self.fit, self.runs, self.by_run, self.rng, thresholds.CLEARLY_BETTER)


def _of_another_channel(naming: Naming, remaining: RemainingDependence, most: Dependence) -> bool:
    """Whether a channel that shows no named effect explains more than those named, and the residual still depends on
    it.

    The channel is identified before the form: an effect that only absorbs a part of another channel's influence would
    hide it. A state of charge that falls in every run is confounded with time.
    """
    if most.channel.name == "soc":
        return False
    named = (term for one in naming.named for term in (one.term, *one.rivals))
    covered = {channel for term in named for channel in term.hypothesis.channels}
    by_named = 1.0 - float(np.prod([1.0 - one.held_out_gain for one in naming.named]))
    not_covered = most.channel.name not in covered and remaining.channel == most.channel.name
    return not_covered and most.held_out_gain > by_named
