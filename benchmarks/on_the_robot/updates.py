"""Time and memory of the companion over a million updates.

`python benchmarks/on_the_robot/updates.py` lets a Husky drive out until its companion says turn,
home, and out again with a charged battery, with ten readings a second. After each tenth of the
updates it prints the processor time of an update and the resident memory, as in docs/results.md.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.on_the_robot.soak import resident_mb
from homeward import cli
from homeward.companion import Companion, CompanionError
from homeward.physics import ancillary_power, model

EVERY_S = 0.1
"""Time between updates: messages of odometry come at 10 Hz and more."""
POSITION_SD_M, POWER_SD = 1.0, 0.05
"""Noise of positions, m, and of power, a share. Chosen: those of an ordinary outdoor robot."""
EMPTY_V, FULL_V = 23.4, 25.6
"""Voltage of an empty and of a full battery. Chosen: two lead-acid batteries of 12 V, as a Husky
has."""
PARTS = 10
"""Parts of the updates, each with a line."""


@dataclass(frozen=True)
class Args:
    """How many updates."""

    updates: int = 1_000_000
    """Updates."""
    robot: str = "husky"
    """Robot."""
    seed: int = 1
    """Seed of the noise."""


class Driven:
    """A robot that drives straight out at cruise, and home when it is told to.

    Attributes:
        charges: Times that its battery was charged at home.
    """

    def __init__(self, companion: Companion, rng: Generator) -> None:
        robot = companion.robot
        self._rng = rng
        self._companion = companion
        self._full_j = robot.usable_energy_j
        self._speed_mps = companion.vehicle.cruise_mps
        force_n = float(model.traction_force(robot, self._speed_mps, 0.0))
        self._power_w = force_n * self._speed_mps / robot.traction_efficiency + float(
            ancillary_power(robot, 0.0)
        )
        self._left_j = self._full_j
        self._way_m = 0.0
        self._heads_home = False
        self.charges = 0

    def readings(self) -> Iterator[dict[str, Any]]:
        """Readings of one moment after the other, without an end."""
        time_s = 0.0
        while True:
            charge = self._left_j / self._full_j
            volts = EMPTY_V + charge * (FULL_V - EMPTY_V)
            power_w = self._power_w * (1.0 + POWER_SD * self._rng.standard_normal())
            east_m, north_m = (self._way_m, 0.0) + POSITION_SD_M * self._rng.standard_normal(2)
            yield {
                "time_s": time_s, "speed_mps": self._speed_mps, "voltage_v": volts, "current_a": power_w / volts,
                "soc": round(charge, 2), "grade_rad": 0.0,
                "heading_rad": np.pi if self._heads_home else 0.0, "position": (east_m, north_m),
            }  # fmt: skip
            time_s += EVERY_S
            self._left_j -= self._power_w * EVERY_S
            self._way_m += (-1.0 if self._heads_home else 1.0) * self._speed_mps * EVERY_S

    def obey(self, turn_now: bool) -> None:
        """Turn if that is advised; at home, charge and leave again."""
        self._heads_home = self._heads_home or turn_now
        if self._heads_home and self._way_m <= 0.0:
            self._heads_home = False
            self._left_j = self._full_j
            self._way_m = 0.0
            self._companion.charged(1.0)
            self.charges += 1


def main(args: Args) -> None:
    """Drive, and print.

    Raises:
        CompanionError: An argument is invalid.
    """
    if args.updates < PARTS:
        raise CompanionError(f"give at least {PARTS} --updates")
    console = cli.Terminal()
    companion = Companion(args.robot, home=(0.0, 0.0))
    driven = Driven(companion, np.random.default_rng(args.seed))
    # written once now, so that it does not grow the memory later
    took_s = np.full(args.updates, np.nan)
    ends = {part * args.updates // PARTS for part in range(1, PARTS + 1)}
    begin = 0
    console.print(
        f"{args.robot}, seed {args.seed}, an update each {EVERY_S:g} s; processor time of an update:"
    )
    for count, reading in enumerate(driven.readings(), start=1):
        begun_s = time.process_time()
        advice = companion.update(**reading)
        took_s[count - 1] = time.process_time() - begun_s
        driven.obey(advice.turn_now)
        if count in ends:
            console.print(line(count, driven, took_s[begin:count]))
            begin = count
        if count == args.updates:
            break
    median_ms, late_ms, most_ms = 1e3 * np.quantile(took_s, (0.5, 0.99, 1.0))
    console.print(f"all: median {median_ms:.2f}, 99 % {late_ms:.2f}, most {most_ms:.1f} ms")
    for text in advice.warnings:
        console.print(text, soft_wrap=True)


def line(count: int, driven: Driven, took_s: NDArray[np.float64]) -> str:
    """Where it stands, in a line: time of the last updates, shape (updates,), and memory."""
    hours = count * EVERY_S / 3600.0
    mean_ms = 1e3 * float(took_s.mean())
    return (
        f"{count:>9,} updates, {hours:.1f} h, {driven.charges} charges: {mean_ms:.2f} ms in the mean, "
        f"{resident_mb():.1f} MB resident"
    )


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (CompanionError,)))
