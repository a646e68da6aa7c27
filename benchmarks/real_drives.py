"""The file that a diagnosis writes, on later drives of real vehicles, beside two regressions.

`HOMEWARD_DATA=FOLDER python -m benchmarks.real_drives --sets bmw v9 leaf eco husky f1tenth`; with
`--scales`, what the priors of the fit made to predict are worth; with `--regressions`, the two
regressions alone, in seconds.

A part of each set is diagnosed, and the file as written is replayed on the other drives, which
nothing has seen. Beside it stand the given file and two regressions that are fitted to the same
drives: a ridge on features of the motion, and least squares on a formula with no negative
coefficient, so that a robot file could say the same. All are compared by the energy of a drive
(charge, where motor current was recorded), and the power. A file is replayed in the windows of the
diagnosis. A regression has these windows or means of a second, in which others fit such models,
whichever is better on all later drives of a vehicle: a choice in favour of the regression, as
nobody who has not driven yet could make it.

What was concealed is a label: BMW and Leaf were recorded with the power of heater and cooler, which
no recording contains.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from joblib import Parallel, delayed
from rich.console import Console
from rich.table import Table
from scipy.optimize import least_squares
from sklearn.linear_model import RidgeCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from homeward.datasets import DatasetError, fetch
from homeward.diagnosis import Recording, analyse, read_recording, thresholds
from homeward.diagnosis.fit.predictive import SCALES, Scales, fit_predictive
from homeward.diagnosis.fit.replay import Runs, average, predict
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.read.signals import WINDOW_S
from homeward.diagnosis.tell.report import corrected_toml
from homeward.logs.channels import Array
from homeward.physics import Robot, load_robot
from homeward.physics.model import GRAVITY_MPS2

Set = Literal["bmw", "v9", "leaf", "eco", "husky", "f1tenth"]
GROUNDS = ("ASPHALT", "FLOORING", "ICE", "SNOW")
BLOCKS = 4
"""Of the car's one drive: each in turn is held out."""
WIDTH = 170  # chosen: characters, so that a split stays in a line
LONGER_S, LONGER = 1.0, ", 1 s"
"""Windows that the regressions may have instead of those of the diagnosis, means of a second, and
what the names of these predictions end in."""
FEW_DRIVES = 6
"""Below so many, one drive in turn is held out instead of every second one."""
TURN_MPS = 0.57
"""Difference of wheel speeds by a turn of 1 rad/s, m/s: the track of a Husky; only scales a
feature."""
KELVIN_C = 16.0, 22.0
"""Below and above which the ridge may know heating and cooling, as in the published regressions of
car energy."""


@dataclass(frozen=True)
class Args:
    """What to run."""

    sets: tuple[Set, ...] = ("bmw", "v9", "leaf", "eco", "husky", "f1tenth")
    """Vehicles; those whose recordings are not at hand are named and left out."""
    jobs: int = 2
    """Processes."""
    without: tuple[str, ...] = ()
    """Conditions under which an effect is named that are left out, to see what they are worth."""
    scales: bool = False
    """Instead: the fit made to predict, without a diagnosis, with each of its priors half and twice
    as wide."""
    regressions: bool = False
    """Instead: the two regressions alone, in both windows."""


@dataclass(frozen=True)
class Split:
    """A set divided into drives that are diagnosed and later ones."""

    vehicle: str
    part: str
    robot: str
    diagnosed: Sequence[Recording]
    later: Sequence[Recording]


