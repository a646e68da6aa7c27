"""Copy the policies that `benchmarks/agents/learn.py` trained into the package:
`python benchmarks/agents/ship.py`.

For each mission and start, the policy of the best seed on the episodes of the learning curve is
copied to agents/policies, with its curve and a model card. The episodes that the card reports are
not used for the choice.
"""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks.tables import span
from homeward import cli
from homeward.agents.evaluation.learning_curve import EPISODES, Point, read_curve
from homeward.agents.learning.settings import DMAX
from homeward.agents.registry import SHIPPED, shipped
from homeward.agents.trained.policy_file import DESCRIPTION, WEIGHTS, PolicyFileError, load_policy
from homeward.agents.trained.run_folder import CURVE
from homeward.files import write_whole

CARD = "card.md"
SEEN = {
    "scratch": "on the observation alone, without a rule",
    "dmax": "on the observation and on the belief: a posterior of the robot, the wind and the energy of the way home",
}


@dataclass(frozen=True)
class Args:
    """Runs and destination."""

    runs: Path = Path("runs/learn")
    """Folder that learn.py wrote."""
    out: Path = SHIPPED
    """Folder that the agents ppo and ppo_scratch are loaded from."""


def main(args: Args) -> None:
    """Copy the policies and write their cards.

    Raises:
        PolicyFileError: There is nothing to ship.
        OSError: A folder cannot be read or written.
    """
    try:
        rows = json.loads((args.runs / "learn.json").read_text("utf-8"))
    except FileNotFoundError:
        raise PolicyFileError(
            f"{args.runs} holds no learn.json: run benchmarks/agents/learn.py first"
        ) from None
    for row in rows:
        folders = [
            args.runs / f"{row['mission']}-{row['start']}-{seed}" for seed in range(row["seeds"])
        ]
        chosen_folder = max(
            folders, key=lambda folder: max(point.score for point in read_curve(folder)[1:])
        )
        out = args.out / shipped(row["mission"], row["start"]).name
        out.mkdir(parents=True, exist_ok=True)
        for name in (WEIGHTS, DESCRIPTION, CURVE):
            shutil.copyfile(chosen_folder / name, out / name)
        write_whole(
            out / CARD,
            card(dict(load_policy(chosen_folder).description), row, read_curve(chosen_folder)),
        )
        print(f"{chosen_folder} -> {out}")


def card(description: dict[str, Any], row: dict[str, Any], curve: list[Point]) -> str:
    """Model card of a policy, as Markdown.

    Args:
        description: Its `policy.json`.
        row: Figures of its mission and start on unseen episodes, from `learn.json`.
        curve: Its learning curve.
    """
    training = description["training"]
    seed = training["seed"]
    agent = "ppo" if row["start"] == DMAX else f"ppo_{row['start']}"
    versions = ", ".join(f"{name} {version}" for name, version in description["versions"].items())
    points = "\n".join(
        f"| {point.steps:,} | {point.trained_s:.0f} | {point.score:.4g} | {point.stranded_rate:.1%} |"
        for point in curve
    )
    names = {
        "first_greedy": "first policy, greedy", "first_sampled": "first policy, sampled",
        "last_greedy": "last policy, greedy, all seeds", "last_sampled": "last policy, sampled, all seeds",
        "score": f"`{agent}`, greedy, all seeds", "sampled": f"`{agent}`, sampled, all seeds",
        "dmax": "`dmax`", "dmax_mapped": "`dmax_mapped`", "dmax_adaptive": "`dmax_adaptive`",
        "dmax_belief": "`dmax_belief`", "planner": "`planner`",
    }  # fmt: skip
    compared_rows = []
    for name, heading in names.items():
        stranded_rate = row["stranded_rate"] if name == "score" else row[f"{name}_stranded_rate"]
        compared_rows.append(f"| {heading} | {row[name]:.4g} | {stranded_rate:.2%} |")
    compared = "\n".join(compared_rows)
    against = {
        "first": "first policy",
        "rule": f"best of the three d_max rules that do not estimate the robot, `{row['rule']}`",
        "planner": "planner",
    }
    gains = {f"minus the {words}": f"minus_{name}" for name, words in against.items()}
    gains |= {f"last minus the {against[name]}": f"last_minus_{name}" for name in ("first", "rule")}
    gained = "; ".join(
        f"{words} {span(row[name], row[f'{name}_ci95'], '+.3g')}" for words, name in gains.items()
    )
    seeds = f"the best of {row['seeds']} seeds" if row["seeds"] > 1 else "one seed"
    return f"""# {agent}, {row["mission"]}

A policy for `{description["env"]}`, `{training["difficulty"]}`, robot `{training["robot"]}`, a decision every
{description["decision_s"]:g} s. `evaluate.py --env {description["env"]} --agents {agent}` uses it.

* **What it is**: two hidden layers of {training["hidden"]} units, {SEEN[row["start"]]}.
* **Trained by**: `{description["command"]}`, seed {seed}, {description["steps"]:,} decisions,
  {curve[-1].trained_s:.0f} s; the weights after {description["after_steps"]:,} decisions and {seeds}, selected on the
  {EPISODES} missions of the learning curve.
* **Versions**: {versions}. Weights `{description["weights_sha256"][:16]}`.
* **On {row["episodes"]:,} unseen missions**: this policy scores {row["score_by_seed"][seed]:.4g} and strands in
  {row["stranded_by_seed"][seed]:.2%}, greedy. Paired differences of score, all seeds, greedy (95 %): {gained}.
* **Limits**: trained on one robot, one difficulty and generated routes. In other settings
  `evaluate.py` warns. A shield (`{agent}+shield`) lowers the risk of stranding.

| {row["episodes"]:,} missions | score | stranded |
|---|---|---|
{compared}

The learning curve, on {EPISODES} missions of its own:

| decisions | training, s | score | stranded |
|---|---|---|---|
{points}
"""


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (PolicyFileError,)))
