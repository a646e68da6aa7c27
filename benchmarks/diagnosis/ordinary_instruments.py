"""Whether ordinary instruments mislead the diagnosis: clean robots and true effects, recorded through faulty channels.

`python benchmarks/diagnosis/ordinary_instruments.py` drives robots out and back over hills by the project's own kernel,
spoils one thing about the recording at a time, and prints what the diagnosis says over seeds: of a clean robot it ought
to name nothing, and a true effect it ought to find whatever the instrument. It takes about an hour.
"""

from __future__ import annotations

import dataclasses
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from homeward import cli
from homeward.diagnosis import Diagnosis, Recording, RecordingError, diagnose
from homeward.physics import Robot, load_robot, replay

Array = NDArray[np.float64]
Trap = Callable[[pd.DataFrame, np.random.Generator], pd.DataFrame]

STEP_S = 0.1
ROBOTS = ("husky", "jackal", "turtlebot3_burger")
EFFECTS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "clean": {},
    "turning": {"turning": {"scrub": 0.3}},
    "inertia": {"inertia": {"mass_factor": 1.0}},
    "copper_loss": {},
    "internal_resistance": {},
    "surface": {},
}
"""True effects; those without numbers here depend on the robot or on the place, see `drive`."""


@dataclass(frozen=True)
class Args:
    """What to diagnose."""

    traps: tuple[str, ...] = ()
    """Traps, all if left out."""
    robots: tuple[str, ...] = ROBOTS
    """Presets."""
    effects: tuple[str, ...] = ("clean",)
    """True effects, or clean."""
    seeds: int = 10
    """Seeds of each combination."""
    first_seed: int = 100
    """The first of them; the thresholds were chosen on 0 to 4."""
    verbose: bool = False
    """Print the summaries."""


def drive(robot: Robot, seed: int, effect: str = "clean", duration_s: float = 480.0) -> pd.DataFrame:
    """Drive a robot out and back on one path over hills, with stops and turns, measured with little noise.

    Args:
        robot: Who drives, as its file says.
        seed: Of drive and noise.
        effect: What it has beside.
        duration_s: How long.
    """
    rng = np.random.default_rng(seed)
    count = int(duration_s / STEP_S)
    time_s: Array = STEP_S * np.arange(count, dtype=np.float64)
    top = robot.max_speed_mps
    speed = uniform_filter1d(_levels(rng, count, (0.0, 0.3, 0.5, 0.7, 0.9), 6.0, 20.0), 15, mode="nearest") * top
    speed[speed < 0.02 * top] = 0.0
    path_m = np.concatenate(([0.0], np.cumsum(speed[:-1] * STEP_S)))
    half_m = path_m[-1] / 2.0
    place_m = half_m - np.abs(path_m - half_m)
    home = np.where(path_m > half_m, -1.0, 1.0)
    waves_m = rng.uniform(40.0, 120.0, 4) * top
    phases, slopes = rng.uniform(0.0, 2.0 * np.pi, 4), rng.uniform(0.02, 0.05, 4)
    height = sum(
        s * w / (2 * np.pi) * np.sin(2 * np.pi * place_m / w + p)
        for s, w, p in zip(slopes, waves_m, phases, strict=True)
    )
    slope = sum(s * np.cos(2 * np.pi * place_m / w + p) for s, w, p in zip(slopes, waves_m, phases, strict=True))
    grade = np.arctan(slope) * home
    turns = uniform_filter1d(_levels(rng, count, (0.0, 0.0, 0.0, 0.3, -0.3, 0.6, -0.6), 3.0, 9.0), 9, mode="nearest")
    yaw_rate = turns * (speed > 0.0)
    sensing_hz = _levels(rng, count, (0.0, 0.2, 0.5), 30.0, 60.0) * robot.max_sensing_hz
    drawn = {
        "grade_rad": grade, "yaw_rate_radps": yaw_rate, "accel_mps2": np.gradient(speed, time_s),
        "sensing_hz": sensing_hz,
    }  # fmt: skip
    usual = float(replay(robot, time_s, speed, **drawn).power_w.mean())
    true, roughness = robot, np.zeros(count)
    if EFFECTS[effect]:
        true = dataclasses.replace(robot, effects={**robot.effects, **EFFECTS[effect]})
    elif effect == "internal_resistance":  # a tenth of the mean power
        sag = {"internal_resistance": {"ohm": 0.1 * robot.nominal_voltage_v**2 / usual}}
        true = dataclasses.replace(robot, effects={**robot.effects, **sag})
    elif effect == "copper_loss":
        drive_n = robot.rolling_resistance * robot.mass_kg * 9.81
        loss = {"copper_loss": {"w_per_n2": 0.3 * usual / drive_n**2}}
        true = dataclasses.replace(robot, effects={**robot.effects, **loss})
    elif effect == "surface":
        true = dataclasses.replace(robot, effects={**robot.effects, "surface": {"gain": 0.6}})
        roughness = (place_m > 0.6 * half_m).astype(np.float64)
    power_w = replay(true, time_s, speed, roughness=roughness, **drawn).power_w
    drift = lfilter([np.sqrt(1.0 - 0.98**2)], [1.0, -0.98], rng.standard_normal(count))
    power_w = power_w * (1.0 + 0.02 * drift) + 0.02 * usual * rng.standard_normal(count)
    return pd.DataFrame({
        "time_s": time_s,
        "speed_mps": speed + 0.003 * top * rng.standard_normal(count) * (speed > 0.0),
        "yaw_rate_radps": yaw_rate + 0.005 * rng.standard_normal(count),
        "grade_rad": grade + 0.002 * rng.standard_normal(count),
        "elevation_m": height + 0.005 * rng.standard_normal(count),
        "base_distance_m": place_m,
        "sensing_hz": sensing_hz,
        "power_w": power_w,
    })  # fmt: skip


