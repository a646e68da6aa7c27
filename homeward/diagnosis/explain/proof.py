"""Evidence for hypotheses: held-out error by cross-validation, BIC, and p-values by placebo tests.

Each is fitted beside the refit. Levels of a schedule are searched anew in every fold, on its training windows. Where an
effect changes in time, stretches of a few windows are held out, as the windows around them determine its level;
elsewhere whole blocks are.

Hypotheses without a search are all tried on placebos, residuals whose blocks have random signs, which keeps
autocorrelation and heteroscedasticity (wild cluster bootstrap: Cameron, Gelbach & Miller, 2008), and the largest score
counts (Westfall & Young, 1993). A search is repeated on every placebo, until some score as high (Besag & Clifford,
1991): also on random signs of blocks or, for repeated changes, on surrogates, Gaussian noise of the same spectrum
(Theiler et al., 1992), which has no levels. The p-value comes from the exponential tail of their scores (Winkler
et al., 2016), times the number of kinds of searches: those of one kind differ only in the load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.change_points import Schedule, clearly_apart
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.fit.fitted import Fitted, bounded
from homeward.diagnosis.fit.folds import FOLDS, cut_blocks, cut_stretches, per_block
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.autocorrelation import independent_windows, innovations, noise_of
from homeward.logs.channels import Array, Index, Mask

DRAWS = 1999
"""Residuals with random signs: the least p-value is then 0.0005, a twentieth of FALSE_ALARM_RATE."""
_SEARCHES, _LARGEST = 39, 10  # the largest, a quarter of the scores, whose mean estimates the tail within a third
_MORE, _CLOSE = 4, 10.0  # four times as many searches where p is within this factor of the limit; chosen
_AS_GOOD = 3  # placebos with as high a score that end a search; chosen: p is then 0.02 or more, above the limit
_AROUND_A_STEP = (1, 2, 4)  # windows: as far as a change is refined (change_points)
_WORTH_A_LOOK = 0.005  # log of the ratio of held-out errors above which windows are counted; chosen: 0.5 %


@dataclass(frozen=True)
class _Split:
    """One fold: its columns, their products and those with the target, over training and held-out windows."""

    held: Mask  # (windows,)
    columns: Array  # (windows, columns), the target last
    own: tuple[Index, ...]  # columns of each hypothesis
    fitted: Array  # (columns, columns)
    tested: Array


@dataclass(frozen=True)
class Bench:
    """Hypotheses, the base model that they extend, and the residual that they explain."""

    model: Fitted  # refitted together with them
    candidates: tuple[Term, ...]
    runs: Runs
    target: Array  # what is to be explained, (windows,)
    block: Index
    beside: tuple[int, ...] = ()  # hypotheses that count as part of the base
    channel_error: float = 0.0  # squared error expected from errors of the channels

    def with_base(self, other: int) -> Bench:
        """The same with a hypothesis in the base, of which others may be misspecification."""
        extended = replace(self, beside=(*self.beside, other))
        for name in ("_whole", "_by_block", "_by_stretch"):
            if name in self.__dict__:  # cached values do not depend on the base
                extended.__dict__[name] = self.__dict__[name]
        return extended

    @cached_property
    def _whole(self) -> _Split:
        return self._split(np.zeros(len(self.target), np.bool_), [term.columns for term in self.candidates])

    @cached_property
    def _by_block(self) -> tuple[_Split, ...]:
        fold = self.block % FOLDS
        return tuple(self._fold(fold == number, "place") for number in range(FOLDS))

    @cached_property
    def _by_stretch(self) -> tuple[_Split, ...]:
        fold = cut_stretches(self.runs.run) % FOLDS
        return tuple(self._fold(fold == number, "time") for number in range(FOLDS))

    def _fold(self, held: Mask, axis: str) -> _Split:
        """Columns with the levels found without the held-out windows."""
        training = ~held
        columns = [term.columns for term in self.candidates]
        for searched, shares in self._searches:
            first = self.candidates[searched[0]]
            if first.axis != axis or first.schedule is None or first.load is None:
                continue
            schedules = first.hypothesis.search(
                first.schedule.axis, first.load, self.target, self.runs, training, shares
            )
            for index in searched:
                columns[index] = _as_searched(self.candidates[index], schedules, training)
        return self._split(held, columns)

    @cached_property
    def _searches(self) -> list[tuple[list[int], list[float]]]:
        """Hypotheses that share a search, as effects of one load do, and its penalties, the largest first."""
        searched_by_load: dict[tuple[bool, str, bytes], list[int]] = {}
        for index, term in enumerate(self.candidates):
            if term.schedule is not None and term.load is not None:
                key = (term.hypothesis.signed, term.axis, term.load.tobytes())
                searched_by_load.setdefault(key, []).append(index)
        searches = []
        for searched in searched_by_load.values():
            schedules = [self.candidates[index].schedule for index in searched]
            shares = {schedule.share for schedule in schedules if schedule is not None}
            searches.append((searched, sorted(shares, reverse=True)))
        return searches

    def _split(self, held: Mask, columns: Sequence[Array]) -> _Split:
        widths = [of_term.shape[1] for of_term in columns]
        ends = np.cumsum([self.model.jacobian.shape[1], *widths])
        own = tuple(np.arange(start, end) for start, end in pairwise(ends))
        design = np.column_stack([self.model.jacobian, *columns, self.target])
        held_out = design[held]
        tested = held_out.T @ held_out
        return _Split(held=held, columns=design, own=own, fitted=design.T @ design - tested, tested=tested)

    def _chosen(self, split: _Split, chosen: tuple[int, ...]) -> Index:
        """Columns of the base and of the chosen hypotheses."""
        of_model = np.arange(self.model.jacobian.shape[1])
        of_terms = [split.own[index] for index in (*self.beside, *chosen)]
        return np.concatenate([of_model, *of_terms])

    def _terms(self, chosen: tuple[int, ...]) -> list[Term]:
        """The hypotheses of the base and the chosen ones."""
        return [self.candidates[index] for index in (*self.beside, *chosen)]

    def _in_time(self, chosen: tuple[int, ...]) -> bool:
        """Whether some size changes at estimated moments: then stretches are held out."""
        return any(term.axis == "time" and term.schedule is not None for term in self._terms(chosen))

    def _splits(self, in_time: bool) -> tuple[_Split, ...]:
        return self._by_stretch if in_time else self._by_block

    def _weights(self, split: _Split, columns: Index, chosen: tuple[int, ...]) -> Array:
        """Bounded least-squares weights of these columns over the training windows."""
        terms = self._terms(chosen)
        low, high = self.model.freedom()
        lows = np.concatenate([low, *(term.low for term in terms)])
        highs = np.concatenate([high, *(term.high for term in terms)])
        return bounded(split.fitted[np.ix_(columns, columns)], split.fitted[columns, -1], lows, highs)

    def _error(self, chosen: tuple[int, ...], in_time: bool) -> float:
        """Held-out squared error of these hypotheses beside the base."""
        total = 0.0
        for split in self._splits(in_time):
            columns = self._chosen(split, chosen)
            weights = self._weights(split, columns, chosen)
            moment, gram = split.tested[columns, -1], split.tested[np.ix_(columns, columns)]
            explained = 2.0 * weights @ moment - weights @ gram @ weights
            total += max(float(split.tested[-1, -1] - explained), 0.0)
        return total

    @cached_property
    def _error_of(self) -> Callable[[tuple[int, ...], bool], float]:
        return cache(self._error)

    def share(self, *chosen: int) -> float:
        """Share of the base's held-out squared error that these hypotheses explain."""
        before, after = self.squared_error(*chosen), self._error_of(chosen, self._in_time(chosen))
        return 1.0 - after / before if before > 0.0 else 0.0

    @cached_property
    def shares(self) -> Array:
        """That of each hypothesis alone, shape (hypotheses,)."""
        return np.array([self.share(index) for index in range(len(self.candidates))])

    def squared_error(self, *chosen: int) -> float:
        """Held-out squared error of the base, on the folds that these hypotheses are tried on."""
        return self._error_of((), self._in_time(chosen))

    def score(self, share: float, independent: float, *chosen: int) -> float:
        """Reduction of BIC by these hypotheses beside the base, from held-out share and effective sample size."""
        return float(-independent * np.log(max(1.0 - share, 1e-300)) - self._freedom(chosen) * np.log(independent))

    def held_out_bic(self, *chosen: int) -> float:
        """The same, with the effective sample size of their residual."""
        share = self.share(*chosen)
        # Counting independent windows takes time: of what hardly explains anything the least number does.
        worth_a_look = -np.log(max(1.0 - share, 1e-300)) > _WORTH_A_LOOK
        independent = self.independent(*chosen) if worth_a_look else 2.0
        return self.score(share, independent, *chosen)

    def innovations_bic(self, chosen: int) -> float:
        """The same from the likelihoods of autoregressive residuals (intervention analysis: Box & Tiao, 1975): steps
        stand out from their innovations, and a drift that levels follow does not."""
        windows = len(self.target)
        gained = self._innovation(()) - self._innovation((chosen,))
        return float(windows * gained - self._freedom((chosen,)) * np.log(windows))

    def is_in_steps(self, chosen: int) -> bool:
        """Whether its size changes in steps that stand out from the innovations, unlike levels that follow a drift."""
        term = self.candidates[chosen]
        in_time = term.axis == "time" and term.schedule is not None
        return in_time and self.innovations_bic(chosen) >= thresholds.STRONG_BIC

    def delta_bic(self, chosen: int) -> float:
        """Evidence for one hypothesis: from the held-out share or, of one in steps, from the innovations if more."""
        by_share = self.held_out_bic(chosen)
        return max(by_share, self.innovations_bic(chosen)) if self.is_in_steps(chosen) else by_share

    def _freedom(self, chosen: tuple[int, ...]) -> int:
        """Parameters of these hypotheses, with those that a search has spent."""
        terms = [self.candidates[index] for index in chosen]
        return sum(term.columns.shape[1] + term.hidden for term in terms)

    @cached_property
    def _innovation(self) -> Callable[[tuple[int, ...]], float]:
        def log_square(chosen: tuple[int, ...]) -> float:
            _, (left,) = innovations(self._residual(chosen), self.runs.run)
            return float(np.log(max(float(np.mean(left**2)), 1e-300)))

        return cache(log_square)

    def independent(self, *chosen: int) -> float:
        """Effective sample size, windows, by the autocorrelation time of the residual of these hypotheses.

        The residual of a wrong model has the autocorrelation of what it lacks, and counts for less. But steps that are
        clearly above the residual are identified by the windows around them, so that only short lags count.
        """
        residual = self._residual(chosen)
        schedules = [self.candidates[index].schedule for index in chosen]
        if schedules and all(clearly_apart(schedule) for schedule in schedules):
            correlation_windows = noise_of(residual, self.runs.run, _AROUND_A_STEP).correlation
            return max(len(residual) / correlation_windows, 2.0)
        return independent_windows(residual, self.runs.run)

    def _residual(self, chosen: tuple[int, ...]) -> Array:
        """Residual of these hypotheses, shape (windows,)."""
        columns = self._chosen(self._whole, chosen)
        weights = self._weights(self._whole, columns, chosen)
        return np.asarray(self.target - self._whole.columns[:, columns] @ weights)

    @cached_property
    def _left(self) -> Array:
        """What the base leaves to be explained, shape (windows,)."""
        return self._residual(()) if self.beside else self.target

    def absorbed(self) -> dict[str, float]:
        """Share of each effect that the refit absorbs (R^2 of its columns on the refit's): the least of its forms."""
        gram, base = self._whole.fitted, np.arange(self.model.jacobian.shape[1])
        inverse = np.linalg.pinv(gram[np.ix_(base, base)], rcond=1e-10)
        shares: dict[str, float] = {}
        for own, term in zip(self._whole.own, self.candidates, strict=True):
            for column in own:
                size = float(gram[column, column])
                taken = float(gram[column, base] @ inverse @ gram[base, column])
                share = float(np.clip(taken / size, 0.0, 1.0)) if size > 0.0 else 1.0
                shares[term.effect] = min(share, shares.get(term.effect, 1.0))
        return shares

    def predictions(self, *chosen: int) -> tuple[Array, Array]:
        """Held-out predictions of the base, and with these hypotheses, shape (windows,) each."""
        without, with_it = np.empty(len(self.target)), np.empty(len(self.target))
        for split in self._splits(self._in_time(chosen)):
            without[split.held] = self._predicted(split, ())
            with_it[split.held] = self._predicted(split, chosen)
        return without, with_it

    def _predicted(self, split: _Split, chosen: tuple[int, ...]) -> Array:
        """Prediction of the held-out windows by these hypotheses beside the base."""
        columns = self._chosen(split, chosen)
        weights = self._weights(split, columns, chosen)
        return np.asarray(split.columns[np.ix_(split.held, columns)] @ weights)

    def p_value(self, chosen: int, independent: float, rng: np.random.Generator) -> float:
        """P-value: how often noise alone gives some hypothesis as high a score, a search repeated on every placebo."""
        term = self.candidates[chosen]
        if term.schedule is None:
            reached = self.score(self.share(chosen), independent, chosen)
            return float((1 + np.sum(self._best_of_noise(independent, rng) >= reached)) / (DRAWS + 1))
        reached = self._searched(term, self._left)
        scheduled = [other for other in self.candidates if other.schedule is not None]
        kinds = {(other.axis, other.hypothesis.changes) for other in scheduled}
        scores: list[float] = []
        p_value = 1.0
        for placebo in self._placebos(chosen, rng):
            scores.append(self._searched(term, placebo))
            as_good = sum(score >= reached for score in scores)
            if as_good == _AS_GOOD:
                return _AS_GOOD / len(scores)
            if len(scores) % _SEARCHES == 0:
                p_value = min(1.0, len(kinds) * _tail(np.array(scores), reached))
                close = 1.0 / _CLOSE < p_value / thresholds.FALSE_ALARM_RATE < _CLOSE
                if not close:
                    break
        return p_value

    def _best_of_noise(self, independent: float, rng: np.random.Generator) -> Array:
        """Score of the best hypothesis without a search, for residuals with random signs of blocks, shape (draws,)."""
        splits = self._by_block
        columns_of_all = splits[0].columns[:, :-1]  # without the target
        moments = per_block(columns_of_all * self._left[:, None], self.block)
        signs = rng.choice([-1.0, 1.0], (DRAWS, len(moments)))
        fold_of_block = np.arange(len(moments)) % FOLDS
        # Products of the columns with each draw, shape (draws, columns), over held-out and training blocks of a fold.
        tested = [signs[:, fold_of_block == fold] @ moments[fold_of_block == fold] for fold in range(FOLDS)]
        fitted = [signs[:, fold_of_block != fold] @ moments[fold_of_block != fold] for fold in range(FOLDS)]

        def errors(chosen: tuple[int, ...]) -> Array:
            """Held-out squared error of each draw, shape (draws,)."""
            total = np.zeros(DRAWS)
            for fold, split in enumerate(splits):
                columns = self._chosen(split, chosen)
                grid = np.ix_(columns, columns)
                weights = bounded(split.fitted[grid], fitted[fold][:, columns].T)
                added = weights * (split.tested[grid] @ weights - 2.0 * tested[fold][:, columns].T)
                total += float(np.sum(self._left[split.held] ** 2)) + added.sum(axis=0)
            return np.maximum(total, 1e-300)

        without = np.log(errors(()))
        best = np.full(DRAWS, -np.inf)
        for index, term in enumerate(self.candidates):
            if term.schedule is None and index not in self.beside:
                ratio = without - np.log(errors((index,)))
                best = np.maximum(best, independent * ratio + self.score(0.0, independent, index))
        return best

    def _placebos(self, chosen: int, rng: np.random.Generator) -> Iterator[Array]:
        """Targets under the null hypothesis, (windows,) each; blocks of one sign outlast the residual's correlation."""
        block = cut_blocks(self.runs.run, self._residual((chosen,)))
        for _ in range(_MORE * _SEARCHES):
            if self.candidates[chosen].hypothesis.is_switched:
                yield _of_same_spectrum(self._left, rng)
            else:
                yield self._left * rng.choice([-1.0, 1.0], int(block.max()) + 1)[block]

    def _searched(self, term: Term, target: Array) -> float:
        """Score of the best schedule of an effect that a search in this target finds, each fold searched by itself."""
        kind = (term.effect, term.axis)
        alike = [
            other for other in self.candidates if other.schedule is not None and (other.effect, other.axis) == kind
        ]
        small = replace(self, candidates=tuple(alike), target=target, beside=())
        scores = []
        for index in range(len(alike)):
            scores.append(small.score(small.share(index), small.independent(index), index))
            scores.append(small.innovations_bic(index))
        return max(scores)


