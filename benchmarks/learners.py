"""Learning from nothing: what shaping, a memory and another learner do, the table of docs/learning.md.

`python benchmarks/learners.py` trains PPO with the shaping by d_max, without any and paid as it goes, recurrent PPO
(sb3-contrib) and deep Q-learning (Stable-Baselines3) on the same missions, all of them from nothing and from the
observation alone, and compares them with the best rule on unseen episodes. Finished runs are kept in OUT, so that a run
that was killed goes on with the next one.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, final

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table
from sb3_contrib import RecurrentPPO
from stable_baselines3 import DQN
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own

from benchmarks.learn import best_rule, interval
from homeward import cli
from homeward.agents.base import Observations, Policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import wilson
from homeward.agents.learning.network import _MODE_LOGITS
from homeward.agents.learning.ppo import deployed, make_model, one_thread
from homeward.agents.learning.provenance import made_with
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import PPOSettings, TrainingError
from homeward.envs.actions import LEVELS, encode_actions
from homeward.envs.options import Known, OptionError, Options, known_of
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.files import write_whole

SETTINGS = PPOSettings(guide="none", insight=False, learning_rate=1e-3)
"""Of PPO; the others take from them what they share."""


@dataclass(frozen=True)
class Args:
    """What to train and on how many episodes to compare."""

    out: Path = Path("runs/learners")
    """Folder of the results."""
    missions: tuple[str, ...] = ("Survey", "OutAndBack")
    """Missions to train for."""
    learners: tuple[str, ...] = ("ppo", "ppo unshaped", "ppo naive", "recurrent ppo", "dqn")
    """Learners."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    seeds: int = 2
    """Training seeds: 0, 1, ..."""
    steps: int = 400_000
    """Decisions to train on: the recurrent learner and deep Q-learning take two to three minutes for so many."""
    episodes: int = 2000
    """Unseen episodes to compare on."""


def main(args: Args) -> None:
    """Train, compare and print the table.

    Raises:
        TrainingError, OptionError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    unknown = [name for name in args.learners if name not in LEARNERS]
    if unknown or args.seeds < 1 or args.episodes < 2 or args.steps < 1:
        raise TrainingError(
            f"{args}: give --learners of {', '.join(LEARNERS)}, and at least 1 of --seeds and --steps and 2 --episodes"
        )
    table = Table(
        title=f"{args.difficulty}, {args.steps:,} decisions, {args.seeds} seeds, {args.episodes} unseen episodes",
        box=box.SIMPLE_HEAD,
    )
    for heading in ("mission", "learner", "score, by seed", "minus best rule (95 %)", "stranded (95 %)", "training, s"):
        table.add_column(heading, justify="left" if heading in ("mission", "learner") else "right")
    for mission in args.missions:
        options = Options(mission, difficulty=args.difficulty, discount=SETTINGS.discount)
        rule, of_rule = best_rule(Options(mission, difficulty=args.difficulty), tuple(episode_seeds(0, args.episodes)))
        count = len(of_rule.score)
        table.add_row(mission, rule, f"{of_rule.score.mean():.4g}", "", _rate(int(of_rule.stranded.sum()), count), "")
        for learner in args.learners:
            runs = [one_run(args, options, learner, seed) for seed in range(args.seeds)]
            scores = np.array([run["score"] for run in runs])
            low, high = interval(scores - of_rule.score)
            table.add_row(
                mission, learner, ", ".join(f"{score:.4g}" for score in scores.mean(axis=1)),
                f"{(scores - of_rule.score).mean():+.4g} ({low:+.4g} to {high:+.4g})",
                _rate(sum(run["stranded"] for run in runs), scores.size),
                f"{np.median([run['trained_s'] for run in runs]):.0f}",
            )  # fmt: skip
    Console(width=120).print(table)


def _rate(stranded: int, count: int) -> str:
    low, high = wilson(stranded, count)
    return f"{stranded / count:.2%} ({low:.2%} to {high:.2%})"


def one_run(args: Args, options: Options, learner: str, seed: int) -> dict[str, Any]:
    """Train with one seed and run the unseen episodes, or find what came of it in an earlier run."""
    code = made_with(options) | {name: version(name) for name in ("stable-baselines3", "sb3-contrib", "torch")}
    key = {
        "steps": args.steps,
        "episodes": args.episodes,
        "options": dataclasses.asdict(options),
        "made_with": code,
    }
    file = args.out / f"{options.mission}-{options.difficulty}-{learner.replace(' ', '_')}-{seed}.json"
    if file.is_file():
        kept: dict[str, Any] = json.loads(file.read_text())
        if {name: kept.get(name) for name in key} == key:
            return kept
    Console(stderr=True).print(f"{options.mission}, {learner}, seed {seed}: training", highlight=False)
    start = time.perf_counter()
    with one_thread():
        policy = LEARNERS[learner](options, args.steps, seed)
        trained_s = time.perf_counter() - start
        episodes = run_episodes(policy, options, episode_seeds(0, args.episodes)).episodes
    found = {**key, "trained_s": trained_s, "score": episodes.score.tolist(), "stranded": int(episodes.stranded.sum())}
    write_whole(file, json.dumps(found) + "\n")
    return found


def missions(options: Options, count: int, seed: int) -> SB3Adapter:
    """Missions side by side, rewarded as those of PPO."""
    env = HomewardVectorEnv(count, autoreset_mode="SameStep", **vars(options))
    adapter = SB3Adapter(env, SETTINGS.stranding_cost, late_is_lost=True)
    adapter.seed(seed * count)  # no two seeds share a mission
    return adapter


def train_ppo(options: Options, steps: int, seed: int) -> Policy:
    """PPO as `train.py --guide none --learning-rate 1e-3` does it, but for the critic's insight."""
    model = make_model(options, SETTINGS, seed)
    model.learn(steps)
    return deployed(model, None)


