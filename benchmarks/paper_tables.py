"""The model beside the paper's measurements, untuned: mission hours (Table II), composition (Table III), drive power.

`python benchmarks/paper_tables.py` prints the tables. Source: Tiwari, Xiao, Chong, IROS 2018, arXiv 1811.03159.
"""

import dataclasses
import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own

from benchmarks.tables import table
from homeward.physics import Robot, ancillary_power, d_max, load_robot, mission_energy, usable_energy
from homeward.physics.model import composition

SPEED_MPS = 1.0
"""Speed of all missions here: the paper's Table III is for about 1 m/s; it gives no speed for Table II."""

INCLINE_RAD = math.radians(5.71)
"""Grade of the paper's incline (Trajectory)."""

COMPUTER_W = (8.0, 15.0)
"""Least and most power of the embedded computer that the paper names as its next step."""


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

WHEELS_UP_H = 1.379
"""Hours of the wheels-up test at 99.9 % duty (Table II)."""

COMPONENTS_W = {
    "manoeuvring": (4.8158, 6.8456),
    "sensing": (0.0293, 0.0348),
    "radio": (0.165, 0.166),
    "micro-controller": (0.3928, 0.3928),
}
"""Least and most power of each component, W (Table III)."""

PRINTED_SHARES_PCT = {
    "manoeuvring": (89.13, 92.02),
    "sensing": (0.46, 0.54),
    "radio": (2.23, 3.05),
    "micro-controller": (5.29, 7.26),
}
"""Composition as Table III prints it, %."""


def mission_hours(robot: Robot, mission: FieldTest) -> float:
    """Hours that the model gives a mission of Table II at `SPEED_MPS` on a full battery, sensing at rest.

    The incline is shuttled, so that its power is the mean of uphill and downhill; a negative force draws nothing.
    """
    if mission.grade_rad == 0.0:
        distance_m = d_max(robot, SPEED_MPS, duty=mission.duty)
    else:
        up_and_down = np.array([mission.grade_rad, -mission.grade_rad])
        per_metre_j = mission_energy(robot, 1.0, SPEED_MPS, up_and_down, mission.duty).mean()
        distance_m = robot.usable_energy_j / per_metre_j
    return float(distance_m / (SPEED_MPS * mission.duty) / 3600.0)


def drive_power(robot: Robot, grade_rad: float = 0.0) -> float:
    """Power into the drive at `SPEED_MPS`, W."""
    return float(mission_energy(robot, SPEED_MPS, SPEED_MPS, grade_rad) - ancillary_power(robot, 0.0))


def robots() -> dict[str, Robot]:
    """Rusti as the preset has it, without drag, and with the battery's 0.12 kg not included in m_R."""
    rusti = load_robot("rusti")
    no_drag = dataclasses.replace(rusti, drag_ns2_per_m2=0.0)
    return {
        f"{rusti.mass_kg:.2f} kg, c = {rusti.drag_ns2_per_m2:g} (preset)": rusti,
        f"{rusti.mass_kg:.2f} kg, c = 0": no_drag,
        f"0.90 kg, c = {rusti.drag_ns2_per_m2:g}": dataclasses.replace(rusti, mass_kg=0.90),
        "0.90 kg, c = 0": dataclasses.replace(no_drag, mass_kg=0.90),
    }


def hours_table() -> Table:
    """Table II: measured hours beside the model's."""
    title = f"Table II: the model's hours (and model / measured) at {SPEED_MPS:g} m/s, nothing tuned"
    names = (name.replace(", ", "\n").replace(" (", "\n(") for name in robots())
    shown = table(title, ("course",), ("duty", "measured h", *names))
    for mission in MISSIONS:
        hours = (mission_hours(robot, mission) for robot in robots().values())
        beside = (f"{model_h:.2f} ({model_h / mission.measured_h:.2f})" for model_h in hours)
        shown.add_row(mission.course, f"{mission.duty:.1%}", f"{mission.measured_h:.3f}", *beside)
    return shown


