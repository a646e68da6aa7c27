"""When an effect is named: one table of conditions, each a number and its limit.

Each effect must meet `CONDITIONS`, and all named effects together `TOGETHER`. `judge` is the only place where they are
evaluated. The result and the report carry every value, and the page "When an effect is named" shows this table.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
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


@dataclass(frozen=True)
class Condition(Generic[Judged]):
    """One condition: what it asks of a candidate or of all named effects, of which of them, and its limit."""

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
        holds = {"at least": value >= limit, "at most": value <= limit, "more than": value > limit}[self.side]
        return Checked(self.name, float(value), self.side, limit, bool(holds))


def check_names(names: Collection[str]) -> None:
    """Raise a `ValueError` for a name that is no condition's."""
    known = [*(condition.name for condition in CONDITIONS), *(condition.name for condition in TOGETHER)]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f"{unknown[0]!r} is no condition; these are: {', '.join(known)}")


def judge(judged: Judged, without: Collection[str], conditions: Sequence[Condition[Judged]]) -> tuple[Checked, ...]:
    """Check a candidate, or all named effects, against conditions in their order, up to the first that does not hold.

    Conditions `without` which an experiment runs are checked as well, and refuse nothing.
    """
    checks = []
    for condition in conditions:
        checked = condition.check(judged)
        if checked is None:
            continue
        checks.append(checked)
        if not checked.holds and condition.name not in without:
            break
    return tuple(checks)


def passes(checks: Collection[Checked], without: Collection[str] = ()) -> bool:
    """Whether no check refuses."""
    return all(checked.holds or checked.condition in without for checked in checks)


def _least_gain(candidate: Candidate) -> float:
    of_fault = not candidate.term.hypothesis.physical
    return thresholds.SMALLEST_GAIN_OF_THE_FLEXIBLE if of_fault else thresholds.SMALLEST_GAIN_TO_NAME


def _times_instruments(candidate: Candidate) -> float:
    by_instruments = max(meter_error(candidate.runs), candidate.channel_error)
    return candidate.explained / max(by_instruments, 1e-300)


def _evidence(candidate: Candidate) -> float | None:
    if candidate.term.axis == "steady":
        return None
    beside = bool(candidate.without.terms) and candidate.term.axis == "time"
    sudden = candidate.term.schedule is not None and candidate.term.hypothesis.is_sudden
    return candidate.innovations_bic if beside or sudden else candidate.delta_bic


def _apart(candidate: Candidate) -> float | None:
    schedule = candidate.term.schedule
    beside = bool(candidate.without.terms) and candidate.term.axis == "time"
    if schedule is None or not beside or candidate.gain.share > thresholds.HALF:
        return None
    return schedule.apart


def _beyond_motion(candidate: Candidate) -> float | None:
    if candidate.term.axis == "steady" or not candidate.without.terms:
        return None
    return candidate.gain.share - candidate.without.by_motion


