"""Accuracy of the estimated energy of the way home, with robot and wind estimated: tables of
docs/results.md.

`python benchmarks/agents/identification.py` drives missions out for some decisions, gets the
distribution of the energy of the way home from two estimators, and drives home to measure it, as a
share of a full battery. The estimators are `belief`, from `homeward.agents.belief`, and `ratio`,
from `dmax_adaptive`, which scales the map by measured over modelled consumption. After the estimate
the battery gets more energy than the way home can consume, so that missions that would strand count
as well.
"""

from __future__ import annotations

import itertools
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.special import ndtr

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.tables import rate, span, table
from homeward import cli
from homeward.agents.base import Observations, feature
from homeward.agents.belief import Belief
from homeward.agents.evaluation import episode_seeds
from homeward.agents.evaluation.statistics import Bootstrap, interval
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.pace import NO_SENSING
from homeward.agents.thresholds import MISSED
from homeward.envs.actions import decode_actions, encode_actions
from homeward.envs.batch import Batch
from homeward.envs.conditions.instruments import InstrumentError
from homeward.envs.options import OptionError, Options
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv
from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH

Array = NDArray[np.float64]
RISK = 1e-3
"""Probability with which the margin should be below the quantile that is counted."""
COVERED = 0.9
"""Probability of the central interval whose coverage is counted."""
_BATTERIES = 9.0
"""Full batteries that the way home is driven with beside what is left."""


@dataclass(frozen=True)
class Args:
    """What to drive."""

    difficulties: tuple[str, ...] = ("uncertain", "harsh")
    """Difficulties."""
    instruments: str | None = None
    """exact, meter, gauge or a TOML file; by default those of the difficulty."""
    weather: str | None = None
    """still or changing; by default that of the difficulty."""
    decisions: tuple[int, ...] = (15, 30, 45)
    """Decisions of the way out."""
    missions: int = 2000
    """Missions of each."""
    seed: int = 0
    """Seed of the missions, as in evaluate.py."""


class Mixture(NamedTuple):
    """A mixture of normal distributions for each mission, arrays of shape (missions,
    components)."""

    weight: Array
    mean: Array
    sd: Array

    @property
    def expected(self) -> Array:
        """Its mean, shape (missions,)."""
        return np.asarray(np.einsum("nk,nk->n", self.weight, self.mean))

    def cdf(self, values: Array) -> Array:
        """Probability of less than a value, shape (missions,)."""
        z = (values[:, None] - self.mean) / self.sd
        return np.asarray(np.einsum("nk,nk->n", self.weight, ndtr(z)))

    def crps(self, values: Array) -> Array:
        """Continuous ranked probability score of a value, shape (missions,).

        Source: Grimit, Gneiting, Berrocal, Johnson, Q. J. R. Meteorol. Soc. 132, 2006, Eq. 4: the
        closed form of E|X - y| - E|X - X'| / 2.
        """
        apart = _expected_absolute(values[:, None] - self.mean, self.sd)
        between = _expected_absolute(
            self.mean[:, :, None] - self.mean[:, None, :],
            np.hypot(self.sd[:, :, None], self.sd[:, None, :]),
        )
        spread = np.einsum("nk,nl,nkl->n", self.weight, self.weight, between)
        return np.asarray(np.einsum("nk,nk->n", self.weight, apart) - 0.5 * spread)


def _expected_absolute(mean: Array, sd: Array) -> Array:
    """Mean of the absolute value of a normal variable."""
    z = mean / sd
    density = np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    return np.asarray(2.0 * sd * density + mean * (2.0 * ndtr(z) - 1.0))


@dataclass(frozen=True)
class Forecasts:
    """Estimated and measured energies of the missions that came home; shares are of a full battery.

    Attributes:
        forecasts: Distribution of the energy of the way home, as a share, by estimator.
        home_share: Measured energy of the way home, shape (missions,).
        wind_mps: Distance of the estimated wind from the true wind, shape (missions,).
        below: Whether the margin was below its quantile, shape (missions,).
        update_us: Mean time of an update of one mission, microseconds.
    """

    forecasts: dict[str, Mixture]
    home_share: Array
    wind_mps: Array
    below: NDArray[np.bool_]
    update_us: float


