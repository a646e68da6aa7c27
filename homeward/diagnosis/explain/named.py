"""What the naming returns: the named effects with their evidence, those refused, and the score of
every hypothesis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.result import Checked


@dataclass(frozen=True)
class Named:
    """One effect identified in the recordings, and the evidence for it."""

    term: Term
    delta_bic: float  # against the model without it
    held_out_gain: float  # share of the squared held-out error of the model without it
    gain_ci95: tuple[float, float]
    p_value: float  # share of placebos that score as high
    rivals: tuple[Term, ...]  # effects confounded with it, best first
    checks: tuple[Checked, ...] = ()  # values of the conditions


@dataclass(frozen=True)
class Ranked:
    """One hypothesis tried alone, for the report."""

    effect: str
    axis: str
    delta_bic: float
    held_out_gain: float


@dataclass(frozen=True)
class Refused:
    """An effect that was about to be named, and the conditions up to the one that refused it."""

    effect: str
    checks: tuple[Checked, ...]


@dataclass(frozen=True)
class Naming:
    """The named effects and the score of every hypothesis; `absorbed` is each effect's share that
    the refit absorbs."""

    named: tuple[Named, ...] = ()
    corrected: Corrected | None = None  # the model with them, where any is named
    ranking: tuple[Ranked, ...] = ()
    absorbed: Mapping[str, float] = field(default_factory=dict)
    unrecorded: bool = False  # whether an unrecorded channel may explain the mismatch
    refused: tuple[Refused, ...] = ()
    together: tuple[Checked, ...] = ()  # values of the conditions on all named effects together

    def nothing_named(self) -> Naming:
        """The scores of the hypotheses, with none of them named."""
        return Naming(ranking=self.ranking, absorbed=self.absorbed, refused=self.refused)
