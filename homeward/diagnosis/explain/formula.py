"""Symbolic regression of a residual that no known effect explains: a sparse, dimensionally consistent formula.

Candidates are the weight's power m g v, the drive's load, or plain watts, times at most two dimensionless groups of the
channels (|w| B / v_max, a / g, sin(grade), ...) with small powers. At most two terms are taken by forward selection, by
held-out error and by the extended BIC, with a penalty for the size of the search (Chen & Chen, Biometrika 2008). It is
validated as the catalogue's effects are, and its placebos repeat the whole search on channels shifted in time: the best
of thousands of candidates counts only if it beats the best of thousands that cannot be a cause.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.fitted import Fitted, excited, with_columns
from homeward.diagnosis.fit.held_out import delta_bic, gain, held_out
from homeward.diagnosis.fit.parameter_groups import AT_REST
from homeward.diagnosis.fit.refit import standard_errors
from homeward.diagnosis.fit.replay import Runs
from homeward.logs import thresholds as logs_thresholds
from homeward.logs.autocorrelation import correlation_windows, noise_of, shifted_in_time
from homeward.logs.channels import Array, Index
from homeward.physics import Robot, ancillary_power
from homeward.physics.model import GRAVITY_MPS2

_PLACEBOS = round(1.0 / thresholds.SIGNIFICANT) - 1  # the highest score of all then has p = SIGNIFICANT
_MOST_TERMS = 2  # chosen: each takes a search and its placebos
_MOST_SEARCHED = 20_000  # windows; chosen: bounds the time, of more the search takes every second, third, ...
_MOST_ALTERNATIVES = 3  # expressions listed beside a term; chosen: to be read at a glance
_RIDGE = 1e-8  # of columns of norm 1; chosen: makes collinear ones invertible and changes nothing else
_MILD_C = 20.0  # zero and unit of the temperature in formulas; chosen: room temperature
_PLAIN, _SQUARED, _ROOT_TOO = (1.0,), (1.0, 2.0), (0.5, 1.0, 2.0)  # powers of a group


@dataclass(frozen=True)
class EmpiricalTerm:
    """One term of the formula: `coefficient` times the expression `text`."""

    text: str  # such as "m g v (|w| B / v_max)^2"
    coefficient: float
    ci95: tuple[float, float]
    unit: str  # of the coefficient: "1", "W" or "A"
    alternatives: tuple[str, ...]  # expressions that fit these recordings equally well


@dataclass(frozen=True)
class Empirical:
    """A validated formula; `columns` and `contribution` have shape (windows, terms)."""

    symbol: str  # of what it adds to: "P" or "I"
    terms: tuple[EmpiricalTerm, ...]
    constants: Mapping[str, str]  # symbols that are the same for all windows, with value and unit
    columns: Array
    contribution: Array
    delta_bic: float
    held_out_gain: float  # share of the refit's squared held-out error
    gain_ci95: tuple[float, float]
    p_value: float  # share of placebo searches that score as high

    @property
    def text(self) -> str:
        """The formula with its numbers, such as "P = 0.31 W f_s / f_max"."""
        parts = []
        for term in self.terms:
            unit = "" if term.unit == "1" else f" {term.unit}"
            sign = "-" if term.coefficient < 0.0 else "+"
            parts.append(f"{sign} {abs(term.coefficient):.3g}{unit} {term.text}".rstrip())
        formula = " ".join(parts)
        return f"{self.symbol} = {formula.removeprefix('+ ') if formula[0] == '+' else formula.replace('- ', '-', 1)}"


def propose(fit: Fitted, runs: Runs, block: Index, fold: Index, rng: np.random.Generator) -> Empirical | None:
    """Find a formula that fits the residual of a refit; None where none is validated.

    Windows of one `block` are dependent, those of one `fold` are held out together, shape (windows,) each.
    """
    library = candidates(fit, runs)
    search = Search(library, fit, runs, fold)
    chosen: list[int] = []
    p_value = total_bic_gain = 0.0
    while len(chosen) < _MOST_TERMS:
        scores = search.scores(library.parts, chosen)
        best = int(np.argmax(scores))
        before, after = search.held_out(chosen), search.held_out([*chosen, best])
        bic_gain = delta_bic(runs.observed, before, after, runs.run) - float(library.cost[best])
        gained = gain(runs.observed, before, after, block, rng)
        if bic_gain < thresholds.STRONG_BIC or gained.share < thresholds.SMALLEST_GAIN or gained.ci95[0] <= 0.0:
            break
        p_value_of_term = _placebo_p_value(search, chosen, float(scores[best]), rng)
        if p_value_of_term > thresholds.SIGNIFICANT:
            break
        chosen = [*chosen, best]
        total_bic_gain += bic_gain
        p_value = max(p_value, p_value_of_term)
    if not chosen:
        return None
    chosen, alternatives = _reconsidered(search, chosen)
    columns = library.columns(chosen)
    gained = gain(runs.observed, search.held_out([]), search.held_out(chosen), block, rng)
    sizes, errors = _coefficients(fit, runs, block, columns)
    terms = tuple(
        EmpiricalTerm(library.texts[candidate], size, (size - error, size + error), library.units[candidate], others)
        for candidate, size, error, others in zip(chosen, sizes.tolist(), errors.tolist(), alternatives, strict=True)
    )
    texts = " ".join(term.text for term in terms)
    return Empirical(
        "P" if runs.unit == "W" else "I", terms, constants(texts, fit.parameters.nominal, runs), columns,
        columns * sizes, total_bic_gain, gained.share, gained.ci95, p_value,
    )  # fmt: skip


@dataclass(frozen=True)
class Library:
    """All candidates, each a base times two factors, of which the first is 1."""

    texts: tuple[str, ...]
    units: tuple[str, ...]  # of a coefficient
    parts: Array  # (windows, bases + factors): what candidates are products of
    places: Index  # (candidates, 3): base and factors of each in `parts`
    cost: Array  # (candidates,): BIC penalty of the search, twice the log of the number of candidates as simple

    def columns(self, chosen: Sequence[int]) -> Array:
        """Values of some candidates, shape (windows, chosen)."""
        return np.asarray(self.parts[:, self.places[np.array(chosen, np.intp)]].prod(axis=2))

    def products(self, parts: Array, known: Array) -> tuple[Array, Array]:
        """Squares of all candidates, shape (candidates,), and products with known columns, (candidates, columns).

        Either is a product of two factors under a weight, so that one product of matrices serves all pairs of factors.
        """
        bases = int(self.places[:, 0].max()) + 1
        factors = parts[:, bases:]
        squares, moments = [], []
        for number, base in enumerate(parts.T[:bases]):
            with_this_base = self.places[:, 0] == number
            first, second = self.places[with_this_base, 1:].T - bases
            # Sums over windows for every pair of factors, of which the candidates are some.
            weighted = factors[:, None, :] * (base[:, None] * known)[:, :, None]
            moment_of_pairs = np.tensordot(factors, weighted, (0, 0))
            square_of_pairs = ((factors * base[:, None]) ** 2).T @ factors**2
            moments.append(moment_of_pairs[first, :, second])
            squares.append(square_of_pairs[first, second])
        return np.concatenate(squares), np.concatenate(moments)


@dataclass(frozen=True)
class Search:
    """A search for a further term beside those that are present."""

    library: Library
    fit: Fitted
    runs: Runs
    fold: Index
    correlation: float | None = None  # autocorrelation time of the residual, windows; None: of the refit's

    def scores(self, parts: Array, present: Sequence[int]) -> Array:
        """Reduction of BIC by each candidate beside the refit and the terms present, shape (candidates,).

        `parts` is what candidates are products of, as the library has it or shifted in time.
        """
        residual = self.runs.observed - self.fit.predicted
        thin = slice(None, None, math.ceil(len(residual) / _MOST_SEARCHED))
        beside = np.column_stack([self.fit.jacobian, self.library.columns(present)])[thin]
        norms = np.linalg.norm(beside, axis=0)
        known = np.column_stack([beside[:, norms > 0.0] / norms[norms > 0.0], residual[thin]])
        products = []
        for fold in np.unique(self.fold):
            held = self.fold[thin] == fold
            squares, moments = self.library.products(parts[thin][held], known[held])
            products.append(_Products(known[held].T @ known[held], squares, moments))
        without, with_it = _squared_errors(products)
        correlation = self.correlation or noise_of(residual, self.runs.run).correlation
        effective = max(len(residual) / correlation, 2.0)
        return np.asarray(effective * np.log(without / with_it) - np.log(effective) - self.library.cost)

    def held_out(self, present: Sequence[int]) -> Array:
        """Held-out predictions of the refit with these terms, within the bounds of what is physical."""
        columns = self.library.columns(present)
        return held_out(lambda chosen: with_columns(self.fit, chosen, self.runs.observed, columns), self.fold)


class _Products(NamedTuple):
    """Sums over the windows of a fold."""

    gram: Array  # (known, known): products of the known columns, the target last
    squares: Array  # (candidates,): squares of the candidates
    moments: Array  # (candidates, known): products of both


def _squared_errors(folds: Sequence[_Products]) -> tuple[float, Array]:
    """Squared error on each fold of fits to the others, without a candidate and with each, shape (candidates,).

    A candidate contributes its part orthogonal to the other columns (Frisch & Waugh, Econometrica 1, 1933).
    """
    error_without = 0.0
    error_with = np.zeros(len(folds[0].squares))
    for number, test in enumerate(folds):
        training = [fold for index, fold in enumerate(folds) if index != number]
        gram = np.sum([fold.gram for fold in training], axis=0)
        squares = np.sum([fold.squares for fold in training], axis=0)
        moments = np.sum([fold.moments for fold in training], axis=0)
        with_columns, with_target = moments[:, :-1], moments[:, -1]
        inverse = np.linalg.inv(gram[:-1, :-1] + _RIDGE * np.eye(len(gram) - 1))
        weights = inverse @ gram[:-1, -1]
        spanned = with_columns @ inverse  # weights of the columns that describe each candidate best
        own_square = squares - (spanned * with_columns).sum(axis=1)
        is_new = own_square > 1e-6 * np.maximum(squares, 1e-300)  # else it is collinear with the model
        size = np.where(is_new, (with_target - with_columns @ weights) / np.where(is_new, own_square, 1.0), 0.0)
        # The residual as a combination of the known columns, without a candidate and, less `size` times it, with each.
        residual = np.append(-weights, 1.0)
        residuals = residual + np.pad(spanned * size[:, None], ((0, 0), (0, 1)))
        error_without += max(float(residual @ test.gram @ residual), 0.0)
        of_columns = ((residuals @ test.gram) * residuals).sum(axis=1)
        of_both = (test.moments * residuals).sum(axis=1)
        error_with += np.maximum(of_columns - 2.0 * size * of_both + size**2 * test.squares, 0.0)
    return max(error_without, 1e-300), np.maximum(error_with, 1e-300)


def _reconsidered(search: Search, chosen: Sequence[int]) -> tuple[list[int], list[tuple[str, ...]]]:
    """Each term chosen anew beside the others, as the first was chosen without the second; and its equivalents."""
    residual = search.runs.observed - search.held_out(chosen)
    judge = replace(search, correlation=correlation_windows(residual, search.runs.run))
    final, alternatives = list(chosen), []
    for index in range(len(final)):
        scores = judge.scores(search.library.parts, final[:index] + final[index + 1 :])
        best_first = np.argsort(-scores, kind="stable").tolist()
        final[index] = best_first[0]
        least = scores[final[index]] - thresholds.STRONG_BIC
        as_good = [candidate for candidate in best_first[1:] if scores[candidate] > least]
        alternatives.append(tuple(search.library.texts[candidate] for candidate in as_good[:_MOST_ALTERNATIVES]))
    return final, alternatives


def _placebo_p_value(search: Search, present: Sequence[int], score: float, rng: np.random.Generator) -> float:
    """P-value: share of searches, this one included, that score as high on placebos, channels shifted in time."""
    parts = search.library.parts
    of_placebos = [float(search.scores(shifted_in_time(parts, rng), present).max()) for _ in range(_PLACEBOS)]
    as_high = sum(placebo >= score for placebo in of_placebos)
    return (1 + as_high) / (_PLACEBOS + 1)


def _coefficients(fit: Fitted, runs: Runs, block: Index, columns: Array) -> tuple[Array, Array]:
    """Coefficient of each term fitted together with the groups, and half its interval clustered by block."""
    predicted = with_columns(fit, np.ones(len(runs.observed), np.bool_), runs.observed, columns)
    design = np.column_stack([fit.jacobian[:, excited(fit, runs)], columns])
    sizes = np.asarray(np.linalg.lstsq(design, predicted - fit.predicted, rcond=None)[0][-columns.shape[1] :])
    errors = standard_errors(design, runs.observed - predicted, block)[-columns.shape[1] :]
    return sizes, float(student.ppf(0.975, max(int(block.max()) + 1 - design.shape[1], 1))) * errors


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
    robot, ones = fit.parameters.nominal, np.ones(len(runs.observed))
    if runs.unit == "A":
        # Current is a force: the load is the current above that at rest.
        load = np.maximum(fit.predicted - fit.theta[AT_REST], 0.0)
        bases = [_Base("", "A", ones, frozenset()), _Base("I_drive", "1", load)]
    else:
        weight_w = robot.mass_kg * GRAVITY_MPS2 * np.abs(runs.context["speed_mps"])
        load = np.maximum(fit.predicted - ancillary_power(fit.groups.robot, runs.sensing_hz), 0.0)
        bases = [
            # A constant times a power of v is a load.
            _Base("", "W", ones, frozenset({"(v / v_max)", "(v / v_max)^2"})),
            _Base("m g v", "1", weight_w),
            _Base("P_drive", "1", load),
        ]
    factors = [_Factor("", "1", ones), *_factors(runs, robot)]
    pairs = [(0, 0)]  # the base alone; a factor alone is paired with the first, which is 1
    for first in range(len(factors)):
        for second in range(first + 1, len(factors)):
            if factors[first].family != factors[second].family:
                pairs.append((first, second))
    indices, texts, units = [], [], []
    for number, base in enumerate(bases):
        for first, second in pairs:
            symbols = (factors[first].text, factors[second].text)
            if base.excluded.isdisjoint(symbols):
                indices.append((number, first, second))
                texts.append(" ".join(filter(None, (base.text, *symbols))))
                units.append(base.unit)
    places = np.array(indices)
    factors_of = (places[:, 1:] > 0).sum(axis=1)
    as_simple = np.cumsum(np.bincount(factors_of, minlength=3))
    return Library(
        texts=tuple(texts),
        units=tuple(units),
        parts=np.column_stack([*(base.values for base in bases), *(factor.values for factor in factors)]),
        places=places + np.array([0, len(bases), len(bases)]),
        cost=2.0 * np.log(as_simple[factors_of]),
    )


def constants(text: str, robot: Robot, runs: Runs) -> dict[str, str]:
    """Symbols of a formula that are the same for all windows, with value and unit."""
    known = {
        "m ": f"m = {robot.mass_kg:.4g} kg",
        "v_max": f"v_max = {robot.max_speed_mps:.4g} m/s",
        " B": f"B = {robot.track_m:.4g} m",
        "f_max": f"f_max = {robot.max_sensing_hz:.4g} Hz",
        "r_max": f"r_max = {_largest(runs.context.get('base_distance_m', np.zeros(1))):.4g} m",
        "t_max": f"t_max = {float(runs.elapsed_s.max()):.4g} s",
        "P_drive": "P_drive = the drive's power by the refit",
        "I_drive": "I_drive = the drive's current by the refit",
    }
    return {symbol.strip(): meaning for symbol, meaning in known.items() if symbol in text}


def _factors(runs: Runs, robot: Robot) -> list[_Factor]:
    """Each group of the channels that these runs have and that change, to each of its powers."""
    factors = []
    for family, text, values, powers in _groups(runs, robot):
        symbol = text if text.startswith(("[", "cos")) else f"({text})"
        for power in powers:
            raised = values**power
            if np.isfinite(raised).all() and float(np.ptp(raised)) > 1e-9:
                factors.append(_Factor(symbol if power == 1.0 else f"{symbol}^{power:g}", family, raised))
    return factors


_Dimensionless = tuple[str, str, Array, tuple[float, ...]]  # family, formula, values of shape (windows,), powers


def _groups(runs: Runs, robot: Robot) -> list[_Dimensionless]:
    """Dimensionless groups, NaN where the channel is missing."""
    missing = np.full(len(runs.observed), np.nan)
    channel = defaultdict(lambda: missing, runs.context)
    speed, turning, accel = np.abs(channel["speed_mps"]), channel["yaw_rate_radps"], channel["accel_mps2"]
    wheels = missing if "yaw_rate_radps" in runs.context else np.abs(channel["wheel_difference_mps"])
    per, scale_s = "v_max / g", robot.max_speed_mps / GRAVITY_MPS2
    if robot.track_m > 0.0:
        per, scale_s = "B / v_max", robot.track_m / robot.max_speed_mps
    sine, warmth = np.sin(channel["grade_rad"]), (channel["temperature_c"] - _MILD_C) / _MILD_C
    far_m, time_s = np.abs(channel["base_distance_m"]), runs.elapsed_s
    return [
        ("speed", "[v > 0]", (speed > logs_thresholds.STANDSTILL_MPS).astype(np.float64), _PLAIN),
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


def _sectors(heading_rad: Array) -> Iterator[_Dimensionless]:
    """Functions of the heading; heading 0 is east, as in ENU frames."""
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
