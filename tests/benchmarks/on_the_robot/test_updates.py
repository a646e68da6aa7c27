"""Time and memory over many updates: the robot obeys and is charged at home, and every part has its
line."""

import re

import numpy as np
import pytest

from benchmarks.on_the_robot.updates import PARTS, Args, Driven, main
from homeward.companion import Companion, CompanionError


def test_every_part_of_the_updates_has_its_time_and_memory(
    capsys: pytest.CaptureFixture[str],
) -> None:
    main(Args(updates=40))
    lines = re.findall(
        r"([\d,]+) updates, .* charges: ([\d.]+) ms in the mean, ([\d.]+) MB",
        capsys.readouterr().out,
    )
    assert [int(count) for count, _time, _memory in lines] == [
        4 * part for part in range(1, PARTS + 1)
    ]
    assert all(
        float(time_ms) > 0.0 and float(memory_mb) > 50.0 for _count, time_ms, memory_mb in lines
    )
    with pytest.raises(CompanionError, match=f"at least {PARTS} --updates"):
        main(Args(updates=PARTS - 1))


def test_the_robot_turns_when_it_is_told_and_leaves_home_with_a_charged_battery() -> None:
    driven = Driven(Companion("husky", home=(0.0, 0.0)), np.random.default_rng(0))
    readings = driven.readings()
    out = [next(readings) for _moment in range(50)]
    driven.obey(turn_now=True)
    back = [next(readings) for _moment in range(60)]
    driven.obey(turn_now=False)
    assert {reading["heading_rad"] for reading in out} == {0.0} and back[-1]["heading_rad"] == np.pi
    assert out[0]["voltage_v"] > back[-1]["voltage_v"]
    again = next(readings)
    assert driven.charges == 1 and again["soc"] == 1.0 and again["heading_rad"] == 0.0
