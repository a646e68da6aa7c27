"""The benchmark of faulty gauges: its battery, way, gauges and instruments do what physics and
their names say."""

import ast
import csv
import io
import math
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from rich.table import Table as RichTable

from benchmarks.on_the_robot import gauges
from benchmarks.on_the_robot.gauges import report
from benchmarks.on_the_robot.gauges.__main__ import Args, Chemistry, main, make_cases
from benchmarks.on_the_robot.gauges.agents import (
    Z90,
    CompanionRun,
    Estimate,
    has_gauge,
    metered_share,
    mirror,
    turn_at_half,
    turn_at_reserve,
)
from benchmarks.on_the_robot.gauges.cell import (
    CURVES,
    SLOW_V,
    TEMPERATURE_C,
    Floats,
    Pack,
    discharge,
    full_state,
    height,
    is_down,
    open_circuit_v,
    step,
    total_share,
)
from benchmarks.on_the_robot.gauges.drive import (
    SHARES_OF_WAY,
    Case,
    Drive,
    Outcome,
    Point,
    run_drive,
)
from benchmarks.on_the_robot.gauges.gauge import GAUGES, Gauge, shown_shares
from benchmarks.on_the_robot.gauges.ground import Ground, draw_ground, home_energy_j, traction_w
from benchmarks.on_the_robot.gauges.instruments import Conditions, Readings, draw_conditions, read
from benchmarks.on_the_robot.gauges.robots import (
    Curve,
    Label,
    TrueRobot,
    accepted_curve,
    draw_robot,
    draw_wear,
    label_of,
    measured_curve,
    refusal,
    robot_file,
    worn_pack,
)
from benchmarks.on_the_robot.gauges.score import covers, mean_of, rate_of
from benchmarks.on_the_robot.gauges.sizes import FILE, Sizes, read_sizes
from benchmarks.on_the_robot.gauges.way import (
    CELL,
    CURRENT_A,
    ENERGY_J,
    POWER_W,
    RECORD_COLUMNS,
    SHARE,
    SPEED_MPS,
    STATE_COLUMNS,
    TIME_S,
    VOLTAGE_V,
    WayOut,
    drive_home,
    drive_out,
)
from homeward import companion, load_robot

SIZES = read_sizes()
CHEMISTRIES = tuple(SIZES.cells)
SEEDS = range(12)
UPDATE_S = 6.0


def at_25_c(sizes: Sizes) -> Sizes:
    """Packs as good as new, in air of 25 C."""
    truth = replace(
        sizes.truth,
        temperature_c=[25.0, 25.0],
        capacity_share=[1.0, 1.0],
        resistance_factor=[1.0, 1.0],
    )
    return replace(sizes, truth=truth)


def calm(sizes: Sizes) -> Sizes:
    """A level, even way without wind, stops or wander: the same power all along, out and home."""
    truth = replace(
        sizes.truth, wind_mps=[0.0, 0.0], gust_share=0.0, standby_wander=0.0, speed_wander=0.0
    )
    ground = replace(sizes.ground, patch_sd=0.0, stops_per_hour=0.0)
    robots = {name: replace(robot, grade_sd_rad=[0.0, 0.0]) for name, robot in sizes.robots.items()}
    return replace(sizes, truth=truth, ground=ground, robots=robots)


def exact(sizes: Sizes) -> Sizes:
    """Instruments and counters without any error."""
    instruments = replace(
        sizes.instruments,
        voltage_gain_sd=0.0,
        voltage_noise_share=0.0,
        current_gain_sd=0.0,
        current_offset_share_sd=0.0,
        current_noise_share=0.0,
        speed_gain_sd=0.0,
        speed_noise_share=0.0,
        grade_offset_sd_deg=0.0,
        grade_noise_deg=0.0,
        heading_offset_sd_deg=0.0,
        heading_noise_deg=0.0,
        temperature_offset_sd_c=0.0,
        dropouts_per_h=0.0,
        single_dropouts_per_h=0.0,
    )
    gauge = replace(
        sizes.gauge, counter_start_sd=0.0, counter_gain_sd=0.0, counter_offset_per_h=0.0
    )
    return replace(sizes, instruments=instruments, gauge=gauge)


def rng(seed: int) -> np.random.Generator:
    """A generator."""
    return np.random.default_rng(seed)


def pack_of(
    chemistry: str, sizes: Sizes, seed: int = 0, pack_share: float = 1.0
) -> tuple[Pack, Label]:
    """A pack for a Husky, and its label."""
    place = sizes.robots["husky"]
    label = label_of(
        place.preset, place.cells[chemistry], sizes.cells[chemistry].label_v, pack_share
    )
    return worn_pack(chemistry, label, sizes, draw_wear(sizes, rng(seed))), label


@dataclass(frozen=True)
class Truth:
    """A drawn robot on its way out."""

    robot: TrueRobot
    pack: Pack
    ground: Ground
    state: Floats
    way: WayOut


def truth_of(sizes: Sizes, chemistry: str = "nmc", seed: int = 0) -> Truth:
    """A Husky with a third of its pack, driven out until its battery is cut off."""
    place = sizes.robots["husky"]
    pack, label = pack_of(chemistry, sizes, seed, pack_share=0.3)
    robot = draw_robot(place.preset, place.cruise_mps, sizes, rng(seed))
    ground = draw_ground(
        robot, place.grade_sd_rad, label.energy_j / robot.standby_w, sizes, rng(seed)
    )
    state = full_state(pack, 1.0)
    return Truth(robot, pack, ground, state, drive_out(pack, state, ground, UPDATE_S, sizes.truth))


@pytest.fixture(scope="module")
def hilly() -> Truth:
    """On hills in wind."""
    return truth_of(at_25_c(SIZES), seed=3)


@pytest.fixture(scope="module")
def level() -> Truth:
    """On a calm way."""
    return truth_of(calm(at_25_c(SIZES)))


