"""Agents on the same episodes: run, summarise with intervals, compare in pairs."""

from __future__ import annotations

import csv
import io
import itertools
import json
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import homeward
from homeward.agents.base import Policy
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv

SCHEMA = 1
_SIDE_BY_SIDE = 512
"""Missions that run at once."""
_RESAMPLES = 9999
_CHUNK = 4_000_000
"""Numbers that the bootstrap holds at once."""


@dataclass(frozen=True)
class Episodes:
    """What came of an agent's episodes; arrays of shape (episodes,), in columns of `episodes.csv`.

    Attributes:
        score: Score of the mission, 0 unless the robot got home.
        home: Whether it got home.
        stranded: Whether its battery ran empty on the way.
        timed_out: Whether the time limit came first.
        energy_left_j: Energy in the battery at the end, J.
        furthest_m: Furthest distance from home along the route, m.
        time_s: Duration, s.
        decisions: Number of decisions.
    """

    score: NDArray[np.float64]
    home: NDArray[np.bool_]
    stranded: NDArray[np.bool_]
    timed_out: NDArray[np.bool_]
    energy_left_j: NDArray[np.float64]
    furthest_m: NDArray[np.float64]
    time_s: NDArray[np.float64]
    decisions: NDArray[np.int64]


TRACED = ("time_s", "energy_share", "position_m", "speed_mps", "sensing_hz")
"""Columns of a trace: time, true state of charge, distance from home, speed and sensing rate of the last decision."""


@dataclass(frozen=True)
class Run:
    """An agent's episodes, the median time of a decision in microseconds, and how the first missions went.

    `traces` has shape (decisions + 1, missions, TRACED): the start of the first missions and the end of every decision;
    a mission that is over stays as it is. `interest` is that of their routes, shape (missions, places).
    """

    episodes: Episodes
    decision_us: float
    traces: NDArray[np.float32]
    interest: NDArray[np.float32]


def episode_seeds(seed: int, count: int) -> list[int]:
    """Seeds of episodes, one each; the first ones are the same for any count.

    They are at least 2^63, so that no evaluation meets an episode of training, whose seeds are small.

    Args:
        seed: Seed of the evaluation, 0 or above.
        count: Number of episodes.

    >>> [hex(one) for one in episode_seeds(7, 2)] == [hex(one) for one in episode_seeds(7, 3)[:2]]
    True
    """
    words = np.random.SeedSequence(seed).generate_state(count, np.uint64)
    return [int(word) | 1 << 63 for word in words]


def run_episodes(
    policy: Policy,
    options: Options,
    seeds: Sequence[int],
    advance: Callable[[int], None] = lambda episodes: None,
) -> Run:
    """Run one agent, a batch of missions side by side.

    Args:
        policy: The agent, made for such an environment.
        options: Keyword arguments of the environment.
        seeds: Seed of each episode.
        advance: Called with the number of episodes that just ended.
    """
    parts: list[Episodes] = []
    times_us: list[float] = []
    for start in range(0, len(seeds), _SIDE_BY_SIDE):
        part = seeds[start : start + _SIDE_BY_SIDE]
        env = HomewardVectorEnv(len(part), autoreset_mode="Disabled", **vars(options))
        episodes, part_us, states = _run_batch(policy, env, part, advance)
        parts.append(episodes)
        times_us += part_us
        if start == 0:
            places = env.batch.setting.shared["places"][0]
            traces, interest = states, env.batch.routes["places"]["interest"][:, :places].copy()
    whole = {one.name: np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Episodes)}
    return Run(Episodes(**whole), float(np.median(times_us)), traces, interest)


def _run_batch(
    policy: Policy, env: HomewardVectorEnv, seeds: Sequence[int], advance: Callable[[int], None]
) -> tuple[Episodes, list[float], NDArray[np.float32]]:
    """Run missions to their ends on the bare batch, which leaves those that are over as they are."""
    batch, count = env.batch, env.num_envs
    observations, _ = env.reset(seed=list(seeds))
    rewards, terminated, truncated = np.empty(count), np.empty(count, np.bool_), np.empty(count, np.bool_)
    begun, over = np.ones(count, np.bool_), 0
    times_us, states = [], [_state(batch.records)]
    while over < count:
        start = time.perf_counter()
        actions = policy.act(observations, begun)
        times_us.append(1e6 * (time.perf_counter() - start) / count)
        ended = batch.step(actions, observations, rewards, terminated, truncated)
        states.append(_state(batch.records))
        begun = np.zeros(count, np.bool_)
        over += ended
        advance(ended)
    return _outcome(batch.records), times_us, np.stack(states)


