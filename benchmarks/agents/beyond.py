"""Whether a learned turn gets beyond the planner's, and how far any turn could: figures of docs/learning.md.

`python benchmarks/agents/beyond.py` drives missions as the planner does, but for its turn. At every decision near it a
copy of the mission heads home, which tells of each chance to turn what would have come of it. On the same drives it
compares, at equal stranding,

* the planner's turn: where the margin home, as believed, is down to some standard deviations;
* a learned one: a network moves that margin by what is observed and believed. It climbs the exact gradient of the
  expected score (Becker, Cheridito and Jentzen, Deep optimal stopping, JMLR 20, 2019), and meets missions that it has
  not learned from;
* the last chance from which the robot gets home: no turn on these drives scores more.

The planner itself drives more slowly when it has little to spare. OUT/beyond.json holds the rows; finished ones are
kept: a run that was killed goes on.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.kept import Kept
from benchmarks.tables import span, table
from homeward import cli
from homeward.agents.base import Observations
from homeward.agents.evaluation import episode_seeds
from homeward.agents.evaluation.margins import Curve
from homeward.agents.evaluation.statistics import interval
from homeward.agents.planner import Planner
from homeward.agents.rules.dmax_belief import BeliefDmaxRule
from homeward.envs import kernel
from homeward.envs.actions import LEVELS
from homeward.envs.batch import Batch
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.features import INDEX, OBSERVATION_DTYPE
from homeward.envs.options import OptionError, Options
from homeward.envs.state import RETURN
from homeward.envs.vector import HomewardVectorEnv
from homeward.estimation.prior import EAST, GAIN, NORTH, PER_CAPACITY, ROLLING, WEIGHT

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
DRIVEN = {"OutAndBack": -3.0, "Survey": -1.0}
"""Standard deviations that the planner keeps back as it drives: so few that it goes on past its turn as before, and on
surveys, where its prices follow from what it has to spare, not many fewer than at its turn."""
RESERVES = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.5)
"""Standard deviations at which turns are compared, the planner's and the learned one."""
RATES = {"0.5 %": 0.005, "1 %": 0.01}
"""Rates of stranding at which they are."""
_NEVER = -1e9  # standard deviations: it turns for its time and at the end of the route alone
_NEAR = 9.0  # standard deviations of margin from which chances are noted: more than the most reserve
_LACKING = -0.01  # of the battery: a margin after which no chance is looked for that gets home
_LENT = 0.5  # of the battery: to a copy, so that it comes home and tells what it lacked
_HOMEWARD = range(LEVELS // 2, LEVELS)  # levels of speed of a copy
_FIRST_SEED = (1 << 62) + 10 * (1 << 32)  # of training: beyond those that benchmarks/tune.py meets
_RESAMPLES = 999
_HIDDEN, _RATE, _BATCH, _DECAY = 32, 3e-3, 512, 1e-3
_RESERVE, _SHARPNESS, _SURE = 3.0, 3.0, 20.0
"""In training turns are drawn, by a logistic function of the margin below a reserve, in standard deviations."""


@dataclass(frozen=True)
class Args:
    """What to compare."""

    missions: tuple[str, ...] = tuple(DRIVEN)
    """Missions."""
    difficulties: tuple[str, ...] = ("uncertain", "harsh")
    """Difficulties."""
    training: int = 2048
    """Missions that are learned from."""
    episodes: int = 1024
    """Missions of each comparison."""
    seeds: tuple[int, ...] = (7, 29)
    """Seeds that they follow from, as in evaluate.py; one comparison each."""
    epochs: int = 60
    """Times that each mission is learned from."""
    out: Path = Path("runs/beyond")
    """Folder of the results."""


class Chances(NamedTuple):
    """Chances to turn: decisions on the way out from near the turn on, arrays of shape (missions, chances).

    Attributes:
        inputs: What is observed and believed, float32, shape (missions, chances, inputs).
        margin: Believed margin of going on and then home, in its standard deviations; infinite where there is none.
        score: What comes of turning there, 0 where the robot strands.
        home: Whether it gets home.
        forced: Whether it turns there in any case, as its time or the route is over.
    """

    inputs: NDArray[np.float32]
    margin: Array
    score: Array
    home: Mask
    forced: Mask

    def outcome(self, margin: Array, reserve: float) -> tuple[Array, Mask]:
        """Score and stranding of missions that turn where a margin is first below a reserve, shape (missions,) each."""
        turns = (margin < reserve) | self.forced
        first = np.arange(len(turns)), turns.argmax(axis=1)
        home = turns.any(axis=1) & self.home[first]
        return np.where(home, self.score[first], 0.0), ~home


def drive_on(options: Options, seeds: Sequence[int]) -> Chances:
    """Drive missions as the planner does but for its turn, and note what would come of every chance to turn."""
    count, found = len(seeds), list[tuple[NDArray[Any], ...]]()
    env = HomewardVectorEnv(count, autoreset_mode="Disabled", **vars(options))
    batch, (observations, _) = env.batch, env.reset(seed=list(seeds))
    planner = Planner(batch.known, DRIVEN[options.mission])
    rule = planner.rule
    assert isinstance(rule, BeliefDmaxRule)
    results = np.empty(count), np.empty(count, np.bool_), np.empty(count, np.bool_)
    begun, over = np.ones(count, np.bool_), np.zeros(count, np.bool_)
    while not over.all():
        rule.deviations = _NEVER
        forced = rule.turns(observations, begun)
        rule.deviations = DRIVEN[options.mission]
        actions = planner.drive(observations, forced | over)
        outlook = rule.outlook
        margin = (outlook.left - outlook.home - outlook.onwards) / np.maximum(outlook.deviation, 1e-9)
        near = (~over & ((margin < _NEAR) | forced)).nonzero()[0]
        left = margin_home(batch, near)
        inputs = np.concatenate((observations, _believed(rule, observations, margin)), axis=1)[near]
        score = np.where(left > 0.0, batch.records["score"][near], 0.0)
        found.append((near, inputs, margin[near], score, left > 0.0, forced[near]))
        over[near] |= (left < _LACKING) | forced[near]
        batch.records["over"] |= over
        batch.step(actions, observations, *results)
        over |= batch.records["over"]
        observations[over, INDEX["home_cost"]] = np.nan  # of these, nothing is estimated any more
        begun = np.zeros(count, np.bool_)
    return _by_mission(found, count)


def _by_mission(found: list[tuple[NDArray[Any], ...]], count: int) -> Chances:
    """Chances by mission, from those of each decision with the missions that they are of."""
    missions, *columns = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(missions, kind="stable")  # of each mission in turn, as they came
    missions, counts = missions[order], np.bincount(missions, minlength=count)
    at, shape = np.arange(len(missions)) - np.repeat(counts.cumsum() - counts, counts), (count, counts.max())
    laid = [np.zeros((*shape, *column.shape[1:]), column.dtype) for column in columns]
    laid[1][:] = np.inf
    for whole, column in zip(laid, columns, strict=True):
        whole[missions, at] = column[order]
    return Chances(*laid)


def margin_home(batch: Batch, chosen: NDArray[np.int64]) -> Array:
    """Energy left at home if missions return now, a share of the usable energy; below 0 it is what is lacking.

    Each drives home at that of the upper levels of speed which leaves most.

    Args:
        batch: Missions on their way out; nothing of it is changed.
        chosen: Which of them, shape (k,), as what is returned.
    """
    margins, count, lent_j = [], len(chosen), _LENT * batch.known.shared["usable_j"][0]
    results = np.zeros(count, OBSERVATION_DTYPE), np.empty(count), *np.empty((2, count), np.bool_)
    robots, routes, levels = batch.robots[chosen], batch.routes[chosen], np.empty((0, 3), np.float32)
    for speed in _HOMEWARD:
        records, actions = batch.records[chosen], np.tile(np.array([[speed, 0, RETURN]]), (count, 1))  # a copy
        records["energy_j"] += lent_j
        while not records["over"].all():
            kernel.step_in_turn(actions, levels, batch.constants, records, robots, routes, *results)
        margins.append(np.where(records["home"], _LENT * (records["energy_j"] / lent_j - 1.0), -_LENT))
    return np.asarray(np.max(margins, axis=0))


def _believed(rule: BeliefDmaxRule, observations: Observations, margin: Array) -> NDArray[np.float32]:
    """What the planner believes of itself, the wind and the way home, about 1 in size, shape (missions, columns)."""
    outlook, belief = rule.outlook, rule.belief
    plans = belief.plans(observations)
    plans["home_cost_j"][margin >= _NEAR] = np.nan
    spread, hypotheses = belief.margin(plans, RATES["0.5 %"]), belief.estimator.state["hypotheses"]
    mean, weight = belief.estimator.mean(), np.exp(hypotheses["log_weight"])
    variance = np.einsum("nk,nkaa->na", weight, hypotheses["covariance"])
    columns = (
        outlook.left, outlook.home, 20.0 * outlook.onwards, 20.0 * outlook.deviation, margin * outlook.deviation,
        np.clip(margin, -4.0, _NEAR), weight.max(axis=1),
        *(mean[:, [ROLLING, WEIGHT, GAIN]] * mean[:, [PER_CAPACITY]]).T,
        0.1 * mean[:, EAST], 0.1 * mean[:, NORTH], *np.sqrt(variance[:, [EAST, NORTH, PER_CAPACITY]]).T,
        (spread.total["margin_low_j"] - spread.total["margin_j"]) / np.maximum(spread.total["margin_sd_j"], 1e-9),
    )  # fmt: skip
    return np.stack(columns, axis=1).astype(np.float32)


def learn_turn(chances: Chances, epochs: int, seed: int) -> Callable[[Chances], Array]:
    """Train a network that moves the margin, on missions of which all chances are known.

    Args:
        chances: Of the missions.
        epochs: Times that each is learned from.
        seed: Of the weights and the order of the missions.

    Returns:
        A function from chances to their margins as learned, in standard deviations, shape (missions, chances).
    """
    there = np.isfinite(chances.margin)
    mean, deviation = (one(chances.inputs[there], axis=0) for one in (np.mean, np.std))

    def scaled(some: Chances) -> torch.Tensor:
        return torch.as_tensor(np.clip((some.inputs - mean) / (deviation + 1e-6), -4.0, 4.0))

    torch.manual_seed(seed)
    last = torch.nn.Linear(_HIDDEN, 1)
    torch.nn.init.zeros_(last.weight)
    network = torch.nn.Sequential(torch.nn.Linear(len(mean), _HIDDEN), torch.nn.Tanh(), last)
    optimizer = torch.optim.Adam(network.parameters(), lr=_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs)
    inputs, margin = scaled(chances), torch.as_tensor(np.where(there, chances.margin, 2.0 * _NEAR).astype(np.float32))
    score = torch.as_tensor((chances.score / chances.score.max(axis=1).mean()).astype(np.float32))
    forced, rng = torch.as_tensor(chances.forced), np.random.default_rng(seed)
    for _ in range(epochs):
        for some in map(torch.as_tensor, np.split(rng.permutation(len(score)), range(_BATCH, len(score), _BATCH))):
            moved = network(inputs[some])[..., 0]
            logit = torch.where(forced[some], _SURE, _SHARPNESS * (_RESERVE - margin[some] + moved))
            on = torch.nn.functional.logsigmoid(-logit)
            turns = torch.exp(torch.nn.functional.logsigmoid(logit) + on.cumsum(dim=1) - on)  # here and not before
            loss = _DECAY * moved.square().mean() - (turns * score[some]).sum(dim=1).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        schedule.step()

    def learned(some: Chances) -> Array:
        with torch.no_grad():
            return np.asarray(some.margin - network(scaled(some))[..., 0].numpy())

    return learned


def compare(chances: Chances, learned: Array, seed: int) -> dict[str, Any]:
    """How far a learned margin and the last chance that gets home are above the planner's turn, at each of `RATES`.

    Args:
        chances: Of some missions.
        learned: Their margins as learned, in standard deviations.
        seed: Of resampling.
    """
    count, last = len(chances.score), chances.score.max(axis=1)
    rng, row = np.random.default_rng(seed), dict[str, Any]()
    weights = np.vstack((np.ones(count), rng.multinomial(count, np.full(count, 1.0 / count), _RESAMPLES))) / count
    curves = {}
    for name, margin in (("planner", chances.margin), ("learned", learned)):
        runs = zip(*(chances.outcome(margin, reserve) for reserve in RESERVES), strict=True)
        points = [weights @ np.stack(one, axis=1) for one in runs]
        curves[name] = [Curve(RESERVES, *map(tuple, point)) for point in zip(*points, strict=True)]
        row[name] = {"score": curves[name][0].score, "stranded": curves[name][0].stranded}
    for told, rate in RATES.items():
        planner, ours = (np.array([one.at(rate) or np.nan for one in some]) for some in curves.values())
        row[told] = {"planner": planner[0]}
        for name, scores in (("learned", ours), ("last", weights @ last)):
            gains = scores / planner - 1.0
            row[told] |= {name: gains[0], f"{name}_ci95": interval(gains[np.isfinite(gains)])}
    return row


def main(args: Args) -> None:
    """Drive, learn, compare, and print the tables.

    Raises:
        OptionError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if not set(args.missions) <= set(DRIVEN) or not set(args.difficulties) <= set(DIFFICULTIES):
        raise OptionError(f"give --missions of {', '.join(DRIVEN)} and --difficulties of {', '.join(DIFFICULTIES)}")
    if min(args.training, args.episodes, args.epochs) < 1 or min(args.seeds, default=-1) < 0:
        raise OptionError("give --training, --episodes and --epochs of at least 1, and --seeds of 0 or more")
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    settings = {"training": args.training, "episodes": args.episodes, "epochs": args.epochs, "seeds": args.seeds}
    console, kept = Console(width=120), Kept(args.out / "beyond.json", **settings)
    for mission, difficulty in itertools.product(args.missions, args.difficulties):
        name = f"{mission}, {difficulty}"
        if name not in kept.results:
            kept.keep(name, rows_of(args, Options(mission, difficulty=difficulty)))
        console.print(_table(name, kept.results[name]))


def rows_of(args: Args, options: Options) -> dict[str, Any]:
    """Comparisons on the missions that were learned from, and on those of each seed."""
    own = drive_on(options, range(_FIRST_SEED, _FIRST_SEED + args.training))
    learned = learn_turn(own, args.epochs, 0)
    rows = {"learned from": compare(own, learned(own), 0)}
    for seed in args.seeds:
        unseen = drive_on(options, episode_seeds(seed, args.episodes))
        rows[f"seed {seed}"] = compare(unseen, learned(unseen), seed)
    return rows


def _table(name: str, rows: Mapping[str, Any]) -> Table:
    right = ("stranded", "planner's", "learned, above it (95 %)", "last chance, above it (95 %)")
    shown = table(f"{name}: turns on the same drives", ("missions",), right)
    for (missions, row), stranded in itertools.product(rows.items(), RATES):
        one = row[stranded]
        gains = (span(one[turn], one[f"{turn}_ci95"], "+.1%") for turn in ("learned", "last"))
        shown.add_row(missions, stranded, f"{one['planner']:.4g}", *gains)
    return shown


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError,)))
