"""A mission in a few lines of text, for terminals."""

from __future__ import annotations

from homeward import quantities
from homeward.envs.missions import MISSIONS
from homeward.envs.viewer.scene import Scene

_WIDTH = 60  # characters of a bar; chosen: a line with its note stays within a terminal


def describe(scene: Scene) -> str:
    """Three lines: where it is, the route with its point of no return (!), and the battery with the
    way home (=).

    Args:
        scene: The scene to show.
    """
    return "\n".join((_where(scene), _route(scene), _battery(scene)))


def _where(scene: Scene) -> str:
    doing = ""
    if not scene.over:
        doing = f"{scene.speed_mps:.2g} m/s, sensing {scene.sensing_hz:.0f} Hz, "
    memory = ""
    if MISSIONS[scene.mission].senses:
        memory = f"memory {scene.memory:.0%} full, "
    return (
        f"{scene.state}: {quantities.distance(scene.position_m)} from home after {quantities.duration(scene.time_s)}, "
        f"{doing}{memory}score {quantities.count(scene.score)}"
    )


def _route(scene: Scene) -> str:
    driven = [_metres(scene, column) < scene.furthest_m for column in range(_WIDTH)]
    line = ["#" if is_driven else "." for is_driven in driven]
    note = ""
    if scene.runs_out_m is not None:
        line[_column(scene, scene.runs_out_m)] = "!"
        note = f"; ! battery empty {quantities.distance(scene.runs_out_m)}"
    elif scene.no_return_m is not None:
        line[_column(scene, scene.no_return_m)] = "!"
        note = f"; ! point of no return {quantities.distance(scene.no_return_m)}"
    line[_column(scene, scene.position_m)] = _robot_mark(scene)
    laps = ""
    if scene.laps_left is not None:
        laps = f"; {scene.laps_left:.1f} laps to spare"
    return f"home    |{''.join(line)}| {quantities.distance(scene.length_m)}{note}{laps}"


def _robot_mark(scene: Scene) -> str:
    """The robot: its direction, or that it is stranded."""
    if scene.state == "stranded":
        return "X"
    if scene.direction > 0:
        return ">"
    return "<"


def _battery(scene: Scene) -> str:
    left_share = scene.left_j / scene.full_j
    home_share = scene.home_j / scene.full_j
    marks = [
        _battery_mark((column + 0.5) / _WIDTH, left_share, home_share) for column in range(_WIDTH)
    ]
    return (
        f"battery |{''.join(marks)}| {left_share:.0%} left, gauge {scene.gauge_j / scene.full_j:.0%}, "
        f"way home {home_share:.0%} by its own model"
    )


def _battery_mark(share: float, left_share: float, home_share: float) -> str:
    """One column of the battery: = energy for the way home, # more than that, ! what the way home
    lacks."""
    if share < min(home_share, left_share):
        return "="
    if share < left_share:
        return "#"
    if share < home_share:
        return "!"
    return "."


def _metres(scene: Scene, column: int) -> float:
    return (column + 0.5) / _WIDTH * scene.length_m


def _column(scene: Scene, metres: float) -> int:
    return min(max(int(metres / scene.length_m * _WIDTH), 0), _WIDTH - 1)
