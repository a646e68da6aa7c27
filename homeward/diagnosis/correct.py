"""The corrected robot: fitted groups written back into a robot file, as far as recordings determine them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from homeward.diagnosis.parameters import with_ancillary, with_effects_of
from homeward.diagnosis.refit import Estimate
from homeward.diagnosis.replay import thrust_n_per_a
from homeward.diagnosis.result import Verdict
from homeward.diagnosis.signals import Unit
from homeward.physics import Robot, d_max


def correct(
    robot: Robot,
    estimates: Sequence[Estimate],
    unit: Unit,
    verdict: Verdict,
    effects: Mapping[str, Mapping[str, float]],
) -> Robot:
    """Robot with the fitted value of each identifiable group, and the effects that were named.

    Losses, and what cannot be told apart, stay as assumed.

    A verdict that finds no fault changes nothing: a difference within the noise is no correction. Nor does unknown
    physics: the fitted values then make up for it and are no measurement.
    """
    if verdict not in ("parameters_off", "missing_physics"):
        return robot
    fitted = {one.group.name: one.fitted for one in estimates if one.fitted is not None}
    per = robot.traction_efficiency if unit == "W" else thrust_n_per_a(robot)
    if unit == "W" and fitted.keys() & {"idle_power", "sample_energy"}:
        idle = robot.sensing_idle_w + robot.communication_w + robot.controller_w
        sample = robot.sensing_j_per_sample + robot.computer_j_per_sample
        robot = with_ancillary(robot, fitted.get("idle_power", idle), fitted.get("sample_energy", sample))
    if effects:
        found = {name: {key: float(f"{value:.6g}") for key, value in one.items()} for name, one in effects.items()}
        robot = with_effects_of(robot, found)
    if per == 0.0:
        return robot
    rolling_kg = robot.rolling_resistance * robot.mass_kg
    changes: dict[str, float] = {}
    if "mass" in fitted:
        changes["mass_kg"] = fitted["mass"] * per
    if "rolling" in fitted:
        rolling_kg = fitted["rolling"] * per
    if "drag" in fitted:
        changes["drag_ns2_per_m2"] = fitted["drag"] * per
    if "rolling" in fitted or "mass" in fitted:
        mass_kg = changes.get("mass_kg", robot.mass_kg)
        changes["rolling_resistance"] = float(np.clip(rolling_kg / mass_kg, 1e-9, 1.0))
    rounded: dict[str, Any] = {name: float(f"{value:.6g}") for name, value in changes.items()}
    return dataclasses.replace(robot, **rounded)


def of_capacity(robot: Robot, factor: float) -> Robot:
    """The robot with a battery that holds so many times what its file says."""
    return dataclasses.replace(robot, rated_energy_j=float(f"{robot.rated_energy_j * factor:.6g}"))


def comments(before: Robot, after: Robot, estimates: Sequence[Estimate]) -> dict[str, str]:
    """Comment for each field of the robot file that was changed: what it was, and under which assumption it holds."""
    held = {
        "rolling_resistance": "from C_rr m / Gamma, losses kept as assumed",
        "mass_kg": "from m / Gamma, losses kept as assumed",
        "drag_ns2_per_m2": "from c / Gamma, losses kept as assumed",
        "rated_energy_j": "from the recorded state of charge against the energy drawn",
    }
    if not any(one.group.name == "mass" and one.fitted is not None for one in estimates):
        held["rolling_resistance"] = "from C_rr m / Gamma, mass and losses kept as assumed"
    changed = {}
    for field in dataclasses.fields(Robot):
        old, new = getattr(before, field.name), getattr(after, field.name)
        if isinstance(new, float) and new != old:
            how = held.get(field.name, "from the fitted ancillary power, shared out as before")
            changed[field.name] = f"fitted by diagnose.py ({how}); it was {old:.6g}"
    return changed


def range_change(before: Robot, after: Robot) -> float:
    """Change of d_max at each robot's optimal speed on level ground, m."""
    return float(d_max(after) - d_max(before))
