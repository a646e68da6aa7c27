"""The learner, which alone imports torch and Stable-Baselines3. `homeward.agents.trained` reads its results.

Read in this order: `settings`, `homeward.agents.trained.inputs` (inputs of a policy, and the first policy), `network`,
`sb3_adapter` (missions under Stable-Baselines3), `ppo` (a run), `callback`, `checkpoint`, `folder`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from homeward.installed import advice

__all__ = ["sb3_vec_env", "settings"]

if TYPE_CHECKING:
    from homeward.agents.learning.sb3_adapter import SB3Adapter


def sb3_vec_env(env_id: str, num_envs: int, *, seed: int = 0, **options: Any) -> SB3Adapter:
    """The native vector environment under Stable-Baselines3: one compiled step for all missions.

    Args:
        env_id: Id, such as `homeward/Survey-v0`.
        num_envs: Number of missions side by side.
        seed: Mission i begins with seed `seed + i`.
        **options: Options of the environment, such as `difficulty="known"`.

    Raises:
        OptionError: The id, an option or a value is not allowed.
        ModuleNotFoundError: stable-baselines3 or torch is not installed.

    >>> env = sb3_vec_env("homeward/OutAndBack-v0", 512)
    >>> env.reset().shape == (512, *env.observation_space.shape)
    True
    """
    try:
        from homeward.agents.learning.sb3_adapter import SB3Adapter
    except ModuleNotFoundError as error:
        name = str(error.name)
        raise ModuleNotFoundError(f"training needs {name}: {advice('train', name)}", name=name) from None
    from homeward.envs import IDS
    from homeward.envs.options import OptionError
    from homeward.envs.vector import HomewardVectorEnv

    missions = {one: mission for mission, one in IDS.items()}
    if env_id not in missions:
        raise OptionError(f"unknown env {env_id!r}; choose from {', '.join(missions)}")
    env = SB3Adapter(HomewardVectorEnv(num_envs, mission=missions[env_id], autoreset_mode="SameStep", **options))
    env.seed(seed)
    return env
