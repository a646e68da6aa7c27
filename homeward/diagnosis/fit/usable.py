"""Checks before any fitting: which runs are usable, and findings about all of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.lags import late_slope, without_drift
from homeward.diagnosis.fit.replay import average as average_runs
from homeward.diagnosis.fit.replay import predict
from homeward.diagnosis.fit.signs import signs_of_power, wrong_slopes
from homeward.diagnosis.read.even import on_even_clock
from homeward.diagnosis.read.faults import without_faults
from homeward.diagnosis.read.pitch import without_tilt
from homeward.diagnosis.read.signals import WINDOW_S, Signals, gaps, known, signals, slopes_known
from homeward.logs import thresholds as logs_thresholds
from homeward.logs.channels import lacking
from homeward.logs.recordings import Recording
from homeward.logs.times import median_step_s
from homeward.physics import Robot


@dataclass(frozen=True)
class Finding:
    """A remark on a recording; one that is `refused` is excluded from the verdict."""

    recording: str
    text: str
    refused: bool = False


class _Run(NamedTuple):
    """A usable run: as given, without faults and with the errors of what was interpolated, and in one form."""

    given: Recording
    mended: Recording
    error: Mapping[str, float]
    read: Signals

    def again(self, robot: Robot, late_s: float = 0.0, sloped: bool = True) -> _Run:
        """The same with slopes that are late, or without those from an elevation."""
        return self._replace(read=signals(self.mended, robot, late_s, self.error, sloped))


def usable_runs(recordings: Sequence[Recording], robot: Robot) -> tuple[list[Signals], list[Finding]]:
    """Check each recording of a robot and bring the usable ones into one form.

    Power is preferred: where some runs hold power and others only motor current, the latter are excluded. Top speed
    and power by the robot file distinguish a wrong unit from a fast drive.
    """
    findings: list[Finding] = []
    kept: list[_Run] = []
    seen: dict[str, str] = {}
    for given in recordings:
        same = f"is the same as {seen[given.sha256]}" if given.sha256 in seen else None
        seen.setdefault(given.sha256, given.name)
        if refused := same or _lacks(given):
            findings.append(Finding(given.name, refused, refused=True))
            continue
        given, uneven = on_even_clock(given, WINDOW_S)
        if uneven is not None:
            findings.append(Finding(given.name, uneven))
        mended, error = without_faults(given, robot)
        findings += [Finding(mended.name, note) for note in mended.notes]
        run = signals(mended, robot, known_error=error)
        if fault := _fault_but_for_sign(run, robot):
            findings.append(Finding(given.name, fault, refused=True))
        else:
            kept.append(_Run(given, mended, error, run))
    signs = signs_of_power([run.read for run in kept], robot)
    findings += [Finding(kept[number].given.name, sign.text, sign.refused) for number, sign in signs.items()]
    wrong = {number for number, sign in signs.items() if sign.refused}
    kept = [run for number, run in enumerate(kept) if number not in wrong]
    if len({run.read.unit for run in kept}) > 1:
        current = [run.given.name for run in kept if run.read.unit == "A"]
        findings += [Finding(name, "has motor current only, while other runs have power", True) for name in current]
        kept = [run for run in kept if run.read.unit == "W"]
    if not kept:
        return [], findings
    sloped = slopes_known([run.read for run in kept if "grade_rad" not in run.mended.channels])
    kept = kept if sloped else [run.again(robot, sloped=False) for run in kept]
    findings += [Finding(run.given.name, text) for run in kept for text in _remarks(run.given, run.read, robot)]
    findings += _lacked([run.read for run in kept], {name for run in kept for name in run.mended.channels})
    runs, notes = _corrected(kept, robot, sloped)
    return runs, findings + notes


def _lacked(runs: Sequence[Signals], recorded: Collection[str]) -> list[Finding]:
    """Channels that some runs have and others lack: there nothing was sensed, or the value is unknown."""
    given = dict.fromkeys(name for run in runs for name in run.context if name in recorded)
    findings = []
    for run in runs:
        if lacks := [name for name in given if name not in run.context]:
            nothing = "; its sensing rate is assumed to be 0" if "sensing_hz" in lacks else ""
            findings.append(Finding(run.name, f"lacks {', '.join(lacks)}, which other runs have{nothing}"))
    return findings


def _corrected(kept: Sequence[_Run], robot: Robot, sloped: bool) -> tuple[list[Signals], list[Finding]]:
    """The runs corrected for a late or tilted slope and a drifting clock, seen from power; a check of the robot."""
    runs, notes, first = [run.read for run in kept], list[Finding](), kept[0].given.name
    if late_s := late_slope(runs, [run.mended for run in kept], robot):
        runs = [run.again(robot, late_s, sloped).read for run in kept]
        notes.append(Finding(first, f"slopes of all runs are {late_s:.3g} s late against power: they are corrected"))
    if any("grade_rad" in run.mended.channels for run in kept):
        runs, angle = without_tilt(runs)
        if angle:
            text = f"slopes of ways that close have a mean of {np.degrees(angle):+.2g} degrees"
            notes.append(Finding(first, f"{text}: the sensor is tilted, and the slopes of all runs are corrected"))
    runs, drifts = without_drift(runs, robot)
    for name, drift_s in drifts.items():
        way = "back" if drift_s > 0.0 else "ahead"
        text = f"the clock of power falls {way} by {abs(drift_s):.2g} s against that of motion: it is corrected"
        notes.append(Finding(name, text))
    if wrong_sign := wrong_slopes(runs, robot):
        notes.append(Finding(first, wrong_sign))
    ratio = _over_expected(runs, robot)
    if not 1.0 / thresholds.TWICE < ratio < thresholds.TWICE:
        text = f"draws {ratio:.2g} times what {robot.name} should, all runs together"
        notes.append(Finding(first, f"{text}: is this the right robot, and the right unit?"))
    return runs, notes


def _over_expected(signals: Sequence[Signals], robot: Robot) -> float:
    """Recorded power or current over the robot file's prediction; 1 where there is none."""
    runs = average_runs(signals)
    predictable = runs.unit == "W" or robot.traction_n_per_a > 0.0
    expected = float(np.sum(predict(runs, robot))) if predictable else 0.0
    return float(np.sum(runs.observed)) / expected if expected > 0.0 else 1.0


