"""Candidates for an empirical term: what drives the load, times at most two dimensionless groups of the channels."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.channels import Array, Index
from homeward.physics import Robot, ancillary_power
from homeward.physics.model import GRAVITY_MPS2

_MILD_C = 20.0
_STANDS_MPS = 0.02
_PLAIN, _SQUARED, _ROOT_TOO = (1.0,), (1.0, 2.0), (0.5, 1.0, 2.0)  # powers of a group


@dataclass(frozen=True)
class Library:
    """All candidates, each a base times two factors, of which the first is 1."""

    texts: tuple[str, ...]
    units: tuple[str, ...]  # of a coefficient
    parts: Array  # (windows, bases + factors): what candidates are products of
    places: Index  # (candidates, 3): base and factors of each in `parts`
    cost: Array  # (candidates,): what the search costs in BIC, the log of the number of candidates that are as simple

    def columns(self, chosen: Sequence[int]) -> Array:
        """Values of some candidates, shape (windows, chosen)."""
        return np.asarray(self.parts[:, self.places[np.array(chosen, np.intp)]].prod(axis=2))

    def products(self, parts: Array, known: Array) -> tuple[Array, Array]:
        """Squares of all candidates, shape (candidates,), and products with known columns, (candidates, columns).

        Either is a product of two factors under a weight, so that one product of matrices serves all pairs of factors.
        """
        bases = int(self.places[:, 0].max()) + 1
        factors, squares, moments = parts[:, bases:], [], []
        for number, base in enumerate(parts.T[:bases]):
            first, second = self.places[self.places[:, 0] == number, 1:].T - bases
            weighted = factors[:, None, :] * (base[:, None] * known)[:, :, None]
            moments.append(np.tensordot(factors, weighted, (0, 0))[first, :, second])
            squares.append((((factors * base[:, None]) ** 2).T @ factors**2)[first, second])
        return np.concatenate(squares), np.concatenate(moments)


class _Base(NamedTuple):
    text: str
    unit: str
    values: Array  # (windows,)
    excluded: frozenset[str] = frozenset({"[v > 0]"})  # factors that it is not multiplied with


class _Factor(NamedTuple):
    text: str
    family: str
    values: Array  # (windows,)


def candidates(fit: Fitted, runs: Runs) -> Library:
    """Every candidate that the channels of these runs allow."""
    robot, one = fit.parameters.nominal, np.ones(len(runs.observed))
    if runs.unit == "A":
        # Current is a force: the load is what the motors draw beyond their current at rest.
        load = np.maximum(fit.predicted - fit.theta[0], 0.0)
        bases = [_Base("", "A", one, frozenset()), _Base("I_drive", "1", load)]
    else:
        weight_w = robot.mass_kg * GRAVITY_MPS2 * np.abs(runs.context["speed_mps"])
        load = np.maximum(fit.predicted - ancillary_power(fit.groups.robot, runs.sensing_hz), 0.0)
        bases = [
            _Base("", "W", one, frozenset({"(v / v_max)", "(v / v_max)^2"})),  # with a higher power of v it is a load
            _Base("m g v", "1", weight_w),
            _Base("P_drive", "1", load),
        ]
    factors = [_Factor("", "1", one), *_factors(runs, robot)]
    found = [
        (number, i, j)
        for number, base in enumerate(bases)
        for i, first in enumerate(factors)
        for j, second in enumerate(factors)
        if (i == j == 0 or (i < j and first.family != second.family)) and not {first.text, second.text} & base.excluded
    ]
    texts = (" ".join(filter(None, (bases[base].text, factors[i].text, factors[j].text))) for base, i, j in found)
    places = np.array(found)
    simplicity = (places[:, 1:] > 0).sum(axis=1)
    as_simple = np.cumsum(np.bincount(simplicity, minlength=3))
    return Library(
        tuple(texts),
        tuple(bases[base].unit for base, _, _ in found),
        np.column_stack([*(one.values for one in bases), *(one.values for one in factors)]),
        places + np.array([0, len(bases), len(bases)]),
        2.0 * np.log(as_simple[simplicity]),
    )


def constants(text: str, robot: Robot, runs: Runs) -> dict[str, str]:
    """Symbols of a formula that are the same for all windows, with value and unit."""
    known = {
        "m ": f"m = {robot.mass_kg:.4g} kg",
        "v_max": f"v_max = {robot.max_speed_mps:.4g} m/s",
        " B": f"B = {robot.track_m:.4g} m",
        "f_max": f"f_max = {robot.max_sensing_hz:.4g} Hz",
        "r_max": f"r_max = {_largest(runs.context.get('base_distance_m', np.zeros(1))):.4g} m",
        "t_max": f"t_max = {float(_time_in_run(runs).max()):.4g} s",
        "P_drive": "P_drive = what the refit says of the drive",
        "I_drive": "I_drive = what the refit says of the drive",
    }
    return {symbol.strip(): meaning for symbol, meaning in known.items() if symbol in text}


def _factors(runs: Runs, robot: Robot) -> list[_Factor]:
    """Each group of the channels that these runs have and that change, to each of its powers."""
    found = []
    for family, text, values, powers in _groups(runs, robot):
        symbol = text if text.startswith(("[", "cos")) else f"({text})"
        for power in powers:
            factor = _Factor(symbol if power == 1.0 else f"{symbol}^{power:g}", family, values**power)
            if np.isfinite(factor.values).all() and float(np.ptp(factor.values)) > 1e-9:
                found.append(factor)
    return found


_Group = tuple[str, str, Array, tuple[float, ...]]  # family, formula, values of shape (windows,), powers


def _groups(runs: Runs, robot: Robot) -> list[_Group]:
    """Dimensionless groups, NaN where the channel is missing."""
    missing = np.full(len(runs.observed), np.nan)
    channel = defaultdict(lambda: missing, runs.context)
    speed, turning, accel = np.abs(channel["speed_mps"]), channel["yaw_rate_radps"], channel["accel_mps2"]
    wheels = missing if "yaw_rate_radps" in runs.context else np.abs(channel["wheel_difference_mps"])
    per, scale_s = "v_max / g", robot.max_speed_mps / GRAVITY_MPS2
    if robot.track_m > 0.0:
        per, scale_s = "B / v_max", robot.track_m / robot.max_speed_mps
    sine, warmth = np.sin(channel["grade_rad"]), (channel["temperature_c"] - _MILD_C) / _MILD_C
    far_m, time_s = np.abs(channel["base_distance_m"]), _time_in_run(runs)
    return [
        ("speed", "[v > 0]", (speed > _STANDS_MPS).astype(np.float64), _PLAIN),
        ("speed", "v / v_max", speed / robot.max_speed_mps, _ROOT_TOO),
        ("turning rate", f"|w| {per}", np.abs(turning) * scale_s, _ROOT_TOO),
        ("turning rate", f"w+ {per}", np.maximum(turning, 0.0) * scale_s, _PLAIN),
        ("turning rate", "|v_r - v_l| / v_max", wheels / robot.max_speed_mps, _ROOT_TOO),
        ("acceleration", "|a| / g", np.abs(accel / GRAVITY_MPS2), _SQUARED),
        ("acceleration", "a+ / g", np.maximum(accel / GRAVITY_MPS2, 0.0), _SQUARED),
        ("acceleration", "a- / g", np.maximum(-accel / GRAVITY_MPS2, 0.0), _PLAIN),
        ("grade", "|sin(grade)|", np.abs(sine), _SQUARED),
        ("grade", "sin(grade)+", np.maximum(sine, 0.0), _SQUARED),
        ("grade", "sin(grade)-", np.maximum(-sine, 0.0), _SQUARED),
        ("sensing", "f_s / f_max", channel["sensing_hz"] / robot.max_sensing_hz, _ROOT_TOO),
        ("temperature", "(T - 20 C) / 20 K", warmth, _SQUARED),
        ("temperature", "(T - 20 C)+ / 20 K", np.maximum(warmth, 0.0), _PLAIN),
        ("temperature", "(20 C - T)+ / 20 K", np.maximum(-warmth, 0.0), _SQUARED),
        *_sectors(channel["heading_rad"]),
        ("distance", "r / r_max", far_m / max(_largest(far_m), 1e-9), _ROOT_TOO),
        ("payload mass", "payload / m", np.abs(channel["payload_kg"]) / robot.mass_kg, _ROOT_TOO),
        ("charge", "1 - soc", np.clip(1.0 - channel["soc"], 0.0, 1.0), _ROOT_TOO),
        ("time", "t / t_max", time_s / max(float(time_s.max()), 1e-9), _ROOT_TOO),
    ]


def _sectors(heading_rad: Array) -> Iterator[_Group]:
    """Ways to depend on the heading; that of 0 is called east, as in ENU frames."""
    for degrees in range(0, 360, 45):
        along = np.cos(heading_rad - np.deg2rad(degrees))
        if degrees < 180:
            yield "heading", f"cos(heading - {degrees} deg)", along, _PLAIN
            yield "heading", f"[heading within 90 deg of {degrees} deg]", (along > 0.0).astype(np.float64), _PLAIN
        within = (along > np.sqrt(0.5)).astype(np.float64)
        yield "heading", f"cos(heading - {degrees} deg)+", np.maximum(along, 0.0), _PLAIN
        yield "heading", f"[heading within 45 deg of {degrees} deg]", within, _PLAIN


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))


def _time_in_run(runs: Runs) -> Array:
    first = np.array([runs.time_s[runs.run == run][0] for run in range(len(runs.signals))])
    return np.asarray(np.maximum(runs.time_s - first[runs.run], 0.0))
