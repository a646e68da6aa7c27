"""The learning curve: the score of the policy, as it would be deployed, from time to time during training."""

from __future__ import annotations

import csv
import io
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from homeward.agents.base import Policy
from homeward.agents.evaluation.episodes import episode_seeds, run_episodes
from homeward.agents.learning.settings import TrainingError
from homeward.agents.trained.run_folder import CURVE
from homeward.envs.options import Options
from homeward.files import csv_text, write_whole

EPISODES = 500
"""Episodes of a point. Chosen: a share of them has an error of at most 4.4 percentage points (95 %)."""
SEED = 1_000_003
"""Seed of the episodes of curves: neither those of training nor, unless asked for, those of an evaluation."""


@dataclass(frozen=True)
class Point:
    """A policy at some point of its training; `trained_s` excludes the time of the curve itself."""

    steps: int
    trained_s: float
    score: float
    stranded_rate: float
    late_rate: float


def measure(policy: Policy, options: Options, steps: int, trained_s: float) -> Point:
    """Run the episodes of curves."""
    episodes = run_episodes(policy, options, episode_seeds(SEED, EPISODES)).episodes
    means = (float(values.mean()) for values in (episodes.score, episodes.stranded, episodes.timed_out))
    return Point(steps, trained_s, *means)


def read_curve(folder: Path) -> list[Point]:
    """The curve of a run, empty if there is none.

    Raises:
        TrainingError: The file is damaged.
    """
    if not (folder / CURVE).is_file():
        return []
    try:
        rows = csv.DictReader(io.StringIO((folder / CURVE).read_text("utf-8")))
        return [Point(int(row["steps"]), *(float(row[field.name]) for field in fields(Point)[1:])) for row in rows]
    except (ValueError, KeyError, TypeError, csv.Error):
        raise TrainingError(f"{folder / CURVE} is damaged: delete it to continue with a new curve") from None


def write_curve(folder: Path, points: list[Point]) -> None:
    """Write the curve of a run, completely or not at all.

    Raises:
        OSError: The folder cannot be written to.
    """
    rows = ((point.steps, *(f"{value:.6g}" for value in astuple(point)[1:])) for point in points)
    write_whole(folder / CURVE, csv_text([[field.name for field in fields(Point)], *rows]))