def train_ppo_unshaped(options: Options, steps: int, seed: int) -> Policy:
    """The same, with nothing but the score at the end."""
    return train_ppo(dataclasses.replace(options, shaping="none"), steps, seed)


def train_ppo_naively(options: Options, steps: int, seed: int) -> Policy:
    """The same, paid as it goes."""
    model = make_model(options, SETTINGS, seed)
    env = model.env
    assert isinstance(env, SB3Adapter)
    model.set_env(PaidAsItGoes(env))
    model.learn(steps)
    return deployed(model, None)


def train_recurrent(options: Options, steps: int, seed: int) -> Policy:
    """PPO whose policy and value each have an LSTM, so that they can remember what decisions took."""
    model = RecurrentPPO(
        "MlpLstmPolicy", missions(options, 128, seed), learning_rate=1e-3, n_steps=128, batch_size=4096,
        n_epochs=SETTINGS.epochs, gamma=SETTINGS.discount, gae_lambda=SETTINGS.gae_lambda, clip_range=SETTINGS.clip,
        policy_kwargs={"lstm_hidden_size": 64, "net_arch": [64]}, seed=seed, device="cpu",
    )  # fmt: skip
    head = model.policy.action_net
    assert isinstance(head, torch.nn.Linear)
    with torch.no_grad():
        head.bias[-3:] = torch.tensor(_MODE_LOGITS)
    return Learned(model.learn(steps))


def train_dqn(options: Options, steps: int, seed: int) -> Policy:
    """Deep Q-learning of returns over ten decisions, from a memory of half a million."""
    env = FlatActions(missions(options, 64, seed), choices(known_of(options)))
    model = DQN(
        "MlpPolicy", env, learning_rate=3e-4, buffer_size=500_000, learning_starts=50_000, batch_size=512,
        gamma=SETTINGS.discount, train_freq=1, gradient_steps=4, n_steps=10, target_update_interval=2000,
        exploration_fraction=0.5, exploration_final_eps=0.02, policy_kwargs={"net_arch": [128, 128]}, seed=seed,
        device="cpu",
    )  # fmt: skip
    return Learned(model.learn(steps), env.table)


LEARNERS: dict[str, Callable[[Options, int, int], Policy]] = {
    "ppo": train_ppo,
    "ppo unshaped": train_ppo_unshaped,
    "ppo naive": train_ppo_naively,
    "recurrent ppo": train_recurrent,
    "dqn": train_dqn,
}


def choices(known: Known) -> NDArray[Any]:
    """Every speed and sensing rate to go on with, a stop, and the way home at cruise, shape (choices, 3).

    Speeds and rates of a stop or of the way home are of little use, and a robot that tries everything alike then
    heads home in one of 27 trials instead of in one of three.
    """
    s = known.shared[0]
    speeds, rates = (levels.ravel() for levels in np.indices((LEVELS, LEVELS)) / (LEVELS - 1))
    speeds_mps = s["min_speed_mps"] + speeds * (s["max_speed_mps"] - s["min_speed_mps"])
    others = [encode_actions(known, s["cruise_mps"], 0.0, mode) for mode in (STOP, RETURN)]
    return np.concatenate([encode_actions(known, speeds_mps, rates * s["max_sensing_hz"], GO), *others])


class FlatActions(VecEnvWrapper):
    """Missions whose actions are numbers of rows of a table."""

    def __init__(self, venv: SB3Adapter, table: NDArray[Any]) -> None:
        super().__init__(venv, action_space=gym.spaces.Discrete(len(table)))
        self.table = table

    def reset(self) -> VecEnvObs:
        """Begin all missions."""
        return self.venv.reset()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self.venv.step_async(self.table[actions])

    def step_wait(self) -> VecEnvStepReturn:
        """Step all missions."""
        return self.venv.step_wait()


class PaidAsItGoes(VecEnvWrapper):
    """Pays what the score rises by at once, whether or not the robot gets home, and takes the cost of stranding."""

    def __init__(self, venv: SB3Adapter) -> None:
        super().__init__(venv)
        self._batch = venv.env.batch

    def reset(self) -> VecEnvObs:
        """Begin all missions."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Step all missions."""
        batch = self._batch
        before = batch.records["score"].copy()
        observations, _, dones, infos = self.venv.step_wait()
        after = batch.records["score"].copy()
        ended = np.flatnonzero(dones)
        stranded = np.array([infos[i]["stranded"] for i in ended], np.bool_)
        after[ended] = np.where(stranded, before[ended], [infos[i]["score"] for i in ended])
        rewards = (after - before) * batch.known.shared["per_score"][0]
        rewards[ended] -= SETTINGS.stranding_cost * stranded
        return observations, rewards.astype(np.float32), dones, infos


@final
class Learned(Policy):
    """A learner's likeliest or best actions, by its memory where it has one."""

    def __init__(self, model: BaseAlgorithm, table: NDArray[Any] | None = None) -> None:
        self._model, self._table = model, table
        self._memory: Any = None

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        if begun.all():
            self._memory = None
        actions, self._memory = self._model.predict(
            observations, state=self._memory, episode_start=begun, deterministic=True
        )
        return actions if self._table is None else self._table[actions]


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (TrainingError, OptionError), interrupted="the same command goes on"))
