"""Coverage of the 90 % interval of a corrected file for the energy of the rest of a drive, on
held-out drives.

`python benchmarks/on_the_robot/range_coverage.py --out runs/range_coverage` does what a user does:
it diagnoses recordings, writes `corrected.toml` with its table `[uncertainty]`, and predicts from
that file with `homeward.watch`, as if live, the energy of the rest of other drives. It prints, by
part, the coverage with its interval (bootstrap over independent robots, blocks or runs), bias, half
width and CRPS. For comparison it prints the error of d_max alone (Tiwari et al., Eq. 8, on level
ground at the drive's mean speed and duty cycle), for the given and the corrected file.
`range_drives.py` defines the drives. Finished sites are stored.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.kept import Kept
from benchmarks.on_the_robot.range_drives import PARTS, Site, sites
from benchmarks.tables import span, table
from homeward import cli
from homeward.agents.evaluation.statistics import RESAMPLES
from homeward.companion import CompanionError
from homeward.datasets import DatasetError
from homeward.diagnosis import Recording, analyse, read_recording
from homeward.diagnosis.fit.replay import current_a
from homeward.diagnosis.read.signals import signals, steps_s
from homeward.diagnosis.tell.report import write_outputs
from homeward.physics import Robot, d_max, load_robot
from homeward.watch.predictions import Watched, rest_of
from homeward.watch.replay import watch
from homeward.watch.scores import missing, scores_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Args:
    """What to drive."""

    parts: tuple[str, ...] = PARTS
    """Of rover (MuJoCo), cell (PyBaMM), f1tenth and husky."""
    robots: int = 12
    """Simulated robots of a part."""
    seed: int = 1
    """Seed of what is drawn; 0 and 11 to 16 were used to develop the tool."""
    out: Path = Path("runs/range_coverage")
    """Folder of recordings, diagnoses and range_coverage.json."""


class CoverageError(ValueError):
    """An argument that cannot be used."""


def score_of(site: Site, run: str, watched: Watched, plain: tuple[Array, Array]) -> dict[str, Any]:
    """Scores of one held-out drive or window: sums over its moments, over the sum of the measured
    energies of the rest.

    `bias` is the sum of predictions over that of measured values, less 1; `width` half the
    interval; `nominal` and `corrected` the absolute error of d_max alone with the two files.

    Args:
        site: The site.
        run: Name of the run.
        watched: Predictions and measured values.
        plain: Predictions of d_max alone at its moments, with the nominal and with the corrected
            file.
    """
    total_j = float(watched.took_j.sum())
    half_j = 0.5 * (watched.high_j - watched.low_j)
    scores_j = scores_of(watched).crps
    nominal, corrected = (
        float(np.abs(prediction_j - watched.took_j).sum()) / total_j for prediction_j in plain
    )
    return {
        "site": site.name, "run": run, "moments": len(half_j), "covered": float(watched.covered.mean()),
        "covered_first": bool(watched.covered[0]), "bias": float(watched.mean_j.sum()) / total_j - 1.0,
        "width": float(half_j.sum()) / total_j, "crps": float(scores_j.sum()) / total_j, "nominal": nominal,
        "corrected": corrected,
    }  # fmt: skip


def plain_of(robot: Robot, recording: Recording, watched: Watched) -> Array:
    """Energy of the rest at each moment by the paper's model, shape (moments,).

    It is that of d_max on level ground at the drive's mean speed while moving and its duty cycle.
    For motor currents it is the charge by rolling, drag and slope.
    """
    robot = dataclasses.replace(robot, effects={}) if watched.unit == "A s" else robot
    run = signals(recording, robot)
    step_s = np.append(steps_s(run.time_s), 0.0)
    speed = np.abs(run.speed_mps)
    if watched.unit == "A s":
        rest_as = rest_of(current_a(run, robot) * step_s)
        return rest_as[np.searchsorted(run.time_s - run.time_s[0], watched.time_s)]
    moving_s = float(step_s[speed > 0.0].sum())
    mean_mps = float(speed @ step_s) / moving_s
    duty = moving_s / float(step_s.sum())
    sensing_hz = float(run.sensing_hz @ step_s) / float(step_s.sum())
    return (
        robot.usable_energy_j
        / float(d_max(robot, mean_mps, duty=duty, sensing_hz=sensing_hz))
        * watched.left_m
    )


def proof_of(make: Callable[[], Site], folder: Path) -> dict[str, Any]:
    """Diagnose a site's training drives, and predict the held-out ones with the corrected file."""
    site = make()
    analysis = analyse(list(site.training), site.nominal, site.columns)
    write_outputs(analysis, folder / "diagnosis")
    nominal = load_robot(site.nominal)
    robot = load_robot(folder / "diagnosis" / "corrected.toml")
    scores = []
    left_out = 0
    for path, run in zip(site.held_out, site.runs, strict=True):
        recording = read_recording(path, site.columns)
        try:
            watched = watch(recording, robot)
        except CompanionError:  # turning on the spot, which a file without scrub cannot predict
            left_out += 1
            continue
        plain = plain_of(nominal, recording, watched), plain_of(robot, recording, watched)
        scores.append(score_of(site, run, watched, plain))
    return {
        "site": site.name,
        "verdict": analysis.diagnosis.verdict,
        "scores": scores,
        "left_out": left_out,
    }