def splits(vehicle: Set) -> list[Split]:
    """Divisions of a vehicle's drives: odd and even positions of the sorted names, both ways, or
    one in turn.

    Raises:
        DatasetError: Its recordings are not at hand.
    """
    if vehicle == "husky":
        divisions = []
        for ground in GROUNDS:
            drives = [
                read_recording(path, "husky_borealtc")
                for path in sorted(fetch("husky_borealtc", ground))
            ]
            divisions += _halves(vehicle, "husky", drives, f"{ground.lower()}, ")
        return divisions
    if vehicle == "f1tenth":
        drive = read_recording(fetch("f1tenth_frictionmaps", "")[0], "f1tenth_frictionmaps")
        return _one_in_turn(vehicle, "f1tenth", _blocks(drive))
    folder = Path(os.environ.get("HOMEWARD_DATA", "")) / _FOLDERS[vehicle]
    if not os.environ.get("HOMEWARD_DATA") or not folder.is_dir():
        raise DatasetError(
            f"{vehicle}: no folder {_FOLDERS[vehicle]} in HOMEWARD_DATA; its recordings are not public"
        )
    robot = str(folder.parent / "robots" / f"{_ROBOTS[vehicle]}.toml")
    drives = [read_recording(path) for path in sorted(folder.glob("*.csv"))]
    if len(drives) < FEW_DRIVES:
        return _one_in_turn(vehicle, robot, drives)
    divisions = _halves(vehicle, robot, drives, "")
    if vehicle == "bmw":
        summer = [drive for drive in drives if "TripA" in drive.name]
        winter = [drive for drive in drives if "TripB" in drive.name]
        divisions.append(Split(vehicle, "winter to summer", robot, diagnosed=winter, later=summer))
        divisions.append(Split(vehicle, "summer to winter", robot, diagnosed=summer, later=winter))
        divisions += _halves(vehicle, robot, winter, "winter, ")
    return divisions


_FOLDERS = {"bmw": "bmw_i3", "v9": "euc_v9", "leaf": "leaf_ved", "eco": "tamu_track"}
_ROBOTS = {"bmw": "bmw_i3", "v9": "v9", "leaf": "leaf", "eco": "tamu"}


def _halves(vehicle: str, robot: str, drives: Sequence[Recording], prefix: str) -> list[Split]:
    odd = drives[::2]
    even = drives[1::2]
    return [
        Split(vehicle, f"{prefix}odd to even", robot, diagnosed=odd, later=even),
        Split(vehicle, f"{prefix}even to odd", robot, diagnosed=even, later=odd),
    ]


def _one_in_turn(vehicle: str, robot: str, drives: Sequence[Recording]) -> list[Split]:
    """Splits by which each drive in turn is the later one."""
    divisions = []
    for number, drive in enumerate(drives):
        diagnosed = [*drives[:number], *drives[number + 1 :]]
        divisions.append(Split(vehicle, f"without {number}", robot, diagnosed, later=[drive]))
    return divisions


def _blocks(drive: Recording) -> list[Recording]:
    """A drive cut into parts of equal length."""
    block_of_sample = np.arange(len(drive)) * BLOCKS // len(drive)
    blocks = []
    for number in range(BLOCKS):
        channels = {
            name: values[block_of_sample == number] for name, values in drive.channels.items()
        }
        blocks.append(
            replace(
                drive, name=f"block {number}", sha256=f"{drive.sha256}{number}", channels=channels
            )
        )
    return blocks


@dataclass(frozen=True)
class Errors:
    """Errors on later drives: of all energy, of a drive's on average (each at most a half), and R2
    of power."""

    total_pct: float
    drive_pct: float
    r2: float


@dataclass(frozen=True)
class Outcome:
    """What came of one split."""

    split: str
    vehicle: str
    verdict: str
    named: tuple[str, ...]
    holds: str
    errors: dict[str, Errors]
    # by model: share by which the energy of each later drive is off, at most a half
    missed: dict[str, list[float]]
    # by load of `LABELS`, of later drives with its label: by the file, by the label
    labelled_j: dict[str, list[tuple[float, float]]]


