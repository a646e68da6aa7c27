"""Checks before any fitting: which runs are usable, and findings about all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    """A usable run: on an even clock, without faults and with the errors of what was interpolated,
    and in one form."""

    recorded: Recording
    mended: Recording
    error: Mapping[str, float]
    signals: Signals

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.recorded.name

    def again(self, robot: Robot, late_s: float = 0.0, sloped: bool = True) -> _Run:
        """The same with slopes that are late, or without those from an elevation."""
        return self._replace(signals=signals(self.mended, robot, late_s, self.error, sloped))


def usable_runs(
    recordings: Sequence[Recording], robot: Robot
) -> tuple[list[Signals], list[Finding]]:
    """Check each recording of a robot and bring the usable ones into one form.

    Power is preferred: where some runs hold power and others only motor current, the latter are
    excluded. Top speed and power by the robot file distinguish a wrong unit from a fast drive.
    """
    findings: list[Finding] = []
    runs: list[_Run] = []
    names_by_hash: dict[str, str] = {}
    for recording in recordings:
        if recording.sha256 in names_by_hash:
            text = f"is the same as {names_by_hash[recording.sha256]}"
            findings.append(Finding(recording.name, text, refused=True))
            continue
        names_by_hash[recording.sha256] = recording.name
        run, findings_of_run = _usable_run(recording, robot)
        findings += findings_of_run
        if run is not None:
            runs.append(run)
    # Signs and units are judged over all runs together.
    runs, signs = _of_right_sign(runs, robot)
    findings += signs
    runs, current_only = _of_one_unit(runs)
    findings += current_only
    if not runs:
        return [], findings
    # Slopes from an elevation are used in all runs or in none.
    sloped = slopes_known([run.signals for run in runs if "grade_rad" not in run.mended.channels])
    if not sloped:
        runs = [run.again(robot, sloped=False) for run in runs]
    for run in runs:
        findings += [Finding(run.name, text) for text in _remarks(run.recorded, run.signals)]
    findings += _lacked(runs)
    corrected, corrections = _corrected(runs, robot, sloped)
    findings += corrections
    findings += _doubts(corrected, robot, runs[0].name)
    return corrected, findings


def _usable_run(recording: Recording, robot: Robot) -> tuple[_Run | None, list[Finding]]:
    """The run of a recording, None where it is not usable, and findings about it."""
    lacks = _lacks(recording)
    if lacks is not None:
        return None, [Finding(recording.name, lacks, refused=True)]
    findings = []
    recording, uneven = on_even_clock(recording, WINDOW_S)
    if uneven is not None:
        findings.append(Finding(recording.name, uneven))
    mended, error = without_faults(recording, robot)
    findings += [Finding(mended.name, note) for note in mended.notes]
    run = signals(mended, robot, known_error=error)
    fault = _fault_but_for_sign(run, robot)
    if fault is not None:
        findings.append(Finding(recording.name, fault, refused=True))
        return None, findings
    return _Run(recording, mended, error, run), findings


def _of_right_sign(runs: Sequence[_Run], robot: Robot) -> tuple[list[_Run], list[Finding]]:
    """The runs without those whose power has the wrong sign, and what the signs of power come
    to."""
    signs = signs_of_power([run.signals for run in runs], robot)
    findings = [
        Finding(runs[number].name, sign.text, sign.refused) for number, sign in signs.items()
    ]
    right = [
        run for number, run in enumerate(runs) if number not in signs or not signs[number].refused
    ]
    return right, findings


def _of_one_unit(runs: Sequence[_Run]) -> tuple[list[_Run], list[Finding]]:
    """The runs with power or, where none has, those with motor current; and findings about the
    excluded ones."""
    with_power = [run for run in runs if run.signals.unit == "W"]
    if not with_power:
        return list(runs), []
    text = "has motor current only, while other runs have power"
    return with_power, [
        Finding(run.name, text, refused=True) for run in runs if run.signals.unit == "A"
    ]


def _lacked(runs: Sequence[_Run]) -> list[Finding]:
    """Channels that some runs have and others lack: there nothing was sensed, or the value is
    unknown."""
    recorded = {name for run in runs for name in run.mended.channels}
    in_some = dict.fromkeys(
        name for run in runs for name in run.signals.context if name in recorded
    )
    findings = []
    for run in runs:
        lacks = [name for name in in_some if name not in run.signals.context]
        if not lacks:
            continue
        text = f"lacks {', '.join(lacks)}, which other runs have"
        if "sensing_hz" in lacks:
            text += "; its sensing rate is assumed to be 0"
        findings.append(Finding(run.signals.name, text))
    return findings


def _corrected(
    runs: Sequence[_Run], robot: Robot, sloped: bool
) -> tuple[list[Signals], list[Finding]]:
    """The runs corrected for a late or tilted slope and a drifting clock, seen from power; what was
    corrected."""
    corrected = [run.signals for run in runs]
    findings = []
    name_of_all = runs[0].name  # what is said of all runs stands at the first
    late_s = late_slope(corrected, [run.mended for run in runs], robot)
    if late_s != 0.0:
        corrected = [run.again(robot, late_s, sloped).signals for run in runs]
        text = f"slopes of all runs are {late_s:.3g} s late against power: they are corrected"
        findings.append(Finding(name_of_all, text))
    if any("grade_rad" in run.mended.channels for run in runs):
        corrected, tilt_rad = without_tilt(corrected)
        if tilt_rad != 0.0:
            text = (
                f"slopes of ways that close have a mean of {np.degrees(tilt_rad):+.2g} degrees: the sensor is tilted, "
                "and the slopes of all runs are corrected"
            )
            findings.append(Finding(name_of_all, text))
    corrected, drifts = without_drift(corrected, robot)
    for name, drift_s in drifts.items():
        way = "back" if drift_s > 0.0 else "ahead"
        text = f"the clock of power falls {way} by {abs(drift_s):.2g} s against that of motion: it is corrected"
        findings.append(Finding(name, text))
    return corrected, findings


def _doubts(runs: Sequence[Signals], robot: Robot, name: str) -> list[Finding]:
    """What all runs together show about signs, robot and unit, under a name."""
    findings = []
    wrong_sign = wrong_slopes(runs, robot)
    if wrong_sign is not None:
        findings.append(Finding(name, wrong_sign))
    ratio = _over_expected(runs, robot)
    if not 1.0 / thresholds.TWICE < ratio < thresholds.TWICE:
        text = (
            f"draws {ratio:.2g} times what {robot.name} should, all runs together: is this the right robot, and the "
            "right unit?"
        )
        findings.append(Finding(name, text))
    return findings


def _over_expected(signals: Sequence[Signals], robot: Robot) -> float:
    """Recorded power or current over the robot file's prediction; 1 where there is none."""
    runs = average_runs(signals)
    if runs.unit == "A" and robot.traction_n_per_a <= 0.0:
        return 1.0
    expected = float(np.sum(predict(runs, robot)))
    if expected > 0.0:
        return float(np.sum(runs.observed)) / expected
    return 1.0