def drive(options: Options, seeds: list[int], count: int) -> Forecasts:
    """Drive out for some decisions with the planner's excitation steps, estimate the way home, and
    drive home.

    Args:
        options: Keyword arguments of the environment.
        seeds: Seed of each mission.
        count: Decisions of the way out.
    """
    env = HomewardVectorEnv(len(seeds), autoreset_mode="Disabled", **vars(options))
    batch = env.batch
    m = env.batch.records
    observations, _ = env.reset(seed=seeds)
    belief = Belief(batch.known, MISSED)
    ratio = AdaptiveDmaxRule(batch.known, NO_SENSING, 0.0)
    begun = np.ones(len(seeds), np.bool_)
    update_s = 0.0
    cruise_mps = batch.known.shared["cruise_mps"][0]
    out_action = encode_actions(batch.known, cruise_mps, 0.0, GO)
    home_action = encode_actions(batch.known, cruise_mps, 0.0, RETURN)
    for decision in range(count + 1):
        start = time.perf_counter()
        belief.learn(observations, begun)
        if decision:  # the first one may compile kernels
            update_s += time.perf_counter() - start
        outlook = ratio.look(observations, begun)
        begun = np.zeros(len(seeds), np.bool_)
        if decision < count:
            actions = np.repeat(out_action, len(seeds), axis=0)
            actions[belief.looks_back(observations)] = belief.back_action
            _step(batch, actions, observations)
    plans = belief.plans(observations, float(decode_actions(batch.known, home_action).speed_mps[0]))
    low_j = belief.margin(plans, RISK).total["margin_low_j"]
    home_cost = feature(observations, "home_cost")
    deviation = outlook.deviation * home_cost / (home_cost + ratio.cost_of_going_on(observations))
    forecasts = {
        "belief": way_home(belief, plans),
        "ratio": Mixture(
            np.ones((len(seeds), 1)), outlook.home[:, None], np.maximum(deviation, 1e-9)[:, None]
        ),
    }
    wind_mps = _wind_error_mps(batch, belief)
    left_j = m["energy_j"].copy()
    full_j = m["capacity_j"].copy()
    alive = ~m["over"]
    top_up(batch)
    used_j = m["ledger_j"].sum(axis=1)
    while not m["over"].all():
        _step(batch, np.repeat(home_action, len(seeds), axis=0), observations)
    used_j = m["ledger_j"].sum(axis=1) - used_j
    home = m["home"] & alive
    is_below = m["meter_gain"] * (left_j - used_j) < low_j
    return Forecasts(
        forecasts={
            name: Mixture(*(part[home] for part in forecast))
            for name, forecast in forecasts.items()
        },
        home_share=(used_j / full_j)[home],
        wind_mps=wind_mps[home],
        below=is_below[home],
        update_us=1e6 * update_s / (count * len(seeds)),
    )


def _step(batch: Batch, actions: NDArray[np.int64], observations: Observations) -> None:
    ended = np.empty((2, batch.count), np.bool_)
    batch.step(actions, observations, np.empty(batch.count), *ended)


def top_up(batch: Batch) -> None:
    """Give missions more energy than any way home consumes; descents regenerate as much as
    before."""
    m = batch.records
    more_j = _BATTERIES * m["capacity_j"]
    m["energy_j"] += more_j
    m["capacity_j"] += more_j


def way_home(belief: Belief, plans: NDArray[np.void]) -> Mixture:
    """Distribution of the energy of plans, as a share of a full battery: a component for each
    hypothesis of the wind.

    Args:
        belief: Estimates of robot and wind.
        plans: `homeward.estimation.PLAN_DTYPE`, shape (missions,).
    """
    hypotheses = belief.estimator.state["hypotheses"]
    log_weight = hypotheses["log_weight"].copy()
    count = log_weight.shape[1]
    means = []
    deviations = []
    for number in range(count):
        # As if this hypothesis were the only one.
        hypotheses["log_weight"] = np.where(np.arange(count) == number, 0.0, -np.inf)
        total = belief.margin(plans, RISK).total
        means.append(total["cost_share"].copy())
        deviations.append(np.maximum(total["cost_share_sd"], 1e-9))
    hypotheses["log_weight"] = log_weight
    return Mixture(np.exp(log_weight), np.stack(means, axis=-1), np.stack(deviations, axis=-1))


