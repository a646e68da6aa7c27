"""PPO-Lagrangian of OmniSafe on the native missions: at most a share of them may strand.

OmniSafe 0.5 pins what this project cannot have, so it is installed without its dependencies
(docs/other_stacks.md has the commands); then `python examples/omnisafe_ppolag.py --steps 200000`.
Its own environments, those of Safety-Gymnasium, are left out: they need Gymnasium 0.28 and Python
before 3.11.
"""

from __future__ import annotations

try:
    from homeward.installed import needed
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[train]' in its checkout, or run .venv/bin/python"
    ) from None

needed("train", "torch")

import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
import tyro

from homeward.envs import IDS
from homeward.envs.vector import HomewardVectorEnv

# OmniSafe imports it on loading and calls it for its own environments only.
sys.modules.setdefault("safety_gymnasium", types.ModuleType("safety_gymnasium"))
try:
    import omnisafe
except ModuleNotFoundError as error:
    raise SystemExit(
        f"needs {error.name}: docs/other_stacks.md says how OmniSafe is installed"
    ) from None
from omnisafe.envs.core import CMDP, env_register


@dataclass(frozen=True)
class Args:
    """What to train."""

    env: str = "homeward/Survey-v0"
    """Environment id."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    limit: float = 0.05
    """Share of missions that may strand."""
    steps: int = 1_000_000
    """Decisions to train on, over all missions."""
    n_envs: int = 128
    """Missions side by side, at least 2."""
    per_update: int = 64
    """Decisions of each mission between two updates."""
    out: Path = Path("runs/omnisafe")
    """Folder of OmniSafe's log."""
    seed: int = 0
    """Seed of all that is drawn."""


@env_register
class Missions(CMDP):
    """Native missions with OmniSafe's interface: a cost of 1 on stranding beside the reward,
    tensors in and out."""

    _support_envs: ClassVar[list[str]] = list(IDS.values())
    need_auto_reset_wrapper = False
    need_time_limit_wrapper = False

    def __init__(self, env_id: str, num_envs: int = 1, device: str = "cpu", **options: Any) -> None:
        super().__init__(env_id)
        (mission,) = (mission for mission, id_of_mission in IDS.items() if id_of_mission == env_id)
        self._env = HomewardVectorEnv(
            num_envs,
            mission=mission,
            action_type="continuous",
            autoreset_mode="SameStep",
            **options,
        )
        self._num_envs, self._device, self._seed = num_envs, device, None
        self._action_space, self._observation_space = (
            self._env.single_action_space,
            self._env.single_observation_space,
        )
        self._metadata: dict[str, Any] = {}

    def set_seed(self, seed: int) -> None:
        """Seed of the next reset."""
        self._seed = seed

    def reset(
        self, seed: int | None = None, options: Any = None
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Begin all missions."""
        observations, _ = self._env.reset(seed=self._seed if seed is None else seed)
        self._seed = None
        return self._tensor(observations), {}

    def step(self, action: torch.Tensor) -> tuple[Any, ...]:
        """Observation, reward, cost, terminated, truncated, info."""
        chosen = (
            action.detach()
            .cpu()
            .numpy()
            .reshape(self._num_envs, -1)
            .clip(-1.0, 1.0)
            .astype(np.float32)
        )
        observations, rewards, terminated, truncated, info = self._env.step(chosen)
        costs, final = np.zeros(self._num_envs), {}
        if "final_info" in info:
            costs = np.array(info["final_info"]["cost"])
            ended, last = terminated | truncated, observations.copy()
            last[ended] = np.stack(info["final_obs"][ended])
            final = {
                "final_observation": self._tensor(last),
                "_final_observation": torch.as_tensor(ended),
            }
        return *map(self._tensor, (observations, rewards, costs, terminated, truncated)), final

    def _tensor(self, values: Any) -> torch.Tensor:
        # One mission comes without a dimension for missions.
        batch = torch.as_tensor(np.asarray(values), dtype=torch.float32, device=self._device)
        return batch if self._num_envs > 1 else batch[0]

    def render(self) -> None:
        """Nothing: render a scalar environment."""

    def close(self) -> None:
        """Close the missions."""
        self._env.close()


def main(args: Args) -> tuple[float, float, float]:
    """Train; return, cost and length of the last missions, as OmniSafe has them."""
    per_update = args.n_envs * args.per_update
    agent = omnisafe.Agent(
        "PPOLag",
        args.env,
        custom_cfgs={
            "seed": args.seed,
            "train_cfgs": {
                "total_steps": -(-args.steps // per_update) * per_update,
                "vector_env_nums": args.n_envs,
                "torch_threads": 1,
            },
            "algo_cfgs": {
                "steps_per_epoch": per_update,
                "update_iters": 4,
                "batch_size": 2048,
                "obs_normalize": False,
            },
            "logger_cfgs": {"log_dir": str(args.out), "use_wandb": False},
            "lagrange_cfgs": {"cost_limit": args.limit},
            "env_cfgs": {"difficulty": args.difficulty},
        },
    )
    episode_return, cost, length = agent.learn()
    print(
        f"{args.env}: return {episode_return:.3f}, stranded {cost:.1%}, {length:.0f} decisions a mission"
    )
    return episode_return, cost, length


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
