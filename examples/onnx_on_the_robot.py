"""A trained policy on a robot without torch: `python examples/onnx_on_the_robot.py`, with the extra
`onnx`.

It exports the policy that ships, and lets it drive one mission from the file alone: onnxruntime
runs the network, the beliefs run beside it, and the companion is updated with what the robot reads.
An environment stands in for the robot.
"""

from __future__ import annotations

try:
    from homeward import installed  # noqa: F401 - it says in a line what is not installed
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[onnx]' in its checkout, or run .venv/bin/python"
    ) from None

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from homeward.agents.onboard import load_onboard
from homeward.agents.registry import shipped
from homeward.agents.trained import onnx_export
from homeward.companion import Companion
from homeward.envs.actions import MODES, encode_actions
from homeward.envs.scalar import HomewardEnv


@dataclass(frozen=True)
class Args:
    """What to drive."""

    mission: str = "OutAndBack"
    """OutAndBack, Survey or Patrol."""
    start: str = "dmax"
    """What the training of the policy started from: dmax or scratch."""
    seed: int = 0
    """Seed of the mission."""
    out: Path = Path("runs/onnx")
    """Folder for policy.onnx."""


def reads(env: HomewardEnv) -> dict[str, Any]:
    """What the robot's instruments read now; on a robot, what its drivers say."""
    m = env.batch.records[0]
    here, ahead = m["here"], m["direction"]
    return {
        "time_s": float(m["decisions"] * env.batch.known.shared["decision_s"][0]),
        "position": float(m["position_m"]), "speed_mps": float(m["read_mps"]), "power_w": float(m["read_w"]),
        "soc": float(m["soc"]), "grade_rad": float(ahead * math.asin(here["sine_read"])),
        "heading_rad": math.atan2(ahead * here["north"], ahead * here["east"]),
        "temperature_c": float(m["temperature_c"]), "interest": float(here["interest"]),
    }  # fmt: skip


def main(args: Args) -> bool:
    """Drive one mission and return whether the robot came home."""
    # At the desk: one file with the network, its units, its robot and its setting.
    file = args.out / "policy.onnx"
    onnx_export.main(onnx_export.Args(shipped(args.mission, args.start), file))

    # On the robot: the file, and the companion that asks it once per decision.
    onboard = load_onboard(file)
    companion = Companion(onboard.robot, policy=onboard)

    env = HomewardEnv(mission=args.mission)
    env.reset(seed=args.seed)
    over, decisions, info = False, 0, {}
    while not over:
        advice = companion.update(**reads(env))
        assert advice.action is not None
        if decisions % 20 == 0:
            print(advice)
        speed_mps, sensing_hz, mode = advice.action
        action = encode_actions(env.batch.known, speed_mps, sensing_hz, MODES.index(mode))[0]
        _, _, terminated, truncated, info = env.step(action)
        over, decisions = terminated or truncated, decisions + 1
    print(
        f"{'home' if info['home'] else 'not home'} after {decisions} decisions, score {info['score']:.0f}"
    )
    return bool(info["home"])


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
