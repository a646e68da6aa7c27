"""Agents on the same episodes: seeds, and the result of each episode; `summary` computes
statistics."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Policy
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv

SIDE_BY_SIDE = 512
"""Missions that run side by side. Chosen: work for four threads (`_MISSIONS_A_THREAD` in
`homeward.envs.threads`), in records of less than 1 MB."""


@dataclass(frozen=True)
class Episodes:
    """Results of an agent's episodes; arrays of shape (episodes,), in columns of `episodes.csv`.

    Attributes:
        score: Score of the mission, 0 unless the robot got home.
        home: Whether it got home.
        stranded: Whether its battery was empty before home.
        timed_out: Whether the time limit was reached.
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


TRACE_COLUMNS = ("time_s", "energy_share", "position_m", "speed_mps", "sensing_hz")
"""Columns of a trace: time, true state of charge, distance from home, speed and sensing rate of the
last decision."""


@dataclass(frozen=True)
class Run:
    """An agent's episodes, the median time of a decision in microseconds, and traces of the first
    missions.

    `traces` has shape (decisions + 1, missions, TRACE_COLUMNS): the start of the first missions and
    the end of every decision; a mission that is over stays as it is. `interest` is that of their
    routes, shape (missions, places).
    """

    episodes: Episodes
    decision_us: float
    traces: NDArray[np.float32]
    interest: NDArray[np.float32]

    def followed_by(self, later_runs: Sequence[Run]) -> Run:
        """This run and further ones of the same agent as one; only its own traces are kept."""
        parts = (self, *later_runs)
        episodes = {
            field.name: np.concatenate([getattr(part.episodes, field.name) for part in parts])
            for field in fields(Episodes)
        }
        decision_us = float(np.median([part.decision_us for part in parts]))
        return replace(self, episodes=Episodes(**episodes), decision_us=decision_us)

    def without_traces(self) -> Run:
        """The same run without traces."""
        return replace(
            self,
            traces=np.empty((0, 0, len(TRACE_COLUMNS)), np.float32),
            interest=np.empty((0, 0), np.float32),
        )


def episode_seeds(seed: int, count: int) -> list[int]:
    """Seeds of episodes, one each; the first ones are the same for any count.

    They are at least 2^63, so that no evaluation uses an episode of training, whose seeds are
    small.

    Args:
        seed: Seed of the evaluation, 0 or above.
        count: Number of episodes.

    >>> episode_seeds(7, 2) == episode_seeds(7, 3)[:2]
    True
    """
    words = np.random.SeedSequence(seed).generate_state(count, np.uint64)
    return [int(word) | 1 << 63 for word in words]


def run_episodes(policy: Policy, options: Options, seeds: Sequence[int]) -> Run:
    """Run one agent, a batch of missions side by side.

    Args:
        policy: The agent, made for such an environment.
        options: Keyword arguments of the environment.
        seeds: Seed of each episode, at least one.
    """
    first_batch = _run_batch(policy, options, seeds[:SIDE_BY_SIDE])
    later_batches = [
        _run_batch(policy, options, seeds[start : start + SIDE_BY_SIDE]).without_traces()
        for start in range(SIDE_BY_SIDE, len(seeds), SIDE_BY_SIDE)
    ]
    return first_batch.followed_by(later_batches)


def _run_batch(policy: Policy, options: Options, seeds: Sequence[int]) -> Run:
    """Run missions to their ends on the bare batch, which leaves finished ones unchanged."""
    # The environment would refuse a step with finished missions in it.
    count = len(seeds)
    env = HomewardVectorEnv(count, autoreset_mode="Disabled", **vars(options))
    batch = env.batch
    observations, _ = env.reset(seed=list(seeds))
    rewards = np.empty(count)
    terminated = np.empty(count, np.bool_)
    truncated = np.empty(count, np.bool_)
    begun = np.ones(count, np.bool_)
    over = 0
    times_us = []
    states = [_state(batch.records)]
    while over < count:
        start_s = time.perf_counter()
        actions = policy.act(observations, begun)
        took_s = time.perf_counter() - start_s
        times_us.append(1e6 * took_s / count)
        over += batch.step(actions, observations, rewards, terminated, truncated)
        states.append(_state(batch.records))
        begun = np.zeros(count, np.bool_)
    places = batch.known.shared["places"][0]
    interest = batch.routes["places"]["interest"][:, :places].copy()
    return Run(
        episodes=_outcome(batch.records),
        decision_us=float(np.median(times_us)),
        traces=np.stack(states),
        interest=interest,
    )


def _state(records: NDArray[np.void]) -> NDArray[np.float32]:
    charge = records["energy_j"] / records["capacity_j"]
    columns = (
        records["time_s"],
        charge,
        records["position_m"],
        records["speed_mps"],
        records["sensing_hz"],
    )
    return np.stack(columns, axis=-1).astype(np.float32)


def _outcome(records: NDArray[np.void]) -> Episodes:
    home = records["home"].copy()
    stranded = records["depleted"].copy()
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