def _state(records: NDArray[np.void]) -> NDArray[np.float32]:
    charge = records["energy_j"] / records["capacity_j"]
    columns = (records["time_s"], charge, records["position_m"], records["speed_mps"], records["sensing_hz"])
    return np.stack(columns, axis=-1).astype(np.float32)


def _outcome(records: NDArray[np.void]) -> Episodes:
    home, stranded = records["home"].copy(), records["depleted"].copy()
    return Episodes(
        score=np.where(home, records["score"], 0.0),
        home=home,
        stranded=stranded,
        timed_out=~home & ~stranded,
        energy_left_j=records["energy_j"].copy(),
        furthest_m=records["furthest_m"].copy(),
        time_s=records["time_s"].copy(),
        decisions=records["decisions"].copy(),
    )


@dataclass(frozen=True)
class Evaluation:
    """All agents on the same episodes: what `evaluation.json` and `episodes.csv` hold."""

    env: str
    options: Options
    seed: int
    seeds: list[int]
    runs: Mapping[str, Run]

    def summary(self) -> dict[str, Any]:
        """The content of `evaluation.json`."""
        names = list(self.runs)
        pairs = [(later, earlier) for earlier, later in itertools.combinations(names, 2)]
        scores = {name: run.episodes.score for name, run in self.runs.items()}
        rows = [scores[name] for name in names] + [scores[a] - scores[b] for a, b in pairs]
        intervals = _bootstrap(np.stack(rows), self.seed)
        return {
            "schema": SCHEMA,
            "env": self.env,
            "options": {name: _plain(value) for name, value in vars(self.options).items() if name != "mission"},
            "episodes": len(self.seeds),
            "seed": self.seed,
            "versions": _versions(),
            "agents": {name: _summary(self.runs[name], ci) for name, ci in zip(names, intervals, strict=False)},
            "paired": {
                f"{a} - {b}": _difference(scores[a], scores[b], ci)
                for (a, b), ci in zip(pairs, intervals[len(names) :], strict=True)
            },
        }

    def to_json(self, summary: Mapping[str, Any]) -> str:
        """`evaluation.json`, from the summary."""
        return json.dumps(summary, indent=2, allow_nan=False) + "\n"

    def to_csv(self) -> str:
        """`episodes.csv`: one row per agent and episode."""
        columns = [one.name for one in fields(Episodes)]
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["agent", "episode", "seed", *columns])
        for name, run in self.runs.items():
            values = (getattr(run.episodes, column).tolist() for column in columns)
            for episode, (seed, *row) in enumerate(zip(self.seeds, *values, strict=True)):
                writer.writerow([name, episode, seed, *(int(one) if isinstance(one, bool) else one for one in row)])
        return text.getvalue()


def _bootstrap(rows: NDArray[np.float64], seed: int) -> list[list[float] | None]:
    """95 % percentile intervals of the mean of each row; all rows resample the same episodes."""
    count = rows.shape[1]
    if count < 2:
        return [None] * len(rows)
    chunk = max(1, _CHUNK // rows.size)
    found = stats.bootstrap(
        (rows,), np.mean, n_resamples=_RESAMPLES, batch=chunk, axis=-1, method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval  # fmt: skip
    lows, highs = np.asarray(found.low), np.asarray(found.high)
    return [[float(low), float(high)] for low, high in zip(lows, highs, strict=True)]


def _summary(run: Run, score_ci95: list[float] | None) -> dict[str, Any]:
    episodes, count = run.episodes, len(run.episodes.score)
    stranded = int(episodes.stranded.sum())
    wilson = stats.binomtest(stranded, count).proportion_ci(method="wilson")
    return {
        "score_mean": float(episodes.score.mean()),
        "score_ci95": score_ci95,
        "score_iqm": float(stats.trim_mean(episodes.score, 0.25)),
        "stranded": stranded,
        "stranded_rate": stranded / count,
        "stranded_ci95": [float(wilson.low), float(wilson.high)],
        "timed_out": int(episodes.timed_out.sum()),
        "energy_left_home_j": float(episodes.energy_left_j[episodes.home].mean()) if episodes.home.any() else None,
        "share_of_optimum": None,
        "decision_us": run.decision_us,
    }


def _difference(a: NDArray[np.float64], b: NDArray[np.float64], ci95: list[float] | None) -> dict[str, Any]:
    mean, base = float((a - b).mean()), float(b.mean())
    return {"mean": mean, "ci95": ci95, "relative": mean / base if base else None}


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, int | float | str) else str(value)


def _versions() -> dict[str, str]:
    used = ["numpy", "numba", "gymnasium", "scipy"] + ["torch"] * ("torch" in sys.modules)
    return {"homeward": homeward.__version__, "python": platform.python_version()} | {one: version(one) for one in used}