def steady_way(pack: Pack, cell_v: Floats, hours: float = 4.0) -> WayOut:
    """A way on which the pack gives all that a counter expects of it at one current, with some
    voltage of a cell."""
    records = np.zeros((cell_v.size, RECORD_COLUMNS))
    records[:, TIME_S] = 3600.0 * hours * np.arange(1, cell_v.size + 1) / cell_v.size
    records[:, CURRENT_A] = pack.learned_ah / hours
    records[:, VOLTAGE_V] = cell_v * pack.cells
    return WayOut(records, np.zeros((cell_v.size, STATE_COLUMNS)))


def shown_on(
    way: WayOut, gauge: Gauge, sizes: Sizes, seed: int = 0, chemistry: str = "nmc"
) -> tuple[Floats, str]:
    """What a gauge shows on a way that begins with a full pack."""
    pack, _label = pack_of("nmc", at_25_c(SIZES))
    return shown_shares(gauge, chemistry, pack, 1.0, way, sizes, rng(seed))


@pytest.fixture(scope="module")
def steady() -> WayOut:
    """Four hours from full to empty at 3.6 V, an update every 6 s."""
    pack, _label = pack_of("nmc", at_25_c(SIZES))
    return steady_way(pack, np.full(2400, 3.6))


def readings_of(
    soc: Sequence[float], volts: float = math.nan, amperes: float = math.nan
) -> Readings:
    """Readings of a gauge, and of a meter where it has one, every 10 s."""
    updates = len(soc)
    nothing = np.full(updates, np.nan)
    return Readings(
        time_s=np.linspace(10.0, 10.0 * updates, updates),
        there=np.ones(updates, dtype=np.bool_),
        soc=np.array(soc),
        voltage_v=np.full(updates, volts),
        current_a=np.full(updates, amperes),
        speed_mps=nothing,
        position_m=np.full((updates, 2), np.nan),
        grade_rad=nothing,
        heading_rad=nothing,
        temperature_c=nothing,
    )


@pytest.mark.parametrize("chemistry", CHEMISTRIES)
def test_open_circuit_voltage_rises_with_charge_about_the_label(chemistry: str) -> None:
    cell = SIZES.cells[chemistry]
    curve_v = np.array(cell.curve_v)
    voltages_v = np.array(
        [open_circuit_v(CURVES[cell.curve], curve_v, share) for share in np.linspace(0.0, 1.0, 201)]
    )
    assert (np.diff(voltages_v) > 0.0).all()
    assert voltages_v.mean() == pytest.approx(cell.label_v, rel=0.1)
    assert voltages_v[0] < cell.cutoff_v + 0.2
    assert voltages_v[20] > cell.cutoff_v


@settings(max_examples=15)
@given(
    chemistry=st.sampled_from(CHEMISTRIES),
    rates_c=st.lists(st.floats(0.05, 1.5), min_size=1, max_size=6),
    temperature_c=st.floats(-10.0, 35.0),
    seed=st.integers(0, 100),
)
def test_charge_is_the_integral_of_current_and_losses_are_never_negative(
    chemistry: str, rates_c: list[float], temperature_c: float, seed: int
) -> None:
    truth = replace(SIZES.truth, temperature_c=[temperature_c, temperature_c])
    pack, label = pack_of(chemistry, replace(SIZES, truth=truth), seed)
    state = full_state(pack, 1.0)
    drawn_ah = 0.0
    for rate_c in rates_c:
        power_w = rate_c * label.energy_j / 3600.0
        for _second in range(40):
            rest_v = pack.cells * open_circuit_v(pack.curve, pack.curve_v, height(pack, state))
            voltage_v, current_a = step(pack, state, power_w, 10.0)
            drawn_ah += current_a * 10.0 / 3600.0
            assert voltage_v * current_a <= power_w * (1.0 + 1e-9)
            assert 0.0 < voltage_v <= rest_v
            assert state[TEMPERATURE_C] >= temperature_c - 1e-9
            if is_down(pack, state, voltage_v):
                break
    taken_ah = (1.0 - total_share(state)) * pack.true_ah
    coldest_usable = 1.0 - pack.cold_loss_per_k * max(25.0 - temperature_c, 0.0)
    assert drawn_ah <= taken_ah * (1.0 + 1e-9)
    assert drawn_ah >= taken_ah * coldest_usable * (1.0 - 1e-9)
    if temperature_c >= 25.0:
        assert drawn_ah == pytest.approx(taken_ah)


@pytest.mark.parametrize("chemistry", CHEMISTRIES)
def test_a_fresh_pack_gives_its_label_and_less_when_cold_fast_or_old(chemistry: str) -> None:
    sizes = at_25_c(SIZES)
    pack, label = pack_of(chemistry, sizes)
    label_w = label.energy_j / (3600.0 * sizes.truth.label_hours)

    def given_j(used: Pack, power_w: float) -> float:
        return float(discharge(used, full_state(used, 1.0), power_w, sizes.truth.trip_s)[0])

    fresh_j = given_j(pack, label_w)
    assert fresh_j == pytest.approx(label.energy_j, rel=0.02)
    assert given_j(pack, 4.0 * label_w) < 0.99 * fresh_j
    assert given_j(pack._replace(outside_c=-10.0), label_w) < 0.93 * fresh_j
    old, _label = pack_of(
        chemistry, replace(sizes, truth=replace(sizes.truth, capacity_share=[0.8, 0.8]))
    )
    assert given_j(old, label_w) == pytest.approx(0.8 * fresh_j, rel=0.03)
    worn, _label = pack_of(
        chemistry, replace(sizes, truth=replace(sizes.truth, resistance_factor=[1.8, 1.8]))
    )
    assert given_j(worn, label_w) < fresh_j
    assert pack.learned_ah == pytest.approx(
        discharge(pack, full_state(pack, 1.0), label_w, sizes.truth.trip_s)[1]
    )


