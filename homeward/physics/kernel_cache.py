"""Compiled kernels on disk: kept in a folder that only this user can change, under a name that
depends on the code.

numba's own cache compares only the file of the outermost function with what was compiled, so a
kernel would keep old physics after an edit of a formula that it calls. And it runs whatever lies in
its folder.
"""

from __future__ import annotations

import functools
import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from filelock import FileLock, Timeout
from numba.core.caching import FunctionCache

from homeward.own_effects import own_file

_LONGEST_WAIT_S = 60.0
"""Waiting time for another process that compiles: the largest kernel takes a tenth of that on a
quiet machine."""
_PACKAGES = {
    "physics": ("physics",),
    "estimation": ("physics", "estimation"),
    "envs": ("physics", "envs"),
    "agents": ("physics", "estimation", "envs", "agents"),
}
"""Packages of this project that a kernel may be made of, by the package that it is in:
tests/test_layers.py."""

_FunctionCache: Any = FunctionCache


class KernelCache(_FunctionCache):  # type: ignore[misc]
    """numba's cache of one kernel. If several processes need the kernel at once, one compiles and
    the others wait.

    Only the process that holds the lock writes: of two that write at once, numba could give each
    the code of the other.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._lock = FileLock(
            Path(self.cache_path) / f"{self._impl.filename_base}.lock", timeout=_LONGEST_WAIT_S
        )

    def load_overload(self, signature: Any, target: Any) -> Any:
        kernel = super().load_overload(signature, target)
        if kernel is not None:
            return kernel
        try:
            self._lock.acquire()  # until it is saved
        except (Timeout, OSError, NotImplementedError):
            return None  # compiled, and not kept
        # another process may have compiled it meanwhile
        kernel = super().load_overload(signature, target)
        if kernel is not None:
            self._lock.release()
        return kernel

    def save_overload(self, signature: Any, data: Any) -> None:
        if self._lock.is_locked:
            try:
                super().save_overload(signature, data)
            finally:
                self._lock.release()


def cache_of(function: Callable[..., Any]) -> KernelCache | None:
    """Cache of a kernel, or None if no folder is safe."""
    folder = cache_folder(function.__module__, Path(function.__code__.co_filename))
    if folder is None:
        return None
    config: Any = numba.config
    usual_folder = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        cache = KernelCache(function)
    finally:
        config.CACHE_DIR = usual_folder
    if not Path(cache.cache_path).is_relative_to(folder):
        return None  # where numba cannot write, it takes another folder, which nobody has checked
    return cache


@functools.cache
def cache_folder(module: str, source: Path) -> Path | None:
    """Folder of the kernels of one module, compiled from exactly this code, or None if no folder is
    safe."""
    base = cache_base()
    if base is None:
        return None
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for file in sources(module, source):
        digest.update(f"\0{file.name}\0{_read(file)}".encode())
    folder = base / f"kernels-{digest.hexdigest()[:16]}"
    if not _made_private(folder):
        return None
    return folder


def sources(module: str, source: Path) -> list[Path]:
    """Files that a kernel may be made of: its own, those beside the packages, all of the packages
    that its package may import, and that of an effect of one's own."""
    root = Path(__file__).parents[1]
    package = module.removeprefix("homeward.").split(".")[0]
    files = {source, *root.glob("*.py")}
    for name in _PACKAGES.get(package, ("physics",)):
        files.update((root / name).rglob("*.py"))
    effect_file = own_file()
    if effect_file is not None:
        files.add(effect_file)
    return sorted(files)


@functools.cache
def _read(file: Path) -> str:
    """A source file as it was when first read, because a process keeps what it has loaded."""
    return file.read_text("utf-8")


@functools.cache
def cache_base() -> Path | None:
    """Folder for compiled kernels: HOMEWARD_CACHE if set, otherwise in the user's cache folder.

    Cached kernels are code that will be run. If another user may write to the folder or replace it,
    the kernels are kept in a private temporary folder instead, and one line on stderr says so.
    """
    home = os.path.expanduser(
        os.environ.get("HOMEWARD_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    )
    user = os.getuid() if os.name == "posix" else 0
    temporary = Path(tempfile.gettempdir()) / f"homeward-{user}"
    bases = {Path(home) / "homeward": "in a private temporary folder", temporary: "nowhere"}
    for base, where_instead in bases.items():
        if not _made_private(base):
            continue
        exposed = _open_to_others(base.resolve())
        if exposed is None:
            return base.resolve()
        print(
            f"homeward: other users may change {exposed}: compiled kernels are kept {where_instead}; fix it with chown "
            "and chmod go-rwx, or name another folder in HOMEWARD_CACHE",
            file=sys.stderr,
            flush=True,
        )
    return None


def _made_private(folder: Path) -> bool:
    """Make a folder, and those above it, for this user alone; False if that cannot be."""
    try:
        for place in (*reversed(folder.parents), folder):
            if not place.exists():  # one by one, because a mode applies only to the last folder
                place.mkdir(mode=0o700, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _open_to_others(base: Path) -> Path | None:
    """What users other than this one and root may change, or have left, on the way to the base and
    in it."""
    if os.name != "posix":
        return None
    # Inside a container without the system's root, root's files belong to the owner of the root
    # folder.
    trusted = {os.getuid(), 0, os.stat("/").st_uid}
    kernels = [place for folder in base.glob("kernels-*") for place in (folder, *folder.rglob("*"))]
    # data sets, which lie beside the kernels, are not run
    for place in (*base.parents, base, *kernels):
        try:
            status = place.lstat()
        except FileNotFoundError:  # another process has put it in its place meanwhile
            continue
        if status.st_uid not in trusted or status.st_mode & _forbidden_mode(
            place, base, status.st_mode
        ):
            return place
    return None


def _forbidden_mode(place: Path, base: Path, mode: int) -> int:
    """Bits of a mode by which others may change a place on the way to the base, or in it."""
    if place in base.parents and mode & stat.S_ISVTX:
        return 0  # in a sticky folder such as /tmp only its owner can rename or replace an entry
    if place.parent == base:
        # a folder of kernels lets nobody in, so the modes of what it holds do not matter
        return 0o077
    if place == base or place in base.parents:
        return 0o022
    return 0