def _wind_error_mps(batch: Batch, belief: Belief) -> Array:
    m = batch.records
    mean = belief.estimate().mean
    east_mps = mean[:, EAST] + mean[:, GUST_EAST] - m["mean_east_mps"] - m["gust_east_mps"]
    north_mps = mean[:, NORTH] + mean[:, GUST_NORTH] - m["mean_north_mps"] - m["gust_north_mps"]
    return np.asarray(np.hypot(east_mps, north_mps))


def main(args: Args) -> None:
    """Drive and print.

    Raises:
        OptionError, InstrumentError: An argument cannot be used.
    """
    if args.missions < 2 or args.seed < 0 or any(count < 1 for count in args.decisions):
        raise OptionError(
            "give at least 2 --missions, a --seed of 0 or more and --decisions of 1 or more"
        )
    seeds = episode_seeds(args.seed, args.missions)
    drawn = (
        f"{args.missions} missions, episode_seeds({args.seed}, {args.missions})\n"
        f"instruments {args.instruments or 'of the difficulty'}, weather {args.weather or 'of the difficulty'}"
    )
    ways = table(
        f"Way home, % of a full battery, {drawn}", ("difficulty", "decisions out", "by"),
        ("median, 95th pct. of |error|", "bias", f"in {COVERED:.0%} interval (95 %)", "CRPS", "belief / ratio (95 %)"),
    )  # fmt: skip
    wind_and_margin = table(
        f"Wind and margin by the belief, {drawn}", ("difficulty", "decisions out"),
        ("|wind error|, m/s", f"margin below {RISK:g} quantile (95 %)", "us per update"),
    )  # fmt: skip
    for difficulty, count in itertools.product(args.difficulties, args.decisions):
        options = Options(
            "OutAndBack", difficulty=difficulty, instruments=args.instruments, weather=args.weather
        )
        forecasts = drive(options, seeds, count)
        _add_ways(ways, difficulty, count, forecasts, args.seed)
        wind_mps = _absolute(forecasts.wind_mps, "{:.2f}")
        below = _rate(forecasts.below)
        wind_and_margin.add_row(
            difficulty, str(count), wind_mps, below, f"{forecasts.update_us:.1f}"
        )
    console = Console(width=140)
    console.print(ways)
    console.print(wind_and_margin)
    console.print(
        "Errors are forecasts minus what came; rates and ratios with 95 % intervals.",
        highlight=False,
    )


def _add_ways(ways: Table, difficulty: str, count: int, forecasts: Forecasts, seed: int) -> None:
    crps = {
        name: forecast.crps(forecasts.home_share) for name, forecast in forecasts.forecasts.items()
    }
    means = Bootstrap(
        {name: scores[None] for name, scores in crps.items()}, np.random.default_rng(seed)
    ).means()
    ratio = span(
        crps["belief"].mean() / crps["ratio"].mean(),
        interval(means["belief"] / means["ratio"]),
        ".3f",
    )
    for name, forecast in forecasts.forecasts.items():
        error = forecast.expected - forecasts.home_share
        ways.add_row(
            difficulty, str(count), name, _absolute(100.0 * error, "{:.3f}"), f"{100.0 * error.mean():+.4f}",
            _rate(covered(forecast, forecasts.home_share)), f"{100.0 * crps[name].mean():.4f}",
            ratio if name == "belief" else "",
        )  # fmt: skip


def covered(forecast: Mixture, values: Array) -> NDArray[np.bool_]:
    """Which values are in the central interval, shape (missions,)."""
    return np.asarray(np.abs(forecast.cdf(values) - 0.5) <= 0.5 * COVERED)


def _absolute(errors: Array, style: str) -> str:
    return ", ".join(
        style.format(quantile) for quantile in np.quantile(np.abs(errors), (0.5, 0.95))
    )


def _rate(happened: NDArray[np.bool_]) -> str:
    return rate(int(happened.sum()), len(happened))


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, InstrumentError)))