def test_discharge_leaves_its_state_and_gives_no_more_than_the_charge_allows() -> None:
    pack, label = pack_of("lead_acid", at_25_c(SIZES))
    state = full_state(pack, 0.7)
    before = state.copy()
    energy_j, charge_ah = discharge(pack, state, label.energy_j / 3600.0, SIZES.truth.trip_s)
    assert (state == before).all()
    full_v = pack.cells * open_circuit_v(pack.curve, pack.curve_v, 1.0)
    assert 0.0 < energy_j < 3600.0 * charge_ah * full_v
    assert charge_ah <= 0.7 * pack.true_ah


def test_two_wells_refill_at_rest_and_keep_their_charge() -> None:
    pack, label = pack_of("lead_acid", at_25_c(SIZES))
    state = full_state(pack, 1.0)
    for _minute in range(15):
        step(pack, state, label.energy_j / 3600.0, 60.0)
    drawn_level, drawn_share = height(pack, state), total_share(state)
    sag_v = state[SLOW_V]
    for _minute in range(60):
        step(pack, state, 0.0, 60.0)
    assert drawn_level < drawn_share
    assert drawn_level < height(pack, state) < drawn_share
    assert total_share(state) == pytest.approx(drawn_share)
    assert state[SLOW_V] < 0.01 * sag_v


def test_more_power_than_a_pack_can_give_collapses_its_voltage() -> None:
    pack, _label = pack_of("nmc", at_25_c(SIZES))
    state = full_state(pack, 1.0)
    voltage_v, current_a = step(pack, state, 1e6, 1.0)
    assert voltage_v < pack.cutoff_v
    assert math.isfinite(current_a)
    assert voltage_v * current_a < 1e6


def test_forces_have_the_right_signs() -> None:
    robot = TrueRobot(
        10.0, 0.1, 0.5, gear_loss=0.25, copper_w_per_n2=0.02, standby_w=5.0, cruise_mps=1.0
    )

    def power_w(grade_rad: float = 0.0, against_mps: float = 0.0, across_mps: float = 0.0) -> float:
        values = (grade_rad, robot.rolling_resistance, 1.0, against_mps, across_mps)
        return float(traction_w(robot, *(np.array([value]) for value in values))[0])

    force_n = 0.1 * 10.0 * 9.81 + 0.5
    assert power_w() == pytest.approx(1.25 * force_n + 0.02 * force_n**2)
    assert power_w(grade_rad=0.05) > power_w() > power_w(grade_rad=-0.05) > 0.0
    assert (
        power_w(against_mps=3.0) > power_w(across_mps=3.0) > power_w() > power_w(against_mps=-1.0)
    )
    assert power_w(grade_rad=-0.1) >= 0.0


def test_the_way_has_the_spreads_that_its_sizes_say() -> None:
    place = SIZES.robots["husky"]
    robot = draw_robot(place.preset, place.cruise_mps, SIZES, rng(0))
    ground = draw_ground(robot, [0.04, 0.04], 40_000.0, SIZES, rng(1))
    assert float(ground.grade_rad.std()) == pytest.approx(0.04, rel=0.25)
    assert ground.stop_s.max() <= SIZES.ground.stop_s[1]
    assert np.count_nonzero(ground.stop_s) * 3600.0 / 40_000.0 == pytest.approx(
        SIZES.ground.stops_per_hour, rel=0.5
    )
    assert (
        ground.out_mps[ground.grade_rad > 0.06].mean()
        < ground.out_mps[ground.grade_rad < -0.06].mean()
    )
    assert (
        ground.home_mps[ground.grade_rad > 0.06].mean()
        > ground.home_mps[ground.grade_rad < -0.06].mean()
    )
    assert math.hypot(ground.east_m[0], ground.north_m[0]) == pytest.approx(ground.length_m)
    assert float(np.mean(ground.home_w / ground.mean_home_w)) == pytest.approx(1.0, abs=0.05)


def test_records_of_the_way_out_agree_with_each_other(hilly: Truth) -> None:
    way = hilly.way
    lengths_s = np.diff(way.column(TIME_S), prepend=0.0)
    powers_w = way.column(POWER_W)
    assert (lengths_s >= UPDATE_S - 1e-6).all()
    assert np.cumsum(powers_w * lengths_s) == pytest.approx(way.column(ENERGY_J))
    assert way.column(VOLTAGE_V) * way.column(CURRENT_A) == pytest.approx(powers_w, rel=0.05)
    drawn_ah = np.cumsum(way.column(CURRENT_A) * lengths_s) / 3600.0
    assert 1.0 - way.column(SHARE) == pytest.approx(drawn_ah / hilly.pack.true_ah)
    cells_m = np.cumsum(way.column(SPEED_MPS) * lengths_s)
    assert cells_m == pytest.approx((way.column(CELL) + 1.0) * hilly.ground.length_m)
    full_v = hilly.pack.cells * open_circuit_v(hilly.pack.curve, hilly.pack.curve_v, 1.0)
    assert way.records[-1, ENERGY_J] < 3600.0 * drawn_ah[-1] * full_v


def test_energy_left_is_what_a_steady_way_still_takes_until_the_cut_off(level: Truth) -> None:
    way = level.way
    end_j = way.records[-1, ENERGY_J]
    for index in range(0, way.records.shape[0], 150):
        left_j, _left_ah = discharge(
            level.pack, way.states[index], way.records[index, POWER_W], SIZES.truth.trip_s
        )
        assert left_j == pytest.approx(end_j - way.records[index, ENERGY_J], abs=0.005 * end_j)


def test_energy_of_the_way_home_is_what_driving_home_takes(level: Truth) -> None:
    homes_j = home_energy_j(level.ground)
    turning_j = level.ground.standby_w * SIZES.truth.turning_s
    for index in (0, 40, 200):
        end = drive_home(level.pack, level.way, index, level.ground, SIZES.truth)
        cell = int(level.way.records[index, CELL])
        assert end.arrived
        assert end.energy_j == pytest.approx(homes_j[cell] + turning_j)
        # Out and home are alike on a level way without wind.
        assert homes_j[cell] == pytest.approx(level.way.records[index, ENERGY_J])


