"""The learning curve: the score of the policy, as it would be deployed, from time to time during
training."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from homeward.agents.base import Policy
from homeward.agents.evaluation.episodes import Episodes, episode_seeds, run_episodes
from homeward.agents.learning.settings import TrainingError
from homeward.agents.trained.run_folder import CURVE
from homeward.envs.options import Options
from homeward.files import csv_text, write_whole

EPISODES = 500
"""Episodes of a point. Chosen: a share of them has an error of at most 4.4 percentage points (95
%)."""
SEED = 1_000_003
"""Seed of the episodes of curves: neither those of training nor, unless asked for, those of an
evaluation."""


@dataclass(frozen=True)
class Point:
    """A policy at some point of its training; `trained_s` excludes the time of the curve itself."""

    steps: int
    trained_s: float
    score: float
    stranded_rate: float
    late_rate: float


@dataclass(frozen=True)
class EvaluatedCurve:
    """The learning curve of a run on the missions of an evaluation.

    Attributes:
        present: The policy of each point.
        best_so_far: The policy that the run would have kept had it ended at that point; the last
            one is the policy kept.
    """

    present: list[Point]
    best_so_far: list[Point]


def measure(policy: Policy, options: Options, steps: int, trained_s: float) -> Point:
    """Run the episodes of curves."""
    episodes = run_episodes(policy, options, episode_seeds(SEED, EPISODES)).episodes
    return point_of(episodes, steps, trained_s)


def point_of(episodes: Episodes, steps: int, trained_s: float) -> Point:
    """The point of a policy by its episodes."""
    return Point(
        steps=steps,
        trained_s=trained_s,
        score=float(episodes.score.mean()),
        stranded_rate=float(episodes.stranded.mean()),
        late_rate=float(episodes.timed_out.mean()),
    )


def best_so_far(points: Sequence[Point]) -> list[int]:
    """For each point, which one is kept if the run ends there: the best, the latest of equals; the
    first one counts only while it is alone.

    >>> scores = (7.0, 1.0, 3.0, 2.0, 3.0)
    >>> best_so_far([Point(k, 0.0, score, 0.0, 0.0) for k, score in enumerate(scores)])
    [0, 1, 2, 2, 4]
    """
    best_indices: list[int] = []
    best_index = 0
    for index, point in enumerate(points):
        best_point = points[best_index]
        if best_point.steps == 0 or point.score >= best_point.score:
            best_index = index
        best_indices.append(best_index)
    return best_indices


def read_curve(folder: Path) -> list[Point]:
    """The curve of a run, empty if there is none.

    Raises:
        TrainingError: The file is damaged.
    """
    if not (folder / CURVE).is_file():
        return []
    try:
        rows = csv.DictReader(io.StringIO((folder / CURVE).read_text("utf-8")))
        return [
            Point(
                steps=int(row["steps"]),
                trained_s=float(row["trained_s"]),
                score=float(row["score"]),
                stranded_rate=float(row["stranded_rate"]),
                late_rate=float(row["late_rate"]),
            )
            for row in rows
        ]
    except (ValueError, KeyError, TypeError, csv.Error):
        raise TrainingError(
            f"{folder / CURVE} is damaged: delete it to continue with a new curve"
        ) from None


def write_curve(folder: Path, points: list[Point]) -> None:
    """Write the curve of a run, completely or not at all.

    Raises:
        OSError: The folder cannot be written to.
    """
    rows: list[list[Any]] = [[field.name for field in fields(Point)]]
    for point in points:
        steps, *figures = astuple(point)
        rows.append([steps, *(f"{value:.6g}" for value in figures)])
    write_whole(folder / CURVE, csv_text(rows))
