"""Summary of an evaluation: statistics with intervals, paired comparisons, `evaluation.json` and
`episodes.csv`."""

from __future__ import annotations

import dataclasses
import itertools
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

import homeward
from homeward.agents.evaluation.episodes import Episodes, Run
from homeward.agents.evaluation.statistics import (
    Bootstrap,
    Scores,
    interval,
    iqm,
    performance_profile,
    probability_of_improvement,
    wilson,
)
from homeward.envs.docks import text_of
from homeward.envs.options import Options
from homeward.files import csv_text

SCHEMA = 1
"""Version of the format of evaluation.json."""
_FEWER = 1999
"""Resamples for statistics that take longer than means. Chosen: a 95 % interval then ends at ranks
50 and 1950."""
_THRESHOLDS = 101
"""Scores at which performance profiles are taken. Chosen: a line in steps of 1 %."""


@dataclass(frozen=True)
class Optima:
    """Optimum of each episode with full knowledge, as two bounds, shape (episodes,)."""

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]


@dataclass(frozen=True)
class Evaluation:
    """All agents on the same episodes: the content of `evaluation.json` and `episodes.csv`.

    Attributes:
        env: Id of the environment.
        options: Its keyword arguments.
        seed: Seed of the evaluation.
        seeds: Seeds of the episodes.
        runs: Runs of each agent, one per training seed.
        optimum: Bounds of each episode's optimum, if computed.
    """

    env: str
    options: Options
    seed: int
    seeds: list[int]
    runs: Mapping[str, Sequence[Run]]
    optimum: Optima | None = None

    def scores(self) -> dict[str, Scores]:
        """Scores of each agent, shape (training seeds, episodes)."""
        return {
            name: np.stack([run.episodes.score for run in runs]) for name, runs in self.runs.items()
        }

    def summary(self, rng: Generator) -> dict[str, Any]:
        """The content of `evaluation.json`; a copy of the generator draws the bootstrap."""
        scores = self.scores()
        drawn = Bootstrap(scores, rng)
        fewer = dataclasses.replace(drawn, resamples=_FEWER)
        means = drawn.means()
        iqms = fewer.iqms()
        agents = {}
        for name, runs in self.runs.items():
            agents[name] = {
                **_summary(runs, scores[name]),
                "score_ci95": self._interval(means[name]),
                "score_iqm_ci95": self._interval(iqms[name]),
                **_shares(scores[name], self.optimum),
            }
        paired = {}
        for baseline, agent in itertools.combinations(scores, 2):
            paired[f"{agent} - {baseline}"] = {
                "mean": _difference(scores[agent], scores[baseline]),
                "ci95": self._interval(means[agent] - means[baseline]),
                "relative": _relative(scores[agent], scores[baseline]),
                "probability_of_improvement": probability_of_improvement(
                    scores[agent], scores[baseline]
                ),
                "probability_ci95": self._interval(fewer.improvements(agent, baseline)),
            }
        thresholds = self.thresholds()
        profiles = {
            name: performance_profile(values, thresholds).tolist()
            for name, values in scores.items()
        }
        return {
            "schema": SCHEMA,
            "env": self.env,
            "options": _plain_options(self.options),
            "episodes": len(self.seeds),
            "seed": self.seed,
            "versions": _versions(),
            "agents": agents,
            "paired": paired,
            "optimum": _mean_bounds(self.optimum),
            "profiles": {"score": thresholds.tolist(), **profiles},
        }

    def _interval(self, samples: Scores) -> list[float] | None:
        """95 % interval of bootstrap samples, shape (resamples,); none of a single episode."""
        if len(self.seeds) == 1:
            return None
        return interval(samples)

    def thresholds(self) -> NDArray[np.float64]:
        """Scores at which performance profiles are taken, from 0 to the best."""
        highest = max(float(values.max()) for values in self.scores().values())
        return np.linspace(0.0, highest, _THRESHOLDS)

    def to_json(self, summary: Mapping[str, Any]) -> str:
        """`evaluation.json`, from the summary."""
        return json.dumps(summary, indent=2, allow_nan=False) + "\n"

    def to_csv(self) -> str:
        """`episodes.csv`: one row per agent, training seed and episode."""
        columns = [field.name for field in fields(Episodes)]
        bounds: dict[str, list[float]] = {}
        if self.optimum is not None:
            bounds["optimum_lower"] = self.optimum.lower.tolist()
            bounds["optimum_upper"] = self.optimum.upper.tolist()
        rows: list[list[Any]] = [["agent", "run", "episode", "seed", *columns, *bounds]]
        for name, runs in self.runs.items():
            for index, run in enumerate(runs):
                values = [_numbers(getattr(run.episodes, column)) for column in columns]
                for episode, row in enumerate(
                    zip(self.seeds, *values, *bounds.values(), strict=True)
                ):
                    rows.append([name, index, episode, *row])
        return csv_text(rows)


