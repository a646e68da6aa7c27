"""What explains a mismatch: effects by name, or a formula of the channels, or nothing that is known; and what is left.

An effect that needs a schedule has to stand against what was recorded: where the robot's motion alone, or a formula of
a channel, predicts stretches not seen as well, its name would hide a cause that the recording holds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.explain.describe import where_at_work
from homeward.diagnosis.explain.formula import Empirical, propose
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.explain.motion import explained, motion_gain, place_gain, trees_beat
from homeward.diagnosis.explain.naming import Naming, name_missing
from homeward.diagnosis.explain.parsimony import needless
from homeward.diagnosis.explain.places import Location, locate
from homeward.diagnosis.explain.proof import FOLDS
from homeward.diagnosis.explain.residual_test import Dependence, dependences, independent_blocks
from homeward.diagnosis.explain.untold import is_much, times_noise, untold
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.rules import (
    ADEQUATE,
    AS_WELL,
    HALF,
    MOSTLY,
    MUCH_BETTER,
    TAKEN_UP,
    TOLD_BY_PLACE,
    WITHOUT_A_SCHEDULE,
)


@dataclass(frozen=True)
class Left:
    """What the named effects leave, where it still depends on a channel."""

    channel: str
    location: Location
    formula: Empirical | None  # that it follows, beside the named effects


@dataclass(frozen=True)
class Explanation:
    """What explains the mismatch, where it is, and what it leaves."""

    naming: Naming
    location: Location | None
    empirical: Empirical | None  # the formula that the mismatch follows, where no effect is named
    left: Left | None = None


def explain(
    fit: Refit,
    runs: Runs,
    found: list[Dependence],
    block: NDArray[np.intp],
    fold: NDArray[np.intp],
    seed: int,
    progress: Callable[[str], None],
) -> Explanation:
    """Explain what a refit leaves.

    Args:
        fit: The refit.
        runs: The runs.
        found: On what its residuals depend, found ones first.
        block: Stretches that count as independent, shape (windows,).
        fold: What is held out together, shape (windows,).
        seed: Seed of placebos and intervals.
        progress: Called with what is being done.
    """
    progress("locating")
    much = is_much(runs.observed - fit.predicted, runs)
    location = locate(found[0], runs) if found[0].found else None
    naming = name_missing(fit, runs, block, seed, progress)
    if naming.told_by_no_channel(runs):
        return Explanation(replace(naming.nothing_named(), unrecorded=True), None, None)
    naming, location = _without_what_motion_tells(naming, location, fit, runs, block, fold, seed, progress)
    if not naming.named and location is None and motion_gain(fit, runs, block % FOLDS, seed) < TAKEN_UP:
        in_time = [one for one in found if one.channel.name == "time_s"]
        if in_time and untold(fit, runs):
            return Explanation(naming, locate(in_time[0], runs), None)
        if not much or times_noise(fit, runs) <= 1.0:  # a refit that takes up all that is missing
            naming = _instead_of_parameters(naming, fit, runs, block, fold, seed, progress)
        return Explanation(naming, None, None)
    if not naming.named and location is None and much:
        location = locate(found[0], runs)  # where most of what motion tells shows
    empirical = None
    scheduled = bool(naming.named) and naming.named[0].term.axis == "time" and found[0].channel.name != "time_s"
    if location is not None and (not naming.named or scheduled):
        empirical = propose(fit, runs, block, fold, seed)
    if naming.named and empirical is not None:
        if empirical.held_out_gain > naming.named[0].held_out_gain:
            # A recorded channel says better when it happens than a schedule, which is for causes that none records.
            naming = naming.nothing_named()
        else:
            empirical = None
    left = None if naming.corrected is None else _left(naming.corrected, runs, fold, seed)
    if left is not None and found[0].found and _of_another_channel(naming, left, found[0]):
        naming, left = naming.nothing_named(), None
        empirical = propose(fit, runs, block, fold, seed)
    return Explanation(naming, location, empirical, left)


def _instead_of_parameters(
    naming: Naming,
    fit: Refit,
    runs: Runs,
    block: NDArray[np.intp],
    by_run: NDArray[np.intp],
    seed: int,
    progress: Callable[[str], None],
) -> Naming:
    """What is named if groups that one effect would make up for stay as the robot file has them."""
    held = needless(fit, runs)
    if held is None:
        return naming
    sparing = holding(fit, runs, held)
    again = name_missing(sparing, runs, block, seed, progress, schedules=False)
    again = _without_what_motion_tells(again, None, sparing, runs, block, by_run, seed, progress)[0]
    if not again.named or again.told_by_no_channel(runs):
        return naming
    return replace(again, ranking=naming.ranking, absorbed=naming.absorbed)


def _of_another_channel(naming: Naming, left: Left, most: Dependence) -> bool:
    """Whether a channel that tells of nothing named explains more than what is named, and still does beside it.

    Which channel explains comes before which form: an effect that only takes up a part of what another channel does
    would hide it.
    """
    named = (term for one in naming.named for term in (one.term, *one.rivals))
    told = {channel for term in named for channel in term.hypothesis.channels}
    by_named = 1.0 - float(np.prod([1.0 - one.held_out_gain for one in naming.named]))
    untold = most.channel.name not in told and left.channel == most.channel.name
    return untold and most.held_out_gain > by_named


def _without_what_motion_tells(
    naming: Naming,
    location: Location | None,
    fit: Refit,
    runs: Runs,
    block: NDArray[np.intp],
    by_run: NDArray[np.intp],
    seed: int,
    progress: Callable[[str], None],
) -> tuple[Naming, Location | None]:
    """Name nothing where motion and its history tell more than what is named, or what the first needs a schedule for.

    Where no other effect explains it either, say where it is.
    """
    if naming.corrected is None:
        return naming, location
    first, fold = naming.named[0], block % FOLDS
    if untold(naming.corrected, runs) and explained(fit, naming.corrected, runs, fold) < HALF:
        return naming.nothing_named(), location or where_at_work(first.term, naming.corrected.contribution[0], runs)
    by_motion = motion_gain(fit, runs, fold, seed)
    if first.term.axis != "time":
        share = explained(fit, naming.corrected, runs, fold)
        adequate = (
            first.held_out_gain >= MOSTLY * by_motion
            or share >= ADEQUATE * by_motion
            or (share >= HALF * by_motion and not trees_beat(naming.corrected, fit, runs, by_run, seed, MUCH_BETTER))
        )
        return (naming if adequate else naming.nothing_named()), location
    by_place = 0.0 if first.term.hypothesis.by_place else place_gain(fit, runs, seed)
    if by_motion < AS_WELL * first.held_out_gain and by_place < TOLD_BY_PLACE * first.held_out_gain:
        return naming, location
    again = name_missing(fit, runs, block, seed, progress, schedules=False)
    if (
        again.corrected is not None
        and explained(fit, again.corrected, runs, fold) >= WITHOUT_A_SCHEDULE * first.held_out_gain
    ):
        return replace(again, ranking=naming.ranking, absorbed=naming.absorbed), location
    return naming.nothing_named(), location or where_at_work(first.term, naming.corrected.contribution[0], runs)


def _left(corrected: Corrected, runs: Runs, fold: NDArray[np.intp], seed: int) -> Left | None:
    """Put what the corrected model leaves to the same test as what the refit left."""
    blocks = independent_blocks(corrected, runs)
    most = dependences(corrected, runs, blocks, fold, seed)[0]
    if not most.found or most.channel.name == "time_s":
        return None
    return Left(most.channel.name, locate(most, runs), propose(corrected, runs, blocks.channels, fold, seed))
