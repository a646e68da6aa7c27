"""What cells give in the cold and at a rate, and where they end, by the published facts."""

from __future__ import annotations

import dataclasses
import math

import pytest

from homeward import load_robot
from homeward.physics.cells import FACTS, WARM_C, cells_of

FLAT = dataclasses.replace(load_robot("husky"), chemistry="flat", cells_in_series=0)
LEAD = cells_of(dataclasses.replace(FLAT, chemistry="lead_acid", cells_in_series=12))
SLOWEST_PER_H = 1.0 / FACTS["lead_acid"].label_h[1]


def test_warm_and_as_slow_as_on_the_label_they_give_all_of_it() -> None:
    assert LEAD.derating(WARM_C, SLOWEST_PER_H) == (1.0, 1.0)
    assert LEAD.derating(math.nan, SLOWEST_PER_H) == (1.0, 1.0)  # not read: warm


@pytest.mark.parametrize(
    ("temperature_c", "least", "most"), [(15.0, 0.9, 0.94), (-10.0, 0.65, 0.79)]
)
def test_lead_acid_loses_six_to_ten_permille_a_kelvin(
    temperature_c: float, least: float, most: float
) -> None:
    assert LEAD.derating(temperature_c, SLOWEST_PER_H) == pytest.approx((least, most))


def test_at_a_rate_they_give_what_peukert_says() -> None:
    """In an hour: of a label of 20 h at an exponent of 1.25, and of one of 5 h at 1.05."""
    assert LEAD.derating(WARM_C, 1.0) == pytest.approx((20.0**-0.25, 5.0**-0.05))


@pytest.mark.parametrize(("chemistry", "cells"), [("nmc", 7), ("lipo", 7), ("lfp", 8)])
def test_what_a_rate_takes_from_lithium_cells_is_counted_once(chemistry: str, cells: int) -> None:
    """By the voltage under load, which reaches the cut-off earlier, and by no law beside it."""
    lithium = cells_of(dataclasses.replace(FLAT, chemistry=chemistry, cells_in_series=cells))
    assert lithium.derating(WARM_C, 3.0) == (1.0, 1.0)
    assert lithium.beyond_label_per_h(3.0) > 0.0


def test_a_cut_off_is_the_one_known_or_the_usual_one() -> None:
    assert LEAD.cutoff(21.0) == pytest.approx((21.0 / LEAD.curve.mean_v, 0.0))
    assert LEAD.cutoff(None)[0] == pytest.approx(1.75 / 2.05, rel=0.01)
    assert cells_of(FLAT).cutoff(21.0) == pytest.approx((21.0 / 24.0, 0.0))
    least, most = 3.0 / 3.6, 3.3 / 3.7  # the usual ones of any chemistry
    usual, sd = cells_of(FLAT).cutoff(None)
    assert least <= usual <= most and least < usual + 2.0 * sd


def test_a_measured_curve_is_trusted_more_than_that_of_a_chemistry() -> None:
    measured = cells_of(dataclasses.replace(FLAT, open_circuit_v=((0.0, 22.0), (1.0, 25.4))))
    assert (
        0.0
        < measured.facts.curve_sd
        < min(FACTS[name].curve_sd for name in ("nmc", "lipo", "lfp", "lead_acid"))
    )
    assert measured.rate_per_h(measured.rated_as / 3600.0) == pytest.approx(1.0)
