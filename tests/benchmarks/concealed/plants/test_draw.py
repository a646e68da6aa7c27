"""Cases come from their seed, every kind in turn."""

import pandas as pd
import pytest

from benchmarks.concealed.plants.cases import Part
from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.plants.effects import EFFECTS
from benchmarks.concealed.plants.instruments import FAULTS, NOISES
from benchmarks.concealed.plants.outside import OUTSIDE
from tests.benchmarks.concealed.plants.test_cases import WITHOUT_REPLAY


@pytest.mark.parametrize("part", WITHOUT_REPLAY)
def test_a_seed_always_gives_the_same_cases(part: Part) -> None:
    first, again, other = (make_case(part, seed, 3, short=True) for seed in (5, 5, 6))
    assert (first.hidden, first.label, first.fault, first.nominal) == (again.hidden, again.label, again.fault,
                                                                      again.nominal)  # fmt: skip
    for frame, same in zip(first.recordings, again.recordings, strict=True):
        pd.testing.assert_frame_equal(frame, same)
    assert not first.recordings[0].equals(other.recordings[0])


@pytest.mark.parametrize(("part", "kinds"), [("singles", 81), ("controls", 30), ("outside", 17)])
def test_every_kind_comes_in_turn(part: Part, kinds: int) -> None:
    expected = {
        "singles": len(EFFECTS) * len(NOISES),
        "controls": 2 * (len(FAULTS) + 1),
        "outside": len(OUTSIDE),
    }
    assert kinds == expected[part]
    few = [make_case(part, 2, number, short=True) for number in range(4)]
    assert len({(case.hidden, case.label, case.fault) for case in few}) == 4
