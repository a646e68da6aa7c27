"""The corrected robot: fitted groups written back into a robot file, as far as recordings determine them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from homeward.diagnosis.fitted import Fitted
from homeward.diagnosis.parameters import with_ancillary, with_effects_of
from homeward.diagnosis.refit import Estimate
from homeward.diagnosis.replay import thrust_n_per_a
from homeward.diagnosis.signals import Unit
from homeward.physics import Robot, d_max


def written(robot: Robot, model: Fitted, unit: Unit, effects: Mapping[str, Mapping[str, float]]) -> Robot:
    """Robot as its file has it after a fit: the fitted groups, with losses as assumed, and the effects.

    Args:
        robot: Robot as its file has it now.
        model: The fit; groups that it holds stay as they are.
        unit: Of what was recorded: motor current tells nothing of ancillary power.
        effects: Parameters of each effect.
    """
    idle_w, sample_j, rolling_kg, drag, mass_kg = model.theta.tolist()
    if effects:
        robot = with_effects_of(
            robot, {name: {key: _round(value) for key, value in one.items()} for name, one in effects.items()}
        )
    if unit == "W":
        robot = with_ancillary(robot, idle_w, sample_j)
    elif thrust_n_per_a(robot) == 0.0:
        return robot
    fitted = {
        "mass_kg": mass_kg,
        "drag_ns2_per_m2": drag,
        "rolling_resistance": float(np.clip(rolling_kg / mass_kg, 1e-9, 1.0)),
    }
    changed: dict[str, Any] = {name: _unless_equal(getattr(robot, name), value) for name, value in fitted.items()}
    return dataclasses.replace(robot, **changed)


def _unless_equal(before: float, after: float) -> float:
    return before if abs(after - before) <= _ROUNDING * abs(before) else _round(after)


def _round(value: float) -> float:
    return float(f"{value:.6g}")


_ROUNDING = 1e-9  # of a number: what arithmetic with a group that is held may leave


def of_capacity(robot: Robot, factor: float) -> Robot:
    """The robot with a battery that holds so many times what its file says."""
    return dataclasses.replace(robot, rated_energy_j=_round(robot.rated_energy_j * factor))


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
