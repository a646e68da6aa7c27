"""What the shield keeps and what it costs: strandings and scores of policies with and without it.

`python benchmarks/shield.py` runs every policy on the same episodes bare and shielded and prints the table of
docs/evaluation.md; OUT/shield.json holds it. Finished rows are kept, so that a run that was killed goes on.
`--tune` prints the strandings by deviations kept back instead, on training seeds, and how many of them each confidence
of `agents/shield/shield.py` takes.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numba
import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

from homeward import agents, cli
from homeward.agents import AgentError, Policy, make_policy
from homeward.agents.base import Observations
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import Bootstrap, interval, wilson
from homeward.agents.shield import DEVIATIONS, Shield
from homeward.envs.actions import LEVELS, encode_actions
from homeward.envs.options import MISSIONS, Known, OptionError, Options, known_of
from homeward.envs.routes import GENERATED, HIDDEN_WIND
from homeward.envs.state import GO, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.files import write_whole

TUNED_ON = 4096
"""Missions of each row of the tuning; their seeds are 0 and on, as in training."""
GRID = (2.0, 4.0, 6.0, 8.0)
RECKLESS = ("onward", "wanderer")


@dataclass(frozen=True)
class Args:
    """What to run."""

    policies: tuple[str, ...] = ("random", "onward", "wanderer", "soc50", "dmax_adaptive", "planner", "ppo")
    """Agents of evaluate.py that ship, onward (never turns back) and wanderer (nor does it; draws the rest)."""
    missions: tuple[str, ...] = tuple(MISSIONS)
    """Missions."""
    routes: tuple[str, ...] = (GENERATED, HIDDEN_WIND)
    """Routes: generated or hidden_wind."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    episodes: int = 4000
    """Episodes of each row."""
    seed: int = 0
    """Seed that the episodes follow from, as in evaluate.py."""
    out: Path = Path("runs/shield")
    """Folder of the results."""
    tune: bool = False
    """Print strandings by deviations on training seeds instead."""


@final
class Onward(Policy):
    """Drives on at cruise and senses nothing: only the shield turns it back, at the last moment that it allows."""

    def __init__(self, known: Known) -> None:
        self._action = encode_actions(known, known.shared["cruise_mps"][0], 0.0, GO)

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        return np.repeat(self._action, len(observations), axis=0)


@final
class Wanderer(Policy):
    """Draws speed, sensing rate and, in a tenth of decisions, a stop; it never turns back."""

    def __init__(self, known: Known, rng: np.random.Generator) -> None:
        self._known, self._rng = known, rng

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        s, count = self._known.shared[0], len(observations)
        speed, sensing = self._rng.integers(0, LEVELS, (2, count)) / (LEVELS - 1)
        speed_mps = s["min_speed_mps"] + speed * (s["max_speed_mps"] - s["min_speed_mps"])
        mode = np.where(self._rng.random(count) < 0.1, STOP, GO)
        return encode_actions(self._known, speed_mps, sensing * s["max_sensing_hz"], mode)


def policy_of(name: str, options: Options, known: Known) -> Policy:
    """A policy by its name; those that draw do so alike with and without a shield."""
    if name == "onward":
        return Onward(known)
    if name == "wanderer":
        return Wanderer(known, np.random.default_rng(0))
    return make_policy(name, HomewardVectorEnv(**vars(options)))


def shielded(name: str, options: Options, known: Known) -> Shield:
    """A policy in its shield."""
    return Shield(policy_of(name, options, known), known)


def row_of(args: Args, mission: str, route: str, name: str) -> dict[str, Any]:
    """One row of the table."""
    options = Options(mission, route=route, difficulty=args.difficulty)
    known, seeds = known_of(options), episode_seeds(args.seed, args.episodes)
    bare = run_episodes(policy_of(name, options, known), options, seeds).episodes
    safe = run_episodes(shielded(name, options, known), options, seeds)
    means = Bootstrap({"bare": bare.score[None], "safe": safe.episodes.score[None]}, args.seed).means()
    return {
        "bare": _figures(bare),
        "shielded": _figures(safe.episodes) | {"decision_us": safe.decision_us},
        "difference": float(safe.episodes.score.mean() - bare.score.mean()),
        "difference_ci95": interval(means["safe"] - means["bare"]),
    }


