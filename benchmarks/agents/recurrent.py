"""How far recurrent memory comes: sb3-contrib's `RecurrentPPO` from nothing, beside the planner.

`python benchmarks/agents/recurrent.py --mission Survey --beliefs` trains an LSTM on 64 missions side by side, on the
observation alone or with the beliefs of `homeward.agents.trained.inputs` behind it. After every piece of the training
the greedy policy is validated on missions of their own; the best is kept in OUT, and what it does on unseen missions
is printed beside the planner's. No rule decides or proposes anything, and no first policy is favoured.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, final

import numba
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from sb3_contrib import RecurrentPPO
from stable_baselines3.common.callbacks import BaseCallback

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.tables import rate, span, table
from homeward import cli
from homeward.agents.base import Observations, Policy
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import Bootstrap, interval
from homeward.agents.learning.ppo import one_thread
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import TrainingError
from homeward.agents.registry import AGENTS, Request
from homeward.agents.trained.inputs import BeliefInputs, make_inputs
from homeward.envs.options import Known, OptionError, Options, known_of
from homeward.envs.vector import HomewardVectorEnv
from homeward.files import write_whole

SIDE_BY_SIDE, ROLLOUT = 64, 128
"""Missions that a learner trains on at once, and decisions of each between updates."""
PIECE = 32 * SIDE_BY_SIDE * ROLLOUT
"""Decisions between validations."""
VALIDATION_SEED, VALIDATION_EPISODES = 1_000_003, 500
"""Missions on which the best policy is chosen, as `train.py` does."""


@dataclass(frozen=True)
class Args:
    """What to train and on how many episodes to compare."""

    mission: str = "OutAndBack"
    """Mission."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    beliefs: bool = False
    """Whether what the robot has estimated of itself and the wind is seen, too."""
    steps: int = 3_000_000
    """Decisions to train on; 0: the policy that an earlier run kept."""
    training_seed: int = 0
    """Seed of the training."""
    episodes: int = 2000
    """Unseen episodes to compare on."""
    seed: int = 7
    """Seed that the unseen episodes follow from, as in evaluate.py."""
    out: Path = Path("runs/recurrent")
    """Folder of the best policy and of the curve."""


@final
class Remembering(Policy):
    """What was learned, with the memory of its missions.

    Args:
        model: Trained.
        inputs: What makes its inputs from observations, if they are not the observations.
    """

    def __init__(self, model: RecurrentPPO, inputs: BeliefInputs | None) -> None:
        self._model, self._inputs = model, inputs
        self._memory: tuple[NDArray[Any], ...] | None = None

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        if begun.all():
            self._memory = None
        seen = observations if self._inputs is None else self._inputs(observations, begun)
        actions, self._memory = self._model.predict(seen, self._memory, begun, deterministic=True)
        return actions


def make_model(options: Options, args: Args) -> RecurrentPPO:
    """A learner that has not learned yet."""
    env = HomewardVectorEnv(SIDE_BY_SIDE, autoreset_mode="SameStep", **vars(options))
    adapter = SB3Adapter(env, inputs=_inputs(args, known_of(options)), late_is_lost=True)
    model = RecurrentPPO(
        "MlpLstmPolicy", adapter, n_steps=ROLLOUT, batch_size=1024, n_epochs=4, learning_rate=_falling,
        gamma=options.discount, gae_lambda=0.98, seed=args.training_seed, device="cpu",
        policy_kwargs={"lstm_hidden_size": 64, "net_arch": [64]},
    )  # fmt: skip
    adapter.seed(args.training_seed * SIDE_BY_SIDE)
    return model


def _falling(left: float) -> float:
    """Learning rate by the share of the training that is left."""
    return 1e-3 * max(left, 0.1)


def _inputs(args: Args, known: Known) -> BeliefInputs | None:
    return make_inputs(known) if args.beliefs else None


@final
class Validation(BaseCallback):
    """Validates the policy after every piece of the training, keeps the best and the curve.

    Args:
        args: Of this run.
        options: Of the environment.
        file: The best policy; its curve lies beside it.
    """

    def __init__(self, args: Args, options: Options, file: Path) -> None:
        super().__init__()
        self._args, self._options, self._file = args, options, file
        self._best, self._begun_s, self._curve = -np.inf, time.perf_counter(), list[dict[str, float]]()

    def _on_rollout_start(self) -> None:
        if self.num_timesteps % PIECE == 0 and self.num_timesteps > 0:
            self.validate()

    def validate(self) -> None:
        """Run the validation missions."""
        assert isinstance(self.model, RecurrentPPO)
        seeds = episode_seeds(VALIDATION_SEED, VALIDATION_EPISODES)
        episodes = _run(self.model, self._args, self._options, seeds)
        point = {"decisions": self.num_timesteps, "score": float(episodes.score.mean())}
        point |= {"stranded": float(episodes.stranded.mean()), "seconds": time.perf_counter() - self._begun_s}
        print(json.dumps(point), flush=True)
        self._curve.append(point)
        write_whole(self._file.with_suffix(".json"), json.dumps(self._curve, indent=2) + "\n")
        if point["score"] > self._best:
            self._best = point["score"]
            self.model.save(self._file)

    def _on_step(self) -> bool:
        return True


def main(args: Args) -> None:
    """Train, keep the best policy, and print what it does on unseen missions.

    Raises:
        TrainingError, OptionError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.steps < 0 or args.episodes < 2 or args.seed < 0:
        raise TrainingError(f"{args}: give --steps and a --seed of 0 or more, and at least 2 --episodes")
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    options = Options(args.mission, difficulty=args.difficulty)
    name = f"{args.mission}-{args.difficulty}{'-beliefs' if args.beliefs else ''}-{args.training_seed}"
    file = args.out / f"{name}.zip"
    args.out.mkdir(parents=True, exist_ok=True)
    seeds = episode_seeds(args.seed, args.episodes)
    with one_thread():
        if args.steps:
            validation = Validation(args, options, file)
            make_model(options, args).learn(args.steps, validation)
            validation.validate()
        elif not file.exists():
            raise TrainingError(f"--steps 0: there is no {file} yet")
        learned = _run(RecurrentPPO.load(file, device="cpu"), args, options, seeds)
    planner = run_episodes(AGENTS["planner"](Request(known_of(options), None, 0)), options, seeds).episodes
    Console(width=120).print(_table(args, name, learned, planner))


def _run(model: RecurrentPPO, args: Args, options: Options, seeds: Sequence[int]) -> Episodes:
    return run_episodes(Remembering(model, _inputs(args, known_of(options))), options, seeds).episodes


def _table(args: Args, name: str, learned: Episodes, planner: Episodes) -> Table:
    used = ", ".join(f"{one} {version(one)}" for one in ("sb3-contrib", "torch"))
    made = table(
        f"{name}\n{args.episodes} unseen missions, episode_seeds({args.seed}, {args.episodes}); {used}",
        ["agent"],
        ["mean score", "stranded (95 %)", "minus planner (95 %)"],
    )
    means = Bootstrap({"learned": learned.score[None], "planner": planner.score[None]}, args.seed).means()
    gained = span(float((learned.score - planner.score).mean()), interval(means["learned"] - means["planner"]), "+.4g")
    for agent, episodes, over in (("recurrent, greedy", learned, gained), ("planner", planner, "")):
        stranded = rate(int(episodes.stranded.sum()), args.episodes)
        made.add_row(agent, f"{episodes.score.mean():.4g}", stranded, over)
    return made


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (TrainingError, OptionError)))
