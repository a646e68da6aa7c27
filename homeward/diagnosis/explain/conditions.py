"""When an effect is named: one table of conditions, each a number and its limit.

Each effect must meet `CONDITIONS`, and all named effects together `TOGETHER`. `judge` is the only
place where they are evaluated. The result and the report carry every value, and the page "When an
effect is named" shows this table.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Literal, TypeVar

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.channel_errors import meter_error
from homeward.diagnosis.result import Checked

if TYPE_CHECKING:
    from homeward.diagnosis.explain.candidate import Candidate
    from homeward.diagnosis.explain.together import Together

Judged = TypeVar("Judged")
Side = Literal["at least", "at most", "more than"]

_HOLDS: Mapping[Side, Callable[[float, float], bool]] = {
    "at least": operator.ge,
    "at most": operator.le,
    "more than": operator.gt,
}


@dataclass(frozen=True)
class Condition(Generic[Judged]):
    """One condition: what it asks of a candidate or of all named effects, of which of them, and its
    limit."""

    name: str
    asks: str  # the quantity, in words
    applies_to: str  # in words
    side: Side
    limit: Callable[[Judged], float]
    limit_in_words: str
    origin: str
    value: Callable[[Judged], float | None]  # None where it does not apply

    def check(self, judged: Judged) -> Checked | None:
        """The value beside the limit; None where the condition does not apply."""
        value = self.value(judged)
        if value is None:
            return None
        limit = self.limit(judged)
        holds = _HOLDS[self.side](value, limit)
        return Checked(
            condition=self.name, value=float(value), side=self.side, limit=limit, holds=bool(holds)
        )


def check_names(names: Collection[str]) -> None:
    """Raise a `ValueError` for a name that is no condition's."""
    condition_names = [condition.name for condition in CONDITIONS]
    condition_names += [condition.name for condition in TOGETHER]
    for name in names:
        if name not in condition_names:
            raise ValueError(f"{name!r} is no condition; these are: {', '.join(condition_names)}")


def judge(
    judged: Judged, waived: Collection[str], conditions: Sequence[Condition[Judged]]
) -> tuple[Checked, ...]:
    """Check a candidate, or all named effects, against conditions in their order, up to the first
    that does not hold.

    Conditions that an experiment has `waived` are checked as well, and refuse nothing.
    """
    checks = []
    for condition in conditions:
        checked = condition.check(judged)
        if checked is None:
            continue
        checks.append(checked)
        if not checked.holds and condition.name not in waived:
            break
    return tuple(checks)


def passes(checks: Collection[Checked], waived: Collection[str] = ()) -> bool:
    """Whether no check refuses."""
    return all(checked.holds or checked.condition in waived for checked in checks)


def _is_in_time_beside_others(candidate: Candidate) -> bool:
    return candidate.term.axis == "time" and bool(candidate.without.terms)


def _energy_share(candidate: Candidate) -> float | None:
    if candidate.term.axis == "steady":
        return None
    return candidate.energy_share


def _evidence(candidate: Candidate) -> float | None:
    term = candidate.term
    if term.axis == "steady":
        return None
    is_sudden = term.schedule is not None and term.hypothesis.is_sudden
    # Levels also follow the drift that another effect leaves: only steps stand out of the
    # innovations.
    if is_sudden or _is_in_time_beside_others(candidate):
        return candidate.innovations_bic
    return candidate.delta_bic


def _distance_of_levels(candidate: Candidate) -> float | None:
    schedule = candidate.term.schedule
    if schedule is None or not _is_in_time_beside_others(candidate):
        return None
    if candidate.gain.share > thresholds.HALF:
        return None
    return schedule.apart


def _least_gain(candidate: Candidate) -> float:
    if candidate.term.hypothesis.physical:
        return thresholds.SMALLEST_GAIN_TO_NAME
    return thresholds.SMALLEST_GAIN_OF_THE_FLEXIBLE


def _times_instruments(candidate: Candidate) -> float:
    error_by_instruments = max(meter_error(candidate.runs), candidate.channel_error)
    return candidate.explained / max(error_by_instruments, 1e-300)


def _beyond_motion(candidate: Candidate) -> float | None:
    axis = candidate.term.axis
    if axis == "steady" or not candidate.without.terms:
        return None
    by_motion = candidate.without.by_motion
    counted = by_motion.by_place if axis == "place" else by_motion.in_time
    return candidate.gain.share - counted


