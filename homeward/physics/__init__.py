"""The battery-dissemination model, its effects, and the step that environments and diagnosis
share."""

from homeward.physics.effects import EFFECTS
from homeward.physics.kernel import CAUSES
from homeward.physics.log_replay import Replay, replay
from homeward.physics.model import ancillary_power, ideal_range, traction_force, usable_energy
from homeward.physics.range import (
    Leg,
    below_cutoff,
    d_max,
    leg,
    manoeuvring_energy,
    mission_energy,
    optimal_speed,
)
from homeward.physics.robot import Robot, RobotError, load_robot, preset_names

__all__ = [
    "CAUSES",
    "EFFECTS",
    "Leg",
    "Replay",
    "Robot",
    "RobotError",
    "ancillary_power",
    "below_cutoff",
    "d_max",
    "effects",
    "ideal_range",
    "leg",
    "load_robot",
    "manoeuvring_energy",
    "mission_energy",
    "optimal_speed",
    "preset_names",
    "replay",
    "traction_force",
    "usable_energy",
]