def run(split: Split, without: Sequence[str] = ()) -> Outcome:
    """Diagnose, write the file, and replay it on the later drives."""
    analysis = analyse(list(split.diagnosed), split.robot, without=without)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "corrected.toml"
        path.write_text(corrected_toml(analysis))
        corrected = load_robot(path)
    nominal = load_robot(split.robot)
    later = _windows(split.later, nominal)
    predictions = {
        "given": Prediction(predict(later, nominal), later),
        "file": Prediction(predict(later, corrected), later),
    }
    predictions |= regressions(split, nominal)
    errors = {name: prediction.errors() for name, prediction in predictions.items()}
    missed = {
        name: missed_of(prediction.predicted, prediction.runs).tolist()
        for name, prediction in predictions.items()
    }
    diagnosis = analysis.diagnosis
    named = tuple(effect.effect for effect in diagnosis.missing_physics)
    holds = "nominal" if diagnosis.file is None else diagnosis.file.holds
    labelled = {effect: labelled_load(effect, split, later, corrected) for effect in LABELS}
    return Outcome(
        split=f"{split.vehicle}, {split.part}",
        vehicle=split.vehicle,
        verdict=diagnosis.verdict,
        named=named,
        holds=holds,
        errors=errors,
        missed=missed,
        labelled_j=labelled,
    )


@dataclass(frozen=True)
class Prediction:
    """What was predicted of the later drives, in which windows."""

    predicted: Array  # W or A, (windows,)
    runs: Runs

    def errors(self) -> Errors:
        """Errors in these windows."""
        return errors_of(self.predicted, self.runs)


REGRESSIONS = ("ridge", "least squares")


def regressions(split: Split, robot: Robot) -> dict[str, Prediction]:
    """The later drives by each regression, fitted in the windows of the diagnosis and in those of a
    second."""
    usable_before, _ = usable_runs(split.diagnosed, robot)
    usable_later, _ = usable_runs(split.later, robot)
    predictions = {}
    for suffix, samples, window_s in (
        ("", thresholds.SAMPLES_A_WINDOW, WINDOW_S),
        (LONGER, 1, LONGER_S),
    ):
        before = average(usable_before, samples, window_s)
        later = average(usable_later, samples, window_s)
        for name, regression in zip(REGRESSIONS, (ridge, formula), strict=True):
            predictions[name + suffix] = Prediction(regression(before, later), later)
    return predictions


def in_better_windows(of_vehicle: Sequence[dict[str, Errors]]) -> list[dict[str, Errors]]:
    """Errors of the splits of a vehicle, of each regression in the windows in which the energy of a
    drive is off by less in the mean of the splits."""
    chosen = [
        {name: errors for name, errors in split.items() if not name.endswith(LONGER)}
        for split in of_vehicle
    ]
    for name in REGRESSIONS:
        longer_pct = np.mean([split[name + LONGER].drive_pct for split in of_vehicle])
        if longer_pct < np.mean([split[name].drive_pct for split in of_vehicle]):
            for errors, split in zip(chosen, of_vehicle, strict=True):
                errors[name] = split[name + LONGER]
    return chosen


def _windows(drives: Sequence[Recording], robot: Robot) -> Runs:
    usable, _ = usable_runs(drives, robot)
    return average(usable, thresholds.SAMPLES_A_WINDOW)


def missed_of(predicted: Array, runs: Runs) -> Array:
    """Share by which the energy or charge of each drive is off, at most a half, shape (drives,)."""
    error = np.abs(np.bincount(runs.run, (predicted - runs.observed) * runs.duration_s))
    drawn = np.abs(np.bincount(runs.run, runs.observed * runs.duration_s))
    return np.minimum(error / drawn, thresholds.HALF)


def errors_of(predicted: Array, runs: Runs) -> Errors:
    """Errors of a prediction of later drives."""
    error_j = np.abs(np.bincount(runs.run, (predicted - runs.observed) * runs.duration_s))
    drawn_j = np.abs(np.bincount(runs.run, runs.observed * runs.duration_s))
    squared_error = np.sum((predicted - runs.observed) ** 2)
    r2 = 1.0 - squared_error / np.sum((runs.observed - runs.observed.mean()) ** 2)
    return Errors(
        total_pct=100.0 * error_j.sum() / drawn_j.sum(),
        drive_pct=100.0 * float(missed_of(predicted, runs).mean()),
        r2=float(r2),
    )


@dataclass(frozen=True)
class Motion:
    """What the regressions know of a window: speed, acceleration, slope, turning and temperature,
    (windows,) each."""

    speed_mps: Array
    accel_mps2: Array
    slope: Array
    turn_mps: Array
    warm_c: Array


