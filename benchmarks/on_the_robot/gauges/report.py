"""Tables and the file with one row a drive."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rich.table import Table

from benchmarks.on_the_robot.gauges.agents import Estimate
from benchmarks.on_the_robot.gauges.drive import SHARES_OF_WAY, Drive, Outcome, Point
from benchmarks.on_the_robot.gauges.gauge import GAUGES
from benchmarks.on_the_robot.gauges.score import covers, crps_j, mean_of, rate_of
from benchmarks.on_the_robot.gauges.sizes import Sizes
from benchmarks.tables import table

AGENTS = ("companion", "half charge", "used x 1.2", "latest turn")
"""The last knows everything: nobody who arrives leaves less."""
PAIRED = ("good instruments", "10 m of noise", "clock steps")

AS_METERED = ", as metered"
# By what the drives are grouped for the energy left, and for that of the way home.
ALONG_WAY = {
    "left": ("all", "robot", "recorded", "cut-off", "air", "chemistry", "gauge"),
    "home": ("all", "robot", "recorded", "positions"),
    f"left{AS_METERED}": ("recorded",),
    f"home{AS_METERED}": ("all", "pack", "recorded", "positions"),
}
COLD_C = 10.0  # C, chosen: the middle of the drawn range is near

Group = tuple[str, str, list[Drive]]
Figure = TypeVar("Figure", bool, float)


def stranded_table(drives: list[Drive], sizes: Sizes, title: str) -> Table:
    """How many were stranded, by agent: all, by robot, pack, electrical readings, chemistry, gauge,
    and cell."""
    made = table(f"Stranded: {title}", ["drives", ""], list(AGENTS))
    for by, name, selected in [*_groups(drives, sizes), *_cells(drives, sizes)]:
        rates = [
            rate_of([outcome.stranded for outcome in _outcomes(selected, agent)])
            for agent in AGENTS
        ]
        made.add_row(by, name, *rates)
    return made


def left_table(drives: list[Drive], sizes: Sizes, title: str) -> Table:
    """Charge left at home of those that arrived, share of the charge at the start."""
    made = table(
        f"Charge left at home, share of the start, of those that arrived: {title}",
        ["drives", ""],
        list(AGENTS),
    )
    for by, name, selected in _groups(drives, sizes):
        means = [
            mean_of([outcome.left for outcome in _outcomes(selected, agent)], ".1%")
            for agent in AGENTS
        ]
        made.add_row(by, name, *means)
    return made


def paired_table(drives: list[Drive], title: str) -> Table:
    """The companion on the same drives with exact positions, with 10 m of noise, and with a clock
    that steps."""
    made = table(
        f"The same drives, other instruments: {title}",
        ["positions and clock"],
        ["left at home", "stranded"],
    )
    for name in PAIRED:
        outcomes = _outcomes(drives, name)
        made.add_row(
            name,
            mean_of([outcome.left for outcome in outcomes], ".1%"),
            rate_of([outcome.stranded for outcome in outcomes]),
        )
    return made


def coverage_table(drives: list[Drive], sizes: Sizes, title: str) -> Table:
    """How often the companion's 90 % intervals contain the truth."""

    def figure(drive: Drive, point: Point, energy: str) -> bool:
        return covers(*_said_and_true(point, energy))

    return _along_way("Coverage of 90% intervals", title, _groups(drives, sizes), figure, rate_of)


def error_table(drives: list[Drive], sizes: Sizes, title: str) -> Table:
    """Error of the companion's means, share of the rated energy."""

    def figure(drive: Drive, point: Point, energy: str) -> float:
        said, true_j = _said_and_true(point, energy)
        return (said.mean_j - true_j) / drive.label.energy_j

    def words(errors: list[float]) -> str:
        return mean_of(errors, "+.0%")

    return _along_way(
        "Error of the mean, share of the rated energy", title, _groups(drives, sizes), figure, words
    )


