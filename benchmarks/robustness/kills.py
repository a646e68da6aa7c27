"""Kill commands at random moments, fill their disk, forbid their folder: nothing may be lost or half-written.

`python benchmarks/robustness/kills.py --kills 100` shares the kills (SIGKILL to the whole process group) among train,
evaluate, diagnose, sweep, fleet and watch. They are forks of a process that has everything loaded and compiled, so that
kills hit the work and not the imports. After each kill every file of the output folder must be whole; then the same
command goes on, may be killed again, and ends with the results of a run that nobody disturbed. Then each command runs
where no file may grow beyond some kilobytes, and, without the rights of root where this user is root, in a folder that
is read-only: one line, exit code 2, and what was there before is still there. Sweep and fleet also run on a Ray cluster
of this machine whose workers are killed (`--ray-kills`), one after the other: the results are those of this machine.
OUT/kills.md is the table of the documentation.
"""

from __future__ import annotations

import contextlib
import csv
import ctypes
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro

if __name__ == "__main__":  # a fork has no threads but one, and numba reads this when it is imported
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.robustness.forks import fork, wait, warm
from homeward.__main__ import run

ROOT = Path(__file__).resolve().parents[2]
_SMALL = 3000
"""Bytes that a file may have on the disk that is full: less than any result."""
_CAPABILITY_VERSION, _OVERRIDES = 0x20080522, 0b110
"""The third version, and CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH, of linux/capability.h."""
_AGAIN = 0.3
"""Probability that a run that goes on is killed once more."""
_TINY = [
    "--start", "scratch", "--n-envs", "32", "--n-steps", "16", "--batch-size", "128", "--epochs", "2", "--hidden", "16",
    "--curve", "2", "--steps", "2048", "--decision-s", "120", "--checkpoints", "4", "--env", "homeward/OutAndBack-v0",
]  # fmt: skip
_LONGEST_S = 600.0  # of a command; chosen: what takes longer hangs
_ON_CLUSTERS = ("sweep", "fleet")
_ENDS = {".html": b"</html>", ".png": b"IEND\xaeB`\x82"}


@dataclass(frozen=True)
class Args:
    """How many, and where the table goes."""

    kills: int = 100
    """Kills in all, shared by the commands."""
    ray_kills: int = 3
    """Kills of Ray's workers in each of sweep and fleet; a task may start anew five times."""
    seed: int = 0
    """Seed of the moments."""
    commands: tuple[str, ...] = ("train", "evaluate", "diagnose", "sweep", "fleet", "watch")
    """Which commands."""
    out: Path = Path("runs/kills")
    """Folder of the table."""


@dataclass(frozen=True)
class Command:
    """A command, and what of its output folder a result is."""

    words: list[str]
    result: Callable[[Path], object]
    other: list[str]  # words that make it another job, whose results are not those that are there


@dataclass
class Ending:
    """What became of a command's runs."""

    kills: int = 0
    equal: int = 0
    runs: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    full: str = ""
    read_only: str = ""
    workers: str = ""
    undisturbed_s: float = 0.0


def _of_files(*patterns: str) -> Callable[[Path], object]:
    """What files hold, by pattern, with their names."""

    def result(folder: Path) -> object:
        files = {str(file.relative_to(folder)): file.read_bytes() for one in patterns for file in folder.glob(one)}
        if not files:
            raise FileNotFoundError(f"{folder} holds none of {', '.join(patterns)}")
        return files

    return result


def _of_training(folder: Path) -> object:
    """The policies that a training came to, its best and its last, and the points of its curve."""
    with (folder / "curve.csv").open(newline="") as file:
        points = [row["steps"] for row in csv.DictReader(file)]
    weights = [(folder / one / "policy.safetensors").read_bytes() for one in (".", "last")]
    return weights, points


def _of_table(folder: Path) -> object:
    """Episodes less what they took."""
    with (folder / "episodes.csv").open(newline="") as file:
        return [{k: v for k, v in row.items() if not k.endswith("_us")} for row in csv.DictReader(file)]


def commands(folder: Path) -> dict[str, Command]:
    """What is run, on recordings that are made in a folder."""
    runs = _recordings(folder)
    return {
        "train": Command(["train", *_TINY, "--resume"], _of_training, ["--replace", "--seed", "1"]),
        "evaluate": Command(
            ["evaluate", "--env", "homeward/OutAndBack-v0", "--episodes", "10", "--agents", "soc50", "planner"],
            _of_table, ["--seed", "1"],
        ),
        "diagnose": Command(["diagnose", *map(str, runs), "--robot", "husky"], _of_files("*.json", "*.toml"),
                            ["--seed", "1"]),
        "sweep": Command(
            ["sweep", "--seeds", "0", "1", *_TINY],
            lambda folder: list(map(_of_training, sorted(folder.glob("seed_*")))), ["--seeds", "5"],
        ),
        "fleet": Command(["fleet", str(folder / "garage"), "--robot", "husky"], _of_files("fleet.csv", "*/*.json"),
                         ["--seed", "1"]),
        "watch": Command(["watch", *map(str, runs), "--robot", "husky", "--quiet"], _of_files("watch.csv"),
                         ["--risk", "0.01"]),
    }  # fmt: skip


