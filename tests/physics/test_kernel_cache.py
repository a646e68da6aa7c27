"""The folder of compiled kernels: no old physics, no code of other users, and one process that
compiles."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
import pytest

from homeward.physics import jit, kernel_cache

KERNEL = """
from homeward.physics.effects.standby import standby
from homeward.physics.jit import compiled

@compiled
def power_w(p):
    return standby(p, 0, 0, 0)
"""
"""A small kernel beside those of the physics, with one of its effects: the large ones take long to
compile."""
ASK = """
import dataclasses
import homeward
from homeward.physics.jit import announce_compilation
from homeward.physics.standby_kernel import power_w
robot = dataclasses.replace(homeward.load_robot("rusti"), effects={"standby": {"power_w": 3.0}})
announce_compilation()
print(power_w(robot.record()[0]))
"""


def run(
    code: str, path: Path | str, cache: Path, *arguments: str, check: bool = True
) -> tuple[str, str]:
    """What code prints, on stdout and stderr, that imports from a path and caches its kernels in a
    folder."""
    environment = os.environ | {
        "HOMEWARD_CACHE": str(cache), "TMPDIR": str(cache.parent), "PYTHONPATH": str(path), "NUMBA_OPT": "0"
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=cache.parent, env=environment, capture_output=True, text=True,
        timeout=300,
    )  # fmt: skip
    assert done.returncode == 0 or not check, done.stderr
    return done.stdout.strip(), done.stderr.strip()


def cache_base() -> Path | None:
    """Where kernels are kept, asked anew."""
    folder: Path | None = kernel_cache.cache_base.__wrapped__()
    return folder


def kernels(cache: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?") if path.is_file()}


def test_a_cached_kernel_never_keeps_old_physics(root: Path, tmp_path: Path) -> None:
    package, cache = tmp_path / "homeward", tmp_path / "cache"
    shutil.copytree(
        root / "homeward", package, ignore=shutil.ignore_patterns("__pycache__", "recordings")
    )
    (package / "physics" / "standby_kernel.py").write_text(KERNEL)
    said = "homeward: compiling physics.standby_kernel.power_w, once (1 to 5 seconds) ..."
    assert run(ASK, tmp_path, cache) == ("3.0", said)
    first = kernels(cache)
    assert first
    assert run(ASK, tmp_path, cache) == ("3.0", "")
    assert kernels(cache) == first
    effect = package / "physics" / "effects" / "standby.py"
    source = effect.read_text("utf-8")
    assert source.count("return p.standby_power_w") == 1
    effect.write_text(
        source.replace("return p.standby_power_w", "return 2.0 * p.standby_power_w"), "utf-8"
    )
    assert run(ASK, tmp_path, cache) == ("6.0", said)
    assert first.items() <= kernels(cache).items()


def test_the_cache_lies_where_the_user_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOMEWARD_CACHE", str(tmp_path / "new" / "place"))
    folder = cache_base()
    assert folder == tmp_path / "new" / "place" / "homeward" and folder.is_dir()
    assert cache_base() == folder


def test_a_cache_that_cannot_be_written_moves_to_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("HOMEWARD_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    folder = cache_base()
    assert folder is not None and folder.is_relative_to(tmp_path / "temporary")


@pytest.mark.parametrize(
    ("module", "within"),
    [
        ("homeward.physics.log_replay", ("physics",)),
        ("homeward.estimation.filter", ("physics", "estimation")),
        ("homeward.envs.kernel", ("physics", "envs")),
        ("homeward.agents.planner.kernel", ("physics", "estimation", "envs", "agents")),
    ],
)
def test_a_kernel_is_made_of_the_packages_below_its_own(
    module: str, within: tuple[str, ...], root: Path
) -> None:
    package = root / "homeward"
    source = package.joinpath(*module.split(".")[1:]).with_suffix(".py")
    expected = {
        *package.glob("*.py"),
        *(file for name in within for file in (package / name).rglob("*.py")),
    }
    assert set(kernel_cache.sources(module, source)) == expected
    assert source in expected


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder that the user names for the cache; temporary files lie in another one."""
    (tmp_path / "temporary").mkdir(mode=0o700)
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    monkeypatch.setenv("HOMEWARD_CACHE", str(tmp_path / "parent" / "named"))
    before = os.umask(0o002)  # as on systems where every user has a group of the same name
    try:
        folder = cache_base()
    finally:
        os.umask(before)
    assert folder == tmp_path / "parent" / "named" / "homeward"
    assert all(
        place.stat().st_mode & 0o777 == 0o700
        for place in (folder, folder.parent, folder.parents[1])
    )
    (folder / "kernels-0" / "serial").mkdir(mode=0o700, parents=True)
    (folder / "kernels-0" / "serial" / "kernel.nbc").touch()
    (folder / "kernels-0").chmod(0o700)
    return tmp_path / "parent"


