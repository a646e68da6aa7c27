"""Number of threads that step a batch: several where that is faster, and one where they would wait
for each other."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator

import numba

_MISSIONS_A_THREAD = 128
"""Missions below which stepping is faster than waking a thread: two threads gain from twice as many
on (benchmarks/speed.py --only-threads of commit 8a8e0e2, docs/results.md: 1.15 times at 256)."""
_CALIBRATION_S = 0.004
_CALIBRATION_STEPS = 8
"""Shortest time, and fewest steps, for which one thread is timed. Chosen: 0.8 % of the next, and a
mean of eight."""
_TRUST_S = 0.5
"""Time for which that measurement is used. Chosen: other work may begin or end within a second."""
_PATIENCE_S = 0.001
_CREDIT_S = 0.01
"""Time, s, that several threads may lose against one before they are no longer used; and time, s,
saved since they were tried that offsets such losses. The operating system occasionally lets any
thread wait for some milliseconds. Chosen."""
_PAYBACK = 20.0
_MOST_PAYBACK = 320.0
"""Ratio of time on one thread to time lost by several, before these are tried again; the share lost
is at most its inverse, 5 %. The ratio doubles with every try that fails, down to a share of 0.3 %.
Chosen."""


class Threads:
    """Chooses between one thread and several by measured step times.

    Several threads end a step together, so each waits for the slowest. With other busy processes or
    threads, the slowest is one that the system keeps from running: a step then takes a hundred
    times as long. That cannot be predicted, so both are timed: one thread occasionally, several as
    long as they are faster.

    Args:
        missions: Number of missions in a step.

    Attributes:
        number: Threads of the next step.
    """

    forked = False
    """Whether this process was forked: the threads of its parent are gone, and OpenMP ends it where
    it needs others."""

    def __init__(self, missions: int) -> None:
        if not Threads.forked:
            _start_threads()
        self._worth = missions // _MISSIONS_A_THREAD
        self._one_s = 0.0  # a step on one thread
        self._lost_s = 0.0  # by several
        self._payback = _PAYBACK
        self._calibrate(_CALIBRATION_S)

    @staticmethod
    def worthwhile(missions: int) -> bool:
        """Whether several threads can be faster."""
        return missions >= 2 * _MISSIONS_A_THREAD

    def record(self, seconds: float) -> None:
        """Record the duration of a step."""
        if self.number > 1:
            self._record_several(seconds)
            return
        self._steps += 1
        self._spent_s += seconds
        if self._spent_s >= self._left_s and self._steps >= _CALIBRATION_STEPS:
            self._one_s = self._spent_s / self._steps
            self._try_several()

    def _record_several(self, seconds: float) -> None:
        self._left_s -= seconds
        self._lost_s = max(self._lost_s + seconds - self._one_s, -_CREDIT_S)
        # they wait for each other: one thread, until what was lost is paid back
        if self._lost_s > _PATIENCE_S:
            self._calibrate(self._payback * self._lost_s)
            self._payback = min(2.0 * self._payback, _MOST_PAYBACK)
        # they are faster, but the time of one thread was measured long ago
        elif self._left_s < 0.0:
            self._calibrate(_CALIBRATION_S)
            self._payback = _PAYBACK

    def _calibrate(self, shortest_s: float) -> None:
        """Step on one thread, for at least so long, to measure its time."""
        self.number = 1
        self._left_s = shortest_s
        self._steps = 0
        self._spent_s = 0.0

    def _try_several(self) -> None:
        """Step on several threads, as long as they are faster than one was."""
        self.number = max(min(self._worth, numba.get_num_threads()), 1)
        if Threads.forked:  # threads do not survive a fork
            self.number = 1
        self._left_s = _TRUST_S
        self._lost_s = 0.0
        self._steps = 0
        self._spent_s = 0.0

    @contextlib.contextmanager
    def at_work(self) -> Iterator[None]:
        """Let numba take so many threads, and no two steps of this process at a time: some of its
        layers cannot."""
        allowed = numba.get_num_threads()
        with _AT_WORK:
            if self.number < allowed:
                numba.set_num_threads(self.number)
            try:
                yield
            finally:
                if self.number < allowed:
                    numba.set_num_threads(allowed)


def _start_threads() -> None:
    """Start numba's threads, and keep torch's number.

    The start sets the number of OpenMP threads of the process, which torch shares: a
    `torch.set_num_threads(1)` before would be undone by the first step on several threads.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        numba.get_num_threads()
        return
    torch_threads = torch.get_num_threads()
    numba.get_num_threads()
    torch.set_num_threads(torch_threads)


_AT_WORK = threading.Lock()


def _forget_threads() -> None:
    Threads.forked = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_threads)
