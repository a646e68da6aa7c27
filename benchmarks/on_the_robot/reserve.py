"""What is left at home, and what the reserve of the companion consists of at the moment it says to
turn.

`python benchmarks/on_the_robot/reserve.py --drives 60 --seed 1` drives as
`benchmarks.on_the_robot.gauges` does. What is left of the energy is the sum of three: the reserve
that the companion keeps (energy left less that of the way home, by its means), by how much the true
energy left is above its mean, and by how much the true way home is below its mean. The second table
takes one doubt after another away from the companion as it is at that moment, and prints the
reserve that it needs then.
"""

from __future__ import annotations

import copy
import dataclasses
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from unittest.mock import patch

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from rich.table import Table
from scipy.optimize import brentq
from scipy.special import ndtr
from tyro.conf import FlagCreatePairsOff

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.on_the_robot.gauges.__main__ import Args as Gauges
from benchmarks.on_the_robot.gauges.__main__ import Chemistry, make_cases
from benchmarks.on_the_robot.gauges.drive import Drive, run_drive
from benchmarks.on_the_robot.gauges.sizes import read_sizes
from benchmarks.tables import table
from homeward import cli
from homeward.companion import Companion
from homeward.companion import battery as battery_module
from homeward.companion.battery import BatteryBelief
from homeward.companion.home_estimator import HomeEstimator, WayHome
from homeward.estimation.prior import (
    CLIMB,
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    OFFSET,
    ROLLED,
    ROLLING,
    TILT,
    USED,
    WEIGHT,
)
from homeward.physics.battery import charge_share, energy_share

DOUBTS = {
    "rolling resistance": (ROLLING, ROLLED),
    "payload, climbs and tilt": (WEIGHT, CLIMB, TILT),
    "wind": (EAST, NORTH, GUST_EAST, GUST_NORTH),
    "meter": (GAIN, OFFSET, USED),
}
"""States of the filter, by the doubt that they are."""
ALL, BATTERY, MODEL, TAILS = (
    "all",
    "battery and gauge",
    "what the model omits",
    "tails of Student's t",
)


@dataclass(frozen=True)
class Args:
    """What to drive."""

    drives: int = 60
    """Drives."""
    seed: int = 1
    """Seed of everything drawn."""
    whole: FlagCreatePairsOff[bool] = False
    """Only whole packs."""
    chemistries: tuple[Chemistry, ...] = Gauges.chemistries
    """Chemistries."""
    knows: tuple[Literal["current", "counter", "cutoff", "capacity"], ...] = ()
    """What all robots have: voltage and current; a gauge that counts; a cut-off and a capacity that
    the user tells."""
    risk: float | None = None
    """Accepted risk; by default the companion's."""
    jobs: int = 2
    """Processes."""


def reserves(companion: Companion) -> dict[str, float]:
    """Reserve that is needed as things are, and without each doubt, over a full battery by the
    file."""
    estimator = companion._estimator
    home = companion._way_home()
    needed = {ALL: _needs(estimator, home)}
    battery = estimator.battery
    totals = battery.totals.copy()
    battery.totals[:] = battery.total
    needed[BATTERY] = _needs(estimator, home)
    battery.totals[:] = totals
    for name, make_sure in BATTERY_DOUBTS.items():
        estimator.battery = copy.deepcopy(battery)
        make_sure(estimator.battery)
        needed[name] = _needs(estimator, home)
    estimator.battery = battery
    known = estimator.known
    estimator.known = known._replace(prior=known.prior._replace(model_error=0.0), uncertainty=None)
    needed[MODEL] = _needs(estimator, home)
    estimator.known = known
    for name, states in DOUBTS.items():
        as_estimated = estimator._estimator.state.copy()
        hypotheses = estimator._estimator.state["hypotheses"]
        if EAST in states:
            weights = np.exp(hypotheses["log_weight"])
            means = np.einsum("nk,nka->na", weights, hypotheses["mean"])
            hypotheses["mean"][..., list(states)] = means[:, list(states)]
        for state in states:
            hypotheses["covariance"][..., state, :] = 0.0
            hypotheses["covariance"][..., :, state] = 0.0
        needed[name] = _needs(estimator, home)
        estimator._estimator.state[:] = as_estimated
    needed[TAILS] = _needs_normal(estimator, home)
    return needed


def _know_capacity(battery: BatteryBelief) -> None:
    """Take the mean capacity as known: age, cold, rate and meter together."""
    battery._capacity[:] = battery.trust.weights @ battery._capacity
    _tell_anew(battery)


def _know_start(battery: BatteryBelief) -> None:
    """Take the mean charge at the start as known."""
    battery.trust.start = np.full_like(
        battery.trust.start, battery.trust.weights @ battery.trust.start
    )
    _tell_anew(battery)


def _know_load(battery: BatteryBelief) -> None:
    """Take the voltage under load as known: resistance, curve, cut-off, and how they are in the
    cold."""
    with patch("homeward.companion.battery._SAGS", np.zeros_like(battery_module._SAGS)):
        battery._tell()


def _know_gauge(battery: BatteryBelief) -> None:
    """Take the likeliest explanation of the gauge as the true one: none of the rarer faults."""
    joint = battery.trust.joint
    joint[np.arange(len(joint)) != battery.trust.believed] = 0.0
    joint /= joint.sum()
    battery._tell()


