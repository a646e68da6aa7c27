"""The first training example of the README, copied word for word, with ten training seeds.

`python benchmarks/agents/first_training.py` runs the example in a process of its own for each seed,
and prints the mean score on its 500 unseen missions before and after training, that of the rule
`dmax` on the same missions, and the seconds that the whole example takes. Only the seed is another
one: seeds are a thousand apart, so that no two share a training mission. Finished seeds are stored
in OUT, so that an interrupted run continues.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.kept import Kept
from benchmarks.tables import table
from homeward import cli
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.learning.settings import TrainingError
from homeward.agents.registry import AGENTS, Request
from homeward.envs.options import Options, known_of
from homeward.parallel import ClusterError, TaskError, run_tasks

README = Path(__file__).parents[2] / "README.md"
EPISODES = 500
LEARNS, SEED = "model.learn(", "seed=0"
APART = 1000
"""Distance of training seeds: more than missions side by side."""

MEASURED = """
import json, time
begun_s = time.perf_counter()
{before}
start_s, start_cpu_s = time.perf_counter() - begun_s, time.process_time()
start = float(unseen_episodes(model, env, {episodes}).score.mean())
begun_s, left_out_cpu_s = time.perf_counter(), time.process_time() - start_cpu_s
{after}
wall_s, cpu_s = start_s + time.perf_counter() - begun_s, time.process_time() - left_out_cpu_s
end = float(unseen_episodes(model, env, {episodes}).score.mean())
print(json.dumps({{"start": start, "end": end, "wall_s": wall_s, "cpu_s": cpu_s}}))
"""
"""Program that runs the example; to measure its start and its end is not counted."""


@dataclass(frozen=True)
class Args:
    """Training seeds and output."""

    seeds: int = 10
    """Number of training seeds."""
    jobs: int = 1
    """Seeds at once."""
    out: Path = Path("runs/first_training")
    """Folder of the results."""


def example() -> str:
    """The first example of the README that trains."""
    blocks: list[str] = re.findall(
        r"^```python\n(.*?)^```", README.read_text("utf-8"), re.DOTALL | re.MULTILINE
    )
    return next(block for block in blocks if LEARNS in block)


def program(seed: int) -> str:
    """The example with a seed, and with its measurements around it."""
    text = example()
    if text.count(SEED) != 1:
        raise TrainingError(
            f"the example of the README has {text.count(SEED)} times {SEED!r}; give it once"
        )
    before, learns, after = text.replace(SEED, f"seed={seed}").partition(LEARNS)
    return MEASURED.format(before=before, after=learns + after, episodes=EPISODES)


def run_seed(seed: int) -> dict[str, Any]:
    """Run the example with a seed, and return what it prints last.

    Raises:
        TrainingError: The example fails.
    """
    process = subprocess.run([sys.executable, "-c", program(seed)], capture_output=True, text=True)
    if process.returncode:
        raise TrainingError(
            f"the example fails with seed {seed}: {process.stderr.strip().splitlines()[-1]}"
        )
    result: dict[str, Any] = json.loads(process.stdout.splitlines()[-1])
    return result


def main(args: Args) -> list[dict[str, Any]]:
    """Run the missing seeds, print the table, and return the results of all.

    Raises:
        TrainingError, ClusterError, TaskError: An argument cannot be used, or the example fails.
        OSError: The output folder cannot be written to.
    """
    if args.seeds < 1:
        raise TrainingError(f"--seeds {args.seeds} is not allowed; give at least 1")
    options = Options("OutAndBack")
    rule = run_episodes(
        AGENTS["dmax"](Request(known_of(options))), options, episode_seeds(0, EPISODES)
    ).episodes
    versions = {name: version(name) for name in ("stable-baselines3", "torch")}
    kept = Kept(args.out / "first_training.json", example=example(), versions=versions)
    tasks = {f"seed {APART * k}": APART * k for k in range(args.seeds)}
    run_tasks(run_seed, kept.missing(tasks), jobs=args.jobs, keep=kept.keep, title="training seeds")
    title = (
        f"The README's example on {EPISODES} unseen missions; dmax scores {rule.score.mean():.0f}"
    )
    shown = table(
        title, ("training",), ("start", "end", "end minus dmax", "time, s", "time of processors, s")
    )
    results = [kept.results[name] for name in tasks]
    for name, run in zip(tasks, results, strict=True):
        gain = f"{run['end'] - rule.score.mean():+.0f}"
        times = (f"{run[duration]:.0f}" for duration in ("wall_s", "cpu_s"))
        shown.add_row(name, f"{run['start']:.0f}", f"{run['end']:.0f}", gain, *times)
    above = sum(run["end"] > max(rule.score.mean(), run["start"]) for run in results)
    shown.caption = f"{above} of {args.seeds} seeds end above dmax and above their start"
    Console(width=120).print(shown)
    return results


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (TrainingError, ClusterError, TaskError)))