def _figures(episodes: Episodes) -> dict[str, Any]:
    stranded, count = int(episodes.stranded.sum()), len(episodes.score)
    return {
        "stranded": stranded,
        "stranded_ci95": wilson(stranded, count),
        "timed_out": int(episodes.timed_out.sum()),
        "score": float(episodes.score.mean()),
    }


def compare(args: Args, console: Console) -> None:
    """Run all rows that are missing, keep each, and print the table."""
    made_with = _digest()
    common = {"difficulty": args.difficulty, "episodes": args.episodes, "seed": args.seed, "code": made_with}
    kept: dict[str, Any] = {}
    file = args.out / "shield.json"
    if file.is_file():
        content = json.loads(file.read_text())
        kept = content["rows"] if {name: content.get(name) for name in common} == common else {}
    for mission, route, name in _rows(args):
        key = f"{mission}, {route}, {name}"
        if key not in kept:
            kept[key] = row_of(args, mission, route, name)
            write_whole(file, json.dumps({**common, "rows": kept}, indent=2) + "\n")
            console.print(f"{key}: {kept[key]['shielded']['stranded']} stranded", style="dim", highlight=False)
    console.print(table_of(args, kept))


def table_of(args: Args, rows: dict[str, Any]) -> Table:
    """The table, in the order of the arguments."""
    table = Table(title=f"{args.difficulty}, {args.episodes} episodes a row, seed {args.seed}", box=box.SIMPLE_HEAD)
    for heading in ("mission", "route", "policy"):
        table.add_column(heading)
    for heading in ("stranded", "shielded (95 % at most)", "score", "shielded minus bare (95 %)", "relative"):
        table.add_column(heading, justify="right")
    for mission, route, name in _rows(args):
        row = rows[f"{mission}, {route}, {name}"]
        bare, safe, (low, high) = row["bare"], row["shielded"], row["difference_ci95"]
        table.add_row(
            mission, route, name, str(bare["stranded"]), f"{safe['stranded']} ({safe['stranded_ci95'][1]:.2%})",
            f"{bare['score']:.4g}", f"{row['difference']:+.3g} ({low:+.3g} to {high:+.3g})",
            f"{row['difference'] / bare['score']:+.1%}" if bare["score"] else "",
        )  # fmt: skip
    return table


def _rows(args: Args) -> Iterator[tuple[str, str, str]]:
    return itertools.product(args.missions, args.routes, args.policies)


def _digest() -> str:
    """Hash of the sources of the shield: rows that another shield made are not kept."""
    folder = Path(agents.__file__).parent
    sources = sorted([*folder.glob("shield/*.py"), *folder.glob("identification*.py")])
    return hashlib.sha256(b"\0".join(source.read_bytes() for source in sources)).hexdigest()[:16]


def tune(args: Args, console: Console) -> None:
    """Strandings of the reckless policies by deviations, and the fewest that keep each confidence."""
    table = Table(title=f"strandings of {TUNED_ON} missions by deviations, training seeds", box=box.SIMPLE_HEAD)
    for heading in ("mission", "route", "policy", *(f"{deviations:g}" for deviations in GRID)):
        table.add_column(heading)
    worst = dict.fromkeys(GRID, 0)
    asked, kept = max(DEVIATIONS), dict(DEVIATIONS)
    for mission, route, name in itertools.product(args.missions, (GENERATED, HIDDEN_WIND), RECKLESS):
        options = Options(mission, route=route, difficulty=args.difficulty)
        found = []
        for deviations in GRID:
            DEVIATIONS[asked] = deviations
            episodes = run_episodes(shielded(name, options, known_of(options)), options, range(TUNED_ON)).episodes
            found.append(int(episodes.stranded.sum()))
            worst[deviations] = max(worst[deviations], found[-1])
        table.add_row(mission, route, name, *map(str, found))
    console.print(table)
    for confidence in kept:
        enough = [deviations for deviations in GRID if wilson(worst[deviations], TUNED_ON)[1] < 1.0 - confidence]
        console.print(f"confidence {confidence:g}: deviations {enough[0] if enough else 'beyond the grid'}")


def main(args: Args) -> None:
    """Print the table, or what the deviations were chosen from.

    Raises:
        AgentError, OptionError: A policy, mission or route is not known.
        OSError: The output folder cannot be written to.
    """
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    console = Console()
    if args.tune:
        tune(args, console)
    else:
        compare(args, console)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (AgentError, OptionError)))