def _numbers(values: NDArray[Any]) -> list[Any]:
    """Numbers of a column, with 1 for true and 0 for false."""
    if values.dtype == np.bool_:
        values = values.astype(np.int64)
    return list(values.tolist())


def _plain_options(options: Options) -> dict[str, Any]:
    """Keyword arguments of an environment, for JSON."""
    plain = {name: _plain(value) for name, value in vars(options).items() if name != "mission"}
    return plain | {"docks": text_of(options.docks)}


def _mean_bounds(optimum: Optima | None) -> dict[str, float] | None:
    """Means of both bounds over the episodes."""
    if optimum is None:
        return None
    return {"lower": float(optimum.lower.mean()), "upper": float(optimum.upper.mean())}


def _difference(scores: Scores, baseline: Scores) -> float:
    """Mean score of an agent less that of another."""
    return float(scores.mean() - baseline.mean())


def _relative(scores: Scores, baseline: Scores) -> float | None:
    """The same over the mean score of the other; None where that is 0."""
    return _ratio(_difference(scores, baseline), float(baseline.mean()))


def _ratio(numerator: float, denominator: float) -> float | None:
    """None where there is nothing to compare with: scores, and bounds but for rounding, are not
    negative."""
    if denominator <= 0.0:
        return None
    return numerator / denominator


def _summary(runs: Sequence[Run], scores: Scores) -> dict[str, Any]:
    stranded = np.stack([run.episodes.stranded for run in runs])
    home = np.stack([run.episodes.home for run in runs])
    left_j = np.stack([run.episodes.energy_left_j for run in runs])
    left_home_j = None
    if home.any():
        left_home_j = float(left_j[home].mean())
    events = int(stranded.sum())
    return {
        "training_seeds": len(runs),
        "score_mean": float(scores.mean()),
        "score_iqm": iqm(scores),
        "stranded": events,
        "stranded_rate": events / stranded.size,
        "stranded_ci95": wilson(events, stranded.size),
        "timed_out": int(sum(run.episodes.timed_out.sum() for run in runs)),
        "energy_left_home_j": left_home_j,
        "decision_us": float(np.median([run.decision_us for run in runs])),
    }


def _shares(scores: Scores, optimum: Optima | None) -> dict[str, float | None]:
    """Mean score over that of the oracle's rollout, and over the upper bound: the true share is
    between."""
    if optimum is None:
        return {"share_of_optimum": None, "share_of_optimum_at_least": None}
    mean = float(scores.mean())
    return {
        "share_of_optimum": _ratio(mean, float(optimum.lower.mean())),
        "share_of_optimum_at_least": _ratio(mean, float(optimum.upper.mean())),
    }


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, int | float | str):
        return value
    return str(value)


def _versions() -> dict[str, str]:
    used = ["numpy", "numba", "gymnasium", "scipy"]
    if "torch" in sys.modules:
        used.append("torch")
    return {"homeward": homeward.__version__, "python": platform.python_version()} | {
        library: version(library) for library in used
    }
