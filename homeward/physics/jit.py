"""Compilation with numba: cached on disk under a name that depends on the physics, and announced once."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import re
import signal
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.extending import intrinsic, register_jitable

try:
    import fcntl
except ModuleNotFoundError:  # on Windows
    fcntl = None  # type: ignore[assignment]

Function = TypeVar("Function", bound=Callable[..., Any])

_LONGEST_WAIT_S = 60.0
"""Waiting time for another process that compiles: the largest kernel takes a third of that on a busy machine."""


def inline(function: Function) -> Function:
    """Mark a formula so that compiled kernels inline it; Python and NumPy call it as it is."""
    marked: Function = register_jitable(forceinline=True)(function)
    return marked


def _prefetch(typing: Any, record: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        flag = ir.IntType(32)
        address = builder.bitcast(arguments[0], ir.IntType(8).as_pointer())
        ask = builder.module.declare_intrinsic(
            "llvm.prefetch", [address.type], ir.FunctionType(ir.VoidType(), [address.type, flag, flag, flag])
        )
        builder.call(ask, [address, flag(1), flag(3), flag(1)])
        return context.get_dummy_value()

    return types.void(record), generate


prefetch: Any = intrinsic(_prefetch)
"""Ask the processor to bring the first cache line of a record, which will be written soon."""


@overload
def compiled(function: Function) -> Function: ...


@overload
def compiled(*, parallel: bool) -> Callable[[Function], Function]: ...


def compiled(function: Any = None, *, parallel: bool = False) -> Any:
    """Compile a function at its first call, or load it from the cache folder."""
    if function is None:
        return functools.partial(compiled, parallel=parallel)
    folder = cache_folder(Path(function.__code__.co_filename))
    jit = functools.partial(numba.njit, parallel=parallel, error_model="numpy", nogil=True)
    if folder is None:
        return jit()(function)
    config: Any = numba.config
    before = config.CACHE_DIR
    # numba's cache identifies a function by its name alone: the parallel form of one needs a folder of its own.
    config.CACHE_DIR = str(folder / ("parallel" if parallel else "serial"))
    try:
        cache = KernelCache(function)
    finally:
        config.CACHE_DIR = before
    kernel: Any = jit()(function)
    kernel._cache = cache
    # Where numba cannot write, it uses folders that were not checked and whose names do not depend on the formulas.
    return kernel if Path(cache.cache_path).is_relative_to(folder) else jit()(function)


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Let Ctrl-C wait until the end of the block.

    numba 0.68.1 crashes, or raises SystemError, if an exception comes while it reads a NumPy generator: its
    `unbox_numpy_random_bitgenerator` releases references that it does not have.
    """
    before = signal.getsignal(signal.SIGINT)
    if not callable(before) or threading.current_thread() is not threading.main_thread():  # nothing would be raised
        yield
        return
    pressed = False

    def note(number: int, frame: object) -> None:
        nonlocal pressed
        pressed = True

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if pressed:
            signal.raise_signal(signal.SIGINT)


_FunctionCache: Any = FunctionCache
_NumberedFiles: Any = IndexDataCacheFile


class CacheFiles(_NumberedFiles):  # type: ignore[misc]
    """Cached kernels of one function, an index and a file for each signature, which is named after that signature.

    numba numbers these files. Of two processes that compile two signatures at once, each takes the next number, and one
    of them later loads the code of the other.
    """

    def save(self, key: Any, data: Any) -> None:
        name = self._data_name(int(hashlib.sha256(pickle.dumps(key)).hexdigest()[:15], 16))
        self._save_data(name, data)
        self._save_index(self._load_index() | {key: name})


