"""Compilation with numba: cached on disk under a name that changes with the physics, and announced the first time."""

from __future__ import annotations

import functools
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])


def inline(function: Function) -> Function:
    """Mark a formula so that compiled kernels inline it; Python and NumPy call it as it is."""
    marked: Function = register_jitable(function)
    return marked


def compiled(function: Function | None = None, *, parallel: bool = False) -> Any:
    """Compile a function at its first call, or load it from the cache folder."""
    if function is None:
        return functools.partial(compiled, parallel=parallel)
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(cache_folder())
    try:
        return numba.njit(cache=True, parallel=parallel, error_model="numpy", nogil=True)(function)
    finally:
        numba.config.CACHE_DIR = before


@functools.cache
def cache_folder() -> Path:
    """Folder of the compiled kernels of exactly this source code.

    numba checks only the file of the outermost function, so a cached kernel would keep old physics after an edit of a
    formula it calls. The folder's name therefore carries a hash of every source file of physics and envs.

    Raises:
        OSError: No folder is writable.
    """
    package = Path(__file__).parents[1]
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for folder in (package / "physics", package / "envs"):
        for source in sorted(folder.rglob("*.py")):
            digest.update(source.relative_to(package).as_posix().encode() + source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    home = os.environ.get("HOMEWARD_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    for base in (Path(home).expanduser() / "homeward", Path(tempfile.gettempdir()) / f"homeward-{os.getuid()}"):
        try:
            (base / name).mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(base / name, os.W_OK):
            return base / name
    raise OSError("no writable folder for compiled kernels; set HOMEWARD_CACHE to one")


@functools.cache
def announce_first_compilation() -> None:
    """Say once, on stderr, that kernels are about to be compiled, when none of this source code are in the cache."""
    if not any(cache_folder().rglob("*.nbi")):
        print("homeward: compiling its kernels, once for this version (about half a minute) ...", file=sys.stderr)
