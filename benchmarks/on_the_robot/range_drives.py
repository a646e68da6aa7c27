"""Drives for `range_coverage.py`: for each robot some for the diagnosis, and others held out.

Robots of MuJoCo and batteries of PyBaMM are drawn from [seed, part, number]; all drives of a robot
have the same distribution. For real recordings the seed determines which are held out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.random import Generator

from benchmarks.concealed.plants.cases import ReadBy, misset
from benchmarks.concealed.plants.chain import rollout
from benchmarks.concealed.plants.instruments import NOISES, Logging, record
from benchmarks.concealed.plants.motion import make_drives, make_route
from benchmarks.concealed.plants.vehicles import VEHICLES
from homeward.datasets import fetch
from homeward.files import write_whole

PARTS = ("rover", "cell", "f1tenth", "husky")
TRAINING, HELD_OUT = 4, 4
"""Drives of each simulated robot."""
BLOCKS = 4
"""Of the car's one drive: each in turn is held out, and the file comes from the others."""
FEWEST_S, SHORTEST_S, LONGEST_S = 30.0, 20.0, 120.0
"""Shortest of the Husky's runs that is used, and windows that are cut from those held out."""
WINDOWS = 3
"""That are cut at random from each of the Husky's runs held out."""
GROUNDS = ("ASPHALT", "FLOORING", "ICE", "SNOW")


@dataclass(frozen=True)
class Site:
    """A diagnosis, and the held-out recordings that test its file.

    Attributes:
        name: Name of the robot and its task.
        nominal: Robot file that the diagnosis begins with.
        columns: Mapping for foreign files.
        training: Recordings that are diagnosed.
        held_out: Recordings that are not.
        runs: Run of each of those.
    """

    name: str
    nominal: Path | str
    columns: str | None
    training: Sequence[Path]
    held_out: Sequence[Path]
    runs: Sequence[str]


def sites(part: str, seed: int, robots: int, folder: Path) -> list[partial[Site]]:
    """Functions that make the sites of a part; `robots` is the number of simulated robots."""
    if part in ("rover", "cell"):
        make = rover_site if part == "rover" else cell_site
        return [
            partial(make, seed, number, folder / f"{part}_{number}") for number in range(robots)
        ]
    if part == "f1tenth":
        return [partial(car_site, block, folder / f"f1tenth_{block}") for block in range(BLOCKS)]
    return [partial(husky_site, seed, ground, folder / f"husky_{ground}") for ground in GROUNDS]


