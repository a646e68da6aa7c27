"""How often the diagnosis sees a mismatch where there is none: the false-alarm rate of docs/diagnosis.md.

`python benchmarks/diagnosis/false_alarms.py` diagnoses drives of a Husky that is exactly as its file says, measured
with noise that is correlated in time. It prints the share of verdicts other than no_mismatch, which need a dependence
of some size too, and how often the smallest p-value of a drive is below some levels. It takes about ten minutes.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.tables import rate
from homeward import cli
from homeward.diagnosis import Recording, RecordingError, diagnose
from homeward.diagnosis.explain.residual_test import dependences, independent_blocks
from homeward.diagnosis.fit.folds import cut_folds
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.rules import FALSE_ALARM_RATE
from homeward.physics import load_robot, replay

LEVELS = (FALSE_ALARM_RATE, 0.1, 0.5)
"""Significance levels at which p-values are looked at: the diagnosis's own, and two more for their distribution."""


@dataclass(frozen=True)
class Args:
    """What to diagnose."""

    drives: int = 500
    """Drives, each of 400 s at 2 Hz."""
    seed: int = 0
    """Seed of the first drive; those of the others follow."""


def main(args: Args) -> int:
    """Diagnose and print.

    Returns:
        Number of false alarms.

    Raises:
        RecordingError: An argument cannot be used.
    """
    if args.drives < 1 or args.seed < 0:
        raise RecordingError(f"--drives {args.drives} --seed {args.seed}: give at least 1 and a seed of 0 or more")
    robot = load_robot("husky")
    seeds = range(args.seed, args.seed + args.drives)
    alarms = sum(diagnose([drive(seed)], robot).verdict != "no_mismatch" for seed in seeds)
    shown = rate(alarms, args.drives, ".1%")
    print(f"{alarms} false alarms in {args.drives} drives: {shown}, 95 %; stated: {FALSE_ALARM_RATE:.0%}")
    smallest = np.array([smallest_p_value(drive(seed)) for seed in seeds])
    for level in LEVELS:
        shown = rate(int((smallest <= level).sum()), args.drives, ".1%")
        print(f"smallest p-value <= {level:g}: {shown} of drives")
    return alarms


def smallest_p_value(recording: Recording) -> float:
    """Smallest p-value of all dependences on channels and on time, corrected for their number as in the diagnosis."""
    robot = load_robot("husky")
    runs = average(usable_runs([recording], robot)[0])
    fit = refit(runs, robot)
    blocks = independent_blocks(fit, runs)
    fold, _ = cut_folds(runs, blocks.channels)
    return min(one.p_value for one in dependences(fit, runs, blocks, fold))


def drive(seed: int) -> Recording:
    """A drive with changes of speed, slope and direction; its noise has a correlation of 0.9 from sample to sample."""
    robot, rng = load_robot("husky"), np.random.default_rng(seed)
    time_s = np.arange(0.0, 400.0, 0.5)
    speed = np.repeat(rng.choice([0.0, 0.3, 0.6, 0.9], size=80), 10)
    grade = np.repeat(rng.uniform(-0.05, 0.08, size=20), 40)
    yaw = np.repeat(rng.choice([0.0, 0.0, 0.4, -0.4], size=160), 5)
    noise_w = 3.0 * lfilter([1.0], [1.0, -0.9], rng.normal(size=len(time_s)))
    power = replay(robot, time_s, speed, grade_rad=grade).power_w + noise_w
    channels = {"time_s": time_s, "speed_mps": speed, "grade_rad": grade, "yaw_rate_radps": yaw, "power_w": power}
    return Recording(f"drive {seed}", str(seed), channels)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (RecordingError,)))