CONDITIONS: tuple[Condition[Candidate], ...] = (
    Condition(
        name="energy",
        asks="share of the recorded energy that the effect adds or saves",
        applies_to="an effect whose size changes in time or with place",
        value=_energy_share,
        side="at least",
        limit=lambda candidate: thresholds.GAIN_ERROR,
        limit_in_words=f"{thresholds.GAIN_ERROR:.1%}",
        origin="GAIN_ERROR",
    ),
    Condition(
        name="evidence",
        asks="reduction of BIC by the effect; of a load that switches, and of a schedule beside another effect, in the "
        "innovations, out of which its steps must stand",
        applies_to="an effect whose size changes in time or with place",
        value=_evidence,
        side="at least",
        limit=lambda candidate: thresholds.STRONG_BIC,
        limit_in_words=f"{thresholds.STRONG_BIC:g}",
        origin="STRONG_BIC",
    ),
    Condition(
        name="apart",
        asks="distance between its levels, in standard deviations of the residual",
        applies_to="a schedule beside another effect, if it explains at most half of what that leaves",
        value=_distance_of_levels,
        side="more than",
        limit=lambda candidate: thresholds.FAR_APART,
        limit_in_words=f"{thresholds.FAR_APART:g}",
        origin="FAR_APART",
    ),
    Condition(
        name="gain",
        asks="share that it explains of the held-out squared error of the model without it; of the first effect, that "
        "error less noise of power",
        applies_to="every effect",
        value=lambda candidate: candidate.gain_beyond_noise,
        side="at least",
        limit=_least_gain,
        limit_in_words=f"{thresholds.SMALLEST_GAIN_TO_NAME:.0%}, of a fault of an instrument "
        f"{thresholds.SMALLEST_GAIN_OF_THE_FLEXIBLE:.0%}",
        origin="SMALLEST_GAIN_TO_NAME, SMALLEST_GAIN_OF_THE_FLEXIBLE",
    ),
    Condition(
        name="instruments",
        asks="squared error that it explains over what errors of the channels, or of the meter's scale, explain",
        applies_to="every effect",
        value=_times_instruments,
        side="more than",
        limit=lambda candidate: 1.0,
        limit_in_words="1",
        origin="errors of the recording's own channels",
    ),
    Condition(
        name="motion",
        asks="share that it explains, less what trees on the motion count for",
        applies_to="an effect whose size changes in time or with place, beside another",
        value=_beyond_motion,
        side="more than",
        limit=lambda candidate: 0.0,
        limit_in_words="0",
        origin="the robot's motion is a rival",
    ),
    Condition(
        name="placebo",
        asks="share of placebos in which the same search scores as high",
        applies_to="every effect",
        value=lambda candidate: candidate.p_value,
        side="at most",
        limit=lambda candidate: thresholds.FALSE_ALARM_RATE,
        limit_in_words=f"{thresholds.FALSE_ALARM_RATE:.0%}",
        origin="FALSE_ALARM_RATE",
    ),
)


def _share_beside_a_residual(together: Together) -> float | None:
    if not together.leaves_a_residual:
        return None
    return together.share


def _least_over_motion(together: Together) -> float:
    # What has no recorded cause must explain more than the recorded motion.
    if together.first.term.axis != "steady":
        return 1.0
    if together.beats_trees:
        return thresholds.HALF
    return thresholds.SIMPLER


def _over_motion(together: Together) -> float:
    by_effects = together.share
    by_motion = together.residual.by_motion
    if together.is_scheduled:
        by_effects = together.by_schedules
        by_motion = together.schedules_by_motion
    if by_motion > 0.0:
        return by_effects / by_motion
    return float("inf")


def _place_over_schedule(together: Together) -> float | None:
    if not together.is_scheduled:
        return None
    return together.schedules_by_place / max(together.by_schedules, 1e-300)


def _beyond_channel(together: Together) -> float | None:
    if not together.hides_another_channel:
        return None
    return together.by_each - together.residual.strongest.held_out_gain


TOGETHER: tuple[Condition[Together], ...] = (
    Condition(
        name="recorded",
        asks="number of effects, of the first named and its rivals, that follow a channel which some run lacks",
        applies_to="all",
        value=lambda together: float(together.unrecorded_channels),
        side="at most",
        limit=lambda together: 0.0,
        limit_in_words="0",
        origin="record the channel",
    ),
    Condition(
        name="rest",
        asks="share that they explain of the held-out squared error of the refit",
        applies_to="effects that leave a residual above noise, unless that of the refit depends most on a channel of "
        "the first",
        value=_share_beside_a_residual,
        side="at least",
        limit=lambda together: thresholds.HALF,
        limit_in_words=f"{thresholds.HALF:.0%}",
        origin="HALF",
    ),
    Condition(
        name="motion together",
        asks="share that they explain over the share that trees on the motion explain; of a schedule, over what these "
        "trees count for, both beside the effects that channels show",
        applies_to="all",
        value=_over_motion,
        side="more than",
        limit=_least_over_motion,
        limit_in_words="1 if the size of the first changes in time or with place; otherwise "
        f"{thresholds.HALF:g}, or {thresholds.SIMPLER:g} if trees on the motion leave less than half of the effects' "
        "squared error on unseen runs",
        origin="SIMPLER, HALF",
    ),
    Condition(
        name="place",
        asks="share that trees on the place and the height climbed explain over the share that the schedule explains",
        applies_to="a schedule that is not of the ground",
        value=_place_over_schedule,
        side="at most",
        limit=lambda together: thresholds.HALF,
        limit_in_words=f"{thresholds.HALF:g}",
        origin="HALF",
    ),
    Condition(
        name="channel",
        asks="share that they explain, less that by the channel on which the refit's residual depends most",
        applies_to="effects none of which this channel shows, where what they leave still depends on it",
        value=_beyond_channel,
        side="at least",
        limit=lambda together: 0.0,
        limit_in_words="0",
        origin="the channel is identified before the form",
    ),
)

BEFORE_PLACEBOS = tuple(condition for condition in CONDITIONS if condition.name != "placebo")
"""Those that a rival must meet: that noise would score as high as the named effect is refuted
already."""

BEFORE_REPLAYS = tuple(condition for condition in CONDITIONS if condition.name == "energy")
"""That which needs no replay on held-out windows: evaluated first, as it takes no time."""
