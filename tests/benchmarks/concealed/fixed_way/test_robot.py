"""What the robot consumes is what one computes by hand, and its instruments record that."""

import numpy as np
import pytest

from benchmarks.concealed.fixed_way import robot
from benchmarks.concealed.fixed_way.drive import Drive
from benchmarks.concealed.fixed_way.robot import Hidden, energy_j, power_w, record
from homeward.physics import load_robot

SECONDS = 600
SPEED_MPS = 0.8
# by hand: 60 W standing, 0.7 J * 20 Hz, and (0.14 * 50 kg * 9.80665 m/s² + 0.13 * 0.8² N) * 0.8 m/s
# over an efficiency of 0.953 * 0.729
LEVEL_W = 60.0 + 14.0 + (68.64655 + 0.0832) * 0.8 / 0.694737


def steady(grade_rad: float = 0.0, speed_mps: float = SPEED_MPS) -> Drive:
    """A drive at one speed on an even slope, for ten minutes at 10 Hz."""
    time_s = np.linspace(0.0, SECONDS, SECONDS * 10, endpoint=False)
    held = np.ones_like(time_s)
    way_m = speed_mps * time_s
    return Drive(
        0.1, time_s, way_m, way_m, speed_mps * held, held, 0.0 * held, 0.0 * held, grade_rad * held
    )


def test_the_robot_is_the_preset() -> None:
    preset = load_robot("husky")
    assert preset.mass_kg == robot.MASS_KG
    assert preset.rolling_resistance == robot.ROLLING_RESISTANCE
    assert preset.drag_ns2_per_m2 == robot.DRAG_NS2_PER_M2
    assert preset.traction_efficiency == pytest.approx(robot.EFFICIENCY)
    standby_w = preset.sensing_idle_w + preset.communication_w + preset.controller_w
    assert standby_w == robot.STANDBY_W
    assert preset.sensing_j_per_sample + preset.computer_j_per_sample == robot.J_PER_SAMPLE
    assert preset.rated_energy_j == robot.RATED_ENERGY_J


def test_energy_on_level_ground_is_the_one_by_hand() -> None:
    assert energy_j([steady()], [Hidden()]) == pytest.approx(LEVEL_W * SECONDS, rel=1e-6)


def test_a_climb_takes_the_weight_and_a_descent_gives_nothing_back() -> None:
    climbing_w = 50.0 * 9.80665 * np.sin(0.1) * SPEED_MPS / 0.694737
    less_rolling_w = 68.64655 * (1.0 - np.cos(0.1)) * SPEED_MPS / 0.694737
    assert power_w(steady(0.1), Hidden())[0] == pytest.approx(LEVEL_W + climbing_w - less_rolling_w)
    assert power_w(steady(-0.3), Hidden())[0] == 74.0


@pytest.mark.parametrize(
    ("hidden", "more_w"),
    [
        (Hidden(surface_share=0.5), 0.5 * 68.64655 * SPEED_MPS / 0.694737),
        (Hidden(payload_kg=25.0), 0.5 * 68.64655 * SPEED_MPS / 0.694737),
        (Hidden(viscous_ns_per_m=10.0), 10.0 * SPEED_MPS**2 / 0.694737),
        (Hidden(force_n=10.0), 10.0 * SPEED_MPS / 0.694737),
        (Hidden(drive_share=0.5), 0.5 * (LEVEL_W - 74.0)),
        (Hidden(load_w=12.0), 12.0),
    ],
)
def test_a_hidden_part_consumes_what_it_does_by_hand(hidden: Hidden, more_w: float) -> None:
    assert power_w(steady(), hidden)[0] - LEVEL_W == pytest.approx(more_w, rel=1e-4)
    assert len(hidden.parts) == 1
    assert power_w(steady(), hidden.without(hidden.parts))[0] == pytest.approx(LEVEL_W)


def test_what_is_recorded_is_the_true_drive_but_for_noise() -> None:
    frame = record(steady(0.05), Hidden(), 18.0, np.random.default_rng(5))
    recorded_w = frame["voltage_v"] * frame["current_a"]
    assert recorded_w.mean() == pytest.approx(power_w(steady(0.05), Hidden()).mean(), rel=0.002)
    assert frame["speed_mps"].mean() == pytest.approx(SPEED_MPS, rel=0.01)
    assert frame["grade_rad"].mean() == pytest.approx(0.05, abs=0.004)
    assert frame["temperature_c"].mean() == pytest.approx(18.0, abs=0.5)
    assert frame["distance_m"].iloc[-1] == pytest.approx(SPEED_MPS * SECONDS, rel=0.01)
    assert np.all(frame["sensing_hz"] == 20.0)


def test_a_load_lowers_the_voltage_by_the_internal_resistance() -> None:
    frames = []
    for load_w in (0.0, 200.0):
        frames.append(record(steady(), Hidden(load_w=load_w), 18.0, np.random.default_rng(2)))
    fall_v = (frames[0]["voltage_v"] - frames[1]["voltage_v"]).iloc[:100].mean()
    rise_a = (frames[1]["current_a"] - frames[0]["current_a"]).iloc[:100].mean()
    assert fall_v / rise_a == pytest.approx(0.02, rel=0.05)


def test_a_robot_that_stands_records_no_speed() -> None:
    frame = record(steady(speed_mps=0.0), Hidden(), 18.0, np.random.default_rng(3))
    assert np.all(frame["speed_mps"] == 0.0)
