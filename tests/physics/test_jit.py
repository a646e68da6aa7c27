"""Compiled kernels: found again in the cache, never with old physics, and nothing compiled on import."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from homeward.physics import jit

KERNEL = """
from homeward.physics.effects.standby import standby
from homeward.physics.jit import compiled

@compiled
def power_w(p):
    return standby(p, 0, 0, 0)
"""
"""A small kernel beside those of the physics, with one of its effects: the large ones take long to compile."""
ASK = """
import dataclasses
import homeward
from homeward.physics.jit import announce_first_compilation
from homeward.physics.standby_kernel import power_w
robot = dataclasses.replace(homeward.load_robot("rusti"), effects={"standby": {"power_w": 3.0}})
announce_first_compilation()
print(power_w(robot.record()[0]))
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


def run(code: str, path: Path | str, cache: Path, *arguments: str, check: bool = True) -> tuple[str, str]:
    """What code prints, on stdout and stderr, that imports from a path and caches its kernels in a folder."""
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
    folder: Path | None = jit._cache_base.__wrapped__()
    return folder


def kernels(cache: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?") if path.is_file()}


def test_a_cached_kernel_never_keeps_old_physics(root: Path, tmp_path: Path) -> None:
    package, cache = tmp_path / "homeward", tmp_path / "cache"
    shutil.copytree(root / "homeward", package, ignore=shutil.ignore_patterns("__pycache__", "recordings"))
    (package / "physics" / "standby_kernel.py").write_text(KERNEL)
    said = "homeward: compiling the kernels that this needs, kept for next time (up to half a minute) ..."
    assert run(ASK, tmp_path, cache) == ("3.0", said)
    first = kernels(cache)
    assert first
    assert run(ASK, tmp_path, cache) == ("3.0", "")
    assert kernels(cache) == first
    effect = package / "physics" / "effects" / "standby.py"
    source = effect.read_text("utf-8")
    assert source.count("return p.standby_power_w") == 1
    effect.write_text(source.replace("return p.standby_power_w", "return 2.0 * p.standby_power_w"), "utf-8")
    assert run(ASK, tmp_path, cache) == ("6.0", said)
    assert first.items() <= kernels(cache).items()


def test_import_compiles_nothing(root: Path, tmp_path: Path) -> None:
    assert run(COUNT, root, tmp_path) == ("[]", "")
    assert kernels(tmp_path) == {}


def test_the_cache_lies_where_the_user_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


KERNELS = {
    "physics/jit.py": "",
    "physics/effects/drag.py": "",
    "envs/kernel.py": "from homeward.envs import state\nfrom homeward.envs.driving.speed import (\n    go,\n)\n",
    "envs/state.py": "",
    "envs/driving/speed.py": "    from homeward.envs.driving import hill\n",
    "envs/driving/hill.py": "",
    "envs/viewer.py": "",
    "agents/planner/kernel.py": "from homeward.agents.planner import prices\nimport homeward.envs.kernel\n",
    "agents/planner/prices.py": "",
    "agents/learner.py": "",
}


@pytest.mark.parametrize(
    ("kernel", "made_of"),
    [
        ("physics/effects/drag.py", "physics"),
        ("envs/kernel.py", "physics|envs/(kernel|state|driving)"),
        ("agents/planner/kernel.py", "physics|envs/(kernel|state|driving)|agents/planner"),
    ],
)
@pytest.mark.parametrize("changed", KERNELS)
def test_every_file_that_a_kernel_is_made_of_names_its_cache(
    kernel: str, made_of: str, changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, content in KERNELS.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "physics" / "jit.py"))
    monkeypatch.setattr(jit, "_read", lambda file: file.read_text())
    before = jit.cache_folder.__wrapped__(tmp_path / kernel)
    assert jit.cache_folder.__wrapped__(tmp_path / kernel) == before
    with (tmp_path / changed).open("a") as file:
        file.write("# edited\n")
    after = jit.cache_folder.__wrapped__(tmp_path / kernel)
    assert (after != before) == bool(re.match(made_of, changed))