def test_who_turns_at_once_gets_home_and_who_turns_late_does_not(hilly: Truth) -> None:
    updates = hilly.way.records.shape[0]
    ends = [
        drive_home(hilly.pack, hilly.way, turn, hilly.ground, SIZES.truth)
        for turn in range(0, updates, 20)
    ]
    last = drive_home(hilly.pack, hilly.way, updates - 1, hilly.ground, SIZES.truth)
    arrived = [end.arrived for end in ends]
    shares = np.array([end.share for end in ends if end.arrived])
    assert arrived[0] and not last.arrived
    assert arrived == sorted(arrived, reverse=True)
    assert (np.diff(shares) < 0.0).all()
    assert 0.3 < sum(arrived) / len(arrived) < 0.7


def test_a_counter_shows_the_true_charge_within_its_error(hilly: Truth) -> None:
    way, pack, gauge = hilly.way, hilly.pack, SIZES.gauge
    drawn = (
        np.cumsum(way.column(CURRENT_A) * np.diff(way.column(TIME_S), prepend=0.0))
        / 3600.0
        / pack.learned_ah
    )
    hours = way.column(TIME_S) / 3600.0
    sd = np.sqrt(
        gauge.counter_start_sd**2
        + (gauge.counter_gain_sd * drawn) ** 2
        + (gauge.counter_offset_per_h * hours) ** 2
    )
    scaled = []
    for seed in range(40):
        shown, fault = shown_shares("counter", "nmc", pack, 0.9, way, SIZES, rng(seed))
        error = shown - np.clip(0.9 - drawn, 0.0, 1.0)
        assert fault == ""
        assert (np.abs(error) <= 4.0 * sd + 0.5 * gauge.counter_step).all()
        scaled.append(error[way.records.shape[0] // 2] / sd[way.records.shape[0] // 2])
    assert 0.7 < float(np.std(scaled)) < 1.4
    without_error, _fault = shown_shares("counter", "nmc", pack, 0.9, way, exact(SIZES), rng(0))
    inside = drawn < 0.9
    assert np.abs(without_error - (0.9 - drawn))[inside].max() <= 0.5 * gauge.counter_step + 1e-9


@pytest.mark.parametrize("chemistry", CHEMISTRIES)
@pytest.mark.parametrize("gauge", ["linear_voltage", "pieces_voltage"])
def test_a_gauge_by_voltage_falls_with_the_voltage_from_full_to_empty(
    gauge: Gauge, chemistry: str
) -> None:
    pack, _label = pack_of("nmc", at_25_c(SIZES))
    ends_v = (SIZES.linear_map if gauge == "linear_voltage" else SIZES.pieces_map)[chemistry].v
    falling = steady_way(pack, np.linspace(ends_v[-1] + 0.1, ends_v[0] - 0.1, 2400))
    shown, _fault = shown_on(falling, gauge, SIZES, chemistry=chemistry)
    assert (np.diff(shown) <= 1e-12).all()
    assert (shown[0], shown[-1]) == (1.0, 0.0)
    assert np.unique(shown).size > 50


def test_a_coarse_gauge_shows_whole_steps(steady: WayOut) -> None:
    counted = [shown_on(steady, "counter", SIZES, seed)[0] for seed in SEEDS]
    seen = set()
    for seed in SEEDS:
        shown, fault = shown_on(steady, "coarse", SIZES, seed)
        (coarse_step,) = [
            size for size in SIZES.gauge.coarse_steps if fault == f"steps of {size:.0%}"
        ]
        seen.add(coarse_step)
        assert np.round(shown / coarse_step) * coarse_step == pytest.approx(shown)
        assert (
            np.abs(shown - counted[seed]).max()
            <= 0.5 * coarse_step + 0.5 * SIZES.gauge.counter_step + 1e-9
        )
    assert seen == set(SIZES.gauge.coarse_steps)


def test_a_late_gauge_lags_or_holds_for_as_long_as_it_says(steady: WayOut) -> None:
    fine = replace(exact(SIZES), gauge=replace(exact(SIZES).gauge, counter_step=1e-4))
    words = set()
    for seed in SEEDS:
        shown, fault = shown_on(steady, "late", fine, seed)
        counted, _fault = shown_on(steady, "counter", fine, seed)
        kind, late_s = fault.rsplit(maxsplit=2)[0], float(fault.split()[-2])
        words.add(kind)
        inside = (counted > 0.05) & (counted < 0.9)
        behind_s = 3600.0 * 4.0 * float((shown - counted)[inside].mean())
        # What is read every so often is on average half as old.
        assert behind_s == pytest.approx(late_s if kind == "lags" else 0.5 * late_s, abs=12.0)
        if kind == "read every":
            changes = np.flatnonzero(np.diff(shown))
            assert np.diff(changes) * 6.0 == pytest.approx(late_s, abs=3.5)
    assert words == {"lags", "read every"}


def test_a_late_gauge_counts_the_true_time_between_updates(steady: WayOut) -> None:
    """Updates wait for the end of a cell, so they are further apart than asked."""
    sizes = replace(
        SIZES, gauge=replace(SIZES.gauge, late_held_share=1.0, late_hold_s=[120.0, 120.0])
    )
    slow = WayOut(steady.records[1::2], steady.states[1::2])
    shown, _fault = shown_on(slow, "late", sizes)
    changes_s = 12.0 * np.flatnonzero(np.diff(shown))
    assert np.diff(changes_s).min() == pytest.approx(120.0)


def test_a_reset_gauge_jumps_once_and_counts_on(steady: WayOut) -> None:
    sizes = replace(exact(SIZES), gauge=replace(exact(SIZES).gauge, counter_step=1e-4))
    fall = 1.0 / steady.records.shape[0]
    kinds = set()
    for seed in SEEDS:
        shown, fault = shown_on(steady, "reset", sizes, seed)
        inside = (shown[1:] > 0.0) & (shown[:-1] < 1.0 - 1e-9)
        jumps = np.flatnonzero((np.abs(np.diff(shown) + fall) > 0.01) & inside)
        assert jumps.size == 1, fault
        moment = steady.column(TIME_S)[jumps[0] + 1] / steady.empty_s
        assert SIZES.gauge.reset_when[0] <= moment <= SIZES.gauge.reset_when[1] + 0.01
        if fault == "set to 100%":
            assert shown[jumps[0] + 1] == 1.0
        if fault.startswith("set by the voltage"):
            assert shown[jumps[0] + 1] == pytest.approx(0.4, abs=1e-3)
        kinds.add(fault.split(",")[0].rstrip("+-0123456789%"))
    assert kinds == {"set to ", "set by the voltage", "set "}


def test_a_stuck_gauge_is_a_counter_but_for_the_time_that_it_is_stuck(steady: WayOut) -> None:
    words = set()
    for seed in SEEDS:
        shown, fault = shown_on(steady, "stuck", SIZES, seed)
        counted, _fault = shown_on(steady, "counter", SIZES, seed)
        other = np.flatnonzero(shown != counted)
        held_s = (other[-1] - other[0]) * 6.0
        words.add(fault.split()[-1])
        assert np.unique(shown[other]).size == 1
        assert np.unique(shown[other[0] : other[-1] + 1]).size == 1
        if fault == "stuck for ever":
            assert shown[-1] == shown[other[0]] > 0.3
        else:
            # It takes up to two steps of the counter to notice.
            assert held_s == pytest.approx(float(fault.split()[-2]), abs=300.0)
    assert words == {"ever", "s"}


@pytest.mark.parametrize("gauge", GAUGES)
def test_every_gauge_shows_shares_or_nothing(gauge: Gauge, hilly: Truth) -> None:
    for seed in range(4):
        shown, _fault = shown_shares(gauge, "nmc", hilly.pack, 1.0, hilly.way, SIZES, rng(seed))
        assert shown.shape == hilly.way.column(TIME_S).shape
        if gauge == "none":
            assert np.isnan(shown).all()
        else:
            assert ((shown >= 0.0) & (shown <= 1.0)).all()


def test_instruments_without_error_read_the_truth(hilly: Truth) -> None:
    way = hilly.way
    shown = np.linspace(1.0, 0.0, way.records.shape[0])
    everything = Conditions("voltage and current", 0.0, 0.0, 0.0)
    readings = read(way, hilly.ground, shown, everything, exact(SIZES).instruments, rng(0))
    assert readings.there.all()
    assert (readings.time_s == way.column(TIME_S)).all()
    assert readings.voltage_v == pytest.approx(way.column(VOLTAGE_V))
    assert readings.current_a == pytest.approx(way.column(CURRENT_A))
    assert readings.speed_mps == pytest.approx(way.column(SPEED_MPS))
    assert (readings.soc == shown).all()
    cells = way.column(CELL).astype(int)
    assert readings.position_m[:, 0] == pytest.approx(hilly.ground.east_m[cells])
    assert readings.grade_rad == pytest.approx(hilly.ground.grade_rad[cells])
    assert metered_share(readings, way.column(POWER_W), way.records.shape[0] - 1) == pytest.approx(
        1.0, abs=0.01
    )


def test_other_conditions_leave_all_other_errors_as_they_are(hilly: Truth) -> None:
    shown = np.full(hilly.way.records.shape[0], 0.5)

    def under(conditions: Conditions) -> Readings:
        return read(hilly.way, hilly.ground, shown, conditions, SIZES.instruments, rng(4))

    good = under(Conditions("voltage and current", 0.0, 0.0, 0.3))
    poor = under(Conditions("voltage and current", 10.0, 0.0, 0.3))
    stepped = under(Conditions("voltage and current", 0.0, -3600.0, 0.3))
    blind = under(Conditions("neither", 0.0, 0.0, 0.3))
    np.testing.assert_array_equal(poor.current_a, good.current_a)
    np.testing.assert_array_equal(stepped.position_m, good.position_m)
    assert float(np.nanstd(poor.position_m - good.position_m)) == pytest.approx(10.0, rel=0.1)
    later = hilly.way.column(TIME_S) >= 0.3 * hilly.way.empty_s
    np.testing.assert_array_equal(good.time_s - stepped.time_s, 3600.0 * later)
    assert np.isnan(blind.voltage_v).all() and np.isnan(blind.current_a).all()
    np.testing.assert_array_equal(blind.speed_mps, good.speed_mps)


def test_instruments_fail_as_often_and_err_as_much_as_stated(hilly: Truth) -> None:
    often = replace(SIZES.instruments, dropouts_per_h=20.0, single_dropouts_per_h=40.0)
    shown = np.full(hilly.way.records.shape[0], 0.5)
    all_on = Conditions("voltage and current", 0.0, 0.0, 0.0)
    readings = read(hilly.way, hilly.ground, shown, all_on, often, rng(0))
    assert not readings.there.all() and readings.there[0]
    assert np.isnan(readings.speed_mps).any() and np.isfinite(readings.speed_mps).any()
    gains = []
    for seed in range(60):
        volts = read(hilly.way, hilly.ground, shown, all_on, SIZES.instruments, rng(seed)).voltage_v
        gains.append(float(np.nanmean(volts / hilly.way.column(VOLTAGE_V))))
    assert float(np.std(gains)) == pytest.approx(SIZES.instruments.voltage_gain_sd, rel=0.3)
    drawn = [draw_conditions(False, SIZES.instruments, rng(seed)) for seed in range(400)]
    assert {conditions.recorded for conditions in drawn} == {"voltage", "neither"}
    steps = [conditions.clock_step_s != 0.0 for conditions in drawn]
    assert sum(steps) / len(steps) == pytest.approx(SIZES.instruments.clock_step_share, abs=0.05)
    assert {abs(conditions.clock_step_s) for conditions in drawn} == {
        0.0,
        SIZES.instruments.clock_step_s,
    }
    assert draw_conditions(True, SIZES.instruments, rng(0)).recorded == "voltage and current"


def test_baselines_turn_where_their_rule_says() -> None:
    readings = readings_of([1.0, 0.8, 0.55, 0.54, 0.5, 0.49, 0.2])
    assert turn_at_half(readings, SIZES.rules) == 5
    # 1.2 (1 - 0.54) = 0.552 >= 0.54; 1.2 (1 - 0.55) = 0.54 < 0.55
    assert turn_at_reserve(readings, SIZES.rules) == 3
    readings.there[3:5] = False
    readings.soc[5] = np.nan
    assert turn_at_half(readings, SIZES.rules) == 6
    assert turn_at_reserve(readings, SIZES.rules) == 6
    stuck = readings_of([0.9] * 5)
    assert turn_at_half(stuck, SIZES.rules) is None
    assert turn_at_reserve(stuck, SIZES.rules) is None
    assert has_gauge(stuck) and not has_gauge(readings_of([math.nan] * 5))


def test_the_mirror_rule_takes_for_the_way_home_what_the_way_out_took() -> None:
    rated_j = 1e5
    by_gauge = mirror(readings_of([1.0, 0.9, 0.8]), 2, rated_j, SIZES.rules)
    assert by_gauge is not None
    left, home = by_gauge
    assert (left.mean_j, home.mean_j) == pytest.approx((0.8 * rated_j, 0.2 * rated_j))
    assert home.high_j - home.low_j == pytest.approx(2.0 * Z90 * 0.1 * home.mean_j)
    by_meter = mirror(readings_of([math.nan] * 3, volts=20.0, amperes=5.0), 2, rated_j, SIZES.rules)
    assert by_meter is not None
    assert by_meter[1].mean_j == pytest.approx(100.0 * 30.0)
    assert by_meter[0].mean_j == pytest.approx(rated_j - 100.0 * 30.0)
    assert mirror(readings_of([math.nan] * 3), 2, rated_j, SIZES.rules) is None


@pytest.mark.parametrize("step_s", [-3600.0, 0.0, 3600.0])
def test_the_mirror_rule_meters_right_with_uneven_updates_and_a_clock_that_steps(
    step_s: float,
) -> None:
    even = readings_of([math.nan] * 400, volts=20.0, amperes=5.0)
    times_s = np.cumsum(np.tile([1.1, 2.0, 1.1, 2.2], 100))
    uneven = replace(even, time_s=times_s + step_s * (times_s > 0.5 * times_s[-1]))
    estimates = mirror(uneven, 399, 1e6, SIZES.rules)
    assert estimates is not None
    assert estimates[1].mean_j == pytest.approx(100.0 * times_s[-1], rel=0.01)


def test_the_mirror_rule_does_not_see_what_did_not_come_through() -> None:
    readings = readings_of([1.0, 0.9, 0.8])
    readings.there[2] = False
    estimates = mirror(readings, 2, 1e5, SIZES.rules)
    assert estimates is not None
    assert estimates[0].mean_j == pytest.approx(0.9e5)


def test_a_run_without_advice_has_no_estimates() -> None:
    assert CompanionRun(advice=[None, None]).estimates(1) is None


def rows_of(path: Path) -> list[dict[str, str]]:
    """Rows of a file, without what depends on the computer's speed."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return [
        {name: text for name, text in row.items() if name not in ("seconds", "companion_s")}
        for row in rows
    ]


def quick(path: Path, drives: int, jobs: int) -> Args:
    """Drives of small F1TENTH packs."""
    return Args(
        drives=drives,
        robots=("f1tenth",),
        chemistries=("lipo",),
        gauges=("counter", "none"),
        current=True,
        jobs=jobs,
        out=path,
    )


def test_rows_depend_on_the_number_and_not_on_the_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = main(quick(tmp_path / "alone.csv", drives=1, jobs=1))
    both = main(quick(tmp_path / "both.csv", drives=2, jobs=2))
    (first,), (same, other) = rows_of(tmp_path / "alone.csv"), rows_of(tmp_path / "both.csv")
    assert {name: text for name, text in same.items() if text} == {
        name: text for name, text in first.items() if text
    }
    assert first["empty_s"] != other["empty_s"]
    printed = capsys.readouterr().out
    assert "Stranded" in printed and "Coverage" in printed
    assert "half charge" in alone[0].outcomes and "half charge" not in both[1].outcomes
    for drive in both:
        assert drive.crash == ""
        assert [point.share for point in drive.points] == list(SHARES_OF_WAY)
        assert (np.diff([point.true_left_j for point in drive.points]) < 0.0).all()
        assert (np.diff([point.true_home_j for point in drive.points]) > 0.0).all()


def test_another_seed_is_another_drive_and_rules_at_their_ends_turn_at_once_or_never() -> None:
    rules = replace(SIZES.rules, turn_share=0.0, reserve_factor=1e6, paired_share=0.0)
    args = replace(quick(Path("unused.csv"), drives=1, jobs=1), seed=2)
    (case,) = make_cases(args, "none", SIZES)
    (first_case,) = make_cases(quick(Path("unused.csv"), drives=1, jobs=1), "none", SIZES)
    drive = run_drive(case, replace(SIZES, rules=rules))
    assert case == replace(first_case, seed=2)
    never, at_once = drive.outcomes["half charge"], drive.outcomes["used x 1.2"]
    assert never.stranded and never.turned == 1.0 and math.isnan(never.left)
    assert not at_once.stranded and at_once.turned < 0.1 and at_once.left > 0.9
    latest = drive.outcomes["latest turn"]
    assert not latest.stranded
    assert drive.outcomes["companion"].turned <= latest.turned < 1.0
    assert latest.left < drive.outcomes["companion"].left
    truths = [truth_of(SIZES, seed=seed).way.empty_s for seed in (1, 1, 2)]
    assert truths[0] == truths[1] != truths[2]


@pytest.mark.parametrize("chemistries", [CHEMISTRIES, ("nmc",), ("nmc", "lfp", "flat")])
@pytest.mark.parametrize("gauges", [GAUGES, GAUGES[:7]])
def test_every_gauge_and_chemistry_meets_every_condition(
    chemistries: tuple[Chemistry, ...], gauges: tuple[Gauge, ...]
) -> None:
    cells = len(chemistries) * len(gauges)
    conditions = len(SIZES.truth.pack_shares) * 2 * len(SIZES.robots)
    args = Args(gauges=gauges, chemistries=chemistries, drives=cells * conditions)
    cases = make_cases(args, "none", SIZES)
    assert [case.number for case in cases] == list(range(len(cases)))
    assert len({replace(case, number=0) for case in cases}) == len(cases)
    first_round = cases[:cells]
    assert len({(case.gauge, case.chemistry) for case in first_round}) == cells


def test_without_pybamm_its_engine_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.on_the_robot.gauges.pybamm_pack.find_spec", lambda name: None)
    with pytest.raises(SystemExit):
        main(Args(drives=1, engine="pybamm"))


def changed(tmp_path: Path, old: str, new: str) -> Sizes:
    """Sizes of a copy of the file with a line changed."""
    text = FILE.read_text()
    assert text.count(old) == 1
    path = tmp_path / "sizes.toml"
    path.write_text(text.replace(old, new))
    return read_sizes(path)


def test_every_size_is_used() -> None:
    sources = [path.read_text() for path in FILE.parent.glob("*.py") if path.name != "sizes.py"]
    source = "\n".join(sources)
    sections = [getattr(SIZES, section.name) for section in fields(SIZES)]
    records = [
        record
        for section in sections
        for record in (section.values() if isinstance(section, dict) else [section])
    ]
    names = {name.name for record in records if is_dataclass(record) for name in fields(record)}
    assert len(names) > 90
    assert [name for name in sorted(names) if re.search(rf"\.{name}\b", source) is None] == []


def test_every_size_has_a_source_or_reason() -> None:
    """On its line, on its section's line, or in a comment that names it; a curve's numbers on the
    line of its form."""
    lines = FILE.read_text().splitlines()
    comments = "\n".join(line for line in lines if line.startswith("#"))
    header = ""
    without = []
    for line in lines:
        if line.startswith("["):
            header = line
        if "=" not in line or line.startswith("#"):
            continue
        name = line.split("=")[0].strip()
        if (
            "#" not in line
            and "#" not in header
            and name not in ("preset", "curve_v")
            and name not in comments
        ):
            without.append(f"{header} {name}")
    assert without == []


def test_no_size_may_be_missing_or_unknown(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="counter_stap"):
        changed(tmp_path, "counter_step =", "counter_stap =")
    with pytest.raises(TypeError, match="another"):
        changed(tmp_path, "[curve]\n", "[curve]\nanother = 1.0\n")
    with pytest.raises(KeyError, match="rules"):
        changed(tmp_path, "[rules]", "[rulers]")
    assert set(tomllib.loads(FILE.read_text())) == {section.name for section in fields(SIZES)}


def test_changed_sizes_have_an_effect(tmp_path: Path, steady: WayOut, level: Truth) -> None:
    coarse = changed(tmp_path, "counter_step = 0.01 ", "counter_step = 0.5 ")
    assert set(shown_on(steady, "counter", coarse)[0]) == {0.0, 0.5, 1.0}
    rough = changed(tmp_path, "rolling_factor = [0.8, 1.2]", "rolling_factor = [2.0, 2.0]")
    assert truth_of(calm(at_25_c(rough))).way.empty_s < 0.8 * level.way.empty_s
    heavy = changed(tmp_path, "payload_share = [0.0, 0.2]", "payload_share = [1.0, 1.0]")
    assert truth_of(calm(at_25_c(heavy))).robot.mass_kg == 100.0
    early = changed(tmp_path, "turn_share = 0.5 ", "turn_share = 0.95 ")
    assert turn_at_half(readings_of([1.0, 0.9, 0.8]), early.rules) == 1
    loud = changed(tmp_path, "voltage_gain_sd = 0.005 ", "voltage_gain_sd = 0.5 ")
    everything = Conditions("voltage and current", 0.0, 0.0, 0.0)
    shown = np.full(level.way.records.shape[0], 0.5)
    volts = read(level.way, level.ground, shown, everything, loud.instruments, rng(0)).voltage_v
    assert abs(float(np.nanmean(volts / level.way.column(VOLTAGE_V))) - 1.0) > 0.03


@pytest.mark.parametrize("curve", ["none", "chemistry", "measured"])
def test_homeward_accepts_the_robot_files(curve: Curve, tmp_path: Path) -> None:
    for name, chemistry, pack_share in product(SIZES.robots, CHEMISTRIES, SIZES.truth.pack_shares):
        place = SIZES.robots[name]
        label = label_of(
            place.preset, place.cells[chemistry], SIZES.cells[chemistry].label_v, pack_share
        )
        pack = worn_pack(chemistry, label, SIZES, draw_wear(SIZES, rng(1)))
        measured_v = measured_curve(pack, SIZES, rng(2)) if curve == "measured" else None
        path = robot_file(tmp_path, place.preset, label, chemistry, curve, measured_v)
        robot = load_robot(path)
        battery = tomllib.loads(path.read_text())["battery"]
        assert robot.rated_energy_j == pytest.approx(label.energy_j)
        assert robot.nominal_voltage_v == pytest.approx(label.voltage_v)
        assert ("chemistry" in battery) == (curve == "chemistry")
        assert ("cells_in_series" in battery) == (curve == "chemistry" and chemistry != "flat")
        assert ("open_circuit_v" in battery) == (curve == "measured")
    for chemistry in CHEMISTRIES:
        assert refusal(curve, chemistry, SIZES) is None
    assert accepted_curve(CHEMISTRIES, SIZES) == "chemistry"


def test_of_homeward_it_imports_the_public_companion_only() -> None:
    imported = set()
    for path in Path(gauges.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                imported |= {f"{node.module}.{alias.name}" for alias in node.names}
            elif isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
    of_homeward = {name for name in imported if name.split(".")[0] == "homeward"}
    of_companion = {f"homeward.companion.{name}" for name in companion.__all__}
    assert "homeward.companion.Companion" in of_homeward
    assert of_homeward <= of_companion


def test_a_chemistry_that_is_not_known_is_refused() -> None:
    place = SIZES.robots["husky"]
    known = replace(place, cells={**place.cells, "moon": 7})
    sizes = replace(
        SIZES, robots={"husky": known}, cells={**SIZES.cells, "moon": SIZES.cells["nmc"]}
    )
    assert "moon" in (refusal("chemistry", "moon", sizes) or "")
    assert accepted_curve(["nmc", "moon"], sizes) == "none"


@pytest.mark.parametrize("chemistry", CHEMISTRIES)
def test_a_measured_curve_rises_near_the_true_one(chemistry: str) -> None:
    pack, _label = pack_of(chemistry, SIZES)
    measured = measured_curve(pack, SIZES, rng(5))
    true_v = [
        pack.cells * open_circuit_v(pack.curve, pack.curve_v, share) for share in measured[:, 0]
    ]
    assert measured.shape == (SIZES.curve.measured_points, 2)
    assert (np.diff(measured, axis=0) > 0.0).all()
    assert np.abs(measured[:, 1] - true_v).max() < 4.0 * SIZES.curve.measured_sd_v * pack.cells


def made_up(number: int, covered: bool, stranded: bool, turned_at_once: bool = False) -> Drive:
    """A drive whose energy left is 100 J and whose companion says 100 or 150 J, give or take 20
    J."""
    case = Case(number, 1, "husky", "nmc", "counter", True, 1.0, "none")
    said_j = 100.0 if covered else 150.0
    said = Estimate(said_j, said_j - 20.0, said_j + 20.0)
    point = Point(0.6, 1.0, 100.0, 100.0, left=said, home=said, mirror_left=None, mirror_home=None)
    outcome = Outcome(stranded, math.nan if stranded else 0.1 * (number + 1), 0.5)
    return Drive(
        case=case,
        conditions=Conditions("voltage and current", 0.0, 0.0, 0.0),
        label=Label(7, 25.2, 1000.0),
        fault="",
        cutoff_known=False,
        temperature_c=20.0,
        charge_share=1.0,
        update_s=5.0,
        empty_s=100.0,
        outcomes={"companion": outcome},
        points=[] if turned_at_once else [point],
    )


def cells_of(table: RichTable) -> list[list[str]]:
    """Texts of a table, a list a row."""
    columns = [[str(cell) for cell in column.cells] for column in table.columns]
    return [list(row) for row in zip(*columns, strict=True)]


DRIVES = [
    made_up(0, covered=True, stranded=False),
    made_up(1, covered=False, stranded=False),
    made_up(2, covered=True, stranded=False, turned_at_once=True),
    made_up(3, covered=True, stranded=True),
]


def test_stranded_and_left_count_drives_and_leave_out_agents_without_a_gauge() -> None:
    rows = cells_of(report.stranded_table(DRIVES, SIZES, "made up"))
    assert rows[0] == [
        "all",
        "",
        "25% (5% to 70%) n=4",
        "-",
        "-",
        "-",
    ]  # Wilson's interval of 1 in 4
    assert ["gauge", "counter", "25% (5% to 70%) n=4", "-", "-", "-"] in rows
    assert not any("lfp" in row for row in rows)
    left = cells_of(report.left_table(DRIVES, SIZES, "made up"))
    assert left[0][2].startswith("20.0% (") and left[0][2].endswith("n=3")


def test_coverage_and_error_count_the_points_that_there_are() -> None:
    rows = cells_of(report.coverage_table(DRIVES, SIZES, "made up"))
    assert rows[0] == ["left", "all", "", "-", "-", "67% (21% to 94%) n=3", "-", "-"]  # 2 in 3
    assert {row[0] for row in rows} == set(report.ALONG_WAY)
    errors = cells_of(report.error_table(DRIVES, SIZES, "made up"))
    # 50 J of 1000 J in one of three
    assert errors[0][5].startswith("+2% (") and errors[0][5].endswith("n=3")


def test_as_metered_scales_the_truth_by_the_meter() -> None:
    point = replace(DRIVES[1].points[0], metered=1.5)
    metered = [replace(DRIVES[1], points=[point])]
    rows = cells_of(report.coverage_table(metered, SIZES, "made up"))
    by_energy = {row[0]: row[5] for row in rows if row[1] in ("all", "recorded")}
    assert by_energy["left"].startswith("0%")
    assert by_energy[f"left{report.AS_METERED}"].startswith("100%")


def test_trouble_is_named_and_none_is_silent() -> None:
    assert report.trouble_lines(DRIVES) == []
    crashed = replace(DRIVES[0], crash="ValueError: no", faults={"not a number": 3}, most_left=1.25)
    lines = report.trouble_lines([crashed])
    assert lines[0] == "drive 0 (husky, nmc, counter) crashed: ValueError: no"
    assert lines[1].endswith("not a number, 3 times")
    assert "1 drives, to at most 125%" in lines[2]


def test_figures_of_small_samples() -> None:
    assert rate_of([]) == mean_of([], ".0%") == mean_of([math.nan], ".0%") == "-"
    assert mean_of([0.5, math.nan], ".0%") == "50% n=1"
    assert covers(Estimate(5.0, 4.0, 6.0), 6.0) and not covers(Estimate(5.0, 4.0, 6.0), 6.1)
    console = Console(file=io.StringIO(), width=200)
    console.print(report.paired_table(DRIVES, "made up"))
    assert "good instruments" in console.file.getvalue()  # type: ignore[attr-defined]
