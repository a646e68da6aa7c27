"""Draws the cases of each part, from [seed, part, number] alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from benchmarks.concealed.plants.cases import (
    PARTS,
    Case,
    Part,
    control_case,
    coverage_case,
    go_together,
    hidden_case,
    outside_case,
)
from benchmarks.concealed.plants.catalogue import TRUTHS
from benchmarks.concealed.plants.effects import EFFECTS
from benchmarks.concealed.plants.instruments import FAULTS, NOISES
from benchmarks.concealed.plants.outside import OUTSIDE

Kind = TypeVar("Kind")


def make_case(part: Part, seed: int, number: int, short: bool = False) -> Case:
    """Draw a case; the same three numbers give the same case.

    Args:
        part: Part of the benchmark.
        seed: Seed of the benchmark.
        number: Number of the case in the part; effects are concealed in turn by it.
        short: Whether drives are few and short, for tests.
    """
    rng = np.random.default_rng([seed, PARTS.index(part), number])

    def in_turn(kinds: Sequence[Kind]) -> Kind:
        """Every kind once in a random order before any repeats."""
        order = np.random.default_rng([seed, PARTS.index(part)]).permutation(len(kinds))
        return kinds[int(order[number % len(kinds)])]

    if part == "singles":
        effect, level = in_turn([(effect, level) for effect in EFFECTS for level in NOISES])
        return hidden_case(part, number, (effect,), level, rng, short)
    if part == "pairs":
        effect = in_turn(list(EFFECTS))
        partner = str(rng.choice([name for name in EFFECTS if go_together(effect, name)]))
        level = str(rng.choice(list(NOISES)))
        return hidden_case(part, number, (effect, partner), level, rng, short)
    if part == "controls":
        exact, fault = in_turn(
            [(exact, fault) for exact in (True, False) for fault in ("none", *FAULTS)]
        )
        return control_case(number, exact, fault, rng, short)
    if part == "outside":
        return outside_case(number, in_turn(list(OUTSIDE)), rng, short)
    if part == "rover":
        from benchmarks.concealed.plants import rover  # here, because MuJoCo is optional

        return rover.make(number, *in_turn(rover.KINDS), rng, short)
    if part == "cell":
        from benchmarks.concealed.plants import cell  # here, because PyBaMM is optional

        return cell.make(number, *in_turn(cell.KINDS), rng, short)
    return coverage_case(number, in_turn([*TRUTHS, "none", "none", "none"]), rng, short)
