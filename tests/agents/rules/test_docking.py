"""Docks for the rules: they charge where it pays, and come home."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from homeward.agents import make_policy
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.rules.docking import Docking, Energies
from homeward.envs.features import INDEX, names_of
from homeward.envs.options import Options, known_of
from homeward.envs.vector import HomewardVectorEnv
from tests.agents.rules.shown import RULES

LIMIT_S = 12_000.0
AGENTS = [*RULES, "planner"]
SEEDS = episode_seeds(2, 6)


def patrol(docks: str = "0:15", **options: Any) -> Options:
    return Options(
        "Patrol", docks=docks, time_limit_s=LIMIT_S, **{"difficulty": "known", **options}
    )


def run(name: str, options: Options) -> Episodes:
    return run_episodes(
        make_policy(name, HomewardVectorEnv(**vars(options))), options, SEEDS
    ).episodes


def shown(known: Any, **features: float) -> Any:
    row = np.zeros((1, len(names_of(True))), np.float32)
    for name, value in ({"metered": 0.5, "outbound": 1.0, "consumption": 0.0} | features).items():
        row[0, INDEX[name]] = value
    return row


def energies(margin: float, spare: float, home: float = 0.0, round_trip: float = 0.04) -> Energies:
    return Energies(*(np.array([share]) for share in (margin, spare, home, round_trip)))


@pytest.mark.parametrize("docks", ["0:15", "60:15"])
@pytest.mark.parametrize("name", AGENTS)
def test_on_patrol_with_a_dock_every_agent_drives_for_more_than_a_charge_and_comes_home(
    name: str, docks: str
) -> None:
    episodes = run(name, patrol(docks))
    without = run(name, Options("Patrol", difficulty="known"))
    assert episodes.home.all() and not episodes.timed_out.any()
    assert (episodes.score > without.score).all()


def test_a_dock_on_the_way_leads_further_than_half_of_a_charge() -> None:
    for name in ("dmax_mapped", "dmax_belief", "planner"):
        options = Options("OutAndBack", difficulty="known", docks="1500:30", time_limit_s=LIMIT_S)
        episodes = run(name, options)
        assert episodes.home.all(), name
        assert (
            episodes.score > run(name, Options("OutAndBack", difficulty="known")).score + 500.0
        ).all(), name


def test_it_charges_until_the_battery_lasts_for_the_time_left_or_is_full() -> None:
    known, first = known_of(patrol()), np.ones(1, np.bool_)
    docking = Docking(known, 240.0, 360.0)
    turned = np.zeros(1, np.bool_)

    def stops(**features: float) -> bool:
        spare = features.pop("spare")
        return bool(
            docking.stops(shown(known, **features), first, energies(spare - 0.04, spare), turned)[0]
        )

    assert stops(spare=0.1, time=0.1)
    assert stops(spare=0.03, time=0.97)  # less than a round
    assert not stops(spare=0.1, time=0.97)  # enough for the round that is left
    assert not stops(spare=0.1, time=0.1, metered=0.999)
    far = 45.0 / float(known.shared["reach_m"][0])
    assert not stops(spare=0.1, time=0.1, distance=far, outbound=-1.0)  # a decision leads 30 m
    assert not stops(spare=0.1, time=0.1, distance=0.5 * far)  # behind


def test_the_energy_must_suffice_to_the_last_dock_or_on_to_the_next() -> None:
    known = known_of(Options("OutAndBack", docks="1000:15,2000:15", time_limit_s=LIMIT_S))
    docking, reach_m = Docking(known, 120.0, 120.0), float(known.shared["reach_m"][0])

    def margin(at_m: float, short: float) -> float:
        """At 0.2 of the battery a kilometre, short of the energy for the way home."""
        back_m, out_m = (at_m - 1000.0, 2000.0 - at_m) if at_m > 1000.0 else (at_m, 1000.0 - at_m)
        home = 2e-4 * at_m
        seen = shown(
            known, distance=at_m / reach_m, home_cost=home, dock_cost=2e-4 * back_m, dock_back=back_m / reach_m,
            dock_out=out_m / reach_m,
        )  # fmt: skip
        return float(docking.margin(seen, energies(-short - 0.024, -short, home, 0.024))[0])

    # as far to the dock ahead as home
    assert margin(500.0, 0.01) == pytest.approx(-0.01 + 0.1 - 0.1, abs=1e-6)
    assert margin(1100.0, 0.1) == pytest.approx(-0.124 + 0.2, abs=1e-6)  # back to the dock behind
    assert margin(1900.0, 0.2) == pytest.approx(-0.2 + 0.38 - 0.02, abs=1e-6)  # on to the one ahead
