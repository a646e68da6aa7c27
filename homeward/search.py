"""A search over settings with Optuna, which continues after a kill like an uninterrupted one."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homeward.files import write_whole
from homeward.installed import advice

if TYPE_CHECKING:
    import optuna

LOG_FROM = 10.0
"""Ends of a range whose ratio is this or more are searched on a logarithmic scale: a decade, as of
learning rates."""


class SearchError(ValueError):
    """A search that cannot be made; the message says what to change."""


@dataclass(frozen=True)
class SearchRange:
    """Range to search, with both ends: integers if both ends are integers, otherwise real numbers.

    Raises:
        SearchError: The ends are not finite, or not in order.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise SearchError(
                f"{self.low:g}..{self.high:g} is no range; give LOW..HIGH with LOW below HIGH"
            )


@dataclass(frozen=True)
class Trial:
    """Settings of a trial and its score; NaN if it failed."""

    number: int
    settings: dict[str, Any]
    score: float


def search(
    space: Mapping[str, SearchRange | tuple[Any, ...]],
    trials: int,
    objective: Callable[[int, dict[str, Any]], float],
    study_file: Path,
    keep: Callable[[list[Trial]], object] = lambda done: None,
) -> list[Trial]:
    """Try settings in turn, where a tree-structured Parzen estimator expects the highest score.

    The settings of a trial depend only on its number and the earlier scores (Bergstra et al.,
    Algorithms for hyper-parameter optimization, NeurIPS 2011). Called again with an objective that
    returns the same scores, the search repeats the same trials. With an objective that keeps its
    results, it so continues after a kill.

    Args:
        space: Range or choices of each setting, by name.
        trials: How many.
        objective: Score of a trial from its number and settings, higher is better; NaN where it
            failed.
        study_file: Written after each trial: an Optuna journal, for `optuna-dashboard` and Optuna's
            plots.
        keep: Called after each trial with all that are done.

    Raises:
        SearchError: Optuna is not installed.
        OSError: The file cannot be written.
    """
    optuna = import_optuna()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(direction="maximize", study_name="homeward")
    distributions = {name: _distribution(choice) for name, choice in space.items()}
    done: list[Trial] = []
    for number in range(trials):
        study.sampler = optuna.samplers.TPESampler(seed=number)
        trial = study.ask(distributions)
        score = objective(number, dict(trial.params))
        if math.isnan(score):
            study.tell(trial, state=optuna.trial.TrialState.FAIL)
        else:
            study.tell(trial, score)
        _write_study(study, study_file)
        done.append(Trial(number, dict(trial.params), score))
        keep(done)
    return done


def import_optuna() -> Any:
    """Optuna.

    Raises:
        SearchError: It is not installed.
    """
    try:
        import optuna
    except ModuleNotFoundError as error:
        raise SearchError(f"a search needs {error.name}: {advice('sweep', 'optuna')}") from None
    return optuna


def _distribution(choice: SearchRange | tuple[Any, ...]) -> optuna.distributions.BaseDistribution:
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if not isinstance(choice, SearchRange):
        return CategoricalDistribution(choice)
    low = choice.low
    high = choice.high
    log = low > 0.0 and high >= LOG_FROM * low
    if isinstance(low, int) and isinstance(high, int):
        return IntDistribution(low, high, log=log)
    return FloatDistribution(low, high, log=log)


def _write_study(study: optuna.Study, file: Path) -> None:
    import optuna
    from optuna.storages.journal import JournalFileBackend, JournalStorage

    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / file.name
        optuna.copy_study(
            from_study_name=study.study_name,
            from_storage=study._storage,
            to_storage=JournalStorage(JournalFileBackend(str(copy))),
        )
        write_whole(file, copy.read_bytes())