def _said_and_true(point: Point, energy: str) -> tuple[Estimate, float]:
    """The companion's estimate of an energy, and the truth, J, at the terminals or as the meter
    would read it."""
    name = energy.removesuffix(AS_METERED)
    said: Estimate = getattr(point, name)
    true_j: float = getattr(point, f"true_{name}_j")
    return said, true_j * point.metered if energy.endswith(AS_METERED) else true_j


def _along_way(
    what: str,
    title: str,
    groups: list[Group],
    figure: Callable[[Drive, Point, str], Figure],
    words: Callable[[list[Figure]], str],
) -> Table:
    """Figures of energy left and way home at shares of the way out, a row a group of drives that
    may matter for it."""
    headings = [f"{share:.0%}" for share in SHARES_OF_WAY]
    made = table(f"{what}, at shares of the way out: {title}", ["energy", "drives", ""], headings)
    for energy in ALONG_WAY:
        for by, name, selected in groups:
            if by not in ALONG_WAY[energy]:
                continue
            texts = []
            for share in SHARES_OF_WAY:
                figures = [figure(drive, point, energy) for drive, point in _at(share, selected)]
                texts.append(words(figures))
            made.add_row(energy, by, name, *texts)
    return made


def _at(share: float, drives: list[Drive]) -> list[tuple[Drive, Point]]:
    """Drives with their point at a share of the way out; those that turned at once have none."""
    pairs = []
    for drive in drives:
        pairs.extend([(drive, point) for point in drive.points if point.share == share])
    return pairs


def crps_table(drives: list[Drive], title: str) -> Table:
    """CRPS of the companion and the mirror rule where both estimate, share of the rated energy."""
    headings = ["companion", "mirror rule", "companion less mirror rule"]
    made = table(f"CRPS, % of the rated energy: {title}", ["energy", "way out"], headings)
    for energy in ("left", "home"):
        for share in (None, *SHARES_OF_WAY):
            ours, theirs = _scores(drives, energy, share)
            differences = [our - their for our, their in zip(ours, theirs, strict=True)]
            words = "mean of a drive" if share is None else f"{share:.0%}"
            made.add_row(
                energy,
                words,
                mean_of(ours, ".2f"),
                mean_of(theirs, ".2f"),
                mean_of(differences, "+.2f"),
            )
    return made


def _scores(
    drives: list[Drive], energy: str, share: float | None
) -> tuple[list[float], list[float]]:
    """Scores of companion and mirror rule, % of the rated energy, a value a drive; share None: mean
    over its points."""
    ours: list[float] = []
    theirs: list[float] = []
    for drive in drives:
        points = [
            point
            for point in drive.points
            if point.mirror_left is not None and share in (None, point.share)
        ]
        if not points:
            continue
        truths_j = [getattr(point, f"true_{energy}_j") for point in points]
        our_j = crps_j([getattr(point, energy) for point in points], truths_j)
        their_j = crps_j([getattr(point, f"mirror_{energy}") for point in points], truths_j)
        percent = 100.0 / drive.label.energy_j / len(points)
        ours.append(sum(our_j) * percent)
        theirs.append(sum(their_j) * percent)
    return ours, theirs


def trouble_lines(drives: list[Drive]) -> list[str]:
    """Crashes and inconsistent advice, a line each."""
    lines = []
    for drive in drives:
        case = drive.case
        name = f"drive {case.number} ({case.robot}, {case.chemistry}, {case.gauge})"
        if drive.crash:
            lines.append(f"{name} crashed: {drive.crash}")
        for fault, times in drive.faults.items():
            lines.append(f"{name}: {fault}, {times} times")
    above = [drive for drive in drives if drive.most_left > 1.0]
    if above:
        most = max(drive.most_left for drive in above)
        lines.append(
            f"The mean of the energy left rose above the label in {len(above)} drives, to at most {most:.0%}."
        )
    return lines


def write_rows(drives: list[Drive], path: Path) -> None:
    """Write a row a drive."""
    rows = [_flat(drive) for drive in drives]
    names = list(dict.fromkeys(name for row in rows for name in row))
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)


