"""Symbolic regression of a residual that no known effect explains: a sparse, dimensionally
consistent formula.

Candidates are the weight's power m g v, the drive's load, or plain watts, times at most two
dimensionless groups of the channels (|w| B / v_max, a / g, sin(grade), ...) with small powers. At
most two terms are taken by forward selection, by held-out error and by the extended BIC, with a
penalty for the size of the search (Chen & Chen, Biometrika 2008). It is validated as the
catalogue's effects are, and its placebos repeat the whole search on channels shifted in time: the
best of thousands of candidates counts only if it beats the best of thousands that cannot be a
cause.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.estimates import standard_errors
from homeward.diagnosis.fit.fitted import Fitted, excited, with_columns
from homeward.diagnosis.fit.held_out import delta_bic, gain, held_out
from homeward.diagnosis.fit.parameter_groups import AT_REST
from homeward.diagnosis.fit.replay import Runs
from homeward.logs import thresholds as logs_thresholds
from homeward.logs.autocorrelation import correlation_windows, noise_of, shifted_in_time
from homeward.logs.channels import Array, Index
from homeward.physics import Robot, ancillary_power
from homeward.physics.model import GRAVITY_MPS2

# the highest score of all then has p = SIGNIFICANT
_PLACEBOS = round(1.0 / thresholds.SIGNIFICANT) - 1
_MOST_TERMS = 2  # chosen: each takes a search and its placebos
# windows; chosen: bounds the time, of more the search takes every second, third, ...
_MOST_SEARCHED = 20_000
_MOST_ALTERNATIVES = 3  # expressions listed beside a term; chosen: to be read at a glance
# of columns of norm 1; chosen: makes collinear ones invertible and changes nothing else
_RIDGE = 1e-8
_MILD_C = 20.0  # zero and unit of the temperature in formulas; chosen: room temperature
# Powers of a group.
_PLAIN = (1.0,)
_SQUARED = (1.0, 2.0)
_ROOT_TOO = (0.5, 1.0, 2.0)


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
        formula = " ".join(parts).removeprefix("+ ")
        if formula.startswith("- "):
            formula = formula.replace("- ", "-", 1)
        return f"{self.symbol} = {formula}"


def propose(
    fit: Fitted, runs: Runs, block: Index, fold: Index, rng: np.random.Generator
) -> Empirical | None:
    """Find a formula that fits the residual of a refit; None where none is validated.

    Windows of one `block` are dependent, those of one `fold` are held out together, shape
    (windows,) each.
    """
    library = candidates(fit, runs)
    search = Search(library, fit, runs, fold)
    selection = _forward_selection(search, block, rng)
    if not selection.terms:
        return None
    numbers, alternatives = _reconsidered(search, selection.terms)
    gained = gain(runs.observed, search.held_out([]), search.held_out(numbers), block, rng)
    columns = library.columns(numbers)
    sizes, half_widths = _coefficients(fit, runs, block, columns)
    terms = []
    for index, number in enumerate(numbers):
        size = float(sizes[index])
        half_width = float(half_widths[index])
        terms.append(
            EmpiricalTerm(
                text=library.texts[number],
                coefficient=size,
                ci95=(size - half_width, size + half_width),
                unit=library.units[number],
                alternatives=alternatives[index],
            )
        )
    texts = " ".join(term.text for term in terms)
    symbol = "P" if runs.unit == "W" else "I"
    return Empirical(
        symbol=symbol,
        terms=tuple(terms),
        constants=constants(texts, fit.parameters.nominal, runs),
        columns=columns,
        contribution=columns * sizes,
        delta_bic=selection.delta_bic,
        held_out_gain=gained.share,
        gain_ci95=gained.ci95,
        p_value=selection.p_value,
    )


@dataclass(frozen=True)
class Library:
    """All candidates, each a base times two factors, of which the first is 1."""

    texts: tuple[str, ...]
    units: tuple[str, ...]  # of a coefficient
    parts: Array  # (windows, bases + factors): what candidates are products of
    places: Index  # (candidates, 3): base and factors of each in `parts`
    # (candidates,): BIC penalty of the search, twice the log of the number of candidates as simple
    cost: Array

    def columns(self, numbers: Sequence[int]) -> Array:
        """Values of some candidates, by their numbers, shape (windows, numbers)."""
        return np.asarray(self.parts[:, self.places[np.array(numbers, np.intp)]].prod(axis=2))

    def products(self, parts: Array, model: Array) -> tuple[Array, Array]:
        """Squares of all candidates, shape (candidates,), and products with the columns of a model,
        (candidates, columns).

        Either is a product of two factors under a weight, so that one product of matrices serves
        all pairs of factors.
        """
        bases = int(self.places[:, 0].max()) + 1
        factors = parts[:, bases:]
        squares = []
        moments = []
        for number, base in enumerate(parts.T[:bases]):
            with_this_base = self.places[:, 0] == number
            factor, partner = self.places[with_this_base, 1:].T - bases
            # Sums over windows for every pair of factors, of which the candidates are some.
            weighted = factors[:, None, :] * (base[:, None] * model)[:, :, None]
            moment_of_pairs = np.tensordot(factors, weighted, (0, 0))
            square_of_pairs = ((factors * base[:, None]) ** 2).T @ factors**2
            moments.append(moment_of_pairs[factor, :, partner])
            squares.append(square_of_pairs[factor, partner])
        return np.concatenate(squares), np.concatenate(moments)


@dataclass(frozen=True)
class Search:
    """A search for a further term beside those that are present."""

    library: Library
    fit: Fitted
    runs: Runs
    fold: Index
    # autocorrelation time of the residual, windows; None: of the refit's
    correlation: float | None = None

    def scores(self, parts: Array, present: Sequence[int]) -> Array:
        """Reduction of BIC by each candidate beside the refit and the terms present, shape
        (candidates,).

        `parts` is what candidates are products of, as the library has it or shifted in time.
        """
        residual = self.runs.observed - self.fit.predicted
        thin = slice(None, None, math.ceil(len(residual) / _MOST_SEARCHED))
        design = np.column_stack([self.fit.jacobian, self.library.columns(present)])[thin]
        norms = np.linalg.norm(design, axis=0)
        is_used = norms > 0.0
        model = np.column_stack([design[:, is_used] / norms[is_used], residual[thin]])
        products = []
        for fold in np.unique(self.fold):
            in_fold = self.fold[thin] == fold
            of_fold = model[in_fold]
            squares, moments = self.library.products(parts[thin][in_fold], of_fold)
            products.append(_Products(gram=of_fold.T @ of_fold, squares=squares, moments=moments))
        error, error_with = _squared_errors(products)
        # Autocorrelated windows count as fewer.
        correlation = self.correlation or noise_of(residual, self.runs.run).correlation
        independent = max(len(residual) / correlation, 2.0)
        return np.asarray(
            independent * np.log(error / error_with) - np.log(independent) - self.library.cost
        )

    def held_out(self, present: Sequence[int]) -> Array:
        """Held-out predictions of the refit with these terms, within the bounds of what is
        physical."""
        columns = self.library.columns(present)
        return held_out(
            lambda training: with_columns(self.fit, training, self.runs.observed, columns),
            self.fold,
        )


class _Selection(NamedTuple):
    terms: list[int]  # numbers of candidates
    delta_bic: float  # of all terms together
    p_value: float  # the largest of a term


def _forward_selection(search: Search, block: Index, rng: np.random.Generator) -> _Selection:
    """The likeliest term beside those selected, as long as it lowers BIC and the held-out error
    beyond chance."""
    library = search.library
    observed = search.runs.observed
    selection = _Selection([], 0.0, 0.0)
    while len(selection.terms) < _MOST_TERMS:
        scores = search.scores(library.parts, selection.terms)
        likeliest = int(np.argmax(scores))
        terms = [*selection.terms, likeliest]
        predicted = search.held_out(selection.terms)
        predicted_with = search.held_out(terms)
        bic_gain = delta_bic(observed, predicted, predicted_with, search.runs.run) - float(
            library.cost[likeliest]
        )
        gained = gain(observed, predicted, predicted_with, block, rng)
        if (
            bic_gain < thresholds.STRONG_BIC
            or gained.share < thresholds.SMALLEST_GAIN
            or gained.ci95[0] <= 0.0
        ):
            break
        p_value = _placebo_p_value(search, selection.terms, float(scores[likeliest]), rng)
        if p_value > thresholds.SIGNIFICANT:
            break
        selection = _Selection(
            terms, selection.delta_bic + bic_gain, max(selection.p_value, p_value)
        )
    return selection


class _Products(NamedTuple):
    """Sums over the windows of a fold."""

    gram: Array  # (columns, columns): products of the model's columns, the target last
    squares: Array  # (candidates,): squares of the candidates
    moments: Array  # (candidates, columns): products of both


def _squared_errors(folds: Sequence[_Products]) -> tuple[float, Array]:
    """Squared error on each fold of fits to the others, without a candidate and with each, shape
    (candidates,).

    A candidate contributes its part orthogonal to the other columns (Frisch & Waugh, Econometrica
    1, 1933).
    """
    error_without = 0.0
    error_with = np.zeros(len(folds[0].squares))
    for number, test in enumerate(folds):
        training = [fold for index, fold in enumerate(folds) if index != number]
        gram = np.sum([fold.gram for fold in training], axis=0)
        squares = np.sum([fold.squares for fold in training], axis=0)
        moments = np.sum([fold.moments for fold in training], axis=0)
        times_columns = moments[:, :-1]
        times_target = moments[:, -1]
        inverse = np.linalg.inv(gram[:-1, :-1] + _RIDGE * np.eye(len(gram) - 1))
        weights = inverse @ gram[:-1, -1]
        # weights of the columns that describe each candidate best
        spanned = times_columns @ inverse
        orthogonal_square = squares - (spanned * times_columns).sum(axis=1)
        # else it is collinear with the model
        is_new = orthogonal_square > 1e-6 * np.maximum(squares, 1e-300)
        times_residual = times_target - times_columns @ weights
        divisor = np.where(is_new, orthogonal_square, 1.0)
        size = np.where(is_new, times_residual / divisor, 0.0)
        # The residual as a combination of the model's columns: without a candidate, and with each,
        # of which then `size` times it is taken away.
        residual = np.append(-weights, 1.0)
        residuals = residual + np.pad(spanned * size[:, None], ((0, 0), (0, 1)))
        error_without += max(float(residual @ test.gram @ residual), 0.0)
        square_of_columns = ((residuals @ test.gram) * residuals).sum(axis=1)
        times_candidate = (test.moments * residuals).sum(axis=1)
        square = square_of_columns - 2.0 * size * times_candidate + size**2 * test.squares
        error_with += np.maximum(square, 0.0)
    return max(error_without, 1e-300), np.maximum(error_with, 1e-300)


def _reconsidered(search: Search, terms: Sequence[int]) -> tuple[list[int], list[tuple[str, ...]]]:
    """Each term chosen anew beside the others, as the first was chosen without the second; and its
    equivalents."""
    residual = search.runs.observed - search.held_out(terms)
    judge = replace(search, correlation=correlation_windows(residual, search.runs.run))
    final = list(terms)
    alternatives = []
    for index in range(len(final)):
        present = final[:index] + final[index + 1 :]
        scores = judge.scores(search.library.parts, present)
        highest_first = np.argsort(-scores, kind="stable").tolist()
        final[index] = highest_first[0]
        limit = scores[final[index]] - thresholds.STRONG_BIC
        as_good = [candidate for candidate in highest_first[1:] if scores[candidate] > limit]
        alternatives.append(
            tuple(search.library.texts[candidate] for candidate in as_good[:_MOST_ALTERNATIVES])
        )
    return final, alternatives


def _placebo_p_value(
    search: Search, present: Sequence[int], score: float, rng: np.random.Generator
) -> float:
    """P-value: share of searches, this one included, that score as high on placebos, channels
    shifted in time."""
    parts = search.library.parts
    of_placebos = [
        float(search.scores(shifted_in_time(parts, rng), present).max()) for _ in range(_PLACEBOS)
    ]
    as_high = sum(placebo >= score for placebo in of_placebos)
    return (1 + as_high) / (_PLACEBOS + 1)


def _coefficients(fit: Fitted, runs: Runs, block: Index, columns: Array) -> tuple[Array, Array]:
    """Coefficient of each term fitted together with the groups, and half its interval clustered by
    block."""
    all_windows = np.ones(len(runs.observed), np.bool_)
    predicted = with_columns(fit, all_windows, runs.observed, columns)
    design = np.column_stack([fit.jacobian[:, excited(fit, runs)], columns])
    weights = np.linalg.lstsq(design, predicted - fit.predicted, rcond=None)[0]
    errors = standard_errors(design, runs.observed - predicted, block)
    terms = slice(-columns.shape[1], None)  # they follow the groups
    blocks = int(block.max()) + 1
    degrees_of_freedom = max(blocks - design.shape[1], 1)
    half_widths = float(student.ppf(0.975, degrees_of_freedom)) * errors[terms]
    return np.asarray(weights[terms]), half_widths


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
    bases = _bases(fit, runs)
    factors = [
        _Factor("", "1", np.ones(len(runs.observed))),
        *_factors(runs, fit.parameters.nominal),
    ]
    pairs = [(0, 0)]  # the base alone; a factor alone is paired with the first, which is 1
    for number, factor in enumerate(factors):
        for partner_number, partner in enumerate(factors[number + 1 :], start=number + 1):
            if factor.family != partner.family:
                pairs.append((number, partner_number))
    places = []
    texts = []
    units = []
    for base_number, base in enumerate(bases):
        for number, partner_number in pairs:
            symbols = (factors[number].text, factors[partner_number].text)
            if base.excluded.isdisjoint(symbols):
                places.append((base_number, len(bases) + number, len(bases) + partner_number))
                texts.append(" ".join(filter(None, (base.text, *symbols))))
                units.append(base.unit)
    place_array = np.array(places)
    factors_of = (place_array[:, 1:] > len(bases)).sum(axis=1)  # beside those that are 1
    # candidates of at most so many factors
    as_simple = np.cumsum(np.bincount(factors_of, minlength=3))
    return Library(
        texts=tuple(texts),
        units=tuple(units),
        parts=np.column_stack(
            [*(base.values for base in bases), *(factor.values for factor in factors)]
        ),
        places=place_array,
        cost=2.0 * np.log(as_simple[factors_of]),
    )


def _bases(fit: Fitted, runs: Runs) -> list[_Base]:
    """What candidates are proportional to: one, the weight's power, and the load of the drive."""
    ones = np.ones(len(runs.observed))
    if runs.unit == "A":
        # Current is a force: the load is the current above that at rest.
        load_a = np.maximum(fit.predicted - fit.theta[AT_REST], 0.0)
        return [_Base("", "A", ones, frozenset()), _Base("I_drive", "1", load_a)]
    robot = fit.parameters.nominal
    weight_w = robot.mass_kg * GRAVITY_MPS2 * np.abs(runs.context["speed_mps"])
    load_w = np.maximum(fit.predicted - ancillary_power(fit.groups.robot, runs.sensing_hz), 0.0)
    return [
        # A constant times a power of v is a load.
        _Base("", "W", ones, frozenset({"(v / v_max)", "(v / v_max)^2"})),
        _Base("m g v", "1", weight_w),
        _Base("P_drive", "1", load_w),
    ]


