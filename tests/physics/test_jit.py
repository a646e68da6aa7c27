"""Compiled kernels: found again in the cache, never with old physics, and nothing compiled on import."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from homeward.physics import jit

REPLAY = """
import dataclasses
import numpy as np
import homeward
from homeward.physics import replay
robot = dataclasses.replace(homeward.load_robot("rusti"), effects={"standby": {"power_w": 3.0}})
print(replay(robot, np.arange(2.0), 0.0).power_w[0] - homeward.physics.ancillary_power(robot, 0.0))
"""
COUNT = """
from numba.core import event
compiled = []
class Listener(event.Listener):
    def on_start(self, event): compiled.append(event.data["dispatcher"].py_func.__qualname__)
    def on_end(self, event): pass
event.register("numba:compile", Listener())
import homeward, homeward.physics, homeward.envs, homeward.diagnosis
print(compiled)
"""


def run(code: str, folder: Path, cache: Path) -> tuple[str, str]:
    environment = os.environ | {"HOMEWARD_CACHE": str(cache), "PYTHONPATH": str(folder), "NUMBA_OPT": "0"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr.strip()


def kernels(cache: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?") if path.is_file()}


def test_a_cached_kernel_never_keeps_old_physics(root: Path, tmp_path: Path) -> None:
    package, cache = tmp_path / "homeward", tmp_path / "cache"
    shutil.copytree(root / "homeward", package, ignore=shutil.ignore_patterns("__pycache__", "recordings"))
    said = "homeward: compiling its kernels, once for this version (about half a minute) ..."
    assert run(REPLAY, tmp_path, cache) == ("3.0", said)
    first = kernels(cache)
    assert first
    assert run(REPLAY, tmp_path, cache) == ("3.0", "")
    assert kernels(cache) == first
    effect = package / "physics" / "effects" / "standby.py"
    source = effect.read_text("utf-8")
    assert source.count("return p.standby_power_w") == 1
    effect.write_text(source.replace("return p.standby_power_w", "return 2.0 * p.standby_power_w"), "utf-8")
    assert run(REPLAY, tmp_path, cache) == ("6.0", said)
    assert first.items() <= kernels(cache).items()


def test_import_compiles_nothing(root: Path, tmp_path: Path) -> None:
    assert run(COUNT, root, tmp_path) == ("[]", "")
    assert kernels(tmp_path) == {}


def test_the_cache_lies_where_the_user_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOMEWARD_CACHE", str(tmp_path / "new" / "place"))
    folder = jit.cache_folder.__wrapped__()
    assert folder is not None and folder.is_dir() and folder.is_relative_to(tmp_path / "new" / "place")
    assert jit.cache_folder.__wrapped__() == folder


def test_a_cache_that_cannot_be_written_moves_to_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("HOMEWARD_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    folder = jit.cache_folder.__wrapped__()
    assert folder is not None and folder.is_relative_to(tmp_path / "temporary")


def test_kernels_of_someone_else_are_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOMEWARD_CACHE", str(tmp_path))
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(jit, "_user_id", lambda: tmp_path.stat().st_uid + 1)
    assert jit.cache_folder.__wrapped__() is None


def test_without_any_folder_functions_still_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, "cache_folder", lambda: None)
    assert jit.compiled(double)(21.0) == 42.0


def test_formulas_stay_plain_functions() -> None:
    assert jit.inline(double)(21) == 42


def double(x: float) -> float:
    return 2.0 * x


def test_a_record_asked_for_ahead_stays_as_it_is() -> None:
    records = np.arange(6.0).view([("first", np.float64), ("second", np.float64)])
    before = records.copy()

    @numba.njit
    def ask(records: Any) -> float:
        for i in range(len(records)):
            jit.prefetch(records[i])
        return float(records[2].first)

    assert ask(records) == 4.0
    np.testing.assert_array_equal(records, before)
