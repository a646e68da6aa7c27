"""What all named effects must meet together, and what stands where they do not."""

import numpy as np
import pytest

from homeward.diagnosis.explain.together import only_unrecorded_channels
from tests.diagnosis.made_up import windows


@pytest.mark.parametrize(
    ("channels", "slopes", "lacks"),
    [
        (["base_distance_m"], None, True),
        (["base_distance_m"], [0.1, 0.1, np.nan, np.nan], True),  # one run has none
        (["base_distance_m"], [0.1, np.nan, 0.0, 0.1], False),
        (["base_distance_m", "temperature_c"], None, False),
        (["yaw_rate_radps"], None, False),
        ([], None, False),
    ],
)
def test_what_depends_on_the_place_only_may_be_slopes_that_were_not_recorded(
    channels: list[str], slopes: list[float] | None, lacks: bool
) -> None:
    runs = windows(2, 2) if slopes is None else windows(2, 2, grade_rad=np.array(slopes))
    assert only_unrecorded_channels(channels, runs) == lacks
