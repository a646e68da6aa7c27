"""Packs of PyBaMM's cells in the benchmark of faulty gauges: they give their label, and drive as a
circuit does."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pybamm")

from benchmarks.on_the_robot.gauges.ground import draw_ground
from benchmarks.on_the_robot.gauges.pybamm_pack import (
    PARAMETER_SETS,
    PybammPack,
    _given_j,
    make_pack,
)
from benchmarks.on_the_robot.gauges.robots import Label, Wear, draw_robot, label_of
from benchmarks.on_the_robot.gauges.sizes import Sizes, read_sizes
from benchmarks.on_the_robot.gauges.way import (
    CURRENT_A,
    ENERGY_J,
    POWER_W,
    SHARE,
    TIME_S,
    VOLTAGE_V,
)

SIZES = read_sizes()
NEW = Wear(resistance_factor=1.0, capacity_share=1.0, outside_c=25.0)


def pack_of(chemistry: str, wear: Wear = NEW, start_share: float = 1.0) -> tuple[PybammPack, Label]:
    """A third of a Husky's pack."""
    place = SIZES.robots["husky"]
    label = label_of(place.preset, place.cells[chemistry], SIZES.cells[chemistry].label_v, 0.3)
    return make_pack(chemistry, label, SIZES, wear, start_share), label


@pytest.mark.parametrize("chemistry", PARAMETER_SETS)
def test_a_new_pack_gives_its_label_and_a_worn_one_less(chemistry: str) -> None:
    pack, label = pack_of(chemistry)
    label_w = label.energy_j / (3600.0 * SIZES.truth.label_hours)
    new_j, new_ah = _given_j(pack, None, label_w)
    assert new_j == pytest.approx(label.energy_j, rel=0.002)
    assert new_ah == pytest.approx(pack.learned_ah) and new_ah < pack.true_ah
    assert new_j / new_ah / 3600.0 == pytest.approx(label.voltage_v, rel=0.1)
    faded_j = _given_j(pack_of(chemistry, replace(NEW, capacity_share=0.8))[0], None, label_w)[0]
    assert faded_j == pytest.approx(0.8 * new_j, rel=0.03)
    resists_j = _given_j(
        pack_of(chemistry, replace(NEW, resistance_factor=1.8))[0], None, 3.0 * label_w
    )[0]
    cold_j = _given_j(pack_of(chemistry, replace(NEW, outside_c=-10.0))[0], None, 3.0 * label_w)[0]
    assert resists_j < _given_j(pack, None, 3.0 * label_w)[0]
    assert cold_j < _given_j(pack, None, 3.0 * label_w)[0]
    assert _given_j(pack, None, 1e4 * label_w)[0] < 1e-2 * label.energy_j, (
        "no current delivers that for long"
    )


def test_records_agree_with_each_other_and_the_way_home_with_where_it_turns() -> None:
    pack, label = pack_of("nmc", start_share=0.97)
    place = SIZES.robots["husky"]
    truth: Sizes = replace(SIZES, truth=replace(SIZES.truth, wind_mps=[0.0, 0.0]))
    robot = draw_robot(place.preset, place.cruise_mps, truth, np.random.default_rng(0))
    ground = draw_ground(
        robot, [0.0, 0.0], 2.0 * label.energy_j / robot.standby_w, truth, np.random.default_rng(0)
    )
    way = pack.drive_out(ground, 10.0, truth.truth)
    last = len(way.records) - 1
    lengths_s = np.diff(way.column(TIME_S), prepend=0.0)
    assert np.cumsum(way.column(POWER_W) * lengths_s) == pytest.approx(way.column(ENERGY_J))
    drawn_ah = np.cumsum(way.column(CURRENT_A) * lengths_s) / 3600.0
    assert 0.97 - way.column(SHARE) == pytest.approx(drawn_ah / pack.true_ah, abs=0.003)
    assert (way.column(VOLTAGE_V) > pack.cutoff_v).all() and len(way.states) == len(way.records)
    assert way.column(VOLTAGE_V)[last] < pack.cutoff_v * 1.05
    # The energy left is what a way of the same power still takes until the cut-off.
    mean_w = way.records[-1, ENERGY_J] / way.empty_s
    left_j = pack.left_j(way, last // 2, mean_w, truth.truth)
    assert left_j == pytest.approx(
        way.records[-1, ENERGY_J] - way.records[last // 2, ENERGY_J], rel=0.05
    )
    early, late = (pack.drive_home(way, turn, ground, truth.truth) for turn in (last // 5, last))
    assert early.arrived and not late.arrived
    assert 0.4 < early.share < way.column(SHARE)[last // 5]
