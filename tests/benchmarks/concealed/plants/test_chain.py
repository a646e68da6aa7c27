"""The chain from a drive to its power: stages in order, and what leaves the battery."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.concealed.plants.chain import (
    Mechanism,
    Stage,
    Work,
    charge_left,
    resistance_law,
    rollout,
)
from benchmarks.concealed.plants.motion import make_drives, make_route
from benchmarks.concealed.plants.vehicles import GRAVITY_MPS2, SCOUT, VEHICLES
from tests.benchmarks.concealed.plants.steady import DT_S, ROBOT, motion, plain

STAGES: tuple[Stage, ...] = ("ground", "wheel", "motor", "load", "battery", "instrument")


def test_the_force_is_equation_3() -> None:
    work = Work(motion(1.2, grade_rad=0.1), SCOUT, "gauge")
    weight_n = 68.0 * GRAVITY_MPS2
    expected_n = weight_n * (0.06 * np.cos(0.1) + np.sin(0.1)) + 0.15 * 1.2**2
    assert resistance_law(work) == pytest.approx(np.full(600, expected_n), rel=1e-12)


def test_a_vehicle_that_stands_is_pulled_by_nothing() -> None:
    assert not resistance_law(Work(motion(0.0, grade_rad=0.1), SCOUT, "gauge")).any()


def test_air_from_behind_pushes() -> None:
    work = Work(motion(), SCOUT, "gauge")
    still_n = resistance_law(work)
    work.air_mps = -work.air_mps
    assert still_n - resistance_law(work) == pytest.approx(np.full(600, 2.0 * 0.15), rel=1e-9)


def test_a_descent_gives_nothing_back() -> None:
    work = plain(motion(grade_rad=-0.12))
    assert (work.force_n < 0.0).all() and not work.drive_w.any()


def test_ancillary_power_is_idle_power_and_a_sample_each() -> None:
    work = plain(motion(0.0, sensing_hz=10.0))
    assert work.seen_w == pytest.approx(np.full(600, 8.0 + 4.0 + 28.0 + 0.5 * 10.0))


def test_a_drive_begins_at_95_percent_and_loses_what_the_cells_lose() -> None:
    work = plain(motion())
    used_j = np.cumsum(work.chemical_w) * DT_S
    np.testing.assert_allclose((0.95 - work.soc) * ROBOT.rated_energy_j, used_j)
    work.capacity_share = 0.5
    np.testing.assert_allclose(0.95 - charge_left(work), 2.0 * (0.95 - work.soc))


def test_a_gauge_sees_losses_in_the_cells_and_a_meter_at_the_terminals_does_not() -> None:
    def leak(work: Work, _: np.random.Generator) -> None:
        work.chemical_w = work.chemical_w + 10.0

    mechanism = Mechanism("leak", "battery", leak)
    gauge = rollout(SCOUT, motion(), [mechanism], np.random.default_rng(0), "gauge")
    meter = rollout(SCOUT, motion(), [mechanism], np.random.default_rng(0), "terminals")
    np.testing.assert_allclose(gauge.seen_w - meter.seen_w, 10.0)
    np.testing.assert_allclose(meter.seen_w, plain(motion()).seen_w)


def test_braking_that_is_recovered_is_subtracted() -> None:
    def back(work: Work, _: np.random.Generator) -> None:
        work.returned_w += 7.0

    run = motion(grade_rad=-0.12)
    work = rollout(SCOUT, run, [Mechanism("back", "wheel", back)], np.random.default_rng(0))
    np.testing.assert_allclose(plain(run).power_w - work.power_w, 7.0)


def test_stages_come_in_their_order_whatever_that_of_the_mechanisms() -> None:
    order: list[Stage] = []

    def note(stage: Stage) -> Mechanism:
        return Mechanism(stage, stage, lambda work, _: order.append(stage))

    rollout(SCOUT, motion(), [note(stage) for stage in reversed(STAGES)], np.random.default_rng(0))
    assert tuple(order) == STAGES


@pytest.mark.parametrize(("stage", "name"), [("ground", "rolling"), ("motor", "drive_w")])
def test_what_one_stage_changes_the_next_ones_see(stage: Stage, name: str) -> None:
    def double(work: Work, _: np.random.Generator) -> None:
        setattr(work, name, 2.0 * getattr(work, name))

    work, run = (
        rollout(SCOUT, motion(), [Mechanism("x", stage, double)], np.random.default_rng(0)),
        motion(),
    )
    drag_w = 0.15 / ROBOT.traction_efficiency * (name == "rolling")
    np.testing.assert_allclose(work.drive_w, 2.0 * plain(run).drive_w - drag_w)


def test_nothing_hidden_is_the_papers_model() -> None:
    rng = np.random.default_rng(0)
    for vehicle in VEHICLES:
        robot = vehicle.robot
        run = make_drives(vehicle, [make_route(vehicle, rng)], rng, 1, 15.0, short=True)[0]
        weight_n = robot.mass_kg * GRAVITY_MPS2
        force_n = weight_n * (
            robot.rolling_resistance * np.cos(run.grade_rad) + np.sin(run.grade_rad)
        )
        force_n += robot.drag_ns2_per_m2 * run.speed_mps**2
        expected_w = np.maximum(force_n, 0.0) * run.speed_mps / robot.traction_efficiency
        expected_w += robot.sensing_idle_w + robot.communication_w + robot.controller_w
        expected_w += robot.sensing_j_per_sample * run.sensing_hz
        assert np.allclose(rollout(vehicle, run, [], rng).seen_w, expected_w)
