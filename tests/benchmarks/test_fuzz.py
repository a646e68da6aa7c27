"""The fuzzer reads real files, sees what breaks, and draws the same inputs again."""

import signal
from pathlib import Path

import numpy as np
import pytest

from benchmarks import fuzz
from benchmarks.fuzz import Mutator, Target, Worker, targets

pytest.importorskip("rosbags")


def broken(path: Path) -> None:
    """A loader that breaks on some inputs and refuses others."""
    content = path.read_bytes()
    if b"break" in content:
        raise KeyError(content)
    if b"hang" in content:
        while True:
            pass
    if b"good" not in content:
        raise ValueError("refused")


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Worker:
    monkeypatch.setattr(fuzz, "targets", lambda: {"broken": Target(broken, ".txt", (ValueError,), lambda: [b"good"])})
    monkeypatch.setattr(fuzz, "LONGEST_S", 0.2)
    return Worker("broken", tmp_path / "out")


def test_what_breaks_and_hangs_is_kept(worker: Worker) -> None:
    before = signal.signal(signal.SIGALRM, fuzz._hang)
    try:
        news = [worker.try_one(data) for data in (b"good", b"bad", b"break 1", b"break 2", b"hang", b"bad")]
    finally:
        signal.signal(signal.SIGALRM, before)
    assert news == [True, True, True, False, True, False]
    tally = worker.tally
    assert (tally.inputs, tally.read, tally.refused, sum(tally.findings.values())) == (6, 1, 2, 3)
    kept = {path.read_bytes() for path in worker.out.glob("*.txt")}
    assert kept == {b"break 1", b"hang"}
    assert sum("KeyError" in path.read_text() for path in worker.out.glob("*.trace")) == 1


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", [name for name in targets() if not name.startswith("bag")])
def test_the_files_that_are_changed_are_read_as_they_are(name: str, tmp_path: Path) -> None:
    target = targets()[name]
    read = 0
    for data in target.seeds():
        path = tmp_path / f"input{target.suffix}"
        path.write_bytes(data)
        try:
            target.read(path)
            read += 1
        except target.refusals:
            assert name == "recording by a mapping"  # files of several kinds, of which one fits
    assert read


def test_the_same_seed_draws_the_same_inputs() -> None:
    corpus = [b"time_s,speed_mps\n0,1\n1,2\n" * 100, b'{"a": 1}']
    one, other = (Mutator(np.random.default_rng(3), corpus) for _ in range(2))
    drawn = [one.draw() for _ in range(300)]
    assert drawn == [other.draw() for _ in range(300)]
    assert len(set(drawn)) > 250
