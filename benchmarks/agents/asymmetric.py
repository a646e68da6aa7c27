"""Does it help if the critic sees what is hidden? Train from d_max with and without, and compare on unseen episodes.

`python benchmarks/agents/asymmetric.py` trains as train.py does from d_max, once as it is and once with a value that
also sees the truth behind the instruments (asymmetric actor-critic: Pinto et al. 2017, arXiv 1710.06542); the policy
sees the same in both. Finished runs are kept and a killed one goes on; those without are runs of `learn.py`, which are
found trained in its folder.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numba
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from rich.console import Console
from torch import nn

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own
from benchmarks.agents import learn
from benchmarks.agents.learn import Result
from benchmarks.tables import rate, span, table
from homeward import cli
from homeward.agents.evaluation.statistics import Bootstrap, interval
from homeward.agents.learning import ppo
from homeward.agents.learning.network import Layers, ResidualPolicy
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import DMAX, TrainingError
from homeward.envs.batch import Batch
from homeward.envs.features import LIMIT
from homeward.envs.options import OptionError

HIDDEN = (
    "energy", "margin", "capacity", "rolling", "payload", "wind_east", "wind_north", "grade_ahead", "interest_ahead",
)  # fmt: skip
"""What the critic alone sees: energies as shares of the usable energy, robots as they differ from their file, wind in
10 m/s, and means of all places ahead."""


@dataclass(frozen=True)
class Args:
    """What to train and on how many episodes to compare."""

    out: Path = Path("runs/asymmetric")
    """Folder of the runs with the critic that sees what is hidden."""
    learned: Path = Path("runs/learn")
    """Folder of the runs without, which learn.py wrote; what it lacks is trained."""
    missions: tuple[str, ...] = ("OutAndBack", "Survey")
    """Missions to train for."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    seeds: int = 5
    """Training seeds: 0, 1, ..."""
    steps: int | None = None
    """Decisions to train on; by default as in learn.py."""
    episodes: int = 2000
    """Unseen episodes to compare on."""


def hidden(batch: Batch) -> NDArray[np.float32]:
    """Columns `HIDDEN` of all missions as they are now, shape (missions, columns)."""
    m, p, s, robot = batch.records, batch.robots, batch.known.shared[0], batch.known.robot
    here_m = m["position_m"] - m["place"] * s["place_m"]
    home_j = m["here"]["true_home_cost_j"] + here_m * m["here"]["true_home_j_per_m"]
    places = batch.routes["places"][:, : int(s["places"])]
    ahead = np.arange(places.shape[1]) >= m["place"][:, None]
    columns = (
        m["energy_j"] / s["usable_j"],
        (m["energy_j"] - home_j) / s["usable_j"],
        5.0 * (m["capacity_j"] / s["usable_j"] - 0.9),
        5.0 * (p["rolling_resistance"] / robot.rolling_resistance - 1.0),
        5.0 * p["payload_mass_kg"] / robot.mass_kg,
        (m["mean_east_mps"] + m["gust_east_mps"]) / 10.0,
        (m["mean_north_mps"] + m["gust_north_mps"]) / 10.0,
        *(scale * np.where(ahead, places[name], 0.0).sum(axis=1) / np.maximum(ahead.sum(axis=1), 1)
          for name, scale in (("sin_grade", 10.0), ("interest", 0.5))),
    )  # fmt: skip
    return np.stack(columns, axis=1).astype(np.float32)


class AsymmetricAdapter(SB3Adapter):
    """Missions whose inputs end with what only the critic is to see."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        assert self.observation_space.shape is not None
        columns = self.observation_space.shape[0] + len(HIDDEN)
        self.observation_space = spaces.Box(-LIMIT, LIMIT, (columns,), np.float32)

    def _seen(self, observations: NDArray[np.float32], begun: NDArray[np.bool_]) -> NDArray[np.float32]:
        return np.concatenate((super()._seen(observations, begun), hidden(self.env.batch)), axis=1)


class AsymmetricPolicy(ResidualPolicy):
    """A policy of all inputs but the last `HIDDEN`, and a value that sees those too."""

    def _build_mlp_extractor(self) -> None:
        assert self._valued is not None
        self.mlp_extractor = AsymmetricLayers(self.features_dim, self._hidden, self._valued)  # type: ignore[assignment]


class AsymmetricLayers(Layers):
    """Layers of which only the value sees the last `HIDDEN` inputs."""

    def __init__(self, inputs: int, width: int, valued: torch.Tensor) -> None:
        super().__init__(inputs - len(HIDDEN), width, torch.cat((valued, torch.ones(len(HIDDEN)))))
        self.value_net[0] = nn.Linear(inputs, width)

    def forward_actor(self, inputs: torch.Tensor) -> torch.Tensor:
        return super().forward_actor(inputs[:, : -len(HIDDEN)])


@contextmanager
def asymmetric() -> Iterator[None]:
    """Trainings with a critic that sees what is hidden."""
    with mock.patch.object(ppo, "SB3Adapter", AsymmetricAdapter), mock.patch.object(
        ppo, "ResidualPolicy", AsymmetricPolicy
    ):  # fmt: skip
        yield


def main(args: Args) -> None:
    """Train, compare and print the table.

    Raises:
        TrainingError, OptionError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.seeds < 1 or args.episodes < 2:
        raise TrainingError(f"--seeds {args.seeds} --episodes {args.episodes}: give at least 1 seed and 2 episodes")
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    plain = learn.Args(
        out=args.learned, difficulty=args.difficulty, seeds=args.seeds, steps=args.steps, episodes=args.episodes
    )
    rows = []
    for mission in args.missions:
        without = learn.compare(plain, mission, DMAX)
        with asymmetric():
            rows.append((without, learn.compare(dataclasses.replace(plain, out=args.out), mission, DMAX)))
    Console(width=130).print(table_of(args, rows))


def table_of(args: Args, rows: Sequence[tuple[Result, Result]]) -> Any:
    """A line for each mission, and for what is kept and what training ends with."""
    title = f"A critic that sees what is hidden: {args.episodes} unseen episodes, {args.seeds} training seeds, greedy"
    made = table(title, ("mission", "policy"), ("without", "with", "with minus without (95 %)", "stranded, with"))
    for without, seeing in rows:
        for name in ("best", "last"):
            first, second = (getattr(result, name)["greedy"] for result in (without, seeing))
            means = Bootstrap({"without": first.score, "with": second.score}, 0).means()
            ends = interval(means["with"] - means["without"])
            made.add_row(
                without.mission, name, f"{first.score.mean():.4g}", f"{second.score.mean():.4g}",
                span(float(second.score.mean() - first.score.mean()), ends, "+.3g"),
                rate(int(second.stranded.sum()), second.stranded.size),
            )  # fmt: skip
    return made


if __name__ == "__main__":
    refused = (TrainingError, OptionError)
    sys.exit(cli.run(main, Args, __doc__, refused, interrupted="the same command goes on"))
