"""Agents on the same episodes: `run_episodes` runs one, `tasks` several; statistics with intervals,
and plots."""

from homeward.agents.evaluation.episodes import (
    TRACE_COLUMNS,
    Episodes,
    Run,
    episode_seeds,
    run_episodes,
)

__all__ = ["TRACE_COLUMNS", "Episodes", "Run", "episode_seeds", "run_episodes"]