@pytest.mark.parametrize("place", [".", "named", "named/homeward", "named/homeward/kernels-0"])
@pytest.mark.parametrize("mode", [0o777, 0o775])
def test_a_cache_that_others_may_write_to_is_not_run(
    base: Path, place: str, mode: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    opened = base / place
    opened.chmod(mode)
    folder = cache_base()
    assert folder is not None and folder.is_relative_to(tmp_path / "temporary")
    assert folder.stat().st_mode & 0o077 == 0
    assert capsys.readouterr().err == (
        f"homeward: other users may change {opened}: compiled kernels are kept in a private temporary folder; "
        "fix it with chown and chmod go-rwx, or name another folder in HOMEWARD_CACHE\n"
    )


def test_a_data_set_beside_the_kernels_is_nobodys_code(
    base: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Downloads lie in the same cache folder, where anybody may read them."""
    data = base / "named" / "homeward" / "husky_borealtc"
    data.mkdir()
    data.chmod(0o755)
    assert cache_base() == base / "named" / "homeward"
    assert capsys.readouterr().err == ""


def test_below_a_sticky_folder_what_is_ones_own_is_safe(
    base: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base.chmod(0o1777)
    folder = cache_base()
    assert folder is not None and folder.is_relative_to(base)
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(
    not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away"
)
@pytest.mark.parametrize(
    "place",
    [
        "named",
        "named/homeward",
        "named/homeward/kernels-0",
        "named/homeward/kernels-0/serial/kernel.nbc",
    ],
)
def test_a_cache_of_someone_else_is_not_run(base: Path, place: str, tmp_path: Path) -> None:
    os.chown(base / place, 4321, 4321)
    folder = cache_base()
    assert folder is not None and folder.is_relative_to(tmp_path / "temporary")


def test_a_folder_that_someone_else_left_among_temporary_files_is_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    monkeypatch.setenv("HOMEWARD_CACHE", str(tmp_path / "open"))
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "open"))
    assert cache_base() is None
    assert capsys.readouterr().err.count("\n") == 2


DOUBLE = """
from homeward.physics.jit import compiled

@compiled
def double(x):
    return 2.0 * x
"""
PLANTED = """
import pathlib, pickle, sys
from homeward.physics.kernel_cache import cache_base

class Trap:
    def __reduce__(self):
        return pathlib.Path.touch, (pathlib.Path(sys.argv[1]),)

indices = list(cache_base().rglob("*.nbi"))
for index in indices:
    index.write_bytes(pickle.dumps(Trap()))
print(len(indices))
"""


@pytest.mark.parametrize(("mode", "springs"), [(0o700, True), (0o777, False)])
def test_a_planted_cache_is_not_run(root: Path, tmp_path: Path, mode: int, springs: bool) -> None:
    """In a private folder the same plant is run: it is a trap that springs."""
    (tmp_path / "doubling.py").write_text(DOUBLE)
    cache, sprung, use = (
        tmp_path / "cache",
        tmp_path / "sprung",
        "import doubling; print(doubling.double(21.0))",
    )
    cache.mkdir(mode=0o700)
    places = f"{root}{os.pathsep}{tmp_path}"
    assert run(use, places, cache)[0] == "42.0"
    assert run(PLANTED, places, cache, str(sprung))[0] == "1"
    cache.chmod(mode)
    run(use, places, cache, check=not springs)
    assert sprung.exists() == springs


def test_kernels_that_their_group_may_write_are_safe_in_a_private_folder(base: Path) -> None:
    """As numba makes them where every user has a group of the same name."""
    inner = base / "named" / "homeward" / "kernels-0" / "serial"
    inner.chmod(0o775)
    (inner / "kernel.nbc").chmod(0o664)
    assert cache_base() == base / "named" / "homeward"
    (base / "named" / "homeward" / "kernels-0").chmod(0o755)
    assert cache_base() != base / "named" / "homeward"


def test_numba_keeps_kernels_nowhere_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where its folder is no folder it would go on to others, which nobody has checked."""
    (tmp_path / "file").touch()
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda module, source: tmp_path / "file")
    kernel: Any = jit.compiled(double)
    assert kernel(21.0) == 42.0
    assert not kernel.stats.cache_path


def test_without_any_folder_functions_still_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda module, source: None)
    assert jit.compiled(double)(21.0) == 42.0


