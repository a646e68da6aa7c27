"""One drive: draw the truth, let every agent decide on the same way out, drive home, and keep what
counts.

Truths. The energy left is what the pack would still deliver at its terminals, until it is cut off,
under the mean power of the way out so far. The energy of the way home is what turning and driving
home from there would take at the terminals, with the true ground, the true speeds and the mean
wind. Gusts are left out, because nobody could know them.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.on_the_robot.gauges.agents import (
    CompanionRun,
    Estimate,
    has_gauge,
    metered_share,
    mirror,
    run_companion,
    turn_at_half,
    turn_at_reserve,
)
from benchmarks.on_the_robot.gauges.battery import Battery, Circuit, Engine, make_battery
from benchmarks.on_the_robot.gauges.gauge import Gauge, shown_shares
from benchmarks.on_the_robot.gauges.ground import Ground, draw_ground, home_energy_j
from benchmarks.on_the_robot.gauges.instruments import Conditions, Readings, draw_conditions, read
from benchmarks.on_the_robot.gauges.robots import (
    Curve,
    Label,
    draw_robot,
    draw_wear,
    label_of,
    measured_curve,
    robot_file,
)
from benchmarks.on_the_robot.gauges.sizes import Sizes, between
from benchmarks.on_the_robot.gauges.way import CELL, ENERGY_J, POWER_W, SHARE, TIME_S, WayOut
from homeward.companion import Companion

SHARES_OF_WAY = (0.2, 0.4, 0.6, 0.8, 1.0)
POOR_POSITIONS_M = 10.0  # the brief
SPARE_WAY = 1.6  # chosen: the way is this much longer than the rated energy lasts on level ground


@dataclass(frozen=True)
class Case:
    """What is fixed of a drive before anything is drawn.

    Attributes:
        told_soc: State of charge at the start as the user says; None: the gauge shows it.
        tells_capacity: Whether the user has measured the capacity and says it.
        risk: Accepted risk; None: the default.
        engine: What gives the battery's voltage.
    """

    number: int
    seed: int
    robot: str
    chemistry: str
    gauge: Gauge
    with_current: bool
    pack_share: float
    curve: Curve
    told_soc: float | None = None
    tells_capacity: bool = False
    risk: float | None = None
    engine: Engine = "circuit"


@dataclass(frozen=True)
class Outcome:
    """How a drive ended for an agent.

    Attributes:
        stranded: Whether the battery was cut off before the robot was home.
        left: Share of charge left at home, of the share at the start; NaN if stranded.
        turned: Length of the way out, share of the length after which the battery would have been
            empty.
    """

    stranded: bool
    left: float
    turned: float


@dataclass(frozen=True)
class Point:
    """Truth and estimates at a share of the companion's way out; energies in J.

    The companion's energies are those that the robot's own meter would measure. So `metered` is
    kept: what the meter has read so far over the truth. It is 1 without a meter.
    """

    share: float
    metered: float
    true_left_j: float
    true_home_j: float
    left: Estimate
    home: Estimate
    mirror_left: Estimate | None
    mirror_home: Estimate | None


@dataclass
class Drive:
    """Everything that is kept of a drive.

    Attributes:
        fault: The gauge's fault in words.
        cutoff_known: Whether the companion was told the voltage of the cut-off.
        temperature_c: Of the air.
        charge_share: Charge that the pack gives at 25 C before it is cut off, over the charge on
            its label.
        empty_s: Time after which the battery would be cut off on the way out.
        outcomes: By agent, and of the companion under other conditions, by their name.
        most_left: Largest mean of the energy left that the companion stated, over the energy on the
            label.
        looked: What `look` of `run_drive` returned.
        updates, companion_s: Of the companion, and its computing time for them.
        seconds: Computing time of the whole drive.
    """

    case: Case
    conditions: Conditions
    label: Label
    fault: str
    cutoff_known: bool
    temperature_c: float
    charge_share: float
    update_s: float
    empty_s: float
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    points: list[Point] = field(default_factory=list)
    crash: str = ""
    faults: dict[str, int] = field(default_factory=dict)
    most_left: float = 0.0
    looked: dict[str, float] = field(default_factory=dict)
    updates: int = 0
    companion_s: float = 0.0
    seconds: float = 0.0


def run_drive(
    case: Case, sizes: Sizes, look: Callable[[Companion], dict[str, float]] | None = None
) -> Drive:
    """Draw and drive a case; the same case gives the same drive.

    Args:
        case: The case.
        sizes: Sizes of everything drawn.
        look: Called with the companion when it says to turn.
    """
    start_s = time.perf_counter()
    rng = np.random.default_rng([case.seed, case.number])
    truth_rng, ground_rng, gauge_rng, instrument_rng, curve_rng, paired_rng = rng.spawn(6)
    place = sizes.robots[case.robot]
    cell = sizes.cells[case.chemistry]

    label = label_of(place.preset, place.cells[case.chemistry], cell.label_v, case.pack_share)
    robot = draw_robot(place.preset, place.cruise_mps, sizes, truth_rng)
    wear = draw_wear(sizes, truth_rng)
    start_share = between(truth_rng.random(), sizes.truth.start_share)
    battery = make_battery(case.engine, case.chemistry, label, sizes, wear, start_share)
    cutoff_known = truth_rng.random() < sizes.truth.cutoff_known_share
    level_w = robot.standby_w + robot.rolling_resistance * robot.mass_kg * 9.81 * robot.cruise_mps
    lasts_s = label.energy_j / level_w
    update_s = _update_s(lasts_s, sizes)

    ground = draw_ground(robot, place.grade_sd_rad, SPARE_WAY * lasts_s, sizes, ground_rng)
    way = battery.drive_out(ground, update_s, sizes.truth)
    shown, fault = shown_shares(
        case.gauge, case.chemistry, battery, start_share, way, sizes, gauge_rng
    )
    conditions = draw_conditions(case.with_current, sizes.instruments, instrument_rng)
    reading_seed = int(instrument_rng.integers(2**63))
    measured_v = None
    if case.curve == "measured" and isinstance(battery, Circuit):
        measured_v = measured_curve(battery.pack, sizes, curve_rng)

    drive = Drive(
        case=case,
        conditions=conditions,
        label=label,
        fault=fault,
        cutoff_known=bool(cutoff_known),
        temperature_c=battery.outside_c,
        charge_share=battery.learned_ah / label.charge_ah,
        update_s=update_s,
        empty_s=way.empty_s,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = robot_file(Path(folder), place.preset, label, case.chemistry, case.curve, measured_v)
        cutoff_v = battery.cutoff_v if cutoff_known else None
        more: dict[str, float] = {}
        if case.risk is not None:
            more["risk"] = case.risk
        if case.tells_capacity:
            # What a discharge from full gave, warm and in the label's hours.
            more["capacity_j"] = min(drive.charge_share, 1.0) * label.energy_j

        def ask(asked: Conditions) -> tuple[Readings, CompanionRun]:
            """Let the companion drive under some conditions, with the same errors of all other
            instruments."""
            readings = read(
                way, ground, shown, asked, sizes.instruments, np.random.default_rng(reading_seed)
            )
            run = run_companion(
                path, readings, robot.cruise_mps, cutoff_v, label.energy_j, case.told_soc, more
            )
            return readings, run

        readings, run = ask(conditions)
        if look is not None and run.turn is not None and run.companion is not None:
            drive.looked = look(run.companion)
        drive.outcomes["companion"] = _outcome(run.turn, battery, way, ground, sizes)
        if paired_rng.random() < sizes.rules.paired_share:
            poor = Conditions(conditions.recorded, POOR_POSITIONS_M, 0.0, conditions.clock_when)
            good = Conditions(conditions.recorded, 0.0, 0.0, conditions.clock_when)
            step_s = float(paired_rng.choice([-1.0, 1.0])) * sizes.instruments.clock_step_s
            stepped = Conditions(conditions.recorded, 0.0, step_s, conditions.clock_when)
            for name, asked in (
                ("good instruments", good),
                ("10 m of noise", poor),
                ("clock steps", stepped),
            ):
                _asked_readings, asked_run = ask(asked)
                drive.outcomes[name] = _outcome(asked_run.turn, battery, way, ground, sizes)
                drive.crash = drive.crash or asked_run.crash

    if has_gauge(readings):
        drive.outcomes["half charge"] = _outcome(
            turn_at_half(readings, sizes.rules), battery, way, ground, sizes
        )
        drive.outcomes["used x 1.2"] = _outcome(
            turn_at_reserve(readings, sizes.rules), battery, way, ground, sizes
        )
    drive.outcomes["latest turn"] = _latest_turn(battery, way, ground, sizes)
    drive.points = _points(run, readings, battery, way, ground, label, sizes)
    drive.crash = run.crash or drive.crash
    drive.faults = run.faults
    drive.most_left = run.most_left
    drive.updates = run.updates
    drive.companion_s = run.seconds
    drive.seconds = time.perf_counter() - start_s
    return drive


def _update_s(lasts_s: float, sizes: Sizes) -> float:
    """Time between updates of the companion, s, for a battery that lasts for `lasts_s`."""
    shortest_s, longest_s = sizes.companion.update_s
    wanted_s = round(lasts_s / sizes.companion.updates_per_battery)
    return min(max(float(wanted_s), shortest_s), longest_s)


def _outcome(
    turn: int | None, battery: Battery, way: WayOut, ground: Ground, sizes: Sizes
) -> Outcome:
    """Drive home from where an agent turned; who never turns is stranded where the battery is cut
    off."""
    if turn is None:
        return Outcome(stranded=True, left=math.nan, turned=1.0)
    turned = float(way.records[turn, CELL] / way.records[-1, CELL])
    end = battery.drive_home(way, turn, ground, sizes.truth)
    if not end.arrived:
        return Outcome(stranded=True, left=math.nan, turned=turned)
    return Outcome(stranded=False, left=end.share / float(way.records[0, SHARE]), turned=turned)


def _latest_turn(battery: Battery, way: WayOut, ground: Ground, sizes: Sizes) -> Outcome:
    """Turn at the last update from which the battery, the ground and the weather as they are let
    the robot come home: who leaves less does not arrive.

    It is found by bisection, as who turns later has a longer way home with less.
    """
    latest = _outcome(0, battery, way, ground, sizes)
    early = 0
    late = len(way.records)
    while late - early > 1:
        middle = (early + late) // 2
        outcome = _outcome(middle, battery, way, ground, sizes)
        if outcome.stranded:
            late = middle
        else:
            early = middle
            latest = outcome
    return latest


def _points(
    run: CompanionRun,
    readings: Readings,
    battery: Battery,
    way: WayOut,
    ground: Ground,
    label: Label,
    sizes: Sizes,
) -> list[Point]:
    """Truth and estimates at 20 to 100 % of the companion's way out."""
    last = run.turn if run.turn is not None else len(run.advice) - 1
    if last < len(SHARES_OF_WAY):  # it turned at once
        return []
    homes_j = home_energy_j(ground)
    cells = way.column(CELL)
    points = []
    for share in SHARES_OF_WAY:
        index = min(int(np.searchsorted(cells, share * cells[last])), last)
        said = run.estimates(index)
        if said is None:
            continue
        guessed = mirror(readings, index, label.energy_j, sizes.rules)
        mean_w = float(way.records[index, ENERGY_J] / way.records[index, TIME_S])
        turning_j = ground.standby_w * sizes.truth.turning_s
        points.append(
            Point(
                share=share,
                metered=metered_share(readings, way.column(POWER_W), index),
                true_left_j=battery.left_j(way, index, mean_w, sizes.truth),
                true_home_j=float(homes_j[int(cells[index])]) + turning_j,
                left=said[0],
                home=said[1],
                mirror_left=None if guessed is None else guessed[0],
                mirror_home=None if guessed is None else guessed[1],
            )
        )
    return points
