"""Checks before any fitting: which runs can be used, and what to know about the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homeward.diagnosis.recordings import Recording
from homeward.diagnosis.replay import average as average_runs
from homeward.diagnosis.replay import predict
from homeward.diagnosis.signals import Signals, gaps, signals, usual_step_s
from homeward.physics import Robot

_SHORTEST_RUN_S = 5.0
_FEWEST_SAMPLES = 20
_MOST_MISSING = 0.5
_STANDS_MPS = 0.01
_FAST = 1.5  # times the robot's top speed
_UNIT_RATIO = 3.0  # a ratio within this factor of 1000 is taken for a wrong unit


@dataclass(frozen=True)
class Finding:
    """Something to know about a recording; one that is `refused` is set aside and takes no part in the verdict."""

    recording: str
    text: str
    refused: bool = False


def usable_runs(recordings: Sequence[Recording], robot: Robot) -> tuple[list[Signals], list[Finding]]:
    """Check each recording and bring the usable ones into one form.

    Power is preferred: where some runs hold power and others only motor current, the latter are set aside.

    Args:
        recordings: Runs of one robot.
        robot: The robot file: its top speed and power tell a wrong unit from a fast drive.
    """
    findings: list[Finding] = []
    kept: list[Signals] = []
    seen: dict[str, str] = {}
    for recording in recordings:
        findings += [Finding(recording.name, note) for note in recording.notes]
        if recording.sha256 in seen:
            findings.append(Finding(recording.name, f"is the same as {seen[recording.sha256]}", refused=True))
            continue
        seen[recording.sha256] = recording.name
        run = signals(recording, robot)
        fault = _fault(recording, run, robot)
        if fault is not None:
            findings.append(Finding(recording.name, fault, refused=True))
            continue
        findings += [Finding(recording.name, text) for text in _remarks(recording, run, robot)]
        kept.append(run)
    if len({run.unit for run in kept}) > 1:
        current = [run for run in kept if run.unit == "A"]
        findings += [Finding(r.name, "has motor current only, while other runs have power", True) for r in current]
        kept = [run for run in kept if run.unit == "W"]
    return kept, findings


def _fault(recording: Recording, run: Signals, robot: Robot) -> str | None:
    """Why a run cannot be used, or None."""
    missing = 1.0 - len(run.time_s) / len(recording)
    if missing > _MOST_MISSING:
        return f"motion or power is missing in {missing:.0%} of the samples"
    if len(run.time_s) < _FEWEST_SAMPLES or run.time_s[-1] - run.time_s[0] < _SHORTEST_RUN_S:
        return f"is too short ({len(run.time_s)} samples over {recording.duration_s:.3g} s)"
    if not run.observed.any():
        return "the recorded power or current is zero throughout; was the sensor connected?"
    if np.ptp(run.observed) == 0.0:
        return f"the recorded power or current never changes ({run.observed[0]:.4g} {run.unit}); did the logger hang?"
    quick = float(np.quantile(np.abs(run.speed_mps), 0.99))
    if quick > _FAST * robot.max_speed_mps:
        guess = "; km/h?" if quick / 3.6 <= 1.2 * robot.max_speed_mps else ""
        return (
            f"drives at {quick:.3g} m/s, while {robot.name} reaches {robot.max_speed_mps:g} m/s: "
            f"another robot or another unit{guess}"
        )
    return _wrong_scale(run, robot)


def _wrong_scale(run: Signals, robot: Robot) -> str | None:
    if run.unit == "A" and robot.traction_n_per_a == 0.0:
        return None
    expected = float(np.mean(predict(average_runs([run]), robot)))
    ratio = float(np.mean(run.observed)) / expected if expected > 0.0 else 1.0
    for factor, unit in ((1e3, "milliwatts or milliamperes"), (1e-3, "kilowatts or kiloamperes")):
        if ratio > 0.0 and abs(np.log(ratio / factor)) < np.log(_UNIT_RATIO):
            return f"draws {ratio:.3g} times what {robot.name} should: this looks like {unit}"
    return None


def _remarks(recording: Recording, run: Signals, robot: Robot) -> list[str]:
    remarks = []
    missing = len(recording) - len(run.time_s)
    if missing:
        remarks.append(f"{missing} samples without motion or power are left out")
    remarks += [f"missing values of {name} are interpolated" for name in run.filled]
    jumps = gaps(run.time_s)
    if len(jumps):
        longest = float(np.max(np.diff(run.time_s)[jumps]))
        remarks.append(
            f"{len(jumps)} gaps, the longest {longest:.3g} s where {usual_step_s(run.time_s):.3g} s is usual"
        )
    if np.mean(np.abs(run.speed_mps) > _STANDS_MPS) == 0.0 and not run.yaw_rate_radps.any():
        remarks.append("the robot stands throughout: nothing to learn about its drive")
    elif np.ptp(run.speed_mps) < 0.1 * np.max(np.abs(run.speed_mps)):
        remarks.append("the speed hardly changes: idle power, rolling resistance and drag cannot be told apart from it")
    if run.unit == "A" and (run.observed > 0.0).all():
        remarks.append("motor current without voltage: torque only, so power, energy and range are not known")
    return remarks