def test_every_import_of_the_kernels_is_seen(root: Path) -> None:
    """By Python's own parser: what a kernel's files import of the package are among its sources."""
    package = root / "homeward"
    kernels = [file for part in ("physics", "envs", "estimation", "agents") for file in (package / part).rglob("*.py")]
    kernels = [file for file in kernels if "@compiled" in file.read_text()]
    assert len(kernels) > 5
    for kernel in kernels:
        found = set(jit.sources(kernel))
        for file in found:
            for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                assert not isinstance(node, ast.ImportFrom) or node.level == 0, f"{file}: a relative import"
                if isinstance(node, ast.ImportFrom | ast.Import):
                    module = (node.module or "") if isinstance(node, ast.ImportFrom) else ""
                    names = [f"{module}.{alias.name}".strip(".") for alias in node.names]
                    for name in filter(lambda name: name.startswith("homeward."), (module, *names)):
                        place = package.joinpath(*name.split(".")[1:])
                        assert {place.with_suffix(".py"), place / "__init__.py"} & found or not (
                            place.is_dir() or place.with_suffix(".py").is_file()
                        ), f"{file} imports {name}"


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
    assert all(place.stat().st_mode & 0o777 == 0o700 for place in (folder, folder.parent, folder.parents[1]))
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
        "fix it with chown and chmod go-w, or name another folder in HOMEWARD_CACHE\n"
    )


def test_below_a_sticky_folder_what_is_ones_own_is_safe(base: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base.chmod(0o1777)
    folder = cache_base()
    assert folder is not None and folder.is_relative_to(base)
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize(
    "place", ["named", "named/homeward", "named/homeward/kernels-0", "named/homeward/kernels-0/serial/kernel.nbc"]
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
from homeward.physics import jit

class Trap:
    def __reduce__(self):
        return pathlib.Path.touch, (pathlib.Path(sys.argv[1]),)

indices = list(jit._cache_base().rglob("*.nbi"))
for index in indices:
    index.write_bytes(pickle.dumps(Trap()))
print(len(indices))
"""


@pytest.mark.parametrize(("mode", "springs"), [(0o700, True), (0o777, False)])
def test_a_planted_cache_is_not_run(root: Path, tmp_path: Path, mode: int, springs: bool) -> None:
    """In a private folder the same plant is run: it is a trap that springs."""
    (tmp_path / "doubling.py").write_text(DOUBLE)
    cache, sprung, use = tmp_path / "cache", tmp_path / "sprung", "import doubling; print(doubling.double(21.0))"
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
    (tmp_path / "serial").touch()
    monkeypatch.setattr(jit, "cache_folder", lambda source: tmp_path)
    kernel: Any = jit.compiled(double)
    assert kernel(21.0) == 42.0
    assert not kernel.stats.cache_path


def test_an_entry_that_is_gone_meanwhile_is_no_danger(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process puts its kernels in their places while this one looks at them."""
    walk = os.walk
    monkeypatch.setattr(os, "walk", lambda place: [(*one[:2], [*one[2], "gone.nbc"]) for one in walk(place)])
    assert cache_base() == base / "named" / "homeward"


def test_without_any_folder_functions_still_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, "cache_folder", lambda source: None)
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


@pytest.mark.parametrize("step", ["_save_index", "_save_data"])
def test_two_processes_that_compile_at_once_never_run_the_code_of_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:  # fmt: skip
    files: Any = jit.CacheFiles
    first, second, later = (files(str(tmp_path), "kernel", "stamp") for _ in range(3))
    monkeypatch.setattr(second, "_load_index", dict)  # read before the first one wrote
    write = getattr(first, step)

    def overtaken(*arguments: Any) -> None:
        second.save("float64", "code for float64")
        write(*arguments)

    monkeypatch.setattr(first, step, overtaken)
    first.save("float32", "code for float32")
    for signature in ("float32", "float64"):
        assert later.load(signature) in {f"code for {signature}", None}  # None: compiled once more
    assert {later.load("float32"), later.load("float64")} != {None}


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


def test_of_two_processes_that_need_a_kernel_at_once_one_compiles(root: Path, tmp_path: Path) -> None:
    (tmp_path / "doubling.py").write_text(DOUBLE)
    (tmp_path / "here").mkdir()
    places = f"{root}{os.pathsep}{tmp_path}"
    with ThreadPoolExecutor(2) as pool:
        ask = [pool.submit(run, TOGETHER, places, tmp_path / "cache", str(tmp_path / "here"), name) for name in "ab"]
    assert sorted(asked.result()[0] for asked in ask) == ["42.0 0", "42.0 1"]


def test_a_lock_is_free_once_it_is_given_back_and_keeps_nobody_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jit, "_LONGEST_WAIT_S", 0.2)
    first, second = (jit.Lock(tmp_path / "kernel.lock") for _ in range(2))
    first.acquire()
    second.acquire()  # comes back without it
    assert second._held == -1
    first.release()
    monkeypatch.setattr(jit, "_LONGEST_WAIT_S", 60.0)
    second.acquire()
    assert second._held >= 0
    second.release()
    jit.Lock(tmp_path / "nowhere" / "kernel.lock").acquire()  # a folder that cannot be written
