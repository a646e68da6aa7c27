"""What is timed is the first use, and then the next."""

from __future__ import annotations

from pathlib import Path

from benchmarks.first_use import FIRST_USES, seconds


def test_what_was_compiled_is_not_compiled_again(tmp_path: Path) -> None:
    code = "from homeward.physics import load_robot, replay\nreplay(load_robot('husky'), [0.0, 1.0], 1.0)"
    first_s = seconds(code, str(tmp_path))
    compiled = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nb?")}
    assert compiled and first_s > 0.0
    seconds(code, str(tmp_path))
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nb?")} == compiled


def test_the_code_of_each_part_is_python() -> None:
    assert len(FIRST_USES) == 4
    for part, code in FIRST_USES.items():
        compile(code, part, "exec")
