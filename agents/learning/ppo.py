"""The learner: proximal policy optimisation from Stable-Baselines3 on the native vector
environment."""

from __future__ import annotations

import contextlib
import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numba
import numpy as np
import tensorboard  # noqa: F401 - stable-baselines3 would miss it only once the run has begun
import torch
from rich.console import Console
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.utils import set_random_seed
from threadpoolctl import threadpool_limits

import homeward
from homeward.agents.evaluation.learning_curve import Point, measure
from homeward.agents.learning.callback import TrainingCallback
from homeward.agents.learning.checkpoint import restore_checkpoint, save_checkpoint
from homeward.agents.learning.network import ResidualPolicy, layers_of
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import DMAX, DivergedError, PPOSettings
from homeward.agents.learning.tracking import WandbOutput, log_settings
from homeward.agents.trained.inputs import BeliefInputs, first_policy, make_inputs, valued
from homeward.agents.trained.policy_file import ON_THE_GO, Layer, NetworkPolicy, save_policy
from homeward.agents.trained.run_folder import CURVE_POLICIES, FIRST, LAST, TENSORBOARD
from homeward.envs.features import names_of
from homeward.envs.options import Known, Options, known_of
from homeward.envs.vector import HomewardVectorEnv

# relative to the first; it falls linearly; chosen: the last updates change little
_LAST_LEARNING_RATE = 0.01
_STAGGERED = 128
"""Decisions over which the first missions begin: about as many as a mission has (see
docs/learning.md)."""


