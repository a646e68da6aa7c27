"""The soak of the companion on ROS 2: what cannot be run is said; tests/watch/ros2 runs what it
runs."""

import mmap

import pytest

from benchmarks.on_the_robot.soak import Args, main, resident_mb
from homeward.companion import CompanionError


def test_arguments_that_cannot_be_used() -> None:
    for args in (Args(minutes=0.0), Args(hz=-1.0)):
        with pytest.raises(CompanionError, match="above 0"):
            main(args)


def test_memory_is_that_of_this_process() -> None:
    before_mb = resident_mb()
    # Of the system, as the heap may hold as much that was freed before.
    with mmap.mmap(-1, 50_000_000) as held:
        for page in range(0, len(held), mmap.PAGESIZE):
            held[page] = 1
        assert resident_mb() - before_mb == pytest.approx(50.0, abs=10.0)
