"""A mission in a few lines of text, for terminals."""

from __future__ import annotations

from homeward import quantities
from homeward.envs.missions import MISSIONS
from homeward.envs.viewer.scene import Scene

_WIDTH = 60  # characters of a bar; chosen: a line with its note stays within a terminal


def describe(scene: Scene) -> str:
    """Three lines: where it is, the route with its point of no return (!), and the battery with the way home (=).

    Args:
        scene: The scene to show.
    """
    return "\n".join((_where(scene), _route(scene), _battery(scene)))


def _where(scene: Scene) -> str:
    doing = f"{scene.speed_mps:.2g} m/s, sensing {scene.sensing_hz:.0f} Hz, " if not scene.over else ""
    memory = f"memory {scene.memory:.0%} full, " if MISSIONS[scene.mission].senses else ""
    return (
        f"{scene.state}: {quantities.distance(scene.position_m)} from home after {quantities.duration(scene.time_s)}, "
        f"{doing}{memory}score {quantities.count(scene.score)}"
    )


def _route(scene: Scene) -> str:
    line = ["#" if _metres(scene, column) < scene.furthest_m else "." for column in range(_WIDTH)]
    turn = scene.no_return_m if scene.runs_out_m is None else scene.runs_out_m
    note = ""
    if turn is not None:
        line[_column(scene, turn)] = "!"
        note = "; ! point of no return" if scene.runs_out_m is None else "; ! battery empty"
        note += f" {quantities.distance(turn)}"
    line[_column(scene, scene.position_m)] = "X" if scene.state == "stranded" else ">" if scene.direction > 0 else "<"
    laps = "" if scene.laps_left is None else f"; {scene.laps_left:.1f} laps to spare"
    return f"home    |{''.join(line)}| {quantities.distance(scene.length_m)}{note}{laps}"


def _battery(scene: Scene) -> str:
    left, home = scene.left_j / scene.full_j, scene.home_j / scene.full_j
    marks = [
        "=" if share < min(home, left) else "#" if share < left else "!" if share < home else "."
        for share in ((column + 0.5) / _WIDTH for column in range(_WIDTH))
    ]
    return (
        f"battery |{''.join(marks)}| {left:.0%} left, gauge {scene.gauge_j / scene.full_j:.0%}, "
        f"way home {home:.0%} by its own model"
    )


def _metres(scene: Scene, column: int) -> float:
    return (column + 0.5) / _WIDTH * scene.length_m


def _column(scene: Scene, metres: float) -> int:
    return min(max(int(metres / scene.length_m * _WIDTH), 0), _WIDTH - 1)
