"""What a kill may leave behind is told from what it may not."""

import signal
import sys
import time
from pathlib import Path

import pytest

from benchmarks.robustness import kills
from benchmarks.robustness.kills import faults
from benchmarks.robustness.wheels import VERSIONS, find_pythons


@pytest.mark.parametrize(
    ("name", "whole"),
    [("a.json", b'{"a": 1}\n'), ("a.csv", b"a,b\n1,2\n"), ("a.html", b"<html></html>\n"), ("a.toml", b"a = 1\n"),
     ("a.safetensors", (2).to_bytes(8, "little") + b"{}")],
)  # fmt: skip
def test_half_a_file_is_a_fault(tmp_path: Path, name: str, whole: bytes) -> None:
    (tmp_path / "sub").mkdir()
    path = tmp_path / "sub" / name
    path.write_bytes(whole)
    assert faults(tmp_path) == []
    path.write_bytes(whole[:-2])
    assert len(faults(tmp_path)) == 1
    path.rename(path.with_name(f".{name}.x1y2"))  # as a write leaves it that was killed
    assert faults(tmp_path) == []
    assert faults(tmp_path / "none") == []


@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
def test_a_fork_is_killed_or_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run() -> int:
        _, name, seconds, *_ = sys.argv
        Path(name).write_text("begun")
        time.sleep(float(seconds))
        print("refused", file=sys.stderr)
        return 2

    monkeypatch.setattr(kills, "run", run)
    assert kills._run(["long", "60"], tmp_path / "out", 1.0) == (-signal.SIGKILL, "")
    assert (tmp_path / "long").read_text() == "begun"
    assert kills._run(["short", "0"], tmp_path / "out") == (2, "refused\n")


@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
def test_disks_are_full_and_folders_forbid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run() -> int:
        try:
            (tmp_path / "folder" / "file").write_bytes(bytes(2 * kills._SMALL))
        except OSError as error:
            print(error.strerror, file=sys.stderr)
            return 2
        return 0

    monkeypatch.setattr(kills, "run", run)
    (tmp_path / "folder").mkdir()
    assert kills._run([], tmp_path / "out", limit=kills._fill) == (2, "File too large\n")
    assert kills._run([], tmp_path / "out")[0] == 0
    (tmp_path / "folder" / "file").chmod(0o444)
    assert kills._run([], tmp_path / "out", limit=kills._without_override) == (2, "Permission denied\n")


def test_pythons_that_are_found_are_of_the_versions() -> None:
    assert len(find_pythons()) <= len(VERSIONS)