CONDITIONS: tuple[Condition[Candidate], ...] = (
    Condition(
        "energy", "share of the recorded energy that it adds or saves",
        "an effect whose size changes", "at least", lambda candidate: thresholds.GAIN_ERROR,
        f"{thresholds.GAIN_ERROR:.1%}",
        "GAIN_ERROR",
        lambda candidate: None if candidate.term.axis == "steady" else candidate.energy_share,
    ),
    Condition(
        "evidence",
        "reduction of BIC by it; of a load that switches, and beside another effect, from the innovations of the "
        "residual, of which its steps must stand out",
        "an effect whose size changes", "at least", lambda candidate: thresholds.STRONG_BIC,
        f"{thresholds.STRONG_BIC:g}", "STRONG_BIC",
        _evidence,
    ),
    Condition(
        "apart", "distance of its levels, in standard deviations of their residual",
        "a schedule beside another effect that explains less than half of the rest", "more than",
        lambda candidate: thresholds.FAR_APART, f"{thresholds.FAR_APART:g}",
        "FAR_APART",
        _apart,
    ),
    Condition(
        "gain",
        "share of the held-out squared error of the model without it, less noise of power, that it explains",
        "every effect", "at least", _least_gain,
        f"{thresholds.SMALLEST_GAIN_TO_NAME:.0%}, of a fault of an instrument "
        f"{thresholds.SMALLEST_GAIN_OF_THE_FLEXIBLE:.0%}",
        "SMALLEST_GAIN_TO_NAME, SMALLEST_GAIN_OF_THE_FLEXIBLE",
        lambda candidate: candidate.gain_beyond_noise,
    ),
    Condition(
        "interval", "lower end of the 95 % interval of this share, by block bootstrap",
        "every effect", "more than", lambda candidate: 0.0, "0", "definition of an interval",
        lambda candidate: candidate.gain.ci95[0],
    ),
    Condition(
        "instruments", "what it explains, over what errors of the channels and of the meter's scale explain",
        "every effect", "more than", lambda candidate: 1.0, "1", "errors of the recording's own channels",
        _times_instruments,
    ),
    Condition(
        "motion", "share that it explains, less the share that trees on the motion explain",
        "an effect whose size changes, beside another", "more than", lambda candidate: 0.0, "0",
        "the robot's motion is a rival",
        _beyond_motion,
    ),
    Condition(
        "placebo", "share of placebos in which the same search scores as high",
        "every effect", "at most", lambda candidate: thresholds.FALSE_ALARM_RATE,
        f"{thresholds.FALSE_ALARM_RATE:.0%}", "FALSE_ALARM_RATE",
        lambda candidate: candidate.p_value,
    ),
)  # fmt: skip


def _least_beside_motion(together: Together) -> float:
    if together.is_scheduled:
        return 1.0
    return thresholds.HALF if together.beats_trees else thresholds.SIMPLER


def _beside_motion(together: Together) -> float:
    named, by_motion = together.share, together.residual.by_motion
    if together.is_scheduled:
        named, by_motion = together.by_schedules, together.schedules_by_motion
    return named / by_motion if by_motion > 0.0 else float("inf")


def _beside_place(together: Together) -> float | None:
    if not together.is_scheduled:
        return None
    return together.schedules_by_place / max(together.by_schedules, 1e-300)


def _beyond_channel(together: Together) -> float | None:
    if not together.hides_another_channel:
        return None
    return together.by_each - together.residual.most.held_out_gain


TOGETHER: tuple[Condition[Together], ...] = (
    Condition(
        "recorded", "effects, of the first and its rivals, that are maps of a channel which some run lacks",
        "all", "at most", lambda together: 0.0, "0", "record the channel",
        lambda together: float(together.unrecorded_channels),
    ),
    Condition(
        "rest", "share of the squared held-out error of the refit that they explain",
        "effects that leave a residual above noise, which depends on none of the channels of the first", "at least",
        lambda together: thresholds.HALF, f"{thresholds.HALF:.0%}", "HALF",
        lambda together: together.share if together.leaves_a_residual else None,
    ),
    Condition(
        "motion together", "what they explain over what trees on the motion and its history explain; "
        "of a schedule, both beside the effects that channels show",
        "all", "more than", _least_beside_motion,
        f"1 of a schedule; otherwise {thresholds.SIMPLER:g}, or {thresholds.HALF:g} if trees on the motion do not "
        "leave less than half of their squared error on unseen runs",
        "SIMPLER, HALF",
        _beside_motion,
    ),
    Condition(
        "place", "what the place and the height climbed explain over what the schedule explains",
        "a schedule that is not of the ground", "at most", lambda together: thresholds.HALF,
        f"{thresholds.HALF:g}", "HALF",
        _beside_place,
    ),
    Condition(
        "channel", "share that they explain, less what the channel explains on which the residual depended most",
        "effects that this channel shows none of, where the residual still depends on it", "at least",
        lambda together: 0.0, "0", "the channel is identified before the form",
        _beyond_channel,
    ),
)  # fmt: skip

BEFORE_PLACEBOS = tuple(condition for condition in CONDITIONS if condition.name != "placebo")
"""Those that a rival must meet: that noise would score as high as the named effect is refuted already."""

BEFORE_REPLAYS = tuple(condition for condition in CONDITIONS if condition.name == "energy")
"""That which needs no replay on held-out windows: evaluated first, as it takes no time."""