def constants(text: str, robot: Robot, runs: Runs) -> dict[str, str]:
    """Symbols of a formula that are the same for all windows, with value and unit."""
    meanings = {
        "m ": f"m = {robot.mass_kg:.4g} kg",
        "v_max": f"v_max = {robot.max_speed_mps:.4g} m/s",
        " B": f"B = {robot.track_m:.4g} m",
        "f_max": f"f_max = {robot.max_sensing_hz:.4g} Hz",
        "r_max": f"r_max = {_largest(runs.context.get('base_distance_m', np.zeros(1))):.4g} m",
        "t_max": f"t_max = {float(runs.elapsed_s.max()):.4g} s",
        "P_drive": "P_drive = the drive's power by the refit",
        "I_drive": "I_drive = the drive's current by the refit",
    }
    return {symbol.strip(): meaning for symbol, meaning in meanings.items() if symbol in text}


def _factors(runs: Runs, robot: Robot) -> list[_Factor]:
    """Each group of the channels that these runs have and that change, to each of its powers."""
    factors = []
    for family, text, values, powers in _groups(runs, robot):
        symbol = f"({text})"
        if text.startswith(("[", "cos")):
            symbol = text
        for power in powers:
            raised = values**power
            if np.isfinite(raised).all() and float(np.ptp(raised)) > 1e-9:
                raised_symbol = symbol if power == 1.0 else f"{symbol}^{power:g}"
                factors.append(_Factor(raised_symbol, family, raised))
    return factors


