"""Laws of the step that hold for any robot, with any effects, on any drive."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from homeward import Robot
from homeward.physics import CAUSES, EFFECTS, ancillary_power, d_max, mission_energy
from homeward.physics.kernel import BASE_CAUSES, Conditions
from tests.physics.drives import (
    PLAIN,
    STEADY,
    conditions,
    cut_off,
    drive,
    quantities,
    robots,
    with_effect,
)

EPSILON = float(np.finfo(np.float64).eps)
DRIVING = [
    "rolling",
    "drag",
    "grade",
    *(effect.id for effect in EFFECTS if effect.kind in ("force", "drive")),
]
LOSSES = [effect.id for effect in EFFECTS if effect.kind == "drive"]
STEPS_S = quantities(1e-2, 1e3)


def drives(robot: Robot, most: int = 12) -> st.SearchStrategy[list[Conditions]]:
    return st.lists(conditions(robot), min_size=1, max_size=most)


@given(data=st.data(), robot=robots(), dt_s=STEPS_S)
def test_ledger_sums_to_the_change_of_the_battery(
    data: st.DataObject, robot: Robot, dt_s: float
) -> None:
    steps = data.draw(drives(robot))
    start_j = robot.usable_energy_j * data.draw(st.floats(0.01, 1.0))
    end = drive(robot, steps, dt_s, start_j)
    rounding_j = 2.0 * EPSILON * start_j * len(steps)  # of the battery's own sum
    lost_j = start_j - float(end["energy_j"])
    # the way back may return what went out
    turnover_j = abs(lost_j) + abs(float(end["ledger_j"].clip(max=0.0).sum()))
    assert float(end["ledger_j"].sum()) == pytest.approx(
        lost_j, rel=1e-9, abs=rounding_j + 1e-9 * turnover_j
    )


@given(data=st.data(), robot=robots(without=("regeneration",)), dt_s=STEPS_S)
def test_ledger_is_strict_without_energy_that_comes_back(
    data: st.DataObject, robot: Robot, dt_s: float
) -> None:
    x = data.draw(conditions(robot))
    end = drive(robot, [x], dt_s)
    lost_j = robot.usable_energy_j - float(end["energy_j"])
    rounding_j = 2.0 * EPSILON * robot.usable_energy_j
    assert float(end["ledger_j"].sum()) == pytest.approx(lost_j, rel=1e-9, abs=rounding_j)


@given(data=st.data(), robot=robots(), dt_s=STEPS_S)
def test_energy_is_never_negative_nor_above_what_the_battery_holds(
    data: st.DataObject, robot: Robot, dt_s: float
) -> None:
    steps, state = data.draw(drives(robot)), None
    for count in range(1, len(steps) + 1):
        state = drive(robot, steps[:count], dt_s)
        assert 0.0 <= state["energy_j"] <= robot.usable_energy_j
        assert bool(state["depleted"]) == (state["energy_j"] == 0.0)


@given(data=st.data(), robot=robots(), dt_s=quantities(0.1, 100.0), share=st.floats(0.05, 0.95))
def test_depletion_does_not_depend_on_the_step(
    data: st.DataObject, robot: Robot, dt_s: float, share: float
) -> None:
    stretches = data.draw(st.lists(conditions(robot), min_size=1, max_size=4))
    steps = [x for x in stretches for _ in range(40)]
    charge_j = share * float(drive(robot, steps, dt_s, np.inf)["ledger_j"].sum())
    assume(charge_j > 0.0)
    whole = drive(robot, steps, dt_s, charge_j)
    assume(bool(whole["depleted"]))
    half = drive(robot, [x for x in steps for _ in range(2)], 0.5 * dt_s, charge_j)
    assert half["depleted"]
    # The losses of a step are those at the voltage at its start: where a curve falls, the error is
    # of first order.
    rel = 1e-3 if robot.curve.mean_v == 0.0 else 5e-3
    assert float(half["distance_m"]) == pytest.approx(float(whole["distance_m"]), rel=rel)
    assert float(half["time_s"]) == pytest.approx(float(whole["time_s"]), rel=rel)


@given(data=st.data(), robot=robots(with_effects=False), dt_s=STEPS_S, share=st.floats(1e-6, 1.0))
def test_depletion_is_inside_the_step(
    data: st.DataObject, robot: Robot, dt_s: float, share: float
) -> None:
    x = data.draw(conditions(robot))
    power_w = float(drive(robot, [x], dt_s, np.inf)["power_w"])
    end = drive(robot, [x, x], dt_s, share * power_w * dt_s)
    assert end["depleted"] and end["energy_j"] == 0.0
    assert float(end["time_s"]) == pytest.approx(share * dt_s, rel=1e-12)
    assert float(end["distance_m"]) == pytest.approx(share * dt_s * x.speed_mps, rel=1e-12)


def test_a_start_that_the_battery_cannot_pay_for_moves_nothing() -> None:
    robot = with_effect(PLAIN, "breakaway", start_j=50.0)
    power_w = float(drive(PLAIN, [STEADY], 1.0, np.inf)["power_w"])
    for dt_s in (1.0, 100.0):
        stuck = drive(robot, [STEADY], dt_s, 49.0)
        assert stuck["depleted"] and stuck["distance_m"] < 1e-6
        assert float(stuck["ledger_j"].sum()) == pytest.approx(49.0, rel=1e-9)
        moved = drive(robot, [STEADY], dt_s, 50.0 + 0.4 * power_w)
        assert float(moved["time_s"]) == pytest.approx(0.4, rel=1e-9)


def test_an_empty_battery_stays_empty() -> None:
    robot = with_effect(PLAIN, "regeneration", share=0.9)
    downhill = STEADY._replace(sin_grade=-0.8, cos_grade=0.6)
    end = drive(robot, [STEADY], 10.0, 1.0)
    again = drive(robot, [downhill], 10.0, 0.0, depleted=True, distance_m=float(end["distance_m"]))
    assert again["depleted"] and again["energy_j"] == 0.0
    assert again["distance_m"] == end["distance_m"] and again["ledger_j"].sum() == 0.0


@given(data=st.data(), robot=robots(without=("regeneration",)), dt_s=STEPS_S)
def test_nothing_but_regeneration_puts_energy_back(
    data: st.DataObject, robot: Robot, dt_s: float
) -> None:
    x = data.draw(conditions(robot))
    end = drive(robot, [x], dt_s, np.inf)
    assert end["power_w"] >= ancillary_power(robot, x.sensing_hz)


@given(
    data=st.data(),
    robot=robots(without=(*LOSSES, "slip")),
    per_load=st.floats(0.0, 5.0),
    share=st.floats(0.0, 0.95),
)
def test_no_step_takes_less_than_the_work_on_the_outside_world(
    data: st.DataObject, robot: Robot, per_load: float, share: float
) -> None:
    """So that no loop whatever, also one that climbs gently and falls steeply, gains energy."""
    x = data.draw(conditions(robot, standing=False))
    work_w = float(drive(robot, [x], 1.0, np.inf)["traction_n"]) * x.speed_mps
    inside = {"slip": {"per_load": per_load}, "regeneration": {"share": share}}
    robot = dataclasses.replace(robot, effects={**robot.effects, **inside})
    drive_w = float(drive(robot, [x], 1.0, np.inf)["drive_w"])
    assert drive_w >= work_w - 1e-9 * abs(work_w)


@given(data=st.data(), robot=robots(), back_mps=st.floats(0.0, 1.0), regained=st.floats(0.0, 0.95))
def test_a_closed_route_never_gains_energy(
    data: st.DataObject, robot: Robot, back_mps: float, regained: float
) -> None:
    """Out over any profile and back, starting and ending at rest; the air moves one way, so the
    wind turns round."""
    robot = dataclasses.replace(
        robot, effects={**robot.effects, "regeneration": {"share": regained}}
    )
    profile = data.draw(st.lists(conditions(robot, standing=False), min_size=1, max_size=8))
    lengths_m = data.draw(
        st.lists(quantities(0.1, 1000.0), min_size=len(profile), max_size=len(profile))
    )
    home_mps = robot.min_speed_mps + back_mps * (robot.max_speed_mps - robot.min_speed_mps)
    out = [x._replace(direction=1.0) for x in profile]
    home = [
        x._replace(
            speed_mps=home_mps, sin_grade=-x.sin_grade, headwind_mps=-x.headwind_mps, direction=-1.0
        )
        for x in reversed(profile)
    ]
    way = [*zip(out, lengths_m, strict=True), *zip(home, reversed(lengths_m), strict=True)]
    dt_s = [length_m / x.speed_mps for x, length_m in way]
    before = [0.0, *(x.speed_mps for x, _ in way)]
    steps = [
        x._replace(accel_mps2=(x.speed_mps - speed) / duration)
        for (x, _), speed, duration in zip(way, before, dt_s, strict=False)
    ]
    end = drive(robot, steps, dt_s, np.inf)
    ledger_j = end["ledger_j"]
    rounding_j = 1e-9 * np.abs(ledger_j).sum()
    assert ledger_j.sum() >= -rounding_j
    assert ledger_j[[CAUSES.index(cause) for cause in DRIVING]].sum() >= -rounding_j


@given(
    data=st.data(), robot=robots(with_effects=False), speed=st.floats(0.0, 1.0), grade=st.floats(-1.2, 1.2),
    steps=st.integers(1, 50),
)  # fmt: skip
def test_kernel_range_is_eq_8(
    data: st.DataObject, robot: Robot, speed: float, grade: float, steps: int
) -> None:
    speed_mps = robot.min_speed_mps + speed * (robot.max_speed_mps - robot.min_speed_mps)
    sensing_hz = data.draw(st.floats(0.0, robot.max_sensing_hz))
    reach_m = float(d_max(robot, speed_mps, grade, sensing_hz=sensing_hz))
    x = STEADY._replace(
        speed_mps=speed_mps,
        sensing_hz=sensing_hz,
        sin_grade=float(np.sin(grade)),
        cos_grade=float(np.cos(grade)),
    )
    end = drive(robot, [x] * (steps + 1), reach_m / speed_mps / (steps + 0.5))
    assert end["depleted"]
    assert float(end["distance_m"]) == pytest.approx(reach_m, rel=1e-9)


@given(robot=robots(with_effects=False), duty=st.floats(0.01, 1.0), cycles=st.integers(1, 20))
def test_driving_and_standing_in_turn_is_eq_7(robot: Robot, duty: float, cycles: int) -> None:
    x = STEADY._replace(speed_mps=robot.max_speed_mps, sensing_hz=0.0)
    dt_s = [duty, 1.0 - duty] if duty < 1.0 else [1.0]
    pair = [x, x._replace(speed_mps=0.0)][: len(dt_s)]
    end = drive(robot, pair * cycles, dt_s * cycles, np.inf)
    spent_j = mission_energy(robot, float(end["distance_m"]), robot.max_speed_mps, duty=duty)
    assert float(end["ledger_j"].sum()) == pytest.approx(float(spent_j), rel=1e-9)


def test_a_full_battery_leaves_the_rest_to_the_brakes() -> None:
    robot = with_effect(PLAIN, "regeneration", share=0.9)
    downhill = STEADY._replace(sin_grade=-0.8, cos_grade=0.6, sensing_hz=0.0)
    end = drive(robot, [downhill] * 3, 10.0)
    ledger_j = dict(zip(CAUSES, end["ledger_j"], strict=True))
    assert end["energy_j"] == PLAIN.usable_energy_j
    assert ledger_j["regeneration"] < -1000.0
    assert float(end["ledger_j"].sum()) == pytest.approx(0.0, abs=1e-9 * ledger_j["braking"])


def test_ledger_by_hand() -> None:
    downhill = STEADY._replace(sin_grade=-0.05, cos_grade=0.9987492177719089)
    end = drive(PLAIN, [downhill], 10.0)
    per_n = 2.0 * 10.0 / 0.5  # J of the battery per newton
    assert dict(zip(CAUSES, end["ledger_j"].tolist(), strict=True)) == pytest.approx(
        dict.fromkeys(CAUSES, 0.0)
        | {
            "sensing": (0.5 + 0.01 * 50.0) * 10.0,
            "communication": 2.5,
            "controller": 7.5,
            "computer": (2.0 + 0.02 * 50.0) * 10.0,
            "rolling": 0.1 * 10.0 * 9.80665 * 0.9987492177719089 * per_n,
            "drag": 0.5 * 4.0 * per_n,
            "grade": -10.0 * 9.80665 * 0.05 * per_n,
        },
        rel=1e-12,
    )


def test_no_force_is_charged_where_the_slope_drives() -> None:
    end = drive(PLAIN, [STEADY._replace(sin_grade=-0.6, cos_grade=0.8)], 10.0)
    ledger_j = dict(zip(CAUSES, end["ledger_j"].tolist(), strict=True))
    assert end["traction_n"] < 0.0
    assert (
        ledger_j["rolling"] == ledger_j["drag"] == ledger_j["grade"] == ledger_j["braking"] == 0.0
    )


def test_forces_come_first_so_that_their_columns_can_be_left_out() -> None:
    kinds = [effect.kind for effect in EFFECTS]
    assert (
        len(list(itertools.groupby(kind == "force" for kind in kinds))) == 2 and kinds[0] == "force"
    )
    assert (*BASE_CAUSES, *(effect.id for effect in EFFECTS)) == CAUSES


def test_an_intermittent_load_is_exact_across_steps() -> None:
    robot = with_effect(PLAIN, "intermittent_load", power_w=6.0, period_s=7.0, duty=0.3)
    column = CAUSES.index("intermittent_load")
    for dt_s in (0.1, 1.0, 20.0):
        end = drive(robot, [STEADY] * round(100.0 / dt_s), dt_s, np.inf)
        # 14 periods and 2 s
        assert float(end["ledger_j"][column]) == pytest.approx(6.0 * (14 * 2.1 + 2.0), rel=1e-6)


def test_the_power_of_a_step_is_its_mean() -> None:
    robot = dataclasses.replace(
        PLAIN,
        effects={
            "intermittent_load": {"power_w": 6.0, "period_s": 7.0, "duty": 0.3},
            "motor_heating": {"per_k": 0.004, "rise_k_per_w": 0.5, "time_constant_s": 30.0},
            "internal_resistance": {"ohm": 0.1},
        },
    )
    end = drive(robot, [STEADY], 50.0, np.inf)
    assert float(end["power_w"]) * 50.0 == pytest.approx(float(end["ledger_j"].sum()), rel=1e-12)


STANDING = STEADY._replace(speed_mps=0.0, sensing_hz=0.0)
BELOW = CAUSES.index("below_cutoff")
LOST_INSIDE = CAUSES.index("internal_resistance")


@pytest.mark.parametrize(
    ("load_w", "ohm", "cutoff_v", "rest_v"),
    [
        # At 9 V a load of 9 W draws 1 A, which takes 0.5 V of 0.5 Ohm; one of 36 W draws 4 A.
        (9.0, 0.5, 9.0, 9.5),
        (36.0, 0.5, 9.0, 11.0),
        (9.0, 0.0, 9.0, 9.0),
        # One of 54 W draws 6 A, which takes 6 V of 1 Ohm: even a full battery is cut off at once.
        (54.0, 1.0, 9.0, 12.0),
        # Below 11 V at rest no voltage carries 30.25 W through 1 Ohm; at 11 V, 5.5 V do.
        (30.25, 1.0, 5.0, 11.0),
    ],
)
def test_what_stays_below_the_cut_off_by_hand(
    load_w: float, ohm: float, cutoff_v: float, rest_v: float
) -> None:
    end = drive(cut_off(load_w, ohm, cutoff_v), [STANDING] * 5000, 10.0)
    kept_j = 1e5 * (rest_v**2 - 64.0) / 80.0
    assert end["depleted"] and end["energy_j"] == 0.0
    assert float(end["ledger_j"][BELOW]) == pytest.approx(kept_j, rel=1e-6)
    assert float(end["ledger_j"].sum()) == pytest.approx(1e5, rel=1e-9)
    drawn_j = float(end["ledger_j"].sum() - end["ledger_j"][[BELOW, LOST_INSIDE]].sum())
    assert drawn_j == pytest.approx(load_w * float(end["time_s"]), rel=1e-9)


def test_a_heavy_load_ends_a_battery_that_still_carries_a_light_one() -> None:
    # 11 V at rest: 71,250 J are left, of which 9 W get 38,437 J and 36 W none.
    at_j = 1e5 * (11.0**2 - 64.0) / 80.0
    light = drive(cut_off(9.0), [STANDING], 10.0, at_j, capacity_j=1e5)
    heavy = drive(cut_off(36.001), [STANDING], 10.0, at_j, capacity_j=1e5)
    assert not light["depleted"] and light["ledger_j"][BELOW] == 0.0
    assert heavy["depleted"] and heavy["time_s"] == 0.0
    assert float(heavy["ledger_j"][BELOW]) == at_j


@given(dt_s=STEPS_S)
def test_the_cut_off_comes_within_a_step(dt_s: float) -> None:
    # 36 W, and 4 A through 0.5 Ohm: 44 W, of which 20 J for each second of the step are left.
    end = drive(cut_off(36.0), [STANDING], dt_s, 71250.0 + 20.0 * dt_s, capacity_j=1e5)
    assert end["depleted"] and float(end["ledger_j"][BELOW]) == pytest.approx(71250.0, rel=1e-6)
    assert float(end["time_s"]) == pytest.approx(20.0 / 44.0 * dt_s, rel=0.1)


def test_a_charger_ends_no_battery_below_its_cut_off() -> None:
    end = drive(cut_off(9.0), [STANDING], 10.0, 1000.0, capacity_j=1e5, charger_w=20.0)
    assert not end["depleted"] and end["energy_j"] > 1000.0 and end["ledger_j"][BELOW] == 0.0


@given(data=st.data(), robot=robots(), dt_s=STEPS_S)
def test_without_a_falling_voltage_a_cut_off_changes_nothing(
    data: st.DataObject, robot: Robot, dt_s: float
) -> None:
    flat = dataclasses.replace(robot, open_circuit_v=(), cutoff_v=0.0)
    steps = data.draw(drives(flat))
    start_j = flat.usable_energy_j * data.draw(st.floats(0.01, 1.0))
    with_one = dataclasses.replace(flat, cutoff_v=0.9 * flat.nominal_voltage_v)
    assert drive(with_one, steps, dt_s, start_j) == drive(flat, steps, dt_s, start_j)
