"""Thresholds of reading recordings: those that are derived are what is derived, and their order."""

import math
from itertools import pairwise

import pandas as pd
import pytest

from homeward.logs import thresholds
from homeward.logs.channels import CHANNELS


def test_counts_since_1970_are_told_apart_by_their_unit() -> None:
    low, high = thresholds.EPOCH_S
    # from its last days on
    assert [pd.Timestamp(one, unit="s").year for one in thresholds.EPOCH_S] == [1989, 2099]
    ranges = [(low * per_s, high * per_s) for per_s in (1.0, 1e3, 1e6, 1e9)]
    assert all(one[1] < other[0] for one, other in pairwise(ranges))
    assert high < thresholds.EPOCH_COUNT < 1e3 * low


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert thresholds.LONGEST_RUN_S / 86400.0 == 3.0
    assert thresholds.HALF_A_DAY_S == 0.5 * 86400.0
    assert math.exp(thresholds.UNIT_LOG_RATIO) == pytest.approx(1.12, abs=0.01)
    assert pytest.approx(28.6, abs=0.1) == thresholds.HEADING_JUMP / math.tau
    assert math.degrees(math.asin(thresholds.PLANAR)) == pytest.approx(0.006, abs=0.001)
    assert (
        thresholds.TYPICAL_STEP_S
        < thresholds.SLOW_STEP_S
        < thresholds.LONGEST_STEP_S
        < thresholds.LONGEST_RUN_S
    )
    assert (
        CHANNELS["temperature_c"].high
        < thresholds.COLDEST_K
        < CHANNELS["temperature_c"].low + 273.15
    )


def test_typical_sizes_are_possible() -> None:
    assert all(size <= CHANNELS[name].high for name, size in thresholds.TYPICAL_SIZES.items())
