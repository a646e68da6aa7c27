"""The untuned model compared with the paper's measurements: mission times of Table II.

`python benchmarks/paper_tables.py` prints the table. Source: Tiwari, Xiao, Chong, IROS 2018, arXiv
1811.03159; docs/model.md lists the contradictions of its tables.
"""

import dataclasses
import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.tables import table
from homeward.physics import Robot, d_max, load_robot, mission_energy

SPEED_MPS = 1.0
"""Speed of all missions here: the paper's Table III is for about 1 m/s; it gives no speed for Table
II."""

INCLINE_RAD = math.radians(5.71)
"""Grade of the paper's incline (Trajectory)."""


class FieldTest(NamedTuple):
    """One field test of Table II."""

    course: str
    duty: float
    measured_h: float
    grade_rad: float


MISSIONS = (
    FieldTest("box", 0.997, 1.368, 0.0),
    FieldTest("box", 0.367, 2.143, 0.0),
    FieldTest("box", 0.286, 2.87, 0.0),
    FieldTest("incline", 0.999, 1.768, INCLINE_RAD),
    FieldTest("incline", 0.462, 2.296, INCLINE_RAD),
    FieldTest("incline", 0.133, 4.70, INCLINE_RAD),
)
"""Table II."""


def mission_hours(robot: Robot, mission: FieldTest) -> float:
    """Duration of a mission of Table II by the model, h, at `SPEED_MPS` on a full battery, with
    sensing at rest.

    The robot shuttles on the incline, so that its power is the mean of uphill and downhill; a
    negative force consumes nothing.
    """
    if mission.grade_rad == 0.0:
        distance_m = d_max(robot, SPEED_MPS, duty=mission.duty)
    else:
        up_and_down = np.array([mission.grade_rad, -mission.grade_rad])
        per_metre_j = mission_energy(robot, 1.0, SPEED_MPS, up_and_down, mission.duty).mean()
        distance_m = robot.usable_energy_j / per_metre_j
    return float(distance_m / (SPEED_MPS * mission.duty) / 3600.0)


def robots() -> dict[str, Robot]:
    """The preset Rusti, with and without drag, and with and without the battery's 0.12 kg in
    m_R."""
    rusti = load_robot("rusti")
    no_drag = dataclasses.replace(rusti, drag_ns2_per_m2=0.0)
    return {
        f"{rusti.mass_kg:.2f} kg\nc = {rusti.drag_ns2_per_m2:g}\n(preset)": rusti,
        f"{rusti.mass_kg:.2f} kg\nc = 0": no_drag,
        f"0.90 kg\nc = {rusti.drag_ns2_per_m2:g}": dataclasses.replace(rusti, mass_kg=0.90),
        "0.90 kg\nc = 0": dataclasses.replace(no_drag, mass_kg=0.90),
    }


def main() -> None:
    """Print the measured and the modelled times."""
    title = (
        f"Table II: the model's hours (and model / measured) at {SPEED_MPS:g} m/s, nothing tuned"
    )
    shown = table(title, ("course",), ("duty", "measured h", *robots()))
    for mission in MISSIONS:
        hours = (mission_hours(robot, mission) for robot in robots().values())
        beside = (f"{model_h:.2f} ({model_h / mission.measured_h:.2f})" for model_h in hours)
        shown.add_row(mission.course, f"{mission.duty:.1%}", f"{mission.measured_h:.3f}", *beside)
    Console().print(shown)


if __name__ == "__main__":
    main()