# family, formula, values of shape (windows,), powers
_Dimensionless = tuple[str, str, Array, tuple[float, ...]]


def _groups(runs: Runs, robot: Robot) -> list[_Dimensionless]:
    """Dimensionless groups, NaN where the channel is missing."""
    missing = np.full(len(runs.observed), np.nan)
    channel = defaultdict(lambda: missing, runs.context)
    moves = np.abs(channel["speed_mps"]) > logs_thresholds.STANDSTILL_MPS
    speed = np.abs(channel["speed_mps"]) / robot.max_speed_mps
    # A difference of wheel speeds is a turning rate; where a gyroscope measured that, it is not
    # needed.
    wheels = missing
    if "yaw_rate_radps" not in runs.context:
        wheels = np.abs(channel["wheel_difference_mps"])
    # A time that makes turning rates dimensionless.
    per = "v_max / g"
    scale_s = robot.max_speed_mps / GRAVITY_MPS2
    if robot.track_m > 0.0:
        per = "B / v_max"
        scale_s = robot.track_m / robot.max_speed_mps
    turning = channel["yaw_rate_radps"]
    accel = channel["accel_mps2"] / GRAVITY_MPS2
    sine = np.sin(channel["grade_rad"])
    warmth = (channel["temperature_c"] - _MILD_C) / _MILD_C
    away_m = np.abs(channel["base_distance_m"])
    payload = np.abs(channel["payload_kg"]) / robot.mass_kg
    emptied = np.clip(1.0 - channel["soc"], 0.0, 1.0)
    passed = runs.elapsed_s / max(float(runs.elapsed_s.max()), 1e-9)
    return [
        ("speed", "[v > 0]", moves.astype(np.float64), _PLAIN),
        ("speed", "v / v_max", speed, _ROOT_TOO),
        ("turning rate", f"|w| {per}", np.abs(turning) * scale_s, _ROOT_TOO),
        ("turning rate", f"w+ {per}", np.maximum(turning, 0.0) * scale_s, _PLAIN),
        ("turning rate", "|v_r - v_l| / v_max", wheels / robot.max_speed_mps, _ROOT_TOO),
        ("acceleration", "|a| / g", np.abs(accel), _SQUARED),
        ("acceleration", "a+ / g", np.maximum(accel, 0.0), _SQUARED),
        ("acceleration", "a- / g", np.maximum(-accel, 0.0), _PLAIN),
        ("grade", "|sin(grade)|", np.abs(sine), _SQUARED),
        ("grade", "sin(grade)+", np.maximum(sine, 0.0), _SQUARED),
        ("grade", "sin(grade)-", np.maximum(-sine, 0.0), _SQUARED),
        ("sensing", "f_s / f_max", channel["sensing_hz"] / robot.max_sensing_hz, _ROOT_TOO),
        ("temperature", "(T - 20 C) / 20 K", warmth, _SQUARED),
        ("temperature", "(T - 20 C)+ / 20 K", np.maximum(warmth, 0.0), _PLAIN),
        ("temperature", "(20 C - T)+ / 20 K", np.maximum(-warmth, 0.0), _SQUARED),
        *_sectors(channel["heading_rad"]),
        ("distance", "r / r_max", away_m / max(_largest(away_m), 1e-9), _ROOT_TOO),
        ("payload mass", "payload / m", payload, _ROOT_TOO),
        ("charge", "1 - soc", emptied, _ROOT_TOO),
        ("time", "t / t_max", passed, _ROOT_TOO),
    ]


def _sectors(heading_rad: Array) -> Iterator[_Dimensionless]:
    """Functions of the heading; heading 0 is east, as in ENU frames."""
    for degrees in range(0, 360, 45):
        along = np.cos(heading_rad - np.deg2rad(degrees))
        if degrees < 180:  # of the opposite heading they are these times -1, or 1 less these
            forwards = (along > 0.0).astype(np.float64)
            yield "heading", f"cos(heading - {degrees} deg)", along, _PLAIN
            yield "heading", f"[heading within 90 deg of {degrees} deg]", forwards, _PLAIN
        within = (along > np.sqrt(0.5)).astype(np.float64)
        yield "heading", f"cos(heading - {degrees} deg)+", np.maximum(along, 0.0), _PLAIN
        yield "heading", f"[heading within 45 deg of {degrees} deg]", within, _PLAIN


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
