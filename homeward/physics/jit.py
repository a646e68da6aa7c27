"""Compilation with numba: cached on disk under a name that changes with the physics, and announced the first time."""

from __future__ import annotations

import functools
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import event
from numba.extending import intrinsic, register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])


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
    folder = cache_folder()
    config: Any = numba.config
    before = config.CACHE_DIR
    # numba's cache knows a function by its name alone: the parallel form of one needs a folder of its own.
    config.CACHE_DIR = str(folder / ("parallel" if parallel else "serial")) if folder else ""
    try:
        return numba.njit(cache=folder is not None, parallel=parallel, error_model="numpy", nogil=True)(function)
    finally:
        config.CACHE_DIR = before


@functools.cache
def cache_folder() -> Path | None:
    """Folder of the compiled kernels of exactly this source code, or None if no folder is writable.

    numba checks only the file of the outermost function, so a cached kernel would keep old physics after an edit of a
    formula it calls. The folder's name therefore carries a hash of every source file of physics and envs. It lies in
    HOMEWARD_CACHE, if that is set, else in the user's cache folder, else among temporary files.
    """
    package = Path(__file__).parents[1]
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for folder, pattern in ((package / "physics", "**/*.py"), (package / "envs", "*.py")):  # the viewer has no kernels
        for source in sorted(folder.glob(pattern)):
            digest.update(source.relative_to(package).as_posix().encode() + source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    home = os.environ.get("HOMEWARD_CACHE") or os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    for base in (Path(home) / "homeward", Path(tempfile.gettempdir()) / f"homeward-{_user_id()}"):
        try:
            base.mkdir(parents=True, exist_ok=True)
            (base / name).mkdir(exist_ok=True)
            # Cached kernels are code: a folder that someone else left among temporary files is not used.
            if base.stat().st_uid == _user_id() and os.access(base / name, os.W_OK):
                return base / name
        except OSError:
            continue
    return None


def _user_id() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0  # 0 is what files have for an owner on Windows


@functools.cache
def announce_first_compilation() -> None:
    """From now on say once, on stderr, when a kernel is compiled because it is not in the cache."""
    event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]


class _Announcement(event.Listener):
    def __init__(self) -> None:
        self._made = False

    def on_start(self, event: Any) -> None:
        if not self._made and event.data["dispatcher"].py_func.__module__.startswith("homeward"):
            self._made = True
            often = "once for this version" if cache_folder() else "as no folder to keep them in is writable"
            print(f"homeward: compiling its kernels, {often} (about half a minute) ...", file=sys.stderr, flush=True)

    def on_end(self, event: Any) -> None:
        pass
