"""How much computing one update of a companion takes, and whether its memory stays flat, by one that runs alone.

`python benchmarks/on_the_robot/update.py` drives a Husky around a square at 10 Hz, faster than time goes, and gives it
a new battery when it must turn. It prints the CPU time of an update, resident memory after a tenth, half and all of
them, and the size of its state. `soak.py` listens to a network for an hour.
"""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.on_the_robot.soak import resident_mb
from benchmarks.tables import table
from homeward import cli
from homeward.companion import Companion, CompanionError

_STEP_S = 0.1  # 10 Hz; chosen: robots are logged at about that
_SIDE_M, _SPEED_MPS, _POWER_W = 1000.0, 1.0, 160.0  # chosen: a Husky consumes 159 W at 1 m/s on the level


@dataclass(frozen=True)
class Args:
    """How many."""

    updates: int = 100_000
    """Updates of one companion."""


def main(args: Args) -> None:
    """Drive, and print.

    Raises:
        CompanionError: There are too few updates.
    """
    if args.updates < 100:
        raise CompanionError("give at least 100 --updates")
    companion, place, heading_rad = Companion("husky", home=(0.0, 0.0)), np.zeros(2), 0.0
    full_j, used_j = companion.robot.usable_energy_j, 0.0
    took_s, resident, most_bytes = np.zeros(args.updates), list[float](), 0
    marks = {args.updates // 10, args.updates // 2, args.updates - 1}
    for number in range(args.updates):
        began_s = time.process_time()
        advice = companion.update(
            number * _STEP_S, speed_mps=_SPEED_MPS, power_w=_POWER_W, soc=1.0 - used_j / full_j,
            heading_rad=heading_rad, position=(float(place[0]), float(place[1])),
        )  # fmt: skip
        took_s[number] = time.process_time() - began_s
        if advice.turn_now:
            companion.swap_battery()
            used_j = 0.0
        used_j += _POWER_W * _STEP_S
        heading_rad = 0.5 * math.pi * (number * _STEP_S * _SPEED_MPS // _SIDE_M % 4.0)
        place += _STEP_S * _SPEED_MPS * np.array([math.cos(heading_rad), math.sin(heading_rad)])
        if number in marks:
            resident.append(resident_mb())
            most_bytes = max(most_bytes, len(json.dumps(companion.state())))
    median_ms, late_ms = 1e3 * np.quantile(took_s, (0.5, 0.99))
    shown = table(f"{args.updates} updates", ("of", "one companion"), ())
    shown.add_row("CPU time of an update, median, 99 %", f"{median_ms:.2f}, {late_ms:.2f} ms")
    shown.add_row("resident memory after a tenth, half, all", ", ".join(f"{one:.1f}" for one in resident) + " MB")
    shown.add_row("largest state of these", f"{most_bytes / 1000.0:.0f} kB")
    cli.Terminal().show(shown)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (CompanionError,)))