def coverage(
    scores: list[dict[str, Any]], unit_fields: tuple[str, ...], name: str, seed: int
) -> tuple[float, float, float]:
    """Mean of a score over independent units, those that differ in some fields, and its 95 %
    bootstrap interval."""
    groups = dict[tuple[str, ...], list[float]]()
    for score in scores:
        unit = tuple(score[field] for field in unit_fields)
        groups.setdefault(unit, []).append(float(score[name]))
    sums = np.array([(sum(values), len(values)) for values in groups.values()])
    drawn = np.random.default_rng(seed).integers(0, len(sums), (RESAMPLES, len(sums)))
    means = sums[drawn].sum(axis=1)
    low, high = np.quantile(means[:, 0] / means[:, 1], (0.025, 0.975))
    return float(sums[:, 0].sum() / sums[:, 1].sum()), float(low), float(high)


def main(args: Args) -> dict[str, list[dict[str, Any]]]:
    """Compute the missing sites, store them, and print the table.

    Raises:
        CoverageError, DatasetError: An argument is invalid, or recordings are not available.
        OSError: The output folder cannot be written to.
    """
    unknown = [part for part in args.parts if part not in PARTS]
    if unknown or args.robots < 2 or args.seed < 0:
        raise CoverageError(
            f"give --parts of {', '.join(PARTS)}, at least 2 --robots and a --seed of 0 or more"
        )
    lacking = missing()
    if lacking is not None:
        raise CoverageError(lacking)
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")  # it would ask on the terminal
    console = Console(width=150)
    kept = Kept(args.out / "range_coverage.json", seed=args.seed)
    proofs: dict[str, list[dict[str, Any]]] = {}
    for part in args.parts:
        for number, make in enumerate(sites(part, args.seed, args.robots, args.out)):
            key = f"{part} {number}"
            if key not in kept.results:
                kept.keep(key, proof_of(make, make.args[-1]))
            proof = kept.results[key]
            covered = (
                np.mean([score["covered"] for score in proof["scores"]])
                if proof["scores"]
                else np.nan
            )
            left_out = (
                f"; {proof['left_out']} drives of which the file says nothing"
                if proof["left_out"]
                else ""
            )
            console.print(
                f"{proof['site']}: {proof['verdict']}, {covered:.0%} in the interval{left_out}",
                style="dim",
            )
            proofs.setdefault(part, []).append(proof)
    console.print(table_of(args, proofs))
    return proofs


def table_of(args: Args, proofs_of_part: dict[str, list[dict[str, Any]]]) -> Table:
    """Results by part."""
    right = (
        "drives, of", "moments", "in the 90 % interval (95 %)", "before the start", "bias", "half interval", "CRPS",
        "d_max: corrected, given",
    )  # fmt: skip
    shown = table(f"Held-out drives, seed {args.seed}", ("drives",), right)
    for part, proofs in proofs_of_part.items():
        scores = [score for proof in proofs for score in proof["scores"]]
        unit_fields = ("site",) if part in ("rover", "cell") else ("site", "run")
        units = {tuple(score[field] for field in unit_fields) for score in scores}
        share, *ends = coverage(scores, unit_fields, "covered", args.seed)
        mean = {}
        for name in ("covered_first", "bias", "width", "crps", "corrected", "nominal"):
            mean[name], *_ = coverage(scores, unit_fields, name, args.seed)
        shown.add_row(
            part, f"{len(scores)}, {len(units)}", str(sum(score["moments"] for score in scores)),
            span(share, ends, ".0%"), f"{mean['covered_first']:.0%}", f"{mean['bias']:+.1%}",
            f"{mean['width']:.1%}", f"{mean['crps']:.1%}", f"{mean['corrected']:.1%}, {mean['nominal']:.1%}",
        )  # fmt: skip
    return shown


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (CoverageError, DatasetError)))
