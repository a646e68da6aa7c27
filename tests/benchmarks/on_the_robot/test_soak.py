"""The soak of the companion on ROS 2: what cannot be run is said; tests/watch/ros2 runs what it
runs."""

import time

import pytest

from benchmarks.on_the_robot.soak import Args, main, resident_mb
from homeward.companion import CompanionError


def test_arguments_that_cannot_be_used() -> None:
    for args in (Args(minutes=0.0), Args(hz=-1.0)):
        with pytest.raises(CompanionError, match="above 0"):
            main(args)


def test_memory_is_that_of_this_process() -> None:
    before_mb = resident_mb()
    held = bytearray(50_000_000)
    held[::4096] = bytes(len(held[::4096])).replace(b"\0", b"\1")
    grown_mb = resident_mb() - before_mb
    for _ in range(100):  # a busy system counts a moment later
        if grown_mb > 40.0:
            break
        time.sleep(0.1)
        grown_mb = resident_mb() - before_mb
    assert grown_mb == pytest.approx(50.0, abs=10.0)