def motion_of(runs: Runs) -> Motion:
    """Motion in the windows of runs."""

    def channel(name: str, otherwise: float) -> Array:
        values = runs.context.get(name, np.full(len(runs.run), np.nan))
        return np.nan_to_num(values, nan=otherwise)

    return Motion(
        np.abs(channel("speed_mps", 0.0)),
        channel("accel_mps2", 0.0),
        channel("grade_rad", 0.0),
        TURN_MPS * np.abs(channel("yaw_rate_radps", 0.0)),
        channel("temperature_c", 20.0),
    )


def ridge(training: Runs, later: Runs) -> Array:
    """Ridge on standardised features, its penalty by cross-validation; prediction for the later
    windows."""
    motion_before = motion_of(training)
    turns = float(np.ptp(motion_before.turn_mps)) > 0.0
    warms = float(np.std(motion_before.warm_c)) > 0.5

    def features(motion: Motion) -> Array:
        speed = motion.speed_mps
        accel = motion.accel_mps2
        slope = motion.slope
        force = accel + GRAVITY_MPS2 * slope
        columns = [
            speed, speed**2, speed**3, np.maximum(force, 0.0) * speed, np.minimum(force, 0.0) * speed,
            force**2 * speed, speed * slope, speed * accel, speed > 0.1,
        ]  # fmt: skip
        if turns:
            columns += [motion.turn_mps, np.sqrt(motion.turn_mps), motion.turn_mps * speed]
        if warms:
            columns += [
                np.maximum(KELVIN_C[0] - motion.warm_c, 0.0),
                np.maximum(motion.warm_c - KELVIN_C[1], 0.0),
            ]
        return np.column_stack([np.asarray(column, np.float64) for column in columns])

    model = make_pipeline(StandardScaler(), RidgeCV(np.logspace(-3.0, 4.0, 15)))
    model.fit(features(motion_before), training.observed)
    return np.asarray(model.predict(features(motion_of(later))))


SET_POINTS = (0.5, 0.8, 1.1)
"""Set points of a heater from which the formula is fitted, over 20 C: 10, 16 and 22 C. Chosen: from
cool to warm."""


def formula(training: Runs, later: Runs) -> Array:
    """P0 + max(F, 0) v + r min(F, 0) v + h max(T0 - T, 0), F = c0 + c2 v^2 + M a + W slope, no
    coefficient negative.

    Motor current follows the force: P0 and max(F, 0) while moving, and two terms of turning.
    """
    motion_before = motion_of(training)
    current = training.unit == "A"
    spread = float(np.std(training.observed))
    mean_mps = max(float(motion_before.speed_mps.mean()), 0.1)

    def predicted(numbers: Array, motion: Motion) -> Array:
        idle, rolling, drag, mass, weight, back, heater, below_c, root = numbers
        speed = motion.speed_mps
        turn = motion.turn_mps
        force = (
            rolling
            + drag * speed**2
            + mass * motion.accel_mps2
            + weight * GRAVITY_MPS2 * motion.slope
        )
        if current:
            moving = np.minimum((speed + 0.5 * turn) / 0.05, 1.0)
            return np.asarray(
                moving * (idle + np.maximum(force, 0.0)) + below_c * turn + root * np.sqrt(turn)
            )
        heated = heater * np.maximum(below_c - motion.warm_c, 0.0)
        return np.asarray(
            idle + (np.maximum(force, 0.0) + back * np.minimum(force, 0.0)) * speed + heated
        )

    force_size = spread if current else spread / mean_mps
    scale = np.array([
        float(np.mean(np.abs(training.observed))), force_size, force_size / mean_mps**2, force_size, force_size, 1.0,
        spread / 20.0, spread if current else 20.0, spread,
    ])  # fmt: skip
    start = np.array([0.1, 0.2, 0.1, 0.5, 0.5, 0.5, 0.01, 0.8, 0.01])
    high = np.array([*[np.inf] * 5, 1.0, np.inf, np.inf if current else 1.5, np.inf])

    def misfit(numbers: Array) -> Array:
        return np.asarray((predicted(numbers * scale, motion_before) - training.observed) / spread)

    # From one set point of the heater alone it ends in another optimum with another number of
    # threads.
    fits = []
    for set_point in SET_POINTS:
        start[7] = set_point
        fits.append(least_squares(misfit, start, bounds=(np.zeros(len(start)), high), max_nfev=300))
    best = min(fits, key=lambda fit: float(fit.cost))
    return predicted(best.x * scale, motion_of(later))


