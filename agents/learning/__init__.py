"""The learner, which alone imports torch and Stable-Baselines3. `homeward.agents.trained` reads its
results.

Read in this order: `settings`, `homeward.agents.trained.inputs` (inputs of a policy, and the first
policy), `network`, `sb3_adapter` (missions under Stable-Baselines3), `sb3_policy` (its models as
agents), `ppo` (a run), `callback`, `checkpoint`, `folder`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from homeward.installed import advice

__all__ = ["sb3_policy", "sb3_vec_env", "scratch_start", "settings", "unseen_episodes"]

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from homeward.agents.evaluation.episodes import Episodes
    from homeward.agents.learning.sb3_adapter import AnyVectorEnv, SB3Adapter


def sb3_vec_env(
    env_id: str,
    num_envs: int,
    *,
    seed: int = 0,
    late_is_lost: bool = False,
    info_keys: Sequence[str] = (),
    wrapper_class: Callable[[AnyVectorEnv], AnyVectorEnv] | None = None,
    **options: Any,
) -> SB3Adapter:
    """The native vector environment under Stable-Baselines3: one compiled step for all missions.

    Args:
        env_id: Id, such as `homeward/Survey-v0`.
        num_envs: Number of missions side by side.
        seed: Mission i begins with seed `seed + i`.
        late_is_lost: Whether the time limit ends a mission with a score of 0, instead of being
            bootstrapped.
        info_keys: Keys of `info` that `infos` hold also while missions go on, such as `position_m`.
        wrapper_class: Wraps the vector environment, such as a subclass of
            `gymnasium.vector.VectorWrapper`.
        **options: Options of the environment, such as `difficulty="known"`, and `autoreset_mode`:
            `SameStep`, or `Disabled` for Gymnasium's wrappers of observations.

    Raises:
        OptionError: The id, an option or a value is not allowed.
        ValueError: See `homeward.agents.learning.sb3_adapter.SB3Adapter`.
        ModuleNotFoundError: stable-baselines3 or torch is not installed.

    >>> env = sb3_vec_env("homeward/OutAndBack-v0", 512)
    >>> env.reset().shape == (512, *env.observation_space.shape)
    True
    """
    try:
        from homeward.agents.learning.sb3_adapter import SB3Adapter
    except ModuleNotFoundError as error:
        name = str(error.name)
        raise ModuleNotFoundError(
            f"training needs {name}: {advice('train', name)}", name=name
        ) from None
    from homeward.envs import IDS
    from homeward.envs.options import OptionError
    from homeward.envs.vector import HomewardVectorEnv

    missions = {env_id: mission for mission, env_id in IDS.items()}
    if env_id not in missions:
        raise OptionError(f"unknown env {env_id!r}; choose from {', '.join(missions)}")
    made: AnyVectorEnv = HomewardVectorEnv(
        num_envs, mission=missions[env_id], **{"autoreset_mode": "SameStep", **options}
    )
    wrapped = made if wrapper_class is None else wrapper_class(made)
    env = SB3Adapter(wrapped, late_is_lost=late_is_lost, info_keys=info_keys)
    env.seed(seed)
    return env


def scratch_start(env: SB3Adapter, hidden: int = 64) -> dict[str, Any]:
    """Keywords of Stable-Baselines3's `PPO` or `A2C` for the first policy of
    `homeward train --start scratch`.

    It knows nothing of energy: it cruises, occasionally tries a return, and continues a return that
    it has begun. A return is final after several decisions in a row, which a random network hardly
    ever takes: it may learn to stay out until the time limit, and never to come home.

    Args:
        env: The missions, of discrete or continuous actions.
        hidden: Width of the two hidden layers, of the policy and of the value.

    Raises:
        ValueError: The actions are flat, or a wrapper changes observations or actions.

    >>> from stable_baselines3 import PPO
    >>> env = sb3_vec_env("homeward/OutAndBack-v0", 512)
    >>> model = PPO(env=env, **scratch_start(env), device="cpu")
    """
    from homeward.agents.learning.network import ResidualPolicy
    from homeward.agents.trained.inputs import first_policy

    if env.missions.options.action_type == "flat" or not env.as_missions:
        raise ValueError(
            "the first policy needs the missions' own observations, and discrete or continuous actions"
        )
    network = {
        "hidden": hidden,
        "first": first_policy(env.missions.batch.known, None),
        "valued": None,
    }
    return {"policy": ResidualPolicy, "policy_kwargs": network}


def unseen_episodes(model: BaseAlgorithm, env: SB3Adapter, count: int, seed: int = 0) -> Episodes:
    """Episodes of a model with its most probable actions, on missions of the same options that no
    training uses.

    They are the missions of `homeward evaluate --episodes COUNT --seed SEED`.

    Args:
        model: A model of Stable-Baselines3.
        env: The missions that it was trained on.
        count: Number of episodes, 1 or more.
        seed: Seed of the evaluation, 0 or above.

    Raises:
        ValueError: A wrapper changes observations or actions: the model does not act on missions
            alone.
    """
    from homeward.agents.evaluation.episodes import episode_seeds, run_episodes
    from homeward.agents.learning.sb3_policy import SB3Policy

    if not env.as_missions:
        raise ValueError(
            "a wrapper changes observations or actions; run the model in its own environment instead"
        )
    return run_episodes(SB3Policy(model), env.missions.options, episode_seeds(seed, count)).episodes
