"""Ship the policies that `benchmarks/learn.py` trained: `python benchmarks/ship.py` after it.

For each mission, the policy of the seed that did best on the episodes of the learning curve goes into agents/policies,
with its curve and a card. Nothing is chosen by the episodes that the card reports.
"""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own
from homeward import cli
from homeward.agents.learning.curve import EPISODES, Point, read_curve
from homeward.agents.learning.folder import CURVE
from homeward.agents.registry import SHIPPED
from homeward.agents.trained.policy_file import DESCRIPTION, WEIGHTS, PolicyFileError, load_policy
from homeward.files import write_whole

CARD = "card.md"


@dataclass(frozen=True)
class Args:
    """Which runs to ship, and where to."""

    runs: Path = Path("runs/learn")
    """Folder that learn.py wrote."""
    out: Path = SHIPPED
    """Folder that the agent ppo is loaded from."""


def main(args: Args) -> None:
    """Copy the policies and write their cards.

    Raises:
        PolicyFileError: There is nothing to ship.
        OSError: A folder cannot be read or written.
    """
    try:
        rows = json.loads((args.runs / "learn.json").read_text("utf-8"))
    except FileNotFoundError:
        raise PolicyFileError(f"{args.runs} holds no learn.json: run benchmarks/learn.py first") from None
    for row in rows:
        if (row["difficulty"], row["variant"]) != ("uncertain", "recipe"):
            continue
        folders = sorted(args.runs.glob(f"{row['mission']}-uncertain-recipe-*"))
        best = max(folders, key=lambda folder: max(point.score for point in read_curve(folder)[1:]))
        out = args.out / row["mission"]
        out.mkdir(parents=True, exist_ok=True)
        for name in (WEIGHTS, DESCRIPTION, CURVE):
            shutil.copyfile(best / name, out / name)
        write_whole(out / CARD, card(dict(load_policy(best).description), row, read_curve(best)))
        print(f"{best} -> {out}")


def card(description: dict[str, Any], row: dict[str, Any], curve: list[Point]) -> str:
    """What a user should know of a policy, as Markdown.

    Args:
        description: Its `policy.json`.
        row: Figures of its recipe on unseen episodes, from `learn.json`.
        curve: Its learning curve.
    """
    training = description["training"]
    seed, guide = training["seed"], description["guide"]["rule"]
    low, high = row["gain_ci95"]
    least, most = row["stranded_ci95"]
    versions = ", ".join(f"{name} {version}" for name, version in description["versions"].items())
    points = "\n".join(f"| {p.steps:,} | {p.trained_s:.0f} | {p.score:.4g} | {p.stranded_rate:.1%} |" for p in curve)
    return f"""# ppo, {row["mission"]}

A policy for `{description["env"]}`, `{training["difficulty"]}`, robot `{training["robot"]}`, a decision every
{description["decision_s"]:g} s. `evaluate.py --env {description["env"]} --agents ppo` uses it.

* **What it is**: two hidden layers of {training["hidden"]} on the observation, on what `{guide}` believes of the way
  home, and on what it proposes; the proposal also goes straight to the last layer. `{guide}` runs along.
* **Trained by**: `{description["command"]}`, seed {seed}, {description["steps"]:,} decisions,
  {curve[-1].trained_s:.0f} s; kept as it was after {description["best_after_steps"]:,} decisions, and the best of
  {row["seeds"]} seeds, both by the {EPISODES} missions of the learning curve.
* **Versions**: {versions}. Weights `{description["weights_sha256"][:16]}`.
* **On {row["episodes"]:,} unseen missions**: this policy scores {row["score_by_seed"][seed]:.4g}. Over all seeds of the
  recipe: score {row["score"]:.4g}, {row["gain"]:+.3g} ({low:+.3g} to {high:+.3g}, 95 %, paired) over `{row["rule"]}`
  ({row["rule_score"]:.4g}); stranded {row["stranded_rate"]:.2%} ({least:.2%} to {most:.2%}), the rule
  {row["rule_stranded_rate"]:.2%}.
* **Limits**: trained on one robot, one difficulty and generated routes. Anywhere else it is a transfer, and
  `evaluate.py` warns. Where every stranding matters, put a shield around it (`ppo+shield`).

| decisions | training, s | score | stranded |
|---|---|---|---|
{points}
"""


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (PolicyFileError,))


if __name__ == "__main__":
    sys.exit(run())
