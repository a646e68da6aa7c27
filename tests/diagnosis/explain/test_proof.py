"""What a search finds in noise it finds again in every placebo, and predicts nothing of what was
held out."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.explain.catalogue import terms
from homeward.diagnosis.explain.hypothesis import Setting
from homeward.diagnosis.explain.proof import Bench
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.refit import Refit, refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.thresholds import FALSE_ALARM_RATE
from tests.diagnosis.made_up import autoregressive

Drive = Callable[..., list[Recording]]
FALSE_ALARMS = 0.1


@pytest.fixture(scope="module")
def fit(drive: Drive, husky: Robot) -> tuple[Refit, Runs]:
    runs = average(usable_runs(drive(husky, minutes=4.0), husky)[0])
    return refit(runs, husky), runs


def bench_of(fit: tuple[Refit, Runs], residual: np.ndarray, only: str = "") -> Bench:
    """Hypotheses on a residual of one's own."""
    refitted, runs = fit
    found = [one for one in terms(Setting.of(refitted, runs, residual)) if only in ("", one.axis)]
    return Bench(refitted, tuple(found), runs, residual, cut_blocks(runs.run, residual))


def slow_noise(fit: tuple[Refit, Runs], seed: int, kept: float = 0.8) -> np.ndarray:
    return autoregressive(kept, len(fit[1].observed), seed)


def best(bench: Bench) -> tuple[int, float]:
    """The hypothesis that explains most for its freedom, and the number of independent windows."""
    shares = [bench.share(index) for index in range(len(bench.candidates))]
    independent = bench.independent(int(np.argmax(shares)))
    scores = [bench.score(share, independent, index) for index, share in enumerate(shares)]
    return int(np.argmax(scores)), independent


def test_the_best_of_all_recorded_causes_is_rarely_significant_in_noise(
    fit: tuple[Refit, Runs],
) -> None:
    p_values = []
    for seed in range(12):
        bench = bench_of(fit, slow_noise(fit, seed), "steady")
        p_values.append(bench.p_value(*best(bench), np.random.default_rng(seed)))
    assert np.mean(np.array(p_values) <= FALSE_ALARMS) <= 2.5 * FALSE_ALARMS
    assert np.median(p_values) > 0.2


def test_levels_found_in_noise_are_found_in_placebos_too(fit: tuple[Refit, Runs]) -> None:
    p_values = []
    for seed in range(8):
        bench = bench_of(fit, slow_noise(fit, seed, 0.95), "time")
        p_values.append(bench.p_value(*best(bench), np.random.default_rng(seed)))
    assert np.sum(np.array(p_values) <= FALSE_ALARM_RATE) <= 1
    assert np.median(p_values) > 0.1


def test_spikes_are_levels_of_nothing(fit: tuple[Refit, Runs]) -> None:
    """Eight spikes of one window in each run: the windows beside them know nothing of them."""
    rng = np.random.default_rng(0)
    runs = fit[1]
    residual = rng.standard_normal(len(runs.observed))
    for run in range(3):
        residual[rng.choice(np.flatnonzero(runs.run == run), 8, replace=False)] += 60.0
    bench = bench_of(fit, residual, "time")
    assert bench.candidates
    assert max(bench.share(index) for index in range(len(bench.candidates))) < 0.02


def test_a_step_and_a_load_that_comes_and_goes_are_beyond_chance(fit: tuple[Refit, Runs]) -> None:
    runs = fit[1]
    noise = slow_noise(fit, 0)
    step = bench_of(fit, noise + 4.0 * (runs.time_s > 125.0), "time")
    telegraph = bench_of(fit, noise + 6.0 * (np.floor(runs.time_s / 37.0) % 2), "time")
    for bench, effect in ((step, "standby"), (telegraph, "intermittent_load")):
        _, independent = best(bench)
        chosen = max(
            (
                index
                for index, one in enumerate(bench.candidates)
                if one.effect == effect and one.schedule
            ),
            key=bench.share,
        )
        assert bench.share(chosen) > 0.3
        assert bench.p_value(chosen, independent, np.random.default_rng(0)) < 1e-4


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_steps_stand_out_from_a_drift_and_levels_that_follow_the_drift_do_not(
    fit: tuple[Refit, Runs], noise: float
) -> None:
    def evidence(residual: np.ndarray) -> list[tuple[str, float]]:
        bench = bench_of(fit, residual, "time")
        followed = [
            index
            for index, one in enumerate(bench.candidates)
            if one.schedule and bench.share(index) > 0.2
        ]
        return [
            (bench.candidates[index].effect, bench.innovations_bic(index)) for index in followed
        ]

    runs = fit[1]
    drift = slow_noise(fit, 0, 0.97) + noise * np.random.default_rng(0).standard_normal(
        len(runs.observed)
    )
    of_drift = evidence(drift)
    of_steps = evidence(drift + 12.0 * (np.floor(runs.time_s / 37.0) % 2))
    assert of_drift
    assert max(bic for _, bic in of_drift) < 0.0
    assert max(bic for effect, bic in of_steps if effect == "intermittent_load") > 10.0


def test_hypotheses_of_one_load_with_one_schedule_explain_as_much_of_what_was_held_out(
    drive: Drive, husky: Robot
) -> None:
    """Levels that several penalties find are searched in each fold too, whichever of them a
    hypothesis has."""
    recordings = drive(husky, minutes=4.0, effects={"inertia": {"mass_factor": 1.5}})
    runs = average(usable_runs(recordings, husky)[0])
    on = runs.time_s > 100.0 + 50.0 * (runs.run == 0)
    runs = dataclasses.replace(runs, observed=runs.observed + 25.0 * on)
    refitted = refit(runs, husky)
    bench = bench_of((refitted, runs), runs.observed - refitted.predicted, "time")
    shares = {
        one.effect: bench.share(index)
        for index, one in enumerate(bench.candidates)
        if one.schedule is not None
        and one.schedule.levels == 2
        and np.mean((one.schedule.level > 0) == on) > 0.98
    }
    assert shares["standby"] == pytest.approx(shares["sensor_offset"], abs=0.02)


def test_a_base_that_holds_a_hypothesis_leaves_nothing_for_it(fit: tuple[Refit, Runs]) -> None:
    bench = bench_of(fit, slow_noise(fit, 1), "steady")
    turning = next(index for index, one in enumerate(bench.candidates) if one.effect == "turning")
    column = bench.candidates[turning].columns[:, 0]
    bench = dataclasses.replace(bench, target=bench.target + 10.0 * column / np.std(column))
    assert bench.share(turning) > 0.5
    assert abs(bench.with_base(turning).share(turning)) < 0.01