def _flat(drive: Drive) -> dict[str, object]:
    """A drive as a row."""
    row: dict[str, object] = dict(dataclasses.asdict(drive.case))
    row.update(dataclasses.asdict(drive.conditions))
    row.update(
        label_j=drive.label.energy_j,
        label_v=drive.label.voltage_v,
        fault=drive.fault,
        cutoff_known=drive.cutoff_known,
        temperature_c=drive.temperature_c,
        charge_share=drive.charge_share,
        update_s=drive.update_s,
        empty_s=drive.empty_s,
        crash=drive.crash,
        advice_faults="; ".join(f"{fault}: {times}" for fault, times in drive.faults.items()),
        most_left=drive.most_left,
        updates=drive.updates,
        companion_s=drive.companion_s,
        seconds=drive.seconds,
    )
    for agent, outcome in drive.outcomes.items():
        for name, value in dataclasses.asdict(outcome).items():
            row[f"{agent} {name}"] = value
    for point in drive.points:
        for name, value in _flat_point(point).items():
            row[f"{point.share:.0%} {name}"] = value
    return row


def _flat_point(point: Point) -> dict[str, float]:
    """Numbers of a point by name."""
    flat = {
        "metered": point.metered,
        "true_left_j": point.true_left_j,
        "true_home_j": point.true_home_j,
    }
    for name in ("left", "home", "mirror_left", "mirror_home"):
        estimate = getattr(point, name)
        if estimate is not None:
            flat.update(
                {f"{name} {part}": value for part, value in dataclasses.asdict(estimate).items()}
            )
    return flat


def _groups(drives: list[Drive], sizes: Sizes) -> list[Group]:
    """Groups of drives, each with what it is grouped by and its name; groups without drives are
    left out."""
    groups: list[Group] = [("all", "", drives)]
    for robot in sizes.robots:
        groups.append(("robot", robot, [drive for drive in drives if drive.case.robot == robot]))
    for pack_share in sizes.truth.pack_shares:
        selected = [drive for drive in drives if drive.case.pack_share == pack_share]
        groups.append(("pack", f"{pack_share:.0%}", selected))
    for recorded in ("voltage and current", "voltage", "neither"):
        selected = [drive for drive in drives if drive.conditions.recorded == recorded]
        groups.append(("recorded", recorded, selected))
    for noise_m in dict.fromkeys(sizes.instruments.position_noises_m):
        selected = [drive for drive in drives if drive.conditions.position_noise_m == noise_m]
        groups.append(("positions", f"{noise_m:.0f} m of noise", selected))
    groups.append(("cut-off", "told", [drive for drive in drives if drive.cutoff_known]))
    groups.append(("cut-off", "not told", [drive for drive in drives if not drive.cutoff_known]))
    groups.append(
        (
            "air",
            f"below {COLD_C:.0f} C",
            [drive for drive in drives if drive.temperature_c < COLD_C],
        )
    )
    groups.append(
        (
            "air",
            f"{COLD_C:.0f} C and above",
            [drive for drive in drives if drive.temperature_c >= COLD_C],
        )
    )
    for chemistry in sizes.cells:
        groups.append(
            (
                "chemistry",
                chemistry,
                [drive for drive in drives if drive.case.chemistry == chemistry],
            )
        )
    for gauge in GAUGES:
        groups.append(("gauge", gauge, [drive for drive in drives if drive.case.gauge == gauge]))
    return [group for group in groups if group[2]]


def _cells(drives: list[Drive], sizes: Sizes) -> list[Group]:
    """Groups by gauge and chemistry together."""
    groups: list[Group] = []
    for gauge in GAUGES:
        for chemistry in sizes.cells:
            selected = [
                drive
                for drive in drives
                if drive.case.gauge == gauge and drive.case.chemistry == chemistry
            ]
            if selected:
                groups.append((gauge, chemistry, selected))
    return groups


def _outcomes(drives: list[Drive], agent: str) -> list[Outcome]:
    """Outcomes of an agent; drives that it could not drive, for want of a gauge, are left out."""
    return [drive.outcomes[agent] for drive in drives if agent in drive.outcomes]
