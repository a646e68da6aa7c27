"""Killed commands, and those with a full disk or a read-only folder, lose nothing and leave nothing
half-written.

`HOMEWARD_KILLS=20 pytest tests/robustness/test_killed.py` kills every command so often; else the
fleet's is, once, and `tests/commands` kills a training and a search.
"""

from __future__ import annotations

import contextlib
import csv
import ctypes
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load

from tests.command_line import ended

KILLS = os.environ.get("HOMEWARD_KILLS")
SMALL_BYTES = 3000
"""That a file may have on the disk that is full: less than any result."""
CAPABILITY_VERSION, OVERRIDES = 0x20080522, 0b110
"""The third version, and CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH, of linux/capability.h."""
ENDS = {".html": b"</html>", ".png": b"IEND\xaeB`\x82"}
TINY = (
    "--start scratch --n-envs 32 --n-steps 16 --batch-size 128 --epochs 2 --hidden 16 --curve 2 --steps 2048 "
    "--decision-s 120 --checkpoints 4 --env homeward/OutAndBack-v0"
)


def of_files(folder: Path, *patterns: str) -> dict[str, bytes]:
    """What files hold, by their names."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for one in patterns
        for file in folder.glob(one)
    }


def of_training(folder: Path) -> object:
    """The policies that a training came to, and the steps of its curve."""
    with (folder / "curve.csv").open(newline="") as file:
        steps = [row["steps"] for row in csv.DictReader(file)]
    return of_files(folder, "policy.safetensors", "last/policy.safetensors"), steps


def of_evaluation(folder: Path) -> object:
    """Episodes, less what their decisions took."""
    with (folder / "episodes.csv").open(newline="") as file:
        return [
            {k: v for k, v in row.items() if not k.endswith("_us")} for row in csv.DictReader(file)
        ]


@dataclass(frozen=True)
class Job:
    """A command, what its results are, and words that make it another whose results are not those
    that are there."""

    words: str
    result: Callable[[Path], object]
    other: str = "--seed 1"


JOBS = {
    "train": Job(f"train {TINY} --resume", of_training, "--replace --seed 1"),
    "evaluate": Job("evaluate --env homeward/OutAndBack-v0 --episodes 10 --agents soc50 planner", of_evaluation),
    "diagnose": Job("diagnose RUN --robot husky", lambda out: of_files(out, "*.json", "*.toml")),
    "sweep": Job(f"sweep --seeds {'0 1' if KILLS else '0'} {TINY}",
                 lambda out: list(map(of_training, sorted(out.glob("seed_*")))), "--seeds 5"),
    "fleet": Job("fleet GARAGE --robot husky", lambda out: of_files(out, "fleet.csv", "*/*.json")),
    "watch": Job("watch RUN --robot husky --quiet", lambda out: of_files(out, "watch.csv"), "--risk 0.01"),
}  # fmt: skip


@pytest.fixture(scope="module")
def garage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two robots like a Husky, each with a drive."""
    rng, time_s, folder = (
        np.random.default_rng(0),
        np.arange(1200) / 10.0,
        tmp_path_factory.mktemp("garage"),
    )
    for robot in range(2):
        speed = np.clip(0.5 + 0.5 * np.sin(time_s / (6.0 + robot)), 0.05, 1.0)
        power = 60.0 + (110.0 + 20.0 * robot) * speed + rng.normal(0.0, 3.0, len(time_s))
        path = folder / f"robot_{robot}" / "run.csv"
        path.parent.mkdir()
        table = np.column_stack([time_s, speed, power])
        np.savetxt(path, table, "%.4f", ",", header="time_s,speed_mps,power_w", comments="")
    return folder


def words_of(name: str, garage: Path, out: Path, other: bool = False) -> list[str]:
    job, names = JOBS[name], {"RUN": garage / "robot_0" / "run.csv", "GARAGE": garage}
    line = f"{job.words} {job.other}" if other else job.words
    return [*(str(names.get(word, word)) for word in line.split()), "--out", str(out)]


def faults(folder: Path) -> list[str]:
    """Files of a results folder that are not whole; those with a temporary name do not count."""
    paths = [
        path
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    ]
    return [str(path.relative_to(folder)) for path in paths if not is_whole(path)]