def _recordings(folder: Path) -> list[Path]:
    """Two drives of a Husky-like robot, and a garage of three robots with one each."""
    rng, time_s = np.random.default_rng(0), np.arange(1200) / 10.0
    paths = []
    for robot in range(3):
        speed = np.clip(0.5 + 0.5 * np.sin(time_s / (6.0 + robot)), 0.05, 1.0)
        power = 60.0 + (110.0 + 20.0 * robot) * speed + rng.normal(0.0, 3.0, len(time_s))
        path = folder / "garage" / f"robot_{robot}" / "run.csv"
        path.parent.mkdir(parents=True)
        table = np.column_stack([time_s, speed, power])
        np.savetxt(path, table, "%.4f", ",", header="time_s,speed_mps,power_w", comments="")
        paths.append(path)
    return paths[:2]


def _run(
    words: list[str], out: Path, longest_s: float = _LONGEST_S, limit: Callable[[], object] = bool
) -> tuple[int, str]:
    """Run a command in a fork, killed after so long: its code, -9 if it was, and what it said."""
    said = out.with_name(f"{out.name}.said")
    code, _ = wait(fork(run, [*words, "--out", str(out)], out.parent, said, limit=limit), longest_s)
    return code, said.read_text(errors="replace")


def faults(folder: Path) -> list[str]:
    """Files of a results folder that are not whole; those with a temporary name do not count."""
    found = []
    for path in sorted(folder.rglob("*")) if folder.is_dir() else []:
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        if path.is_file() and not hidden and (fault := _fault(path)):
            found.append(f"{path.relative_to(folder)}: {fault}")
    return found


def _fault(path: Path) -> str:
    content = path.read_bytes()
    try:
        if path.suffix == ".json":
            json.loads(content)
        elif path.suffix == ".safetensors":
            from safetensors.numpy import load

            load(content)
        elif path.suffix in (".csv", ".toml", ".txt") and content[-1:] != b"\n":
            return "does not end with its line"
        elif not content.rstrip().endswith(_ENDS.get(path.suffix, b"")):
            return "does not end"
    except Exception as error:  # whatever the formats raise
        return type(error).__name__
    return ""


def main(args: Args) -> dict[str, Ending]:
    """Kill, fill and forbid; print and write the table."""
    rng, outcomes = np.random.default_rng(args.seed), {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        every = commands(folder)
        for number, command in enumerate(args.commands):
            share = args.kills // len(args.commands) + (number < args.kills % len(args.commands))
            outcomes[command] = _disturb(command, every[command], folder / command, share, args.ray_kills, rng)
            print(_row(command, outcomes[command]), flush=True)
    table = _table(outcomes)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "kills.md").write_text(table)
    print(table)
    return outcomes


def _disturb(
    name: str, command: Command, folder: Path, kills: int, ray_kills: int, rng: np.random.Generator
) -> Ending:  # fmt: skip
    folder.mkdir()
    folder.chmod(0o755)
    outcome = Ending()
    warm(run, [*command.words, "--out", str(folder / "warm")], folder)
    began = time.monotonic()
    code, said = _run(command.words, folder / "undisturbed")
    if code != 0:
        raise SystemExit(f"{name} ends with {code} undisturbed: {said}")
    outcome.undisturbed_s = time.monotonic() - began
    wanted = command.result(folder / "undisturbed")
    while outcome.kills < kills:
        _one_run(command, folder / f"run_{outcome.runs}", wanted, kills, outcome, rng)
    outcome.full = _judged(*_run(command.words, folder / "full", limit=_fill), faults(folder / "full"))
    outcome.read_only = _read_only(command, folder)
    if name in _ON_CLUSTERS and ray_kills:
        outcome.workers = _workers_killed(command, folder, wanted, ray_kills, rng)
    return outcome