def _levels(
    rng: np.random.Generator, count: int, choices: tuple[float, ...], shortest_s: float, longest_s: float
) -> Array:
    values = np.empty(count)
    start = 0
    while start < count:
        length = int(rng.uniform(shortest_s, longest_s) / STEP_S)
        values[start : start + length] = rng.choice(choices)
        start += length
    return values


def _noisy(table: pd.DataFrame, name: str, size: float, rng: np.random.Generator) -> pd.DataFrame:
    return table.assign(**{name: table[name] + size * rng.standard_normal(len(table))})


def _by_elevation(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns=["grade_rad", "base_distance_m"])


def _by_grade(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns=["elevation_m", "base_distance_m"])


def _held(table: pd.DataFrame, names: tuple[str, ...], every: int) -> pd.DataFrame:
    index = np.arange(len(table)) // every * every
    return table.assign(**{name: table[name].to_numpy()[index] for name in names})


def _late(table: pd.DataFrame, name: str, lag_s: Array | float) -> pd.DataFrame:
    time_s = table["time_s"].to_numpy()
    return table.assign(**{name: np.interp(time_s - lag_s, time_s, table[name].to_numpy())})


def _drifting(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    time_s = table["time_s"].to_numpy()
    return _late(_by_grade(table), "power_w", rng.uniform(0.2, 2.0) * time_s / time_s[-1])


def _charged(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    tail = table.iloc[[-1] * 600].copy()
    tail["time_s"] = table["time_s"].iloc[-1] + STEP_S * np.arange(1, 601)
    tail["speed_mps"], tail["yaw_rate_radps"] = 0.0, 0.0
    usual = table["power_w"].mean()
    tail["power_w"] = -0.8 * usual + 0.02 * usual * rng.standard_normal(600)
    return _by_grade(pd.concat([table, tail], ignore_index=True))


def _spiked(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    power = table["power_w"].to_numpy().copy()
    power[rng.choice(len(power), 8, replace=False)] *= rng.uniform(15.0, 40.0, 8)
    return _by_grade(table.assign(power_w=power))


def _rate(table: pd.DataFrame, every: int) -> pd.DataFrame:
    return _by_grade(table).iloc[::every].reset_index(drop=True)


TRAPS: Mapping[str, Trap] = {
    "none": lambda table, rng: _by_grade(table),
    "elevation, good": lambda table, rng: _by_elevation(table),
    "elevation, noise 0.5 m": lambda table, rng: _noisy(_by_elevation(table), "elevation_m", 0.5, rng),
    "elevation, 1 m steps": lambda table, rng: _by_elevation(table).assign(elevation_m=table["elevation_m"].round()),
    "elevation, 10 s late": lambda table, rng: _late(_by_elevation(table), "elevation_m", 10.0),
    "grade, noise 0.7 deg": lambda table, rng: _noisy(_by_grade(table), "grade_rad", np.radians(0.7), rng),
    "elevation, noise 0.5 m, base known": lambda table, rng: _noisy(
        table.drop(columns="grade_rad"), "elevation_m", 0.5, rng
    ),
    "grade, tilted 1.5 deg, base known": lambda table, rng: table.drop(columns="elevation_m").assign(
        grade_rad=table["grade_rad"] + np.radians(1.5)
    ),
    "no grade": lambda table, rng: _by_grade(table).drop(columns="grade_rad"),
    "speed, noise 5 %": lambda table, rng: _noisy(
        _by_grade(table), "speed_mps", 0.05 * float(table["speed_mps"].max()), rng
    ),
    "speed held for 1 s": lambda table, rng: _held(_by_grade(table), ("speed_mps",), 10),
    "all but time held for 1 s": lambda table, rng: _held(
        _by_grade(table), ("speed_mps", "yaw_rate_radps", "grade_rad", "power_w"), 10
    ),
    "power held for 2 s": lambda table, rng: _held(_by_grade(table), ("power_w",), 20),
    "power clock drifts": _drifting,
    "charging at the end": _charged,
    "power of the wrong sign": lambda table, rng: _by_grade(table).assign(power_w=-table["power_w"]),
    "eight spikes": _spiked,
    "1 Hz": lambda table, rng: _rate(table, 10),
    "payload by run": lambda table, rng: _by_grade(table),
}
"""What is spoilt, by name; `recordings` adds the payload to the drive itself."""


def recordings(robot: Robot, trap: str, seed: int, effect: str = "clean", runs: int = 3) -> list[Recording]:
    """Runs of a robot through a faulty instrument."""
    made = []
    for index in range(runs):
        own = 1000 * seed + index
        loaded = 0.15 * index * robot.mass_kg if trap == "payload by run" else 0.0
        driven = robot
        if loaded:
            driven = dataclasses.replace(robot, effects={**robot.effects, "payload": {"mass_kg": loaded}})
        table = TRAPS[trap](drive(driven, own, effect), np.random.default_rng([own, 1]))
        if trap == "payload by run":
            table["payload_kg"] = loaded
        channels = {str(name): table[name].to_numpy(dtype=np.float64) for name in table}
        made.append(Recording(f"run{index}.csv", str(index), channels))
    return made


def told(diagnosis: Diagnosis) -> str:
    """The verdict, with what is named."""
    names = " + ".join(sorted(one.effect for one in diagnosis.missing_physics))
    return f"{names}" if names else diagnosis.verdict


def main(args: Args) -> None:
    """Diagnose and print.

    Raises:
        RecordingError: A trap or effect is not known.
    """
    unknown = [one for one in (*args.traps, *args.effects) if one not in {*TRAPS, *EFFECTS}]
    if unknown:
        raise RecordingError(f"{unknown[0]} is not known; traps: {', '.join(TRAPS)}; effects: {', '.join(EFFECTS)}")
    console = Console()
    table = Table("trap", "effect", *args.robots, title=f"Verdicts, seeds {args.first_seed} and following")
    for effect in args.effects:
        for trap in args.traps or TRAPS:
            row = []
            for name in args.robots:
                robot, counts = load_robot(name), Counter[str]()
                for seed in range(args.first_seed, args.first_seed + args.seeds):
                    diagnosis = diagnose(recordings(robot, trap, seed, effect), robot)
                    counts[told(diagnosis)] += 1
                    if args.verbose:
                        off = ", ".join(f"{one.group} {one.fitted:.3g}" for one in diagnosis.parameters_off)
                        print(f"{trap} | {effect} | {name} | {seed}: {told(diagnosis)} [{off}] {diagnosis.summary}",
                              flush=True)  # fmt: skip
                row.append(", ".join(f"{count} {said}" for said, count in counts.most_common()))
            table.add_row(trap, effect, *row)
    console.print(table)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (RecordingError,)))
