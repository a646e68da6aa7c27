"""Agents come out the same wherever their episodes run, and take along what is in files."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from homeward import load_robot
from homeward.agents import make_policy
from homeward.agents.evaluation import (
    TRACE_COLUMNS,
    Episodes,
    Run,
    episode_seeds,
    run_episodes,
    tasks,
)
from homeward.agents.evaluation.tasks import run_agents, self_contained
from homeward.agents.shield import Shield
from homeward.envs.conditions.instruments import Instruments
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv


def test_outcomes_do_not_depend_on_where_they_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks, "SIDE_BY_SIDE", 16)
    options, seeds = Options("OutAndBack"), episode_seeds(3, 40)
    env = HomewardVectorEnv(**vars(options))
    agents = {name: [make_policy(name, env, seed=1)] for name in ("random", "dmax_adaptive")}
    agents["shielded"] = [Shield(make_policy("dmax", env), env.batch.known)]
    alone, together = (run_agents(agents, options, seeds, jobs=jobs) for jobs in (1, 2))
    straight = run_episodes(make_policy("dmax_adaptive", env), options, seeds)
    for name in agents:
        for field in dataclasses.fields(Episodes):
            outcome = getattr(alone[name][0].episodes, field.name)
            assert outcome.shape == (40,)
            np.testing.assert_array_equal(outcome, getattr(together[name][0].episodes, field.name))
        np.testing.assert_array_equal(alone[name][0].traces, together[name][0].traces)
    np.testing.assert_array_equal(alone["dmax_adaptive"][0].episodes.score, straight.episodes.score)


def test_parts_of_a_run_keep_the_traces_of_the_first_and_the_median_of_their_times() -> None:
    options = Options("OutAndBack")
    policy = make_policy("dmax", HomewardVectorEnv(**vars(options)))
    first, second, third = (
        dataclasses.replace(run_episodes(policy, options, [seed]), decision_us=us)
        for seed, us in ((1, 3.0), (2, 90.0), (3, 5.0))
    )
    whole = first.followed_by([second.without_traces(), third.without_traces()])
    assert isinstance(whole, Run)
    assert whole.decision_us == 5.0
    assert whole.traces.shape[1:] == (1, len(TRACE_COLUMNS))
    np.testing.assert_array_equal(whole.traces, first.traces)
    np.testing.assert_array_equal(whole.interest, first.interest)
    assert whole.episodes.score.tolist() == [
        float(one.episodes.score[0]) for one in (first, second, third)
    ]


@pytest.mark.parametrize("route", ["hill.csv", "box", "hidden_wind"])
def test_options_take_along_what_is_in_files(
    route: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    files = [Path(f"{name}.toml") for name in ("mine", "true", "scale")]
    for mass_kg, file in enumerate(files, start=1):
        file.write_text(dataclasses.replace(load_robot("rusti"), mass_kg=float(mass_kg)).to_toml())
    hill = Path("hill.csv")
    hill.write_text("distance_m,elevation_m,interest,wind_mps\n0,0,1,3\n700,31,2,3\n1500,7,1,3\n")
    mine, true, scale = files
    instruments = Path("mine_instruments.toml")
    instruments.write_text("soc_step = 0.02")
    options = Options(
        "Survey",
        robot=mine,
        route=route,
        true_robot=true,
        scaled_for=scale,
        instruments=instruments,
    )
    there = HomewardVectorEnv(**vars(options)).batch
    carried = self_contained(options)
    for file in (hill, instruments, *files):
        file.unlink()
    elsewhere = HomewardVectorEnv(**vars(carried)).batch
    assert (elsewhere.known.robot, elsewhere.hidden.robot) == (
        there.known.robot,
        there.hidden.robot,
    )
    assert elsewhere.known.instruments == there.known.instruments == Instruments(soc_step=0.02)
    assert elsewhere.constants.tobytes() == there.constants.tobytes()
