"""All missions by name, and their scores in the form of the kernels."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from homeward.envs import MISSION_FILES
from homeward.envs.mission_base import Mission
from homeward.physics.jit import inline

MISSIONS: dict[str, Mission] = {
    name: import_module(f"homeward.envs.{module}").MISSION for name, module in MISSION_FILES.items()
}
"""Every mission by its name."""

CODES = {name: code for code, name in enumerate(MISSIONS)}
"""Number of each mission in the shared record."""


def by_mission(function: str, arguments: str) -> Callable[..., Any]:
    """One function that calls that of the mission whose number stands in the shared record.

    It is written out as text, as the sums of the effects (`homeward.physics.kernel`), because numba
    compiles branches over functions, and no table of them.

    Args:
        function: Name of the field of `Mission`.
        arguments: Names of its arguments, of which one is `shared`.
    """
    names: dict[str, Any] = {"__name__": __name__}
    *other_missions, last_mission = MISSIONS.values()
    lines = [f"def chosen({arguments}):"]
    for mission in other_missions:
        lines += [
            f"    if shared.mission == {CODES[mission.name]}:",
            f"        return {mission.name}({arguments})",
        ]
    lines.append(f"    return {last_mission.name}({arguments})")
    names |= {mission.name: getattr(mission, function) for mission in MISSIONS.values()}
    exec("\n".join(lines), names)
    chosen_by_number: Callable[..., Any] = inline(names["chosen"])
    return chosen_by_number