LABELS = {"heater": "heater_w", "cooler": "ac_w"}
"""Mean power that no recording contains, as named in labels.json, by its effect."""


def labelled_load(
    effect: str, split: Split, later: Runs, robot: Robot
) -> list[tuple[float, float]]:
    """Energy of a load in later drives by the file, and by the label that no recording contains,
    J."""
    file = Path(split.later[0].name).parent / "labels.json"
    if split.vehicle not in ("bmw", "leaf") or not file.is_file():
        return []
    labels = json.loads(file.read_text())
    other_effects = {name: sizes for name, sizes in robot.effects.items() if name != effect}
    without_it = replace(robot, effects=other_effects)
    load_w = predict(later, robot) - predict(later, without_it)
    energies = []
    for number, name in enumerate(later.names):
        label_w = labels.get(Path(name).stem, {}).get(LABELS[effect], np.nan)
        if np.isfinite(label_w):
            in_drive = later.run == number
            length_s = later.duration_s[in_drive]
            energies.append((float(load_w[in_drive] @ length_s), float(label_w * length_s.sum())))
    return energies


@dataclass(frozen=True)
class Varied:
    """Errors of the fit made to predict on later drives of one split, by the prior that was made
    wider or narrower."""

    vehicle: str
    errors: dict[str, Errors]


def vary(split: Split) -> Varied:
    """Fit a file that predicts with other priors, and replay it on the later drives."""
    robot = load_robot(split.robot)
    training = _windows(split.diagnosed, robot)
    later = _windows(split.later, robot)
    priors = {"as they are": SCALES}
    for scale in dataclasses.fields(Scales):
        for factor in (0.5, 2.0):
            wider = replace(SCALES, **{scale.name: factor * getattr(SCALES, scale.name)})
            priors[f"{scale.name} x {factor:g}"] = wider
    errors = {}
    for name, scales in priors.items():
        fit = fit_predictive(
            training, robot, robot, lambda changed: predict(training, changed), training.run, scales
        )
        errors[name] = errors_of(predict(later, fit.changed), later)
    return Varied(split.vehicle, errors)


def show_varied(outcomes: Sequence[Varied]) -> None:
    """Print the mean over splits by vehicle, as a table with a row for each prior."""
    vehicles = list(dict.fromkeys(outcome.vehicle for outcome in outcomes))
    table = Table(
        title="The fit made to predict, later drives: energy of a drive off by, %; R2 of power"
    )
    for name in ("prior", *vehicles):
        table.add_column(name)
    for prior in outcomes[0].errors:
        cells = []
        for vehicle in vehicles:
            of_vehicle = [
                outcome.errors[prior] for outcome in outcomes if outcome.vehicle == vehicle
            ]
            drive_pct = np.mean([errors.drive_pct for errors in of_vehicle])
            cells.append(f"{drive_pct:.1f}  {np.mean([errors.r2 for errors in of_vehicle]):.3f}")
        table.add_row(prior, *cells)
    Console(width=WIDTH).print(table)


def regress(split: Split) -> tuple[Split, dict[str, Errors]]:
    """Errors of each regression in both windows."""
    predictions = regressions(split, load_robot(split.robot))
    return split, {name: prediction.errors() for name, prediction in predictions.items()}


