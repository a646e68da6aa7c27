"""Measure the reference scores of the environments' pages:
`python docs/reference_scores.py [MISSION ...]`.

Each is one run of `evaluate.py`, by the command that the page names; what the page shows of it is
kept beside the page.
"""

import json
import subprocess
import tempfile
from pathlib import Path

import tyro

from homeward.envs import IDS

AGENTS = (
    "random",
    "soc50",
    "dmax",
    "dmax_adaptive",
    "dmax_belief",
    "planner",
    "ppo",
    "ppo_scratch",
)
EPISODES = 500
SEED = 7
SHOWN = (
    "score_mean",
    "score_ci95",
    "stranded_rate",
    "stranded_ci95",
    "share_of_optimum",
    "share_of_optimum_at_least",
)
COMMIT = ("git", "rev-parse", "--short", "HEAD")


def measured(mission: str) -> Path:
    """Where the scores of a mission are kept."""
    return Path(__file__).parent / "environments" / f"{mission}.json"


def main(
    missions: tyro.conf.Positional[tuple[str, ...]] = tuple(IDS), optimum: bool = True
) -> None:
    """Measure scores and keep what the pages show.

    Args:
        missions: Of which missions.
        optimum: Also find the optimum of each episode, which for surveys takes longer than all
            agents together.
    """
    from homeward.commands import evaluate

    for mission in missions:
        words = (
            f"--env {IDS[mission]} --agents {' '.join(AGENTS)} --episodes {EPISODES} --seed {SEED}"
        )
        if optimum:
            words += " --optimum"
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder)
            evaluate.main(evaluate.Args(AGENTS, IDS[mission], EPISODES, SEED, out, optimum=optimum))
            evaluation = json.loads((out / "evaluation.json").read_text("utf-8"))
        shown = {
            name: evaluation[name]
            for name in ("episodes", "seed", "versions", "optimum")
            if name in evaluation
        }
        shown["agents"] = {}
        for agent, scores in evaluation["agents"].items():
            shown["agents"][agent] = {name: scores.get(name) for name in SHOWN}
        shown["commit"] = subprocess.check_output(
            COMMIT, cwd=Path(__file__).parent, text=True
        ).strip()
        shown["command"] = f"python evaluate.py {words}"
        measured(mission).write_text(json.dumps(shown, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    tyro.cli(main)