def composition_table() -> Table:
    """Table III: shares that follow from its powers, beside those it prints."""
    title = "Table III: share of the total power, least and most"
    shown = table(title, ("component",), ("power, W", "by the rule", "as printed"))
    for name, (least, most) in composition(COMPONENTS_W).items():
        low_w, high_w = COMPONENTS_W[name]
        low_pct, high_pct = PRINTED_SHARES_PCT[name]
        printed = f"{low_pct:.2f}% to {high_pct:.2f}%"
        shown.add_row(name, f"{low_w:g} to {high_w:g}", f"{least:.2%} to {most:.2%}", printed)
    at_most, at_least = (computer_share(bound) for bound in (1, 0))
    shown.add_row("manoeuvring, with computer", "", f"{at_most:.1%} to {at_least:.1%}", "30.5% to 36.5%")
    return shown


def computer_share(bound: int) -> float:
    """Manoeuvring's share with the embedded computer, everything at its least (bound 0) or at its most (bound 1)."""
    total_w = sum(watts[bound] for watts in COMPONENTS_W.values()) + COMPUTER_W[bound]
    return COMPONENTS_W["manoeuvring"][bound] / total_w


def power_table() -> Table:
    """Drive power on the plane: the model beside Table III, and beside what Table II's hours imply."""
    shown = table(f"Drive power on the plane at {SPEED_MPS:g} m/s", ("source",), ("W",))
    for name, robot in robots().items():
        shown.add_row(f"model, {name}", f"{drive_power(robot):.2f}")
    low_w, high_w = COMPONENTS_W["manoeuvring"]
    shown.add_row("measured, Table III", f"{low_w:.2f} to {high_w:.2f}")
    rusti, box = load_robot("rusti"), MISSIONS[0]
    implied_w = (rusti.rated_energy_j / (box.measured_h * 3600.0) - ancillary_power(rusti, 0.0)) / box.duty
    shown.add_row(f"implied by Table II: rated energy / {box.measured_h} h, less P_anc", f"{float(implied_w):.2f}")
    return shown


def efficiency_from_wheels_up(field_w: float) -> float:
    """The formula (P_F - P_IF) / P_F of the paper's text for its eta3, from Table II's box and wheels-up hours.

    Args:
        field_w: P_F, mean power of the field test, W.
    """
    wheels_up_w = field_w * MISSIONS[0].measured_h / WHEELS_UP_H  # the same battery lasted longer
    internal_friction_w = wheels_up_w - float(ancillary_power(load_robot("rusti"), 0.0))
    return (field_w - internal_friction_w) / field_w


def errata() -> list[str]:
    """What to know when reading the tables."""
    rusti = load_robot("rusti")
    text = dataclasses.replace(rusti, friction_loss=0.918)
    by_hours = efficiency_from_wheels_up(rusti.rated_energy_j / (MISSIONS[0].measured_h * 3600.0))
    by_power = efficiency_from_wheels_up(sum(most for _, most in COMPONENTS_W.values()))
    downhill_w = drive_power(rusti, -INCLINE_RAD)
    lost = 1.0 - float(usable_energy(rusti, 10.0, 0.0)) / rusti.rated_energy_j
    return [
        f"eta3: Table I's efficiency of 9.2 % gives Omega = {rusti.overall_efficiency:.4%} (8.615 % printed); the loss "
        f"of 91.8 % in the text would give {text.overall_efficiency:.4%}. The text's own formula is an efficiency, not "
        f"a loss: {by_hours:.1%} from Table II's hours and the rated energy, {by_power:.1%} with Table III's power.",
        "eta4: AE = eta4 E_hat contradicts Eq. 7 and Table I; Eq. 7 is the model.",
        f"k1, k2: no unit is given. As printed, ten cycles would take {lost:.0%} of the battery; the preset says what "
        "one unit is, and is new.",
        "Mass: m_R = 0.78 kg may or may not include the 0.12 kg battery, hence both. The paper gives no drag c.",
        "Table III: its sensing share does not follow from its rule, nor does the 36.5 % with an 8 W computer.",
        f"Incline: tan 5.71 deg is C_rr, so that {downhill_w:.2f} W drive it downhill. A negative force draws nothing.",
        "Speed: it differed with the load in the tests, for the voltage at the motors was constant.",
        "Tables II and III disagree: the rated energy over Table II's hours is more power than Table III has. Either "
        "the battery gave less than its rating, or the drive took more than Table III says.",
    ]


def main() -> None:
    """Print everything."""
    console = Console()
    for shown in (hours_table(), composition_table(), power_table()):
        console.print(shown)
    for note in errata():
        console.print(f"* {note}", highlight=False)


if __name__ == "__main__":
    main()