def show_regressions(outcomes: Sequence[tuple[Split, dict[str, Errors]]]) -> None:
    """Print the errors of the regressions by split and, in the mean, by vehicle."""
    table = Table(
        title="Later drives, energy off by: all of it / a drive on average, %; R2 of power"
    )
    for name in ("drives", *outcomes[0][1]):
        table.add_column(name)
    for split, errors in outcomes:
        cells = [_cell([of_model]) for of_model in errors.values()]
        table.add_row(f"{split.vehicle}, {split.part}", *cells)
    for vehicle in dict.fromkeys(split.vehicle for split, _ in outcomes):
        all_of = [errors for split, errors in outcomes if split.vehicle == vehicle]
        cells = [_cell([errors[model] for errors in all_of]) for model in all_of[0]]
        table.add_row(f"{vehicle}, mean of {len(all_of)}", *cells, style="bold")
    Console(width=WIDTH).print(table)


def at_hand(vehicles: Sequence[Set]) -> list[Split]:
    """Splits of the vehicles whose recordings are at hand; the others are named on standard
    error."""
    work: list[Split] = []
    for vehicle in vehicles:
        try:
            work += splits(vehicle)
        except DatasetError as error:
            print(f"left out: {error}", file=sys.stderr)
    return work


def main(args: Args) -> None:
    """Run the sets and print their table."""
    work = at_hand(args.sets)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if args.scales:
            show_varied(list(Parallel(args.jobs)(delayed(vary)(split) for split in work)))
        elif args.regressions:
            show_regressions(list(Parallel(args.jobs)(delayed(regress)(split) for split in work)))
        else:
            show(list(Parallel(args.jobs)(delayed(run)(split, args.without) for split in work)))


def _cell(errors: Sequence[Errors]) -> str:
    """Mean of some errors in a cell."""
    total_pct, drive_pct, r2 = np.mean(
        [dataclasses.astuple(of_split) for of_split in errors], axis=0
    ).tolist()
    return f"{total_pct:.1f} / {drive_pct:.1f}  {r2:.2f}"


def show(outcomes: Sequence[Outcome]) -> None:
    """Print the errors of each split and their mean by vehicle, and the heaters and coolers
    beside their labels."""
    console = Console(width=WIDTH)
    table = Table(
        title="Later drives, energy off by: all of it / a drive on average, %; R2 of power"
    )
    for name in (
        "drives",
        "given file",
        "corrected.toml",
        "ridge",
        "least squares",
        "holds",
        "named",
    ):
        table.add_column(name)
    means = []
    for vehicle in dict.fromkeys(outcome.vehicle for outcome in outcomes):
        of_vehicle = [outcome for outcome in outcomes if outcome.vehicle == vehicle]
        all_errors = in_better_windows([outcome.errors for outcome in of_vehicle])
        for outcome, by_model in zip(of_vehicle, all_errors, strict=True):
            cells = [_cell([errors]) for errors in by_model.values()]
            table.add_row(
                outcome.split, *cells, outcome.holds, ", ".join(outcome.named) or outcome.verdict
            )
        cells = [_cell([by_model[name] for by_model in all_errors]) for name in all_errors[0]]
        means.append((f"{vehicle}, mean of {len(of_vehicle)}", *cells))
    for row in means:
        table.add_row(*row, style="bold")
    console.print(table)
    for outcome in outcomes:
        for effect, energies_j in outcome.labelled_j.items():
            _show_labelled(console, outcome.split, effect, energies_j)
    halves = [
        outcome for outcome in outcomes if outcome.split in ("bmw, odd to even", "bmw, even to odd")
    ]
    both = "bmw, both halves, each by the file of the other"
    for effect in LABELS:
        of_halves = [energies for outcome in halves for energies in outcome.labelled_j[effect]]
        _show_labelled(console, both, effect, of_halves)


def _show_labelled(
    console: Console, drives: str, effect: str, energies_j: Sequence[tuple[float, float]]
) -> None:
    """Print a load's energy in some drives by the file and by its label."""
    if not energies_j:
        return
    by_file_j, by_label_j = np.sum(energies_j, axis=0)
    off = f"{100.0 * (by_file_j / by_label_j - 1.0):+.0f} %" if by_label_j > 0.0 else "no share"
    console.print(
        f"{drives}: the {effect} in {len(energies_j)} labelled drives, {by_file_j / 1e6:.2f} MJ by the file, "
        f"{by_label_j / 1e6:.2f} MJ by the label: {off}"
    )


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
