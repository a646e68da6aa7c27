"""Speed of the vector step beside that of another checkout, such as the commit before a change.

`git worktree add --detach ../before COMMIT && python benchmarks/before_after.py ../before` steps missions of both in
turn, each time in a new process on one thread, and prints the median and range of the ratios: a drift of the machine
meets both, and where in memory a process comes to lie (up to a sixth at 4096 missions) differs from pair to pair.
Settings that the other checkout does not know yet are left out there.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich import box
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own

from benchmarks.speed import SIZES
from homeward import cli

SETTINGS = (
    {"difficulty": "known"},
    {"difficulty": "uncertain", "instruments": "exact", "weather": "still"},  # as before
    {"difficulty": "uncertain", "instruments": "exact"},
    {"difficulty": "uncertain", "instruments": "gauge"},
    {"difficulty": "harsh"},
)
_DECISIONS = 200_000  # a timing; chosen: a tenth of a second or so at millions a second
_RUNS = 5  # timings of each in turn, of which the median counts; chosen
_STEPPER = """
import json, sys, time
import numba, numpy as np
from homeward.envs.vector import HomewardVectorEnv

numba.set_num_threads(1)
settings, size, decisions = json.loads(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
try:
    env = HomewardVectorEnv(size, mission="OutAndBack", **settings)
except ValueError:
    env = HomewardVectorEnv(size, mission="OutAndBack", difficulty=settings["difficulty"])
env.reset(seed=0)
draw = np.random.default_rng(0)
actions = draw.integers(0, env.single_action_space.nvec, (16, size, 3)).astype(env.action_space.dtype)
actions[..., 2] = np.where(draw.random((16, size)) < 0.02, actions[..., 2], 1)  # mostly on
steps = max(decisions // size, 20)
for k in range(20):
    env.step(actions[k % 16])
print("ready", flush=True)
for _ in sys.stdin:
    begun_s = time.perf_counter()
    for k in range(steps):
        env.step(actions[k % 16])
    print(steps * size / (time.perf_counter() - begun_s), flush=True)
"""


class SpeedError(Exception):
    """A checkout cannot be timed."""


@dataclass(frozen=True)
class Args:
    """What to time."""

    before: tyro.conf.Positional[Path]
    """Folder of the other checkout."""
    pairs: int = 9
    """Processes of each, in turn."""


class Stepper:
    """A process that steps the missions of a checkout when asked to."""

    def __init__(self, checkout: Path, settings: dict[str, str], size: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _STEPPER, json.dumps(settings), str(size), str(_DECISIONS)],
            env=os.environ | {"PYTHONPATH": str(checkout.resolve())},
            cwd=tempfile.gettempdir(),  # not a checkout's, whose packages would come first
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        if self._line() != "ready":
            raise SpeedError(f"{checkout}: cannot be timed: {self._process.communicate()[1].strip().splitlines()[-1:]}")

    def decisions_per_s(self) -> float:
        """Of one run."""
        assert self._process.stdin is not None
        print("go", file=self._process.stdin, flush=True)
        return float(self._line())

    def end(self) -> None:
        """Stop the process."""
        self._process.communicate()

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


def main(args: Args) -> None:
    """Time all settings and sizes, and print the table.

    Raises:
        SpeedError: A checkout cannot be timed.
    """
    here = Path(__file__).parents[1]
    if not (args.before / "homeward").is_dir():
        raise SpeedError(f"{args.before}: no checkout of homeward; give the folder that holds the other commit")
    table = Table(title="vector step on one thread", box=box.SIMPLE_HEAD)
    for heading in ("missions", "setting", "M decisions/s", "over before (least to most)"):
        table.add_column(heading, justify="left" if heading == "setting" else "right")
    for size in SIZES:
        for settings in SETTINGS:
            pairs = [_pair(here, args.before, settings, size) for _ in range(args.pairs)]
            ratios = [one / other for one, other in pairs]
            table.add_row(
                f"{size}",
                ", ".join(settings.values()),
                f"{statistics.median(one for one, _ in pairs) / 1e6:.2f}",
                f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})",
            )
    Console().print(table)


def _pair(now: Path, before: Path, settings: dict[str, str], size: int) -> tuple[float, float]:
    """Decisions/s of both, medians of runs in turn."""
    steppers = Stepper(now, settings, size), Stepper(before, settings, size)
    runs = [[stepper.decisions_per_s() for stepper in steppers] for _ in range(_RUNS)]
    for stepper in steppers:
        stepper.end()
    one, other = (statistics.median(speeds) for speeds in zip(*runs, strict=True))
    return one, other


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (SpeedError,)))