def _lacks(recording: Recording) -> str | None:
    """What a recording lacks to be usable, or None."""
    lacks = lacking(recording.channels)
    if lacks:
        return f"has no {lacks}"
    missing = 1.0 - float(known(recording).mean())
    if missing > thresholds.HALF:
        return (
            f"motion or power is missing in {missing:.0%} of the samples; where they are logged in rows of their own, "
            "put both into each row (pandas.merge_asof does)"
        )
    if (
        len(recording) < thresholds.FEWEST_SAMPLES
        or recording.duration_s < thresholds.SHORTEST_RUN_S
    ):
        return f"is too short ({len(recording)} samples over {recording.duration_s:.3g} s)"
    return None


def fault_of(run: Signals, robot: Robot) -> str | None:
    """Why a run of a robot cannot be used, such as its length or unit, in a phrase; None where it
    can."""
    fault = _fault_but_for_sign(run, robot)
    if fault is not None:
        return fault
    signs = signs_of_power([run], robot)
    if 0 in signs and signs[0].refused:
        return signs[0].text
    return None


def _fault_but_for_sign(run: Signals, robot: Robot) -> str | None:
    """The same without the sign of its power, which all runs show together."""
    samples = len(run.time_s)
    if samples == 0:
        return "holds nothing but charging"
    duration_s = run.time_s[-1] - run.time_s[0]
    if samples < thresholds.FEWEST_SAMPLES or duration_s < thresholds.SHORTEST_RUN_S:
        return f"is too short ({samples} samples of driving over {duration_s:.3g} s)"
    if not run.observed.any():
        return "the recorded power or current is zero throughout; was the sensor connected?"
    if np.ptp(run.observed) == 0.0:
        return f"the recorded power or current never changes ({run.observed[0]:.4g} {run.unit}); did the logger hang?"
    return _too_fast(run, robot) or _wrong_unit(run, robot)