TOGETHER = """
import sys, time
from pathlib import Path
from numba.core import event
import doubling
compiled, here = [], Path(sys.argv[1])
class Slow(event.Listener):
    def on_start(self, event): compiled.append(1); time.sleep(2.0)
    def on_end(self, event): pass
event.register("numba:compile", Slow())
(here / sys.argv[2]).touch()
while len(list(here.iterdir())) < 2: time.sleep(0.01)
print(doubling.double(21.0), len(compiled))
"""


def test_of_two_processes_that_need_a_kernel_at_once_one_compiles(
    root: Path, tmp_path: Path
) -> None:
    (tmp_path / "doubling.py").write_text(DOUBLE)
    (tmp_path / "here").mkdir()
    places = f"{root}{os.pathsep}{tmp_path}"
    with ThreadPoolExecutor(2) as pool:
        ask = [
            pool.submit(run, TOGETHER, places, tmp_path / "cache", str(tmp_path / "here"), name)
            for name in "ab"
        ]
    assert sorted(asked.result()[0] for asked in ask) == ["42.0 0", "42.0 1"]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes caches of one kernel, as of two processes."""
    monkeypatch.setattr(kernel_cache, "_LONGEST_WAIT_S", 0.1)
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda module, source: tmp_path)
    return lambda: kernel_cache.cache_of(double)


def test_a_process_that_waits_in_vain_compiles_and_writes_nothing(
    cache: Any, tmp_path: Path
) -> None:
    """Of two that write at once, numba could give each the code of the other."""
    signature = (numba.types.float64,)
    first: Any = jit.compiled(double)
    second: Any = jit.compiled(double)
    first._cache, second._cache = cache(), cache()
    assert first._cache.load_overload(signature, first.targetctx) is None  # and now it compiles
    assert second(21.0) == 42.0
    assert list(tmp_path.rglob("*.nbi")) == []
    assert first(21.0) == 42.0
    assert len(list(tmp_path.rglob("*.nbi"))) == 1


def test_where_no_lock_can_be_had_nothing_is_kept(
    cache: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise NotImplementedError("this file system has no locks")

    kernel: Any = jit.compiled(double)
    kernel._cache = cache()
    monkeypatch.setattr(kernel._cache._lock, "acquire", refuse)
    assert kernel(21.0) == 42.0
    assert list(tmp_path.rglob("*.nbi")) == []


def double(x: float) -> float:
    return 2.0 * x