def _one_run(
    command: Command, out: Path, wanted: object, kills: int, outcome: Ending, rng: np.random.Generator
) -> None:  # fmt: skip
    """A run that is killed, goes on, is perhaps killed again, and ends."""
    outcome.runs += 1
    while outcome.kills < kills:
        if _run(command.words, out, rng.uniform(0.02, 1.0) * outcome.undisturbed_s)[0] != -signal.SIGKILL:
            break  # it ended before
        outcome.kills += 1
        for fault in faults(out):
            outcome.faults[f"after a kill: {fault}"] += 1
        if rng.random() > _AGAIN:
            break
    code, said = _run(command.words, out)
    if code != 0:
        outcome.faults[f"does not go on: {said.strip().splitlines()[-1:]}"] += 1
        return
    equal = command.result(out) == wanted
    outcome.equal += equal
    outcome.faults["another result"] += not equal
    outcome.faults["leftovers with a temporary name"] += any(
        one.name.startswith(".") for one in out.rglob("*") if one.is_file()
    )
    shutil.rmtree(out)


def _fill() -> None:
    """Make it a disk with some kilobytes left."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (_SMALL, _SMALL))


def _read_only(command: Command, folder: Path) -> str:
    """In a folder with older results that may not be written to."""
    out = folder / "read_only"
    shutil.copytree(folder / "undisturbed", out)
    before = _contents(out)
    for path in [out, *out.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    code, said = _run([*command.words, *command.other], out, limit=_without_override)
    changed = [] if _contents(out) == before else ["older results changed"]
    for path in [out, *out.rglob("*")]:
        path.chmod(0o755 if path.is_dir() else 0o644)
    return _judged(code, said, changed)


def _workers_killed(
    command: Command, folder: Path, wanted: object, kills: int, rng: np.random.Generator
) -> str:  # fmt: skip
    """On a Ray cluster of this machine, whose workers are killed one after the other as they work."""
    from ray.cluster_utils import Cluster

    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    node = {"num_cpus": 2, "object_store_memory": 80_000_000, "include_dashboard": False}
    cluster: Any = Cluster(initialize_head=True, head_node_args=node)
    killed, out, said = 0, folder / "cluster", folder / "cluster.said"
    try:
        line = [sys.executable, "-m", "homeward", *command.words, "--cluster", cluster.address, "--out", str(out)]
        with said.open("wb") as file:
            process = subprocess.Popen(line, cwd=out.parent, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=file,
                                       stderr=file)  # fmt: skip
        end_s = time.monotonic() + _LONGEST_S
        while process.poll() is None and time.monotonic() < end_s:
            time.sleep(rng.uniform(2.0, 4.0))  # as long as a worker takes to load and begin
            workers = _ray_workers()
            if killed < kills and workers and process.poll() is None:
                os.kill(workers[int(rng.integers(len(workers)))], signal.SIGKILL)
                killed += 1
        process.kill()  # where it has not ended
        process.wait()
    finally:
        cluster.shutdown()
    equal = process.returncode == 0 and command.result(out) == wanted
    last = said.read_text(errors="replace").strip().splitlines()[-1:]
    return f"{killed} killed, {'equal' if equal else f'code {process.returncode}: {last}'}"


def _ray_workers() -> list[int]:
    """Processes of Ray that work on a task, by the title that it gives them."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if path.read_bytes().startswith(b"ray::_work"):
                found.append(int(path.parent.name))
    return found


def _without_override() -> None:
    """Take from root what lets it write where permissions forbid it, as they do to an ordinary user."""
    if os.geteuid() == 0:
        libc, header, sets = ctypes.CDLL(None), (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION, 0), (ctypes.c_uint32 * 6)()
        libc.capget(header, sets)
        sets[0] &= ~_OVERRIDES  # those in effect, of the first 32
        if libc.capset(header, sets):
            raise OSError("capset failed")


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _judged(code: int, said: str, wrong: list[str]) -> str:
    lines = [line for line in said.strip().splitlines() if line.strip()]
    if code != 2 or "Traceback" in said:
        wrong = [*wrong, f"code {code}: {lines[-1][:150] if lines else ''}"]
    return "; ".join(wrong) if wrong else "refused in one line"


def _row(name: str, one: Ending) -> str:
    broke = "; ".join(f"{what} ({count})" for what, count in one.faults.items() if count) or "nothing"
    return (f"| {name} | {one.undisturbed_s:.1f} s | {one.kills} | {one.equal} of {one.runs} | {broke} | {one.full} "
            f"| {one.read_only} | {one.workers} |")  # fmt: skip


def _table(outcomes: dict[str, Ending]) -> str:
    head = ["| command | undisturbed | kills | equal results | broke | full disk | read-only folder | Ray workers |",
            "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    return "\n".join([*head, *(_row(name, one) for name, one in outcomes.items())]) + "\n"


if __name__ == "__main__":
    tried = main(tyro.cli(Args, description=__doc__))
    sys.exit(1 if any(count for one in tried.values() for count in one.faults.values()) else 0)
