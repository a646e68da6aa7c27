"""The clip and the stills of the viewer in docs/: `python docs/make_clip.py`.

Real missions, as the agents drive them: a survey by `dmax_adaptive` as a clip and a still, and as
stills one of `soc50` that strands out and back and a patrol.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray
from PIL import Image

import homeward  # noqa: F401 (registers the environments)
from homeward.agents import make_policy
from homeward.envs import IDS
from homeward.envs.viewer.clip import write_gif

Frame = NDArray[np.uint8]

STILLS = {
    "viewer_survey": ("Survey", "uncertain", "dmax_adaptive", 3, 0.30),
    "viewer_stranded": ("OutAndBack", "harsh", "soc50", 5, 1.0),
    "viewer_patrol": ("Patrol", "known", "dmax_adaptive", 5, 0.5),
}
"""File, mission, difficulty, agent, seed, and when in the mission the picture is taken: a share of
its decisions."""


def mission_frames(mission: str, difficulty: str, agent: str, seed: int) -> list[Frame]:
    """Pictures of a whole mission, one a decision."""
    env = gym.make(IDS[mission], difficulty=difficulty, render_mode="rgb_array")
    policy = make_policy(agent, env)
    observation, _ = env.reset(seed=seed)
    frames: list[Any] = [env.render()]
    is_first = np.array([True])
    is_over = False
    while not is_over:
        observation, _, terminated, truncated, _ = env.step(
            policy.act(observation[None], is_first)[0]
        )
        frames.append(env.render())
        is_first = np.array([False])
        is_over = terminated or truncated
    return frames


def main(out: Path = Path("docs")) -> None:
    """Write viewer.gif and the stills.

    Args:
        out: Folder.
    """
    for name, (mission, difficulty, agent, seed, when) in STILLS.items():
        frames = mission_frames(mission, difficulty, agent, seed)
        Image.fromarray(frames[round(when * (len(frames) - 1))]).save(
            out / f"{name}.png", optimize=True
        )
        if name == "viewer_survey":
            write_gif(out / "viewer.gif", frames[::2], frames_per_s=10.0, width=720)
    for file in sorted(out.glob("viewer*")):
        print(f"{file}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    tyro.cli(main)
