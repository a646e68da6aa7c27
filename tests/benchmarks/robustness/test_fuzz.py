"""The fuzzer reads real files, sees what breaks, and draws the same inputs again."""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness import fuzz
from benchmarks.robustness.fuzz import End, Lines, Mutator, Target, Worker, targets

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
    assert (tally.ends["read"], tally.ends["refused"], tally.findings.total()) == (1, 2, 3)
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


def test_a_digit_is_the_most_that_a_mild_change_changes() -> None:
    text = b"time_s,speed_mps\n0.25,1\n"
    mutator = Mutator(np.random.default_rng(0), [text])
    changed = [mutator.digit(text) for _ in range(40)]
    assert {len(one) for one in changed} == {len(text)} and len(set(changed)) > 5
    assert all(sum(a != b for a, b in zip(one, text, strict=True)) <= 1 for one in changed)


@pytest.mark.parametrize(
    ("end", "fault"),
    [
        (End(0, 0.1, "", "drawn"), ""),
        (End(2, 0.1, "a note\nhomeward range: no such file", ""), ""),
        (End(2, 0.1, "Unrecognized options\nFor full helptext, run homeward range --help\n", ""), ""),
        (End(2, 0.1, "something else", ""), "refused without a line"),
        (End(1, 0.1, "Traceback (most recent call last):\nKeyError: 1", ""), "code 1, KeyError"),
        (End(-24, 10.1, "", ""), "code -24"),
        (End(0, 0.1, "", "a name \x1b[31m"), "an escape reaches the terminal"),
    ],
)
def test_how_a_command_may_end(end: End, fault: str) -> None:
    assert end.fault().startswith(fault) and bool(end.fault()) == bool(fault)


def _says() -> int:
    print("homeward range: refused", file=sys.stderr)
    return 2


def _breaks() -> int:
    raise KeyError(sys.argv)


def _works_on() -> int:
    while True:
        pass


def _fills() -> int:
    return len(bytearray(4 * fuzz.MOST_BYTES)) % 2


@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
@pytest.mark.parametrize(
    ("run", "code", "said"),
    [(_says, 2, "refused"), (_breaks, 1, "KeyError: ['homeward', 'range']"), (_works_on, -signal.SIGXCPU, ""),
     (_fills, 1, "MemoryError")],
)  # fmt: skip
def test_a_fork_is_held_to_its_limits(
    run: Callable[[], int], code: int, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzz, "LONGEST_S", 1.0)
    end = fuzz._forked(run, ["range"], tmp_path)
    assert end.code == code and said in end.said
    assert os.getpid() and sys.argv[0] != "homeward"  # this process is as it was


def test_command_lines_have_their_files(tmp_path: Path) -> None:
    lines = Lines(tmp_path, np.random.default_rng(0))
    for line in lines.plain():
        given = [Path(word.removeprefix("ppo=")) for word in line if str(tmp_path) in word and "out" not in word]
        assert given and all(path.exists() for path in given), line
    drawn = [lines.draw() for _ in range(60)]
    assert len({line[0] for line in drawn if line}) >= 7
