"""What the tool said of one case beside what was true of it: every judgement on a single case."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.plants.case import Array, Truth, read_truth
from benchmarks.scoring.work import Alone, Aside, verdict_path
from homeward.diagnosis.hypotheses import CATALOGUE
from homeward.diagnosis.location import Place
from homeward.diagnosis.result import Diagnosis

CRASHED = "crashed"
UNNAMED = ("unknown_physics", "parameters_off", "no_mismatch", "not_testable", CRASHED)
"""What may stand where an effect would."""

_AT_THE_FLOOR = 1.1  # error over noise
_HALVED = 0.25  # of the squared excess error


@dataclass(frozen=True)
class Outcome:
    """One case; `diagnosis` is None where the tool crashed, `times_s` holds the samples' times of each run."""

    truth: Truth
    diagnosis: Diagnosis | None
    aside: Aside
    times_s: tuple[Array, ...]

    @property
    def classes(self) -> tuple[frozenset[str], ...]:
        """Of each named effect in order: itself and what the tool says it may be confused with."""
        named = () if self.diagnosis is None else self.diagnosis.missing_physics
        return tuple(frozenset((one.effect, *one.confused_with)) for one in named)

    @property
    def names(self) -> tuple[str, ...]:
        """Named effects in order."""
        return () if self.diagnosis is None else tuple(one.effect for one in self.diagnosis.missing_physics)

    @property
    def verdict(self) -> str:
        """The verdict, or `crashed`."""
        return CRASHED if self.diagnosis is None else self.diagnosis.verdict

    @property
    def first(self) -> str:
        """The effect named first, or the verdict where none is."""
        return self.names[0] if self.names else self.verdict

    @property
    def first_is_true(self) -> bool:
        """Whether the effect named first is hidden here."""
        return self.first in self.truth.truth

    @property
    def class_is_true(self) -> bool:
        """Whether the effect named first, or one that it may be confused with, is hidden here."""
        return bool(self.classes) and not self.classes[0].isdisjoint(self.truth.truth)

    @property
    def is_named_anywhere(self) -> bool:
        """Whether all that is hidden is named, in any order, confusions not counted."""
        return bool(self.truth.truth) and set(self.truth.truth) <= set(self.names)

    @property
    def both_found(self) -> bool:
        """Whether both effects of a pair are found, each by a named effect of its own or what that is confused with."""
        one, other = self.truth.truth
        holds_one = [number for number, held in enumerate(self.classes) if one in held]
        holds_other = [number for number, held in enumerate(self.classes) if other in held]
        return any(a != b for a in holds_one for b in holds_other)

    @property
    def both_mentioned(self) -> bool:
        """As `both_found`, where one named effect may stand for both."""
        return set(self.truth.truth) <= set().union(*self.classes)

    @property
    def named_outside_catalogue(self) -> bool:
        """Whether the first named is an empirical term and no effect of the catalogue."""
        return bool(self.names) and self.first not in CATALOGUE

    @property
    def is_right(self) -> bool:
        """Whether the verdict is what was asked for in a case of this kind."""
        match self.truth.kind:
            case "single":
                return self.class_is_true
            case "pair":
                return self.both_found
            case "outside":
                return self.verdict == "unknown_physics" or self.named_outside_catalogue
            case "invisible":
                return self.verdict in ("parameters_off", "no_mismatch") or self.class_is_true
            case _:
                return self.verdict not in ("missing_physics", "unknown_physics", CRASHED)

    @cached_property
    def location_f1(self) -> float | None:
        """Overlap in time of what was located with when something hidden was at work; None in controls."""
        if not self.truth.truth:
            return None
        if self.diagnosis is None:
            return 0.0
        true = [one for one in self.diagnosis.missing_physics if self._meant(one.effect, one.confused_with)]
        places = [place for one in true for place in one.where] or self.diagnosis.where
        inside = np.concatenate(covered(places, self.times_s))
        affected = np.concatenate(self.truth.affected)
        return float(2.0 * (inside & affected).sum() / max(inside.sum() + affected.sum(), 1))

    def _meant(self, effect: str, confused_with: Sequence[str]) -> bool:
        return not {effect, *confused_with}.isdisjoint(self.truth.truth)

    @property
    def error_fell(self) -> bool | None:
        """Whether correcting halves the error in excess of the noise, held out, or reaches the noise; None: a control.

        Squared errors add up, so that half the excess is a quarter of its square.
        """
        if not self.truth.truth:
            return None
        if self.diagnosis is None or self.diagnosis.fit is None or "corrected" not in self.diagnosis.fit.arms:
            return False
        corrected, refit = (self.diagnosis.fit.arms[name].rmse for name in ("corrected", "refit"))
        noise = self.truth.noise_rms
        return corrected <= _AT_THE_FLOOR * noise or corrected**2 - noise**2 <= _HALVED * (refit**2 - noise**2)

    @property
    def absorbed(self) -> tuple[float | None, ...]:
        """Of each hidden effect the share that a refit would absorb, as the tool says it."""
        shown = {} if self.diagnosis is None else self.diagnosis.what_this_log_can_show
        return tuple(shown.get(effect) for effect in self.truth.truth)

    def alone(self, effect: str) -> Alone | None:
        """How the best hypothesis of an effect did alone."""
        return next((one for one in self.aside.ranking if one.effect == effect), None)


def covered(places: Iterable[Place], times_s: Sequence[Array]) -> list[NDArray[np.bool_]]:
    """Samples of each run that lie in some place; recordings are `run_1...`, `run_2...` in order."""
    inside = [np.zeros(time_s.size, bool) for time_s in times_s]
    for place in places:
        number = int(Path(place.recording).name.removeprefix("run_").partition(".")[0]) - 1
        inside[number] |= (times_s[number] >= place.start_s) & (times_s[number] <= place.end_s)
    return inside


def read_outcome(out: Path, name: str) -> Outcome:
    """Open the truth of a diagnosed case.

    Raises:
        OSError: The case was not written or not diagnosed.
    """
    folder = out / "seen" / name
    count = len(list(folder.glob("run_*")))
    times_s = tuple(
        pd.read_csv(folder / f"run_{number}.csv.gz", usecols=["time_s"])["time_s"].to_numpy(np.float64)
        for number in range(1, count + 1)
    )
    verdict = verdict_path(out, name)
    diagnosis = Diagnosis.from_json(verdict.read_text(encoding="utf-8")) if verdict.exists() else None
    return Outcome(read_truth(out / "truth", name), diagnosis, Aside.read(out, name), times_s)
