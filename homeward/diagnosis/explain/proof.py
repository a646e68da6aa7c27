"""Evidence for hypotheses: held-out error by cross-validation, BIC, and p-values by placebo tests.

Each is fitted beside the refit. Levels of a schedule are searched anew in every fold, on its
training windows. Where an effect changes in time, stretches of a few windows are held out, as the
windows around them determine its level; elsewhere whole blocks are.

Hypotheses without a search are all tried on placebos, residuals whose blocks have random signs,
which keeps autocorrelation and heteroscedasticity (wild cluster bootstrap: Cameron, Gelbach &
Miller, 2008), and the largest score counts (Westfall & Young, 1993). A search is repeated on every
placebo, until some score as high (Besag & Clifford, 1991): also on random signs of blocks or, for
repeated changes, on surrogates, Gaussian noise of the same spectrum (Theiler et al., 1992), which
has no levels. The p-value comes from the exponential tail of their scores (Winkler et al., 2016),
times the number of kinds of searches: those of one kind differ only in the load.
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
from homeward.diagnosis.fit.bounded import bounded
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.folds import FOLDS, cut_blocks, cut_stretches, per_block
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.autocorrelation import independent_windows, innovations, noise_of
from homeward.logs.channels import Array, Index, Mask

DRAWS = 1999
"""Residuals with random signs: the least p-value is then 0.0005, a twentieth of
FALSE_ALARM_RATE."""
_SEARCHES = 39
_LARGEST = 10  # a quarter of the scores, whose mean estimates the tail within a third
_MORE = 4  # times as many searches where p is close to the limit; chosen
_CLOSE = 10.0  # within this factor of the limit; chosen
# placebos with as high a score that end a search; chosen: p is then 0.02 or more, above the limit
_AS_GOOD = 3
_AROUND_A_STEP = (1, 2, 4)  # windows: as far as a change is refined (change_points)
# log of the ratio of held-out errors above which windows are counted; chosen: 0.5 %
_WORTH_A_LOOK = 0.005


@dataclass(frozen=True)
class _Split:
    """One fold: its columns, their products and those with the target, over training and held-out
    windows."""

    held_out: Mask  # (windows,)
    design: Array  # (windows, columns), the target last
    columns_of: tuple[Index, ...]  # columns of each hypothesis
    training_gram: Array  # (columns, columns)
    held_out_gram: Array


@dataclass(frozen=True)
class Bench:
    """Hypotheses, the base model that they extend, and the residual that they explain.

    A hypothesis is given by its index among the `candidates`.
    """

    model: Fitted  # refitted together with them
    candidates: tuple[Term, ...]
    runs: Runs
    target: Array  # what is to be explained, (windows,)
    block: Index
    in_base: tuple[int, ...] = ()  # hypotheses that count as part of the base
    channel_error: float = 0.0  # squared error expected from errors of the channels

    def with_base(self, index: int) -> Bench:
        """The same with a hypothesis in the base, of which others may be misspecification."""
        extended = replace(self, in_base=(*self.in_base, index))
        for name in ("_whole", "_by_block", "_by_stretch"):
            if name in self.__dict__:  # cached values do not depend on the base
                extended.__dict__[name] = self.__dict__[name]
        return extended

    @cached_property
    def _whole(self) -> _Split:
        nothing_held_out = np.zeros(len(self.target), np.bool_)
        return self._split(nothing_held_out, [term.columns for term in self.candidates])

    @cached_property
    def _by_block(self) -> tuple[_Split, ...]:
        fold = self.block % FOLDS
        return tuple(self._fold(fold == number, "place") for number in range(FOLDS))

    @cached_property
    def _by_stretch(self) -> tuple[_Split, ...]:
        fold = cut_stretches(self.runs.run) % FOLDS
        return tuple(self._fold(fold == number, "time") for number in range(FOLDS))

    def _fold(self, held_out: Mask, axis: str) -> _Split:
        """Columns with the levels found without the held-out windows."""
        training = ~held_out
        columns = [term.columns for term in self.candidates]
        for searched, shares in self._searches:
            term = self.candidates[searched[0]]
            if term.axis != axis or term.schedule is None or term.load is None:
                continue
            schedules = term.hypothesis.search(
                term.schedule.axis, term.load, self.target, self.runs, training, shares
            )
            for index in searched:
                columns[index] = _as_searched(self.candidates[index], schedules, training)
        return self._split(held_out, columns)

    @cached_property
    def _searches(self) -> list[tuple[list[int], list[float]]]:
        """Hypotheses that share a search, as effects of one load do, and its penalties, the largest
        first."""
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

    def _split(self, held_out: Mask, columns: Sequence[Array]) -> _Split:
        widths = [columns_of_term.shape[1] for columns_of_term in columns]
        ends = np.cumsum([self.model.jacobian.shape[1], *widths])
        columns_of = tuple(np.arange(start, end) for start, end in pairwise(ends))
        design = np.column_stack([self.model.jacobian, *columns, self.target])
        held_out_rows = design[held_out]
        held_out_gram = held_out_rows.T @ held_out_rows
        return _Split(
            held_out=held_out,
            design=design,
            columns_of=columns_of,
            training_gram=design.T @ design - held_out_gram,
            held_out_gram=held_out_gram,
        )

    def _columns(self, split: _Split, indices: tuple[int, ...]) -> Index:
        """Columns of the base and of these hypotheses."""
        of_model = np.arange(self.model.jacobian.shape[1])
        of_terms = [split.columns_of[index] for index in (*self.in_base, *indices)]
        return np.concatenate([of_model, *of_terms])

    def _terms(self, indices: tuple[int, ...]) -> list[Term]:
        """The hypotheses of the base and these."""
        return [self.candidates[index] for index in (*self.in_base, *indices)]

    def _in_time(self, indices: tuple[int, ...]) -> bool:
        """Whether some size changes at estimated moments: then stretches are held out."""
        return any(
            term.axis == "time" and term.schedule is not None for term in self._terms(indices)
        )

    def _splits(self, in_time: bool) -> tuple[_Split, ...]:
        return self._by_stretch if in_time else self._by_block

    def _weights(self, split: _Split, columns: Index, indices: tuple[int, ...]) -> Array:
        """Bounded least-squares weights of these columns over the training windows."""
        terms = self._terms(indices)
        low, high = self.model.freedom()
        lows = np.concatenate([low, *(term.low for term in terms)])
        highs = np.concatenate([high, *(term.high for term in terms)])
        gram = split.training_gram[np.ix_(columns, columns)]
        moment = split.training_gram[columns, -1]
        return bounded(gram, moment, lows, highs)

    def _error(self, indices: tuple[int, ...], in_time: bool) -> float:
        """Held-out squared error of these hypotheses beside the base."""
        total = 0.0
        for split in self._splits(in_time):
            columns = self._columns(split, indices)
            weights = self._weights(split, columns, indices)
            moment = split.held_out_gram[columns, -1]
            gram = split.held_out_gram[np.ix_(columns, columns)]
            explained = 2.0 * weights @ moment - weights @ gram @ weights
            total += max(float(split.held_out_gram[-1, -1] - explained), 0.0)
        return total

    @cached_property
    def _error_of(self) -> Callable[[tuple[int, ...], bool], float]:
        return cache(self._error)

    def share(self, *indices: int) -> float:
        """Share of the base's held-out squared error that these hypotheses explain."""
        error_of_base = self.squared_error(*indices)
        error = self._error_of(indices, self._in_time(indices))
        if error_of_base > 0.0:
            return 1.0 - error / error_of_base
        return 0.0

    @cached_property
    def shares(self) -> Array:
        """That of each hypothesis alone, shape (hypotheses,)."""
        return np.array([self.share(index) for index in range(len(self.candidates))])

    def squared_error(self, *indices: int) -> float:
        """Held-out squared error of the base, on the folds that these hypotheses are tried on."""
        return self._error_of((), self._in_time(indices))

    def score(self, share: float, independent: float, *indices: int) -> float:
        """Reduction of BIC by these hypotheses beside the base, from held-out share and effective
        sample size."""
        misfit = -independent * np.log(max(1.0 - share, 1e-300))
        return float(misfit - self._freedom(indices) * np.log(independent))

    def held_out_bic(self, *indices: int) -> float:
        """The same, with the effective sample size of their residual."""
        share = self.share(*indices)
        # Counting independent windows takes time: of what hardly explains anything the least number
        # does.
        worth_a_look = -np.log(max(1.0 - share, 1e-300)) > _WORTH_A_LOOK
        independent = self.independent(*indices) if worth_a_look else 2.0
        return self.score(share, independent, *indices)

    def innovations_bic(self, index: int) -> float:
        """The same from the likelihoods of autoregressive residuals (intervention analysis: Box &
        Tiao, 1975): steps stand out from their innovations, and a drift that levels follow does
        not."""
        windows = len(self.target)
        gained = self._innovation(()) - self._innovation((index,))
        return float(windows * gained - self._freedom((index,)) * np.log(windows))

    def is_in_steps(self, index: int) -> bool:
        """Whether its size changes in steps that stand out from the innovations, unlike levels that
        follow a drift."""
        term = self.candidates[index]
        if term.axis != "time" or term.schedule is None:
            return False
        return self.innovations_bic(index) >= thresholds.STRONG_BIC

    def delta_bic(self, index: int) -> float:
        """Evidence for one hypothesis: from the held-out share or, of one in steps, from the
        innovations if more."""
        by_share = self.held_out_bic(index)
        if self.is_in_steps(index):
            return max(by_share, self.innovations_bic(index))
        return by_share

    def _freedom(self, indices: tuple[int, ...]) -> int:
        """Parameters of these hypotheses, with those that a search has spent."""
        terms = [self.candidates[index] for index in indices]
        return sum(term.columns.shape[1] + term.hidden for term in terms)

    @cached_property
    def _innovation(self) -> Callable[[tuple[int, ...]], float]:
        def log_mean_square(indices: tuple[int, ...]) -> float:
            _, (innovation,) = innovations(self._residual(indices), self.runs.run)
            return float(np.log(max(float(np.mean(innovation**2)), 1e-300)))

        return cache(log_mean_square)

    def independent(self, *indices: int) -> float:
        """Effective sample size, windows, by the autocorrelation time of the residual of these
        hypotheses.

        The residual of a wrong model has the autocorrelation of what it lacks, and counts for less.
        But steps that are clearly above the residual are identified by the windows around them, so
        that only short lags count.
        """
        residual = self._residual(indices)
        schedules = [self.candidates[index].schedule for index in indices]
        if schedules and all(clearly_apart(schedule) for schedule in schedules):
            correlation_windows = noise_of(residual, self.runs.run, _AROUND_A_STEP).correlation
            return max(len(residual) / correlation_windows, 2.0)
        return independent_windows(residual, self.runs.run)

    def _residual(self, indices: tuple[int, ...]) -> Array:
        """Residual of these hypotheses, shape (windows,)."""
        columns = self._columns(self._whole, indices)
        weights = self._weights(self._whole, columns, indices)
        return np.asarray(self.target - self._whole.design[:, columns] @ weights)

    @cached_property
    def _unexplained(self) -> Array:
        """What the base leaves to be explained, shape (windows,)."""
        return self._residual(()) if self.in_base else self.target

    def absorbed(self) -> dict[str, float]:
        """Share of each effect that the refit absorbs (R^2 of its columns on the refit's): the
        least of its forms."""
        gram = self._whole.training_gram
        base = np.arange(self.model.jacobian.shape[1])
        # Groups that are held have columns of zeros.
        inverse = np.linalg.pinv(gram[np.ix_(base, base)], rcond=1e-10)
        shares: dict[str, float] = {}
        for columns, term in zip(self._whole.columns_of, self.candidates, strict=True):
            for column in columns:
                square = float(gram[column, column])
                absorbed = float(gram[column, base] @ inverse @ gram[base, column])
                share = float(np.clip(absorbed / square, 0.0, 1.0)) if square > 0.0 else 1.0
                shares[term.effect] = min(share, shares.get(term.effect, 1.0))
        return shares

    def p_value(self, index: int, independent: float, rng: np.random.Generator) -> float:
        """P-value: how often noise alone gives some hypothesis as high a score, a search repeated
        on every placebo."""
        term = self.candidates[index]
        if term.schedule is None:
            reached = self.score(self.share(index), independent, index)
            as_good = np.sum(self._best_of_noise(independent, rng) >= reached)
            return float((1 + as_good) / (DRAWS + 1))  # the recording is one of the draws
        return self._p_value_of_search(index, term, rng)

    def _p_value_of_search(self, index: int, term: Term, rng: np.random.Generator) -> float:
        """P-value of a schedule, by placebos: as many as it takes to tell it from the limit."""
        reached = self._score_of_search(term, self._unexplained)
        scheduled = [candidate for candidate in self.candidates if candidate.schedule is not None]
        # Searches of one kind differ only in the load.
        kinds = {(candidate.axis, candidate.hypothesis.changes) for candidate in scheduled}
        scores: list[float] = []
        p_value = 1.0
        for placebo in self._placebos(index, rng):
            scores.append(self._score_of_search(term, placebo))
            as_good = sum(score >= reached for score in scores)
            # It ends early where noise scores as high again and again: such an effect is not named.
            if as_good == _AS_GOOD:
                return _AS_GOOD / len(scores)
            if len(scores) % _SEARCHES == 0:
                p_value = min(1.0, len(kinds) * _tail(np.array(scores), reached))
                is_close = 1.0 / _CLOSE < p_value / thresholds.FALSE_ALARM_RATE < _CLOSE
                if not is_close:
                    break
        return p_value

    def _best_of_noise(self, independent: float, rng: np.random.Generator) -> Array:
        """Score of the best hypothesis without a search, for residuals with random signs of blocks,
        shape (draws,)."""
        splits = self._by_block
        design = splits[0].design[:, :-1]  # without the target
        moments = per_block(design * self._unexplained[:, None], self.block)
        signs = rng.choice([-1.0, 1.0], (DRAWS, len(moments)))
        fold_of_block = np.arange(len(moments)) % FOLDS
        # Products of the columns with each draw, shape (draws, columns), over training and held-out
        # blocks of a fold.
        training = []
        held_out = []
        for fold in range(FOLDS):
            is_held_out = fold_of_block == fold
            training.append(signs[:, ~is_held_out] @ moments[~is_held_out])
            held_out.append(signs[:, is_held_out] @ moments[is_held_out])

        def errors(indices: tuple[int, ...]) -> Array:
            """Held-out squared error of each draw, shape (draws,)."""
            total = np.zeros(DRAWS)
            for fold, split in enumerate(splits):
                columns = self._columns(split, indices)
                grid = np.ix_(columns, columns)
                # Without bounds, and so for all draws at once.
                weights = bounded(split.training_gram[grid], training[fold][:, columns].T)
                moment = held_out[fold][:, columns].T
                change = weights * (split.held_out_gram[grid] @ weights - 2.0 * moment)
                # Signs leave the square of the target as it is.
                square_of_target = float(np.sum(self._unexplained[split.held_out] ** 2))
                total += square_of_target + change.sum(axis=0)
            return np.maximum(total, 1e-300)

        log_error_of_base = np.log(errors(()))
        highest = np.full(DRAWS, -np.inf)
        for index, term in enumerate(self.candidates):
            if term.schedule is None and index not in self.in_base:
                log_ratio = log_error_of_base - np.log(errors((index,)))
                highest = np.maximum(
                    highest, independent * log_ratio + self.score(0.0, independent, index)
                )
        return highest

    def _placebos(self, index: int, rng: np.random.Generator) -> Iterator[Array]:
        """Targets under the null hypothesis, (windows,) each; blocks of one sign outlast the
        residual's correlation."""
        block = cut_blocks(self.runs.run, self._residual((index,)))
        blocks = int(block.max()) + 1
        for _ in range(_MORE * _SEARCHES):
            if self.candidates[index].hypothesis.is_switched:
                yield _of_same_spectrum(self._unexplained, rng)
            else:
                signs = rng.choice([-1.0, 1.0], blocks)
                yield self._unexplained * signs[block]

    def _score_of_search(self, term: Term, target: Array) -> float:
        """Score of the best schedule of an effect that a search in this target finds, each fold
        searched by itself."""
        schedules_of_effect = tuple(
            candidate
            for candidate in self.candidates
            if candidate.schedule is not None
            and (candidate.effect, candidate.axis) == (term.effect, term.axis)
        )
        # A copy has no cached splits, so that each fold is searched in this target.
        search = replace(self, candidates=schedules_of_effect, target=target, in_base=())
        scores = []
        for index in range(len(schedules_of_effect)):
            scores.append(search.score(search.share(index), search.independent(index), index))
            scores.append(search.innovations_bic(index))
        return max(scores)


