"""The pace that all rules share."""

import numpy as np

from homeward.agents.rules.pace import NO_SENSING, Pace
from homeward.envs.options import Options, known_of
from homeward.envs.state import GO, STOP
from tests.agents.rules.shown import observed


def test_pace_senses_where_it_pays_and_stops_while_the_memory_is_full() -> None:
    known, pace = known_of(Options("Survey")), Pace(rate=0.75, interest=1.0, full=0.8)
    out = none = np.zeros(1, np.bool_)
    assert pace.act(known, observed(interest=0.51), out, none).tolist() == [[4, 3, GO]]
    assert pace.act(known, observed(interest=0.49), out, none).tolist() == [[4, 0, GO]]
    assert pace.act(known, observed(interest=0.51, backlog=0.81), out, none).tolist() == [
        [4, 0, STOP]
    ]
    assert pace.act(known, observed(interest=0.49, backlog=0.81), out, none).tolist() == [
        [4, 0, GO]
    ]
    assert pace.act(known, observed(interest=0.51), out, ~none).tolist() == [[4, 0, STOP]]
    assert NO_SENSING.act(known, observed(interest=2.0), out, none).tolist() == [[4, 0, GO]]