def rover_site(seed: int, number: int, folder: Path) -> Site:
    """A rover of MuJoCo: tours and stop and go on the level, known hills, or different unrecorded
    loads."""
    from benchmarks.concealed.plants import rover, rover_drives
    from benchmarks.concealed.plants import rover_scenarios as scenarios
    from benchmarks.concealed.plants.rover_engine import World

    rng = np.random.default_rng([seed, PARTS.index("rover"), number])
    kind = ("tours", "hills", "loads")[number % 3]
    plain = scenarios.hilly(rng) if kind == "hills" else scenarios.level(rng)
    length_s = scenarios.RUN_S
    count = TRAINING + HELD_OUT
    level = str(rng.choice(list(NOISES)))
    trips = []
    for index in range(count):
        speed_mps = rng.uniform(0.4, 0.85)
        kinds = (
            ("cruise", "stop and go")
            if kind == "hills"
            else ("tour", "stop and go", "tour", "cruise")
        )
        draw = kinds[index // 2 % len(kinds)] if kind == "hills" else kinds[index % len(kinds)]
        if draw == "tour":
            command = rover_drives.tour(rng, length_s, speed_mps)
        elif draw == "stop and go":
            command = rover_drives.stop_and_go(rng, length_s)
        else:
            command = rover_drives.cruise([speed_mps], length_s)
        trip = plain.trips[index % 2]
        load_kg = rng.uniform(0.0, 12.0) if kind == "loads" else 0.0
        loads = np.full(command[0].size, load_kg)
        trips.append(
            dataclasses.replace(trip, speed_mps=command[0], yaw_radps=command[1], payload_kg=loads)
        )
    if kind != "hills":
        trips = [dataclasses.replace(trip, world=World(plain.ground)) for trip in trips]
    vehicle = rover.vehicle_of(rover.calibrated(plain))
    frames = rover.recorded(vehicle, plain, trips, level, rng)[1]
    nominal = misset(vehicle.robot, rng, 0.1, 0.4)
    return _written(folder, f"rover {number}, {kind}", nominal.to_toml(), frames)


def cell_site(seed: int, number: int, folder: Path) -> Site:
    """A vehicle on a battery of PyBaMM: resistance of tabs, cold, or negligible losses; by gauge or
    at terminals."""
    from benchmarks.concealed.plants import cell
    from benchmarks.concealed.plants.cell_electrochemistry import ExhaustedError

    rng = np.random.default_rng([seed, PARTS.index("cell"), number])
    vehicles = [plant for plant in VEHICLES if plant.outdoor]
    vehicle = vehicles[int(rng.integers(len(vehicles)))]
    kind = ("tabs", "cold", "strong")[number % 3]
    pack = cell.STRONG
    if kind == "tabs":
        peak_rate = rng.uniform(1.4, 2.2)
        tab = rng.uniform(0.1, 0.35)
        pack = cell.Pack(cell.ENERGY_CELL, peak_rate, (tab, tab))
    elif kind == "cold":
        pack = cell.Pack(cell.POWER_CELL, rng.uniform(1.5, 2.2), air_c=None)
    read_by: ReadBy = "gauge" if rng.random() < 0.6 else "terminals"
    level = str(rng.choice(list(NOISES)))
    routes = [make_route(vehicle, rng) for _ in range(2)]
    runs = make_drives(vehicle, routes, rng, TRAINING + HELD_OUT, rng.uniform(4.0, 24.0))
    nominal = misset(vehicle.robot, rng, 0.1, 0.4)
    for _ in range(5):
        fitted, cooled = cell.fitted(pack, vehicle, runs, rng)
        mechanism = cell.in_pack(pack, "internal_resistance", fitted, rng, len(runs))
        try:
            works = [rollout(fitted, run, [mechanism], rng, read_by) for run in cooled]
        except ExhaustedError:
            pack = dataclasses.replace(pack, peak_rate=0.8 * pack.peak_rate)
            continue
        frames = [record(work, NOISES[level], Logging(), rng) for work in works]
        robot = dataclasses.replace(nominal, rated_energy_j=fitted.robot.rated_energy_j)
        return _written(
            folder, f"cell {number}, {vehicle.robot.name}, {kind}", robot.to_toml(), frames
        )
    raise RuntimeError(f"no pack is large enough for cell {number}")


def car_site(block: int, folder: Path) -> Site:
    """The F1TENTH car's drive without one block of it, and that block."""
    table = pd.read_csv(fetch("f1tenth_frictionmaps", "")[0])
    pieces = np.array_split(np.arange(len(table)), BLOCKS)
    paths = [folder / f"block_{number}.csv" for number in range(BLOCKS)]
    for path, piece in zip(paths, pieces, strict=True):
        write_whole(path, table.iloc[piece].to_csv(index=False))
    training = [path for number, path in enumerate(paths) if number != block]
    name = f"f1tenth without block {block}"
    return Site(
        name, "f1tenth", "f1tenth_frictionmaps", training, [paths[block]], [f"block {block}"]
    )


def husky_site(seed: int, ground: str, folder: Path) -> Site:
    """Half of the Husky's runs on a ground, and windows of the others, cut at random."""
    rng = np.random.default_rng([seed, PARTS.index("husky"), GROUNDS.index(ground)])
    tables = {path: pd.read_csv(path) for path in sorted(fetch("husky_borealtc", ground))}
    long_enough = [path for path, table in tables.items() if _lasts_s(table) >= FEWEST_S]
    order = [long_enough[index] for index in rng.permutation(len(long_enough))]
    held_out = []
    runs = []
    for path in order[len(order) // 2 :]:
        for number, (start, end) in enumerate(_windows(tables[path], rng)):
            window = folder / f"{path.stem}_{number}.csv"
            write_whole(window, tables[path].iloc[start:end].to_csv(index=False))
            held_out.append(window)
            runs.append(path.stem)
    training = sorted(order[: len(order) // 2])
    return Site(f"husky on {ground}", "husky", "husky_borealtc", training, held_out, runs)


def _lasts_s(table: pd.DataFrame) -> float:
    return float(table["time"].iloc[-1] - table["time"].iloc[0])


def _windows(table: pd.DataFrame, rng: Generator) -> list[tuple[int, int]]:
    """First and last samples of windows of a run."""
    time_s = table["time"].to_numpy() - table["time"].iloc[0]
    cut = []
    for _ in range(WINDOWS):
        length_s = rng.uniform(SHORTEST_S, min(LONGEST_S, time_s[-1]))
        start_s = rng.uniform(0.0, time_s[-1] - length_s)
        cut.append(
            (
                int(np.searchsorted(time_s, start_s)),
                int(np.searchsorted(time_s, start_s + length_s)),
            )
        )
    return cut


def _written(folder: Path, name: str, nominal: str, frames: Sequence[pd.DataFrame]) -> Site:
    paths = [folder / f"drive_{number}.csv" for number in range(len(frames))]
    for path, frame in zip(paths, frames, strict=True):
        write_whole(path, frame.to_csv(index=False))
    write_whole(folder / "nominal.toml", nominal)
    held_out = paths[TRAINING:]
    return Site(
        name,
        folder / "nominal.toml",
        None,
        paths[:TRAINING],
        held_out,
        [path.stem for path in held_out],
    )
