"""A formula for what no known effect explains: sparse, dimensionally consistent, and empirical.

Candidates are the weight's power m g v, the drive's load, or plain watts, times at most two dimensionless groups of the
channels (|w| B / v_max, a / g, sin(grade), ...) with small powers. At most two terms are taken, one after the other, by
held-out error and by a BIC that pays for the size of the search (Chen & Chen, Biometrika 2008). The proof is that of
the catalogue's effects, and its placebos repeat the whole search on channels that are shifted in time: a winner among
thousands is only worth something if the best of thousands without a cause does worse.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from homeward.diagnosis import rules
from homeward.diagnosis.explain.dimensionless import Library, candidates, constants
from homeward.diagnosis.explain.naming import shifted_in_time
from homeward.diagnosis.fit.fitted import Fitted, excited, with_columns
from homeward.diagnosis.fit.folds import correlation_windows, noise_of
from homeward.diagnosis.fit.held_out import evidence, gain, held_out
from homeward.diagnosis.fit.refit import standard_errors
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.channels import Array, Index

_MOST_TERMS = 2
_MOST_SEARCHED = 20_000  # windows; of more the search takes every second, third, ...
_MOST_ALTERNATIVES = 3
_RIDGE = 1e-8


@dataclass(frozen=True)
class EmpiricalTerm:
    """One term of the formula: `coefficient` times what `text` says, with where its symbols come from."""

    text: str  # such as "m g v (|w| B / v_max)^2"
    coefficient: float
    ci95: tuple[float, float]
    unit: str  # of the coefficient: "1", "W" or "A"
    alternatives: tuple[str, ...]  # what does as well on these recordings


@dataclass(frozen=True)
class Empirical:
    """A formula that passed the proof; `columns` and `contribution` have shape (windows, terms)."""

    symbol: str  # of what it adds to: "P" or "I"
    terms: tuple[EmpiricalTerm, ...]
    constants: Mapping[str, str]  # symbols that are the same for all windows, with value and unit
    columns: Array
    contribution: Array
    delta_bic: float
    held_out_gain: float  # share of the refit's squared held-out error
    gain_ci95: tuple[float, float]
    p_value: float  # share of searches without a cause that do as well

    @property
    def text(self) -> str:
        """The formula with its numbers, such as "P = 0.31 W f_s / f_max"."""
        parts = []
        for one in self.terms:
            unit = "" if one.unit == "1" else f" {one.unit}"
            sign = "-" if one.coefficient < 0.0 else "+"
            parts.append(f"{sign} {abs(one.coefficient):.3g}{unit} {one.text}".rstrip())
        formula = " ".join(parts)
        return f"{self.symbol} = {formula.removeprefix('+ ') if formula[0] == '+' else formula.replace('- ', '-', 1)}"


def propose(fit: Fitted, runs: Runs, block: Index, fold: Index, seed: int) -> Empirical | None:
    """Find the formula that the residual of a refit follows; None where none passes the proof.

    Windows of one `block` depend on each other, those of one `fold` are held out together, shape (windows,) each.
    """
    library = candidates(fit, runs)
    search = Search(library, fit, runs, fold)
    chosen: list[int] = []
    p_value = paid = 0.0
    while len(chosen) < _MOST_TERMS:
        scores = search.scores(library.parts, chosen)
        best = int(np.argmax(scores))
        before, after = search.held_out(chosen), search.held_out([*chosen, best])
        pays = evidence(runs.observed, before, after, runs.run) - float(library.cost[best])
        gained = gain(runs.observed, before, after, block, seed)
        if pays < rules.VERY_STRONG or gained.share < rules.SMALLEST_GAIN or gained.ci95[0] <= 0.0:
            break
        p_value_of_term = _placebo_p_value(search, chosen, float(scores[best]), seed)
        if p_value_of_term > 1.0 / (rules.PLACEBOS + 1):
            break
        chosen, paid, p_value = [*chosen, best], paid + pays, max(p_value, p_value_of_term)
    if not chosen:
        return None
    chosen, alternatives = _reconsidered(search, chosen)
    columns = library.columns(chosen)
    gained = gain(runs.observed, search.held_out([]), search.held_out(chosen), block, seed)
    sizes, errors = _coefficients(fit, runs, block, columns)
    terms = tuple(
        EmpiricalTerm(library.texts[one], size, (size - error, size + error), library.units[one], others)
        for one, size, error, others in zip(chosen, sizes.tolist(), errors.tolist(), alternatives, strict=True)
    )
    texts = " ".join(one.text for one in terms)
    return Empirical(
        "P" if runs.unit == "W" else "I", terms, constants(texts, fit.parameters.nominal, runs), columns,
        columns * sizes, paid, gained.share, gained.ci95, p_value,
    )  # fmt: skip


@dataclass(frozen=True)
class Search:
    """What a search for a term needs beside the terms that are present."""

    library: Library
    fit: Fitted
    runs: Runs
    fold: Index
    memory: float | None = None  # of what is left, in windows; by default that of the refit's residual

    def scores(self, parts: Array, present: Sequence[int]) -> Array:
        """Evidence for each candidate beside the refit and the terms present, shape (candidates,).

        `parts` is what candidates are products of, as the library has it or shifted in time.
        """
        residual = self.runs.observed - self.fit.predicted
        thin = slice(None, None, -(-len(residual) // _MOST_SEARCHED))
        beside = np.column_stack([self.fit.jacobian, self.library.columns(present)])[thin]
        norms = np.linalg.norm(beside, axis=0)
        known = np.column_stack([beside[:, norms > 0.0] / norms[norms > 0.0], residual[thin]])
        folds = [self.fold[thin] == one for one in np.unique(self.fold)]
        without, with_it = _squared_errors([
            (known[one].T @ known[one], *self.library.products(parts[thin][one], known[one])) for one in folds
        ])  # fmt: skip
        effective = max(len(residual) / (self.memory or noise_of(residual, self.runs.run).memory), 2.0)
        return np.asarray(effective * np.log(without / with_it) - np.log(effective) - self.library.cost)

    def held_out(self, present: Sequence[int]) -> Array:
        """Held-out predictions of the refit with these terms, within the bounds of what is physical."""
        columns = self.library.columns(present)
        return held_out(lambda chosen: with_columns(self.fit, chosen, self.runs.observed, columns), self.fold)


def _squared_errors(folds: Sequence[tuple[Array, Array, Array]]) -> tuple[float, Array]:
    """Squared error on each fold of fits to the others, without a candidate and with each, shape (candidates,).

    What a candidate adds is what the other columns do not say of it (Frisch & Waugh, Econometrica 1, 1933). A fold has
    products of what is known, the target last, (known, known), squares of candidates, and products with what is known.
    """
    gram, square, beside = (np.array(one) for one in zip(*folds, strict=True))
    without, with_it = 0.0, np.zeros(square.shape[1])
    for test in range(len(folds)):
        rest, power, moment = (np.delete(one, test, axis=0).sum(axis=0) for one in (gram, square, beside))
        inverse = np.linalg.inv(rest[:-1, :-1] + _RIDGE * np.eye(len(rest) - 1))
        weights, said = inverse @ rest[:-1, -1], moment[:, :-1] @ inverse
        own = power - (said * moment[:, :-1]).sum(axis=1)
        seen = own > 1e-6 * np.maximum(power, 1e-300)  # else what is in the model says the same
        size = np.where(seen, (moment[:, -1] - moment[:, :-1] @ weights) / np.where(seen, own, 1.0), 0.0)
        plain = np.append(-weights, 1.0)
        left = plain + np.pad(said * size[:, None], ((0, 0), (0, 1)))  # of the target, less size times the candidate
        without += max(float(plain @ gram[test] @ plain), 0.0)
        squared = ((left @ gram[test]) * left - 2.0 * size[:, None] * beside[test] * left).sum(axis=1)
        with_it += np.maximum(squared + size**2 * square[test], 0.0)
    return max(without, 1e-300), np.maximum(with_it, 1e-300)


def _reconsidered(search: Search, chosen: Sequence[int]) -> tuple[list[int], list[tuple[str, ...]]]:
    """Each term chosen anew beside the others, as the first had to stand in for the second; and what does as well."""
    left = search.runs.observed - search.held_out(chosen)
    judge = replace(search, memory=correlation_windows(left, search.runs.run))
    final, alternatives = list(chosen), []
    for index in range(len(final)):
        scores = judge.scores(search.library.parts, final[:index] + final[index + 1 :])
        best_first = np.argsort(-scores, kind="stable").tolist()
        final[index] = best_first[0]
        close = [one for one in best_first[1:] if scores[one] > scores[final[index]] - rules.VERY_STRONG]
        alternatives.append(tuple(search.library.texts[one] for one in close[:_MOST_ALTERNATIVES]))
    return final, alternatives


def _placebo_p_value(search: Search, present: Sequence[int], score: float, seed: int) -> float:
    """Share of searches, this one among them, that find as good a term among channels shifted in time."""
    rng, parts = np.random.default_rng(seed), search.library.parts
    found = [float(search.scores(shifted_in_time(parts, rng), present).max()) for _ in range(rules.PLACEBOS)]
    return (1 + sum(one >= score for one in found)) / (rules.PLACEBOS + 1)


def _coefficients(fit: Fitted, runs: Runs, block: Index, columns: Array) -> tuple[Array, Array]:
    """Coefficient of each term fitted together with the groups, and half its interval clustered by block."""
    predicted = with_columns(fit, np.ones(len(runs.observed), np.bool_), runs.observed, columns)
    design = np.column_stack([fit.jacobian[:, excited(fit, runs)], columns])
    sizes = np.asarray(np.linalg.lstsq(design, predicted - fit.predicted, rcond=None)[0][-columns.shape[1] :])
    errors = standard_errors(design, runs.observed - predicted, block)[-columns.shape[1] :]
    return sizes, float(student.ppf(0.975, max(int(block.max()) + 1 - design.shape[1], 1))) * errors
