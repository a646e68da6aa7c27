"""The learner: proximal policy optimisation from Stable-Baselines3 on the native vector environment."""

from __future__ import annotations

import contextlib
import math
import platform
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numba
import tensorboard  # noqa: F401 - stable-baselines3 would miss it only once the run has begun
import torch
from rich.console import Console
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from threadpoolctl import threadpool_limits

import homeward
from homeward.agents.learning.callback import TrainingCallback
from homeward.agents.learning.checkpoint import restore_checkpoint, save_checkpoint
from homeward.agents.learning.curve import Point, measure
from homeward.agents.learning.folder import TENSORBOARD
from homeward.agents.learning.guide import Guide, make_guide
from homeward.agents.learning.insight import Insight
from homeward.agents.learning.network import GuidedPolicy, layers_of
from homeward.agents.learning.policy_file import NetworkPolicy, save_policy
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import PPOSettings, TrainingError
from homeward.envs.options import Options, known_of
from homeward.envs.vector import HomewardVectorEnv

_LAST_LEARNING_RATE = 0.01


@dataclass(frozen=True)
class Trained:
    """What a training run came to: decisions taken, and home rate and mean score of the last missions."""

    steps: int
    home_rate: float
    score: float


def train(
    options: Options,
    settings: PPOSettings,
    steps: int,
    seed: int,
    folder: Path,
    *,
    details: Mapping[str, Any],
    checkpoint_s: float,
    curve: int,
    restore: bool,
    console: Console,
) -> Trained:
    """Train a policy and write it as it was when it did best on the missions of the learning curve.

    Args:
        options: Of the environment; the shaping's discount is taken from the settings.
        settings: Of the algorithm.
        steps: Decisions to train on, made up to whole updates.
        seed: Of all that is drawn: with the same seed, on the same machine, the policy is the same.
        folder: Of the run: checkpoints, TensorBoard files and the policy.
        details: More for the policy's description.
        checkpoint_s: Least time between checkpoints, s.
        curve: Points of the learning curve, 1 or more, beside the first.
        restore: Whether to continue from the folder's checkpoint.
        console: Where the progress goes.

    Raises:
        TrainingError: The checkpoint or the device cannot be used.
        OSError: The folder cannot be written to.
    """
    total = math.ceil(steps / settings.rollout) * settings.rollout
    with one_thread():
        model = make_model(options, settings, seed)
        model.set_logger(configure(str(folder / TENSORBOARD), ["tensorboard"]))
        best = restore_checkpoint(model, folder, total) if restore else None
        guide = make_guide(settings.guide, options.mission, known_of(options))

        def measured(steps: int, trained_s: float) -> Point:
            return measure(deployed(model, guide), options, steps, trained_s)

        callback = TrainingCallback(
            folder, total, checkpoint_s, console, math.ceil(total / curve), measured, lambda: layers_of(model), best
        )
        try:
            model.learn(total - model.num_timesteps, callback, reset_num_timesteps=False)
            callback.add_to_curve()
            save_checkpoint(model, callback.best, folder)  # for more steps some day
        except ValueError as error:
            if all(parameter.isfinite().all() for parameter in model.policy.parameters()):
                raise
            raise TrainingError(
                "the weights are no finite numbers any more: train with a smaller --learning-rate, or, if the run was "
                "continued from a checkpoint by someone else, choose another --out"
            ) from error
        finally:
            callback.close()
            model.logger.close()
    versions = {"homeward": homeward.__version__, "python": platform.python_version()}
    versions |= {name: version(name) for name in ("numpy", "numba", "torch", "stable-baselines3")}
    assert callback.best is not None  # the curve has a point at the end
    details = {**details, "steps": total, "best_after_steps": callback.best.steps, "versions": versions}
    save_policy(folder, callback.best.layers, model.action_space, details, guide)
    return Trained(total, callback.home_rate, callback.score)


def make_model(options: Options, settings: PPOSettings, seed: int) -> PPO:
    """An untrained learner on its missions.

    Raises:
        TrainingError: The device cannot be used.
    """
    check_device(settings)
    keywords = vars(options) | {"discount": settings.discount}
    missions = HomewardVectorEnv(settings.n_envs, autoreset_mode="SameStep", **keywords)
    guide = make_guide(settings.guide, options.mission, missions.batch.known)
    env = SB3Adapter(missions, settings.stranding_cost, guide, late_is_lost=True, insight=settings.insight)
    with warnings.catch_warnings():
        # The device is documented where it is chosen.
        warnings.filterwarnings("ignore", "You are trying to run PPO on the GPU", UserWarning)
        model = PPO(
            GuidedPolicy,
            env,
            learning_rate=_Falling(settings.learning_rate),
            n_steps=settings.n_steps,
            batch_size=settings.batch_size,
            n_epochs=settings.epochs,
            gamma=settings.discount,
            gae_lambda=settings.gae_lambda,
            clip_range=settings.clip,
            ent_coef=settings.entropy,
            policy_kwargs={
                "hidden": settings.hidden,
                "insight": Insight.columns if settings.insight else 0,
                "proposals": 0 if guide is None else guide.proposals,
            },
            seed=seed,
            device=settings.device,
        )
    env.seed(seed * settings.n_envs)  # no two seeds share a mission
    return model


def check_device(settings: PPOSettings) -> None:
    """Check that the device is there.

    Raises:
        TrainingError: It is not.
    """
    if settings.device == "cuda" and not torch.cuda.is_available():
        raise TrainingError("device = 'cuda' is not available here; choose cpu")


class _Falling:
    """A learning rate that falls linearly with the remaining share of the run."""

    def __init__(self, start: float) -> None:
        self._start = start

    def __call__(self, remaining: float) -> float:
        return self._start * max(remaining, _LAST_LEARNING_RATE)


def deployed(model: PPO, guide: Guide | None) -> NetworkPolicy:
    """The policy as it stands, as it will act once training is over; the guide begins anew with its missions."""
    description = {} if guide is None else {"guide": guide.description}
    return NetworkPolicy(tuple(layers_of(model)), model.action_space, description, guide)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Keep torch, numba and NumPy's linear algebra to one thread each.

    Batches are too small to gain from more, and idle threads of the one starve the other on a busy machine.
    """
    torch_threads, numba_threads = torch.get_num_threads(), numba.get_num_threads()
    torch.set_num_threads(1)
    numba.set_num_threads(1)
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(torch_threads)
        numba.set_num_threads(numba_threads)
