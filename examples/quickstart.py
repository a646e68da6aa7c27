"""From nothing to a mission that you can watch, in some seconds: `python examples/quickstart.py`.

It asks the model how far the robot gets, makes an environment, lets the rule `dmax_adaptive` drive
one mission, says what came of it and where the energy went, and writes the mission as
runs/quickstart/mission.gif.
"""

from __future__ import annotations

try:
    import homeward
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[view]' in its checkout, or run .venv/bin/python"
    ) from None

from dataclasses import dataclass
from pathlib import Path

import gymnasium as gym
import numpy as np
import tyro

from homeward import quantities
from homeward.agents import make_policy
from homeward.envs.viewer.clip import write_gif


@dataclass(frozen=True)
class Args:
    """What to show."""

    env: str = "homeward/Survey-v0"
    """Environment id: homeward/OutAndBack-v0, homeward/Survey-v0 or homeward/Patrol-v0."""
    robot: str = "rusti_computer"
    """Preset name or TOML file, see `homeward robots`."""
    agent: str = "dmax_adaptive"
    """random, soc50, dmax, dmax_mapped or dmax_adaptive."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    seed: int = 0
    """Seed of the mission: weather, route and what is hidden."""
    out: Path = Path("runs/quickstart")
    """Folder for mission.gif."""


def main(args: Args) -> Path:
    """Drive one mission and return the path of its clip."""
    # The model: how far on one charge?
    robot = homeward.load_robot(args.robot)
    print(
        f"{robot.name}: {quantities.distance(float(homeward.physics.d_max(robot)))} on one charge, on the flat"
    )

    # The environment, as any of Gymnasium's, and an agent that needs no training.
    env = gym.make(args.env, robot=robot, difficulty=args.difficulty, render_mode="rgb_array")
    policy = make_policy(args.agent, env)

    # One mission. Agents decide for batches: here of one, that has just begun.
    observation, info = env.reset(seed=args.seed)
    frames, begun, over = [env.render()], np.array([True]), False
    while not over:
        action = policy.act(observation[None], begun)[0]
        observation, _, terminated, truncated, info = env.step(action)
        frames.append(env.render())
        begun, over = np.array([False]), terminated or truncated

    # What came of it. Only a robot that gets home scores.
    ending = "home" if info["home"] else "stranded" if info["stranded"] else "out of time"
    score = info["score"] if info["home"] else 0.0
    print(
        f"{args.agent}: {ending} after {len(frames) - 1} decisions, score {quantities.count(score)}"
    )
    used = info["energy_j"]
    for cause, joules in sorted(used.items(), key=lambda entry: -entry[1]):
        if joules > 0.001 * used.total():
            print(f"  {cause:<15}{joules / used.total():6.1%}  {quantities.energy(joules)}")

    # To watch it. `render_mode="human"` shows it in a window instead, as it happens.
    clip = args.out / "mission.gif"
    write_gif(clip, frames, width=720)
    print(f"Written to {clip}")
    return clip


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