def _lacks(recording: Recording) -> str | None:
    """What a recording lacks to be usable, or None."""
    if lacks := lacking(recording.channels):
        return f"has no {lacks}"
    missing = 1.0 - float(known(recording).mean())
    if missing > thresholds.HALF:
        return (
            f"motion or power is missing in {missing:.0%} of the samples; where they are logged in rows of their own, "
            "put both into each row (pandas.merge_asof does)"
        )
    if len(recording) < thresholds.FEWEST_SAMPLES or recording.duration_s < thresholds.SHORTEST_RUN_S:
        return f"is too short ({len(recording)} samples over {recording.duration_s:.3g} s)"
    return None


def fault_of(run: Signals, robot: Robot) -> str | None:
    """Why a run of a robot cannot be used, such as its length or unit, in a phrase; None where it can."""
    signs = signs_of_power([run], robot)
    return _fault_but_for_sign(run, robot) or (signs[0].text if 0 in signs and signs[0].refused else None)


def _fault_but_for_sign(run: Signals, robot: Robot) -> str | None:
    """The same without the sign of its power, which all runs show together."""
    if len(run.time_s) == 0:
        return "holds nothing but charging"
    if len(run.time_s) < thresholds.FEWEST_SAMPLES or run.time_s[-1] - run.time_s[0] < thresholds.SHORTEST_RUN_S:
        return f"is too short ({len(run.time_s)} samples of driving over {np.ptp(run.time_s):.3g} s)"
    if not run.observed.any():
        return "the recorded power or current is zero throughout; was the sensor connected?"
    if np.ptp(run.observed) == 0.0:
        return f"the recorded power or current never changes ({run.observed[0]:.4g} {run.unit}); did the logger hang?"
    quick = float(np.quantile(np.abs(run.speed_mps), 0.99))
    if quick > thresholds.HALF_AGAIN * robot.max_speed_mps:
        guess = "; km/h?" if quick / 3.6 <= thresholds.HALF_AGAIN * robot.max_speed_mps else ""
        return (
            f"drives at {quick:.3g} m/s, while {robot.name} reaches {robot.max_speed_mps:g} m/s: "
            f"another robot or another unit{guess}"
        )
    ratio = _over_expected([run], robot)
    for factor, unit in ((1e3, "milliwatts or milliamperes"), (1e-3, "kilowatts or kiloamperes")):
        if ratio > 0.0 and abs(np.log(ratio / factor)) < np.log(thresholds.UNIT_RATIO):
            return f"draws {ratio:.3g} times what {robot.name} should: this looks like {unit}"
    return None


def _remarks(recording: Recording, run: Signals, robot: Robot) -> list[str]:
    remarks = []
    if missing := len(recording) - int(known(recording).sum()):
        remarks.append(f"{missing} samples without motion or power are left out")
    remarks += [f"missing values of {name} are interpolated" for name in run.filled]
    if "elevation_m" in recording.channels and "grade_rad" not in run.context:
        remarks.append("slopes from elevation_m are no larger than their error: they are treated as unknown")
    if len(jumps := gaps(run.time_s)):
        longest = float(np.max(np.diff(run.time_s)[jumps]))
        remarks.append(
            f"{len(jumps)} gaps, the longest {longest:.3g} s where the median step is {median_step_s(run.time_s):.3g} s"
        )
    if np.mean(np.abs(run.speed_mps) > logs_thresholds.STANDSTILL_MPS) == 0.0 and not run.yaw_rate_radps.any():
        remarks.append("the robot stands throughout: the parameters of its drive are not identifiable")
    elif np.ptp(run.speed_mps) < thresholds.HARDLY_CHANGES * np.max(np.abs(run.speed_mps)):
        remarks.append("the speed hardly changes: idle power, rolling resistance and drag are confounded")
    if run.unit == "A" and (run.observed > 0.0).all():
        remarks.append("motor current without voltage: torque only, so power, energy and range are not known")
    return remarks
