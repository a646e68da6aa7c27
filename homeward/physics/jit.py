"""Compilation with numba: kept on disk (`kernel_cache`), and announced."""

from __future__ import annotations

import contextlib
import functools
import gc
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, overload

import numba
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import event
from numba.extending import intrinsic, register_jitable

from homeward.physics.kernel_cache import cache_base, cache_of

Function = TypeVar("Function", bound=Callable[..., Any])


def inline(function: Function) -> Function:
    """Mark a formula so that compiled kernels inline it; Python and NumPy call it as it is.

    Without its wrapper for C, which nothing calls, it compiles faster by a seventh.
    """
    marked: Function = register_jitable(forceinline=True, no_cfunc_wrapper=True)(function)
    return marked


def called(function: Function) -> Function:
    """As `inline`, for long functions that kernels rather call: each copy that is inlined takes
    time to compile."""
    marked: Function = register_jitable(no_cfunc_wrapper=True)(function)
    return marked


def _prefetch(typing: Any, record: Any) -> Any:
    # LLVM's intrinsic takes an address, 1 for writing, 3 for the nearest cache, and 1 for data.
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        flag = ir.IntType(32)
        address = builder.bitcast(arguments[0], ir.IntType(8).as_pointer())
        ask = builder.module.declare_intrinsic(
            "llvm.prefetch",
            [address.type],
            ir.FunctionType(ir.VoidType(), [address.type, flag, flag, flag]),
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
    kernel: Any = numba.njit(parallel=parallel, error_model="numpy", nogil=True)(function)
    cache = cache_of(function)
    if cache is not None:
        kernel._cache = cache
    return kernel


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Let Ctrl-C wait until the end of the block.

    numba 0.68.1 crashes, or raises SystemError, if an exception comes while it reads a NumPy
    generator: its `unbox_numpy_random_bitgenerator` releases references that it does not have.
    """
    handler = signal.getsignal(signal.SIGINT)
    # nothing would be raised
    if not callable(handler) or threading.current_thread() is not threading.main_thread():
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
        signal.signal(signal.SIGINT, handler)
        if pressed:
            signal.raise_signal(signal.SIGINT)


@functools.cache
def announce_compilation() -> None:
    """From now on print a line on stderr for each kernel that is compiled because it is not in the
    cache."""
    event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]


class _Announcement(event.Listener):
    """Names kernels, not the functions that they are made of.

    Meanwhile Python looks for no garbage: numba makes millions of objects that stay, and looking
    takes a tenth of the time.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._collects = False

    def on_start(self, event: Any) -> None:
        kernel = event.data["dispatcher"].py_func
        if self._depth == 0:
            self._collects = gc.isenabled()
            gc.disable()
            _announce(kernel)
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0 and self._collects:
            gc.enable()


def _announce(kernel: Any) -> None:
    """Print that a kernel is compiled, if it is of this project."""
    if not str(kernel.__module__).startswith("homeward."):
        return
    often = "at every start, because no folder can keep it"
    if cache_base():
        often = "once"
    name = f"{kernel.__module__}.{kernel.__qualname__}".removeprefix("homeward.")
    print(f"homeward: compiling {name}, {often} (1 to 5 seconds) ...", file=sys.stderr, flush=True)
