"""Upper limit of what a diagnosis can name: hidden effects that the recordings prove if their exact
form is known.

The exact contribution of an effect is the recordings less those of the same drives without it. It
is one regressor beside the refit and the exact contributions of the other effects, and must meet
the conditions of gain, meter and evidence. No diagnosis has more evidence.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.concealed.plants.cases import Case
from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.proof import Bench
from homeward.diagnosis.explain.residual_test import independent_blocks
from homeward.diagnosis.fit.channel_errors import meter_error, power_noise
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.logs.recordings import read_recording

# largest fitted multiple of the true contribution; chosen: so large that it limits nothing
_MOST = 10.0


def provable(case: Case) -> dict[str, bool]:
    """Whether the recordings prove each hidden effect, in power or in another channel; empty if
    that is not known."""
    if case.without is None:
        return {}
    runs = _runs(case, case.recordings)
    terms = []
    for effect in case.hidden:
        without_it = _runs(case, case.without(effect))
        if len(without_it.observed) != len(runs.observed):
            return {}  # without the effect other windows are usable
        contribution = (runs.observed - without_it.observed)[:, None]
        terms.append(
            Term(CATALOGUE[effect], contribution, np.zeros(1), np.full(1, _MOST), fixed=True)
        )
    fit = refit(runs, case.nominal)
    residual = runs.observed - fit.predicted
    block = independent_blocks(fit, runs).channels
    bench = Bench(fit, tuple(terms), runs, residual, block)
    is_provable = {}
    for index, effect in enumerate(case.hidden):
        bench_of_effect = bench
        noise = power_noise(runs)
        if len(terms) == 2:
            bench_of_effect = bench.with_base(1 - index)
            noise = 0.0
        share = bench_of_effect.share(index)
        squared_error = bench_of_effect.squared_error(index)
        smallest_share = thresholds.SMALLEST_GAIN_TO_NAME * (
            1.0 - noise / max(squared_error, 1e-300)
        )
        has_gain = share >= smallest_share and share * squared_error >= meter_error(runs)
        delta_bic = max(bench_of_effect.held_out_bic(index), bench_of_effect.innovations_bic(index))
        shows_elsewhere = case.refit_misses[effect] == 1.0  # in voltage, charge or distance
        is_provable[effect] = shows_elsewhere or (has_gain and delta_bic >= thresholds.STRONG_BIC)
    return is_provable


def _runs(case: Case, recordings: list[pd.DataFrame]) -> Runs:
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"drive{index}.parquet" for index in range(len(recordings))]
        for file, frame in zip(files, recordings, strict=True):
            frame.to_parquet(file, index=False)
        usable, _ = usable_runs([read_recording(file) for file in files], case.nominal)
    return average(usable, thresholds.SAMPLES_A_WINDOW)