def is_whole(path: Path) -> bool:
    content = path.read_bytes()
    try:
        if path.suffix == ".json":
            json.loads(content)
        elif path.suffix == ".safetensors":
            load(content)
    except Exception:  # whatever the formats raise
        return False
    if path.suffix in (".csv", ".toml", ".txt"):
        return content.endswith(b"\n")
    return content.rstrip().endswith(ENDS.get(path.suffix, b""))


@contextlib.contextmanager
def full_disk() -> Iterator[None]:
    """A disk with some kilobytes left.

    Python would leave half a file of the bytecode of a module that is first imported there, and
    fail on it ever after.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.setenv("PYTHONDONTWRITEBYTECODE", "1")  # of processes that are started there
        resource.setrlimit(resource.RLIMIT_FSIZE, (SMALL_BYTES, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextlib.contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """A folder that may not be written to, for root neither: it loses what lets it write where
    permissions forbid."""
    libc, header, sets = (
        ctypes.CDLL(None),
        (ctypes.c_uint32 * 2)(CAPABILITY_VERSION, 0),
        (ctypes.c_uint32 * 6)(),
    )
    libc.capget(header, sets)
    effective = sets[0]  # of the first 32
    paths = [folder, *folder.rglob("*")]
    for path in paths:
        path.chmod(0o555 if path.is_dir() else 0o444)
    sets[0] = effective & ~OVERRIDES
    assert libc.capset(header, sets) == 0
    try:
        yield
    finally:
        sets[0] = effective
        libc.capset(header, sets)
        for path in paths:
            path.chmod(0o755)


@pytest.mark.parametrize(
    ("name", "whole"),
    [("a.json", b'{"a": 1}\n'), ("a.csv", b"a,b\n1,2\n"), ("a.html", b"<html></html>\n"), ("a.toml", b"a = 1\n"),
     ("a.safetensors", (2).to_bytes(8, "little") + b"{}")],
)  # fmt: skip
def test_half_a_file_is_a_fault(tmp_path: Path, name: str, whole: bytes) -> None:
    path = tmp_path / "sub" / name
    path.parent.mkdir()
    path.write_bytes(whole)
    assert faults(tmp_path) == []
    path.write_bytes(whole[:-2])
    assert faults(tmp_path) == [f"sub/{name}"]
    path.rename(path.with_name(f".{name}.x1y2"))  # as a write leaves it that was killed
    assert faults(tmp_path) == []


@pytest.mark.parametrize("name", JOBS if KILLS else ("fleet",))
def test_a_killed_command_goes_on_and_ends_as_one_that_was_not(
    name: str, garage: Path, tmp_path: Path
) -> None:
    def run(out: Path, longest_s: float) -> int:
        """Exit code; the whole process group is killed after so long."""
        line = [sys.executable, "-m", "homeward", *words_of(name, garage, out)]
        process = subprocess.Popen(
            line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )  # fmt: skip
        try:
            return process.wait(longest_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return process.wait()

    began_s = time.monotonic()
    assert run(tmp_path / "undisturbed", 600.0) == 0
    took_s, rng = time.monotonic() - began_s, np.random.default_rng(0)
    wanted = JOBS[name].result(tmp_path / "undisturbed")
    assert wanted
    for number in range(int(KILLS or 1)):
        out = tmp_path / f"killed_{number}"
        code = run(out, rng.uniform(0.4, 1.0) * took_s)
        assert code in (0, -signal.SIGKILL)
        assert faults(out) == []
        assert run(out, 600.0) == 0
        assert JOBS[name].result(out) == wanted
        assert not [path for path in out.rglob(".*") if path.is_file()], (
            "leftovers with a temporary name"
        )


@pytest.mark.parametrize("name", JOBS)
def test_disks_that_are_full_and_folders_that_forbid(
    name: str, garage: Path, tmp_path: Path
) -> None:
    out = tmp_path / "full"
    with full_disk():
        code, _, said = ended(words_of(name, garage, out))
    assert code == 2 and said.strip().splitlines()[-1].startswith("homeward"), said
    assert faults(out) == []
    out = tmp_path / "read_only"
    assert ended(words_of(name, garage, out))[0] == 0
    before = of_files(out, "**/*.*")
    with read_only(out):
        code, _, said = ended(words_of(name, garage, out, other=True))
    assert code == 2 and said.strip().splitlines()[-1].startswith("homeward"), said
    assert of_files(out, "**/*.*") == before