def _tail(scores: Array, reached: float) -> float:
    """Probability of as high a score, from the exponential tail of the largest of some scores.

    >>> round(_tail(np.arange(100.0), 87.0), 2)
    0.13
    """
    start, *largest = np.sort(scores)[-_LARGEST - 1 :]
    beyond = max(reached - start, 0.0) / max(float(np.mean(largest) - start), 1e-9)
    return float(max(np.mean(scores >= reached), len(largest) / len(scores) * np.exp(-beyond), 1e-12))


def _as_searched(term: Term, found: Sequence[Schedule], chosen: Mask) -> Array:
    """Columns of the same search in the `chosen` windows: by its penalty or, where that adds nothing, a larger one.

    Of the parts of a schedule that which agrees best there.
    """
    assert term.schedule is not None and term.load is not None
    columns, level = np.zeros_like(term.columns), term.schedule.level
    alike = [schedule for schedule in found if schedule.found_by[0] >= term.schedule.share]
    if not alike:
        return columns
    parts = [schedule for schedule in alike if schedule.found_by == alike[-1].found_by]
    best = max(parts, key=lambda schedule: np.count_nonzero((schedule.level == level)[chosen]))
    at_work = best.at_work()[:, : columns.shape[1]]
    columns[:, : at_work.shape[1]] = term.load[:, None] * at_work
    return columns


def _of_same_spectrum(values: Array, rng: np.random.Generator) -> Array:
    """Phase-randomised surrogate: Gaussian noise with the same spectrum, shape (windows,).

    >>> noise = _of_same_spectrum(np.array([3.0, 1.0, -2.0, 4.0]), np.random.default_rng(0))
    >>> round(float(noise @ noise), 9)
    30.0
    """
    spectrum = np.fft.rfft(values)
    phases = np.exp(2j * np.pi * rng.random(len(spectrum)))
    phases[0] = 1.0
    if len(values) % 2 == 0:
        phases[-1] = 1.0
    return np.asarray(np.fft.irfft(spectrum * phases, len(values)))