def _tail(scores: Array, reached: float) -> float:
    """Probability of as high a score, from the exponential tail of the largest of some scores.

    >>> round(_tail(np.arange(100.0), 87.0), 2)
    0.13
    """
    # Beyond the score below the largest ones, their mean excess is that of an exponential
    # distribution.
    start, *largest = np.sort(scores)[-_LARGEST - 1 :]
    beyond = max(reached - start, 0.0) / max(float(np.mean(largest) - start), 1e-9)
    return float(
        max(np.mean(scores >= reached), len(largest) / len(scores) * np.exp(-beyond), 1e-12)
    )


def _as_searched(term: Term, schedules: Sequence[Schedule], training: Mask) -> Array:
    """Columns of the same search in the training windows: by its penalty or, where that adds
    nothing, a larger one.

    Of the parts of a schedule that which agrees best there.
    """
    assert term.schedule is not None and term.load is not None
    columns = np.zeros_like(term.columns)
    as_penalised = [
        schedule for schedule in schedules if schedule.found_by[0] >= term.schedule.share
    ]
    if not as_penalised:
        return columns
    level = term.schedule.level
    parts = [
        schedule for schedule in as_penalised if schedule.found_by == as_penalised[-1].found_by
    ]
    closest = max(parts, key=lambda schedule: np.count_nonzero((schedule.level == level)[training]))
    at_work = closest.at_work()[:, : columns.shape[1]]
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
    # The mean and, of an even number of values, the highest frequency are real.
    phases[0] = 1.0
    if len(values) % 2 == 0:
        phases[-1] = 1.0
    return np.asarray(np.fft.irfft(spectrum * phases, len(values)))