@dataclass(frozen=True)
class Trained:
    """Result of a training run: number of decisions, and home rate and mean score of the last
    missions."""

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
    checkpoints: int,
    curve: int,
    restore: bool,
    console: Console,
    wandb: str | None = None,
) -> Trained:
    """Train a policy, and write the one with the best score on the missions of the learning curve.

    The subfolders `first` and `last` hold the policies at the beginning and the end of training,
    `curve` those of all points of the learning curve.

    Args:
        options: Options of the environment; the shaping's discount is taken from the settings.
        settings: Settings of the algorithm.
        steps: Number of decisions, rounded up to whole updates.
        seed: Seed of all random numbers: on one machine, uninterrupted runs with the same seed are
            equal.
        folder: Folder of the run: checkpoints, TensorBoard files and the policy.
        details: Additions to the policy's description.
        checkpoints: Equal parts of the run, after each of which a checkpoint is written and
            missions restart.
        curve: Points of the learning curve, 1 or more, besides the first.
        restore: Whether to continue from the folder's checkpoint.
        console: Output of the progress.
        wandb: Project of Weights & Biases for the figures, besides TensorBoard.

    Raises:
        TrainingError: No checkpoint can be read, or Weights & Biases cannot be used.
        DivergedError: The weights are not finite any more.
        OSError: The folder cannot be written to.
    """
    total = math.ceil(steps / settings.rollout) * settings.rollout
    with one_thread():
        model = make_model(options, settings, seed)
        model.set_logger(configure(str(folder / TENSORBOARD), ["tensorboard"]))
        best_policy = restore_checkpoint(model, folder, total) if restore else None
        known = known_of(options)
        versions = {"homeward": homeward.__version__, "python": platform.python_version()}
        versions |= {
            name: version(name) for name in ("numpy", "numba", "torch", "stable-baselines3")
        }

        def write(into: Path, layers: Sequence[Layer], after_steps: int) -> None:
            description = {
                **details,
                **ON_THE_GO,
                "steps": total,
                "after_steps": after_steps,
                "versions": versions,
            }
            features = names_of(bool(options.docks))
            save_policy(
                into, layers, model.action_space, description, inputs_of(settings, known), features
            )

        if not model.num_timesteps:
            write(folder / FIRST, layers_of(model), 0)
            log_settings(model.logger, details["training"])

        def measured(steps: int, trained_s: float) -> Point:
            write(folder / CURVE_POLICIES / str(steps), layers_of(model), steps)
            return measure(deployed(model, inputs_of(settings, known)), options, steps, trained_s)

        def begin_anew() -> None:
            draw_anew(model, seed)
            stagger(model)

        updates = total // settings.rollout
        written_after = {
            settings.rollout * (updates * part // checkpoints) for part in range(1, checkpoints)
        }
        begin_anew()
        callback = TrainingCallback(
            folder=folder,
            steps=total,
            checkpoints=written_after,
            console=console,
            every=math.ceil(total / curve),
            measure=measured,
            layers=lambda: layers_of(model),
            best_policy=best_policy,
            begin_anew=begin_anew,
        )
        if wandb is not None:
            model.logger.output_formats.append(WandbOutput(wandb, folder, details["training"]))
        try:
            model.learn(total - model.num_timesteps, callback, reset_num_timesteps=False)
            callback.add_to_curve()
            save_checkpoint(model, callback.best_policy, folder)  # for more steps later
        except ValueError as error:
            if all(parameter.isfinite().all() for parameter in model.policy.parameters()):
                raise
            raise DivergedError(
                "the weights are not finite any more: train with a smaller --learning-rate, or, if the run was "
                "continued from someone else's checkpoint, choose another --out"
            ) from error
        finally:
            callback.close()
            model.logger.close()
    assert callback.best_policy is not None  # the curve has a point at the end
    write(folder / LAST, layers_of(model), total)
    write(folder, callback.best_policy.layers, callback.best_policy.steps)
    return Trained(total, callback.home_rate, callback.score)


def make_model(options: Options, settings: PPOSettings, seed: int) -> PPO:
    """An untrained learner with its missions, on the CPU, which is fastest for so small a
    network."""
    by_start = settings.by_start
    keywords = vars(options) | {"discount": settings.discount}
    missions = HomewardVectorEnv(settings.n_envs, autoreset_mode="SameStep", **keywords)
    known = missions.batch.known
    inputs = inputs_of(settings, known)
    env = SB3Adapter(
        missions, settings.stranding_cost, inputs, late_is_lost=True, senses_on_the_go=True
    )
    network = {"hidden": settings.hidden, "first": first_policy(known, inputs), "valued": None}
    if settings.start == DMAX:
        network["valued"] = valued(known)
    model = PPO(
        ResidualPolicy,
        env,
        learning_rate=lambda remaining: (
            by_start["learning_rate"] * max(remaining, _LAST_LEARNING_RATE)
        ),
        n_steps=settings.n_steps,
        batch_size=settings.batch_size,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip,
        ent_coef=by_start["entropy"],
        policy_kwargs=network,
        seed=seed,
        device="cpu",
    )
    draw_anew(model, seed)
    return model


def inputs_of(settings: PPOSettings, known: Known) -> BeliefInputs | None:
    """Inputs of a policy beside the observation; None from scratch."""
    if settings.start != DMAX:
        return None
    return make_inputs(known)


def draw_anew(model: PPO, seed: int) -> None:
    """Restart missions and random numbers with those of no other seed, and of no other part of an
    interrupted run."""
    words = np.random.SeedSequence((seed, model.num_timesteps)).generate_state(2, np.uint64)
    set_random_seed(int(words[0]) % 2**32)
    model.get_env().seed(int(words[1]) >> 2)  # type: ignore[union-attr]  # below those of evaluations


def stagger(model: PPO) -> None:
    """Begin missions in turn, so that updates cover all stages (Bharthulwar et al. 2025, arXiv
    2511.21011)."""
    env = model.get_env()
    assert isinstance(env, SB3Adapter)
    begins = np.arange(env.num_envs) % _STAGGERED
    ended = np.zeros(env.num_envs, np.bool_)
    seen = env.reset()
    for decision in range(_STAGGERED):
        actions, _ = model.predict(seen)
        seen, _, ended, _ = env.step(actions)  # type: ignore[assignment]
        begins_now = begins == decision
        if begins_now.any():
            seen = env.begin(begins_now)
            ended |= begins_now
    model._last_obs = seen
    model._last_episode_starts = ended


def deployed(model: PPO, inputs: BeliefInputs | None) -> NetworkPolicy:
    """The present policy, as it will act after training, with inputs of its own."""
    return NetworkPolicy(tuple(layers_of(model)), model.action_space, ON_THE_GO, inputs)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Keep torch, numba and NumPy's linear algebra to one thread each.

    Batches are too small to gain from more, and idle threads of one library slow the others on a
    busy machine.
    """
    torch_threads = torch.get_num_threads()
    numba_threads = numba.get_num_threads()
    torch.set_num_threads(1)
    numba.set_num_threads(1)
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(torch_threads)
        numba.set_num_threads(numba_threads)