def _too_fast(run: Signals, robot: Robot) -> str | None:
    """That a run is faster than the robot can be, or None."""
    fast_mps = float(np.quantile(np.abs(run.speed_mps), 0.99))
    fastest_mps = thresholds.HALF_AGAIN * robot.max_speed_mps
    if fast_mps <= fastest_mps:
        return None
    guess = "; km/h?" if fast_mps / 3.6 <= fastest_mps else ""
    return (
        f"drives at {fast_mps:.3g} m/s, while {robot.name} reaches {robot.max_speed_mps:g} m/s: "
        f"another robot or another unit{guess}"
    )


def _wrong_unit(run: Signals, robot: Robot) -> str | None:
    """That the power or current of a run looks like one in thousands or thousandths, or None."""
    ratio = _over_expected([run], robot)
    if ratio <= 0.0:
        return None
    for factor, unit in ((1e3, "milliwatts or milliamperes"), (1e-3, "kilowatts or kiloamperes")):
        if abs(np.log(ratio / factor)) < np.log(thresholds.UNIT_RATIO):
            return f"draws {ratio:.3g} times what {robot.name} should: this looks like {unit}"
    return None


def _remarks(recording: Recording, run: Signals) -> list[str]:
    """Remarks on a run: what is missing in it, and what it does not show."""
    remarks = []
    missing = len(recording) - int(known(recording).sum())
    if missing > 0:
        remarks.append(f"{missing} samples without motion or power are left out")
    remarks += [f"missing values of {name} are interpolated" for name in run.filled]
    if "elevation_m" in recording.channels and "grade_rad" not in run.context:
        remarks.append(
            "slopes from elevation_m are no larger than their error: they are treated as unknown"
        )
    jumps = gaps(run.time_s)
    if len(jumps) > 0:
        longest_s = float(np.max(np.diff(run.time_s)[jumps]))
        median_s = median_step_s(run.time_s)
        remarks.append(
            f"{len(jumps)} gaps, the longest {longest_s:.3g} s where the median step is {median_s:.3g} s"
        )
    largest_mps = np.max(np.abs(run.speed_mps))
    if largest_mps <= logs_thresholds.STANDSTILL_MPS and not run.yaw_rate_radps.any():
        remarks.append(
            "the robot stands throughout: the parameters of its drive are not identifiable"
        )
    elif np.ptp(run.speed_mps) < thresholds.HARDLY_CHANGES * largest_mps:
        remarks.append(
            "the speed hardly changes: idle power, rolling resistance and drag are confounded"
        )
    if run.unit == "A" and (run.observed > 0.0).all():
        remarks.append(
            "motor current without voltage: torque only, so power, energy and range are not known"
        )
    return remarks
