"""Power that a meter at the battery's terminals measures: all but what is lost inside the
battery."""

from __future__ import annotations

import dataclasses
from typing import Any

from homeward.physics.effects import EFFECTS, Effect
from homeward.physics.robot import Robot


def lost_inside(effect: Effect | Any) -> bool:
    """Whether an effect takes energy inside the battery, and not from what moves."""
    return bool(effect.kind == "battery" and "speed_mps" not in effect.needs)


def at_terminals(robot: Robot) -> Robot:
    """The robot with a battery that loses nothing inside, as voltage times current show it.

    >>> import dataclasses, homeward
    >>> sags = dataclasses.replace(homeward.load_robot("husky"), effects={"internal_resistance": {"ohm": 0.1}})
    >>> at_terminals(sags).active_effects
    ()
    """
    inside = {effect.id for effect in EFFECTS if lost_inside(effect)}
    if not inside & set(robot.effects):
        return robot
    outside = {name: parameters for name, parameters in robot.effects.items() if name not in inside}
    return dataclasses.replace(robot, effects=outside)
