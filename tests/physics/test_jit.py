"""Compiled functions: nothing is compiled on import, and formulas stay plain functions."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from homeward.physics import jit

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


def test_import_compiles_nothing(root: Path) -> None:
    done = subprocess.run([sys.executable, "-c", COUNT], cwd=root, capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == ("[]", "")


def test_formulas_stay_plain_functions() -> None:
    assert jit.inline(double)(21) == jit.called(double)(21) == 42


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


def test_ctrl_c_waits_for_the_end_of_a_block_and_none_comes_by_itself() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    ended = []
    try:
        with jit.uninterrupted():
            ended.append("undisturbed")
        with pytest.raises(KeyboardInterrupt), jit.uninterrupted():
            signal.raise_signal(signal.SIGINT)
            ended.append("before it is interrupted")
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended == ["undisturbed", "before it is interrupted"]