def _tell_anew(battery: BatteryBelief) -> None:
    """Tell what is left after capacities or charges were replaced."""
    curve = battery._cells.curve
    energy = energy_share(curve, battery.trust.start) - battery._used / battery._capacity
    battery._charge = charge_share(curve, np.clip(energy, 0.0, 1.0))
    battery._tell()


BATTERY_DOUBTS: dict[str, Callable[[BatteryBelief], None]] = {
    "   capacity: age, cold, rate, meter": _know_capacity,
    "   charge at the start": _know_start,
    "   voltage under load and cut-off": _know_load,
    "   gauge: all but its likeliest explanation": _know_gauge,
}
"""Parts of the battery's doubt, and what makes the companion sure of them."""


def _needs(estimator: HomeEstimator, home: WayHome) -> float:
    """Mean margin less the margin at the accepted risk, over a full battery."""
    outcome = estimator.leaves(home)
    return (outcome.margin.mean - outcome.low_j) / estimator.vehicle.full_j


def _needs_normal(estimator: HomeEstimator, home: WayHome) -> float:
    """The same if the filter's normal distributions had no heavier tails."""
    plan = estimator._plan(0.0, home.cost_j)
    plan["unsure_j"] = home.unsure_j
    margin = estimator._margin(plan, home.ways, home.way_m)
    full_j = estimator.vehicle.full_j
    battery = estimator.battery
    totals_j = full_j * (battery.totals - 1.0)
    means_j = margin.mean_j[0][:, None] + totals_j
    weights = margin.weight[0][:, None] * battery.weights
    sds_j = np.maximum(margin.sd_j[0], 1e-9)[:, None]

    def beyond(value_j: float) -> float:
        return float((weights * ndtr((value_j - means_j) / sds_j)).sum() - estimator._risk)

    low_j = brentq(beyond, means_j.min() - 10.0 * sds_j.max(), means_j.max())
    return float(((weights * means_j).sum() - low_j) / full_j)


def left_over(drive: Drive) -> tuple[float, ...]:
    """Energy left at home, reserve, and errors of both means when it turned, over the energy on the
    label."""
    point = drive.points[-1]
    label_j = drive.label.energy_j
    reserve_j = point.left.mean_j - point.home.mean_j
    more_left_j = point.true_left_j - point.left.mean_j
    less_home_j = point.home.mean_j - point.true_home_j
    left_j = reserve_j + more_left_j + less_home_j
    return left_j / label_j, reserve_j / label_j, more_left_j / label_j, less_home_j / label_j


def main(args: Args) -> None:
    """Drive and print both tables."""
    sizes = read_sizes()
    unpaired = dataclasses.replace(sizes, rules=dataclasses.replace(sizes.rules, paired_share=0.0))
    if "cutoff" in args.knows:
        unpaired = dataclasses.replace(
            unpaired, truth=dataclasses.replace(unpaired.truth, cutoff_known_share=1.0)
        )
    asked = Gauges(
        drives=args.drives, seed=args.seed, charged=True, current="current" in args.knows, chemistries=args.chemistries,
        gauges=("counter",) if "counter" in args.knows else Gauges.gauges,
    )  # fmt: skip
    cases = [
        dataclasses.replace(case, tells_capacity="capacity" in args.knows, risk=args.risk)
        for case in make_cases(asked, "chemistry", sizes)
        if case.pack_share == 1.0 or not args.whole
    ]
    runs = (delayed(run_drive)(case, unpaired, reserves) for case in cases)
    drives: list[Drive] = Parallel(n_jobs=args.jobs)(runs)
    made = [
        drive
        for drive in drives
        if drive.points and drive.looked and not drive.outcomes["companion"].stranded
    ]
    stranded = sum(drive.outcomes["companion"].stranded for drive in drives)
    print(
        f"{stranded} of {len(drives)} stranded; those that turned at once have no way out and are left out below."
    )
    title = f"{len(made)} of {len(cases)} drives that turned on the way, seed {args.seed}; share of the label"
    for shown in _tables(made, title):
        cli.Terminal().show(shown)


def _tables(drives: list[Drive], title: str) -> Iterator[Table]:
    """Both tables."""
    parts = np.array([left_over(drive) for drive in drives])
    charge = np.array([drive.outcomes["companion"].left for drive in drives])
    left_at_home = table(f"Left at home: {title}", ["what"], ["median", "mean"])
    rows: dict[str, NDArray[np.float64]] = {
        "charge that is left, of that at the start": charge,
        "energy that could be drawn": parts[:, 0],
        "   reserve that was kept": parts[:, 1],
        "   true energy left above its mean": parts[:, 2],
        "   true way home below its mean": parts[:, 3],
    }
    for name, values in rows.items():
        left_at_home.add_row(name, f"{np.median(values):.1%}", f"{values.mean():.1%}")
    ways = np.array([drive.outcomes["companion"].turned for drive in drives])
    left_at_home.add_row(
        "way out, of that to empty", f"{np.median(ways):.1%}", f"{ways.mean():.1%}"
    )
    yield left_at_home
    needs = table(f"Reserve without a doubt: {title}", ["without"], ["median", "mean"])
    for name in drives[0].looked:
        values = np.array([drive.looked[name] for drive in drives])
        needs.add_row(
            "(all of them)" if name == ALL else name,
            f"{np.median(values):.1%}",
            f"{values.mean():.1%}",
        )
    yield needs


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, ()))
