"""How far off the way home is if white noise is added to the positions of real drives.

`HOMEWARD_DATA=FOLDER python benchmarks/on_the_robot/noisy_positions.py` drives a companion along
the recorded motion of a Husky on four grounds: its speeds, stops, bends and turns on the spot. The
positions are those that wheels and gyroscope integrate to, as no other were recorded. Noise is
added to them. The speed may be 3 % off and the heading 5 degrees, because wheels slip and compasses
are off. The way home is compared with that of the same drive with exact readings.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.on_the_robot.range_drives import GROUNDS
from benchmarks.tables import table
from homeward import cli
from homeward.companion import Companion
from homeward.datasets import DatasetError, fetch
from homeward.diagnosis.read.signals import signals
from homeward.logs.recordings import Recording, read_recording
from homeward.physics import load_robot
from homeward.watch.replay import heading_of

Array = NDArray[np.float64]

UPDATE_S = 1.0  # chosen: a receiver of satellites sends once a second
# chosen: calibrated odometry has 1 to 5 % (Borenstein & Feng, 1996)
SPEED_OFF, HEADING_OFF_RAD = 1.03, np.radians(5.0)
SHORTEST_M = 30.0  # chosen: three deviations of the largest noise
SHARES = (0.25, 0.5, 1.0)


@dataclass(frozen=True)
class Args:
    """What to drive."""

    noises_m: tuple[float, ...] = (0.0, 1.0, 10.0)
    """Standard deviation of the noise on east and on north, m."""
    seed: int = 0
    """Seed of the noise."""


@dataclass(frozen=True)
class Motion:
    """A recorded drive at each update; arrays of shape (updates,), the positions (updates, 2)."""

    time_s: Array
    speed_mps: Array
    heading_rad: Array
    position_m: Array


def motion_of(recording: Recording) -> Motion:
    """The motion of a recording, sampled once an update."""
    run = signals(recording, load_robot("husky"))
    heading = np.unwrap(heading_of(run))
    step_s = np.diff(run.time_s, append=run.time_s[-1])
    forward_m = run.speed_mps * step_s
    moved_m = np.column_stack([forward_m * np.cos(heading), forward_m * np.sin(heading)])
    place_m = np.cumsum(moved_m, axis=0)
    driven_m = np.cumsum(forward_m)
    time_s = np.arange(run.time_s[0] + UPDATE_S, run.time_s[-1], UPDATE_S)
    place_m = np.column_stack(
        [np.interp(time_s, run.time_s, place_m[:, axis]) for axis in range(2)]
    )
    speed_mps = np.diff(np.interp(time_s, run.time_s, driven_m), prepend=0.0) / UPDATE_S
    change_m = np.diff(place_m, axis=0, prepend=0.0)
    # The direction of the way since the last update; where the robot stands, that in which it
    # looks.
    moves = np.hypot(*change_m.T) > 1e-3
    along = np.arctan2(change_m[:, 1], change_m[:, 0]) + np.pi * (speed_mps < 0.0)
    return Motion(
        time_s, speed_mps, np.where(moves, along, np.interp(time_s, run.time_s, heading)), place_m
    )


def ways_home_m(motion: Motion, noise_m: float, is_off: bool, rng: np.random.Generator) -> Array:
    """Way home at each update, m."""
    companion = Companion("husky", home=(0.0, 0.0), soc=1.0)
    gain, offset_rad = (SPEED_OFF, HEADING_OFF_RAD) if is_off else (1.0, 0.0)
    read_m = motion.position_m + noise_m * rng.standard_normal(motion.position_m.shape)
    ways_m = []
    for index, time_s in enumerate(motion.time_s.tolist()):
        advice = companion.update(
            time_s,
            speed_mps=gain * float(motion.speed_mps[index]),
            heading_rad=float(motion.heading_rad[index]) + offset_rad,
            position=(float(read_m[index, 0]), float(read_m[index, 1])),
            power_w=100.0,
            soc=1.0,
        )
        ways_m.append(advice.way_home_m)
    return np.array(ways_m)


def main(args: Args) -> None:
    """Drive all recordings and print by how much the way home is off."""
    motions = []
    for ground in GROUNDS:
        for path in sorted(fetch("husky_borealtc", ground)):
            motion = motion_of(read_recording(path, "husky_borealtc"))
            if np.abs(motion.speed_mps).sum() * UPDATE_S >= SHORTEST_M:
                motions.append(motion)
    exact_m = [ways_home_m(motion, 0.0, False, np.random.default_rng(0)) for motion in motions]
    headings = [f"at {share:.0%}: median, 95 % within" for share in SHARES]
    made = table(
        f"Error of the way home, m: {len(motions)} drives, seed {args.seed}",
        ["noise", "speed, heading"],
        headings,
    )
    for noise_m in args.noises_m:
        for is_off in (False, True):
            errors_m = []
            for number, (motion, right_m) in enumerate(zip(motions, exact_m, strict=True)):
                said_m = ways_home_m(
                    motion, noise_m, is_off, np.random.default_rng([args.seed, number])
                )
                at = [round(share * (len(said_m) - 1)) for share in SHARES]
                errors_m.append((said_m - right_m)[at])
            errors = np.array(errors_m)
            texts = [
                f"{np.median(column):+.1f}, {np.quantile(np.abs(column), 0.95):.1f}"
                for column in errors.T
            ]
            made.add_row(f"{noise_m:g} m", "3 % and 5 degrees off" if is_off else "exact", *texts)
    cli.Terminal().show(made)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (DatasetError,)))