class KernelCache(_FunctionCache):  # type: ignore[misc]
    """Cached kernels of one function. If several processes need one at once, one compiles and the others wait for
    it."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        base = self._impl.filename_base
        self._cache_file = CacheFiles(self.cache_path, base, self._impl.locator.get_source_stamp())
        self._lock = Lock(Path(self.cache_path) / f"{base}.lock")

    def load_overload(self, signature: Any, target: Any) -> Any:
        found = super().load_overload(signature, target)
        if found is None:
            self._lock.acquire()  # until it is saved
            found = super().load_overload(signature, target)  # another process may have compiled it meanwhile
            if found is not None:
                self._lock.release()
        return found

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            super().save_overload(signature, data)
        finally:
            self._lock.release()


class Lock:
    """A file that one process holds at a time. It is released when that process ends, however it ends.

    It only saves work: if the file cannot be locked, or is held for too long, the process continues without it.
    """

    def __init__(self, file: Path) -> None:
        self._file, self._held = file, -1

    def acquire(self) -> None:
        if fcntl is None or self._held >= 0:
            return
        with contextlib.suppress(OSError):
            self._held = os.open(self._file, os.O_RDWR | os.O_CREAT, 0o600)
            end_s = time.monotonic() + _LONGEST_WAIT_S
            while time.monotonic() < end_s:
                try:
                    return fcntl.flock(self._held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    time.sleep(0.05)
        self.release()

    def release(self) -> None:
        if fcntl is not None and self._held >= 0:
            with contextlib.suppress(OSError):
                fcntl.flock(self._held, fcntl.LOCK_UN)  # forked children may have the file open, too
            os.close(self._held)
            self._held = -1


@functools.cache
def cache_folder(source: Path) -> Path | None:
    """Folder of the kernels of one source file, compiled from exactly this code, or None if no folder is safe.

    numba checks only the file of the outermost function, so a cached kernel would keep old physics after an edit of a
    formula that it calls. The folder's name therefore contains a hash of every file that the kernel may depend on.
    """
    base = _cache_base()
    if base is None:
        return None
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for file in sources(source):
        digest.update(f"\0{file.name}\0{_read(file)}".encode())
    folder = base / f"kernels-{digest.hexdigest()[:16]}"
    try:
        for place in (folder, folder / "serial", folder / "parallel"):
            place.mkdir(mode=0o700, exist_ok=True)
    except OSError:
        return None
    return folder


def sources(source: Path) -> list[Path]:
    """Files that kernels of a source file may depend on: itself, its imports from this package, and all of physics,
    where effects are found by their names."""
    package = Path(__file__).parents[1]
    found: set[Path] = set()
    pending = [source, *(package / "physics").rglob("*.py")]
    while pending:
        file = pending.pop()
        if file not in found and file.is_file():
            found.add(file)
            for module, one, several, plain in _IMPORT.findall(_read(file)):
                names = [f"{module}.{name}" for name in re.findall(r"\w+", several or one)]
                for name in filter(None, (module, plain, *names)):
                    place = package.joinpath(*name.split(".")[1:])
                    pending += [place.with_suffix(".py"), place / "__init__.py"]
    return sorted(found)


_IMPORT = re.compile(
    r"^\s*(?:from (homeward[\w.]*) import (?:([^(\n]+)|\(([^)]*)\))|import (homeward[\w.]*))", re.MULTILINE
)


@functools.cache
def _read(file: Path) -> str:
    """A source file as it was when first read, because a process keeps what it has loaded."""
    return file.read_text("utf-8")


@functools.cache
def _cache_base() -> Path | None:
    """Folder for compiled kernels: HOMEWARD_CACHE if set, otherwise in the user's cache folder.

    Cached kernels are code that will be run. If another user may write to the folder or replace it, the kernels are
    kept in a private temporary folder instead, and one line on stderr says so.
    """
    home = os.path.expanduser(os.environ.get("HOMEWARD_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    bases = (Path(home) / "homeward", Path(tempfile.gettempdir()) / f"homeward-{_user_id()}")
    for base in bases:
        try:
            for place in (*reversed(base.parents), base):
                if not place.exists():  # one by one, because a mode applies only to the last folder
                    place.mkdir(mode=0o700, exist_ok=True)
            folder = base.resolve()
            open_to_others = _open_to_others(folder)
            if open_to_others is None and os.access(folder, os.W_OK):
                return folder
        except OSError:
            continue
        if open_to_others is not None:
            instead = "in a private temporary folder" if base == bases[0] else "nowhere"
            print(
                f"homeward: other users may change {open_to_others}: compiled kernels are kept {instead}; fix it "
                "with chown and chmod go-w, or name another folder in HOMEWARD_CACHE",
                file=sys.stderr,
                flush=True,
            )
    return None


def _open_to_others(base: Path) -> Path | None:
    """A folder on the way to the base, or an entry of it, that users other than this one and root may change."""
    if os.name != "posix":
        return None
    for place in (base, *base.parents):
        # In a sticky folder such as /tmp only its owner can rename or replace an entry.
        if _by_others(place.stat(), sticky_is_safe=place != base):
            return place
    for folder, folders, files in os.walk(base):
        # Other users cannot reach into a private folder: only what they left there before matters.
        private = folder != str(base) and not os.stat(base / Path(folder).relative_to(base).parts[0]).st_mode & 0o077
        for name in (*folders, *files):
            with contextlib.suppress(FileNotFoundError):  # another process may have moved it into place meanwhile
                if _by_others((Path(folder) / name).lstat(), mode_is_safe=private):
                    return Path(folder) / name
    return None


def _by_others(status: os.stat_result, *, sticky_is_safe: bool = False, mode_is_safe: bool = False) -> bool:
    if status.st_uid not in (_user_id(), 0, *_roots_in_a_container()):
        return True
    if mode_is_safe or stat.S_ISLNK(status.st_mode) or (sticky_is_safe and status.st_mode & stat.S_ISVTX):
        return False
    return bool(status.st_mode & 0o022)


def _roots_in_a_container() -> tuple[int, ...]:
    """Owner of the system's root files where that is nobody inside: in a user namespace without it."""
    try:
        inside, outside, _ = map(int, Path("/proc/self/uid_map").read_text().split()[:3])
        return () if (inside, outside) == (0, 0) else (int(Path("/proc/sys/fs/overflowuid").read_text()),)
    except (OSError, ValueError):
        return ()


def _user_id() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0  # on Windows files have the owner 0


@functools.cache
def announce_first_compilation() -> None:
    """From now on print one line on stderr when a kernel is compiled because it is not in the cache."""
    event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]


class _Announcement(event.Listener):
    def __init__(self) -> None:
        self._made = False

    def on_start(self, event: Any) -> None:
        if not self._made and event.data["dispatcher"].py_func.__module__.startswith("homeward"):
            self._made = True
            often = "kept for next time" if _cache_base() else "each time, because no folder can keep them"
            print(
                f"homeward: compiling the kernels that this needs, {often} (up to half a minute) ...",
                file=sys.stderr,
                flush=True,
            )

    def on_end(self, event: Any) -> None:
        pass
