"""Six real vehicles from 1 kg to 3 t: their nominal robot files, and further parameters for the
hidden mechanisms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from homeward.physics import Robot

GRAVITY_MPS2 = 9.80665  # standard gravity, CGPM 1901
KELVIN = 273.15  # 0 °C in kelvin, by definition


@dataclass(frozen=True)
class Plant:
    """A vehicle: its nominal robot, steering, terrain, and parts that the nominal robot lacks."""

    robot: Robot
    steering: Literal["skid", "differential", "ackermann"]
    wheelbase_m: float
    steepest_grade_rad: float  # of its typical ground
    max_accel_mps2: float
    max_turn_radps: float
    leg_m: float  # typical length of one way
    outdoor: bool
    source: str


def rolling_power_w(vehicle: Plant) -> float:
    """Electrical power of rolling resistance at 60 % of top speed, W: the scale of concealed
    physics."""
    robot = vehicle.robot
    force_n = robot.rolling_resistance * robot.mass_kg * GRAVITY_MPS2
    return force_n * 0.6 * robot.max_speed_mps / robot.traction_efficiency


def peak_power_w(vehicle: Plant) -> float:
    """Electrical power at top speed up the steepest slope with all loads on, W."""
    robot = vehicle.robot
    steepness = robot.rolling_resistance + vehicle.steepest_grade_rad
    force_n = (
        steepness * robot.mass_kg * GRAVITY_MPS2 + robot.drag_ns2_per_m2 * robot.max_speed_mps**2
    )
    sample_j = robot.sensing_j_per_sample + robot.computer_j_per_sample
    drive_w = force_n * robot.max_speed_mps / robot.traction_efficiency
    return drive_w + idle_power_w(vehicle) + sample_j * robot.max_sensing_hz


def idle_power_w(vehicle: Plant) -> float:
    """Ancillary power without sensing, W."""
    robot = vehicle.robot
    return robot.sensing_idle_w + robot.communication_w + robot.controller_w


def typical_power_w(vehicle: Plant) -> float:
    """Ancillary power at half the sensing rate and rolling power together, W."""
    robot = vehicle.robot
    sample_j = robot.sensing_j_per_sample + robot.computer_j_per_sample
    return rolling_power_w(vehicle) + idle_power_w(vehicle) + 0.5 * sample_j * robot.max_sensing_hz


BURGER = Plant(
    Robot(
        name="burger_plant", mass_kg=1.0, rolling_resistance=0.12, drag_ns2_per_m2=0.02, rated_energy_j=71928.0,
        nominal_voltage_v=11.1, motor_loss=0.05, friction_loss=0.42, min_speed_mps=0.02, max_speed_mps=0.22,
        sensing_idle_w=0.6, sensing_j_per_sample=0.02, max_sensing_hz=5.0, communication_w=0.1, controller_w=0.4,
        track_m=0.16, traction_n_per_a=56.4,
    ),
    "differential", 0.08, 0.08, 0.2, 1.5, 6.0, False,
    "ROBOTIS e-Manual, TurtleBot3 Burger: 1 kg, 11.1 V 1.8 Ah, 0.22 m/s, XL430-W250 servos; microcontroller board only",
)  # fmt: skip

RACER = Plant(
    Robot(
        name="racer_plant", mass_kg=3.5, rolling_resistance=0.05, drag_ns2_per_m2=0.02, rated_energy_j=199800.0,
        nominal_voltage_v=11.1, motor_loss=0.1, friction_loss=0.2, min_speed_mps=0.2, max_speed_mps=5.0,
        sensing_idle_w=1.5, sensing_j_per_sample=0.05, max_sensing_hz=40.0, communication_w=0.5, controller_w=3.0,
        track_m=0.296,
    ),
    "ackermann", 0.325, 0.06, 1.5, 1.5, 80.0, True,
    "f1tenth.org build: Traxxas Slash 4x4 (wheelbase 324 mm, width 296 mm), 3S 5 Ah LiPo 11.1 V, UST-10LX 40 Hz lidar",
)  # fmt: skip

JACKAL = Plant(
    Robot(
        name="jackal_plant", mass_kg=17.0, rolling_resistance=0.08, drag_ns2_per_m2=0.08, rated_energy_j=972000.0,
        nominal_voltage_v=29.4, motor_loss=0.1, friction_loss=0.25, min_speed_mps=0.1, max_speed_mps=2.0,
        sensing_idle_w=5.0, sensing_j_per_sample=0.15, max_sensing_hz=50.0, communication_w=1.5, controller_w=12.0,
        track_m=0.37559, traction_n_per_a=12.0,
    ),
    "skid", 0.262, 0.12, 0.8, 1.5, 50.0, True,
    "Clearpath Jackal data sheet: 17 kg, 270 Wh, 2.0 m/s; jackal_description: track 0.37559 m, wheelbase 0.262 m",
)  # fmt: skip

SCOUT = Plant(
    Robot(
        name="scout_plant", mass_kg=68.0, rolling_resistance=0.06, drag_ns2_per_m2=0.15, rated_energy_j=2592000.0,
        nominal_voltage_v=24.0, motor_loss=0.12, friction_loss=0.2, min_speed_mps=0.1, max_speed_mps=1.5,
        sensing_idle_w=8.0, sensing_j_per_sample=0.5, max_sensing_hz=20.0, communication_w=4.0, controller_w=28.0,
        track_m=0.582, traction_n_per_a=20.0,
    ),
    "skid", 0.498, 0.12, 0.5, 1.0, 60.0, True,
    "AgileX Scout 2.0 user manual: 68 kg, 24 V 30 Ah, 1.5 m/s, 4 x 200 W brushless, track 582 mm, wheelbase 498 mm",
)  # fmt: skip

WARTHOG = Plant(
    Robot(
        name="warthog_plant", mass_kg=280.0, rolling_resistance=0.07, drag_ns2_per_m2=0.6, rated_energy_j=18144000.0,
        nominal_voltage_v=48.0, motor_loss=0.1, friction_loss=0.22, min_speed_mps=0.2, max_speed_mps=5.0,
        sensing_idle_w=20.0, sensing_j_per_sample=3.0, max_sensing_hz=20.0, communication_w=10.0, controller_w=90.0,
        track_m=1.2,
    ),
    "skid", 0.914, 0.12, 0.8, 0.8, 200.0, True,
    "Clearpath Warthog data sheet: 280 kg, 48 V 105 Ah lead acid, 18 km/h, 1.38 m wide, 0.83 m high",
)  # fmt: skip

TRUCK = Plant(
    Robot(
        name="truck_plant", mass_kg=3242.0, rolling_resistance=0.03, drag_ns2_per_m2=0.55, rated_energy_j=486000000.0,
        nominal_voltage_v=400.0, motor_loss=0.08, friction_loss=0.08, min_speed_mps=0.5, max_speed_mps=15.0,
        sensing_idle_w=150.0, sensing_j_per_sample=20.0, max_sensing_hz=20.0, communication_w=30.0, controller_w=500.0,
        track_m=1.73,
    ),
    "ackermann", 3.45, 0.1, 1.2, 0.3, 600.0, True,
    "Rivian R1T owner's guide: 3242 kg curb, 135 kWh, wheelbase 3.45 m, Cd 0.30; dirt track C_rr 0.03 (Wong, Theory of "
    "Ground Vehicles, table 1.2); an automation kit of 20 Hz lidars",
)  # fmt: skip

VEHICLES = (BURGER, RACER, JACKAL, SCOUT, WARTHOG, TRUCK)
