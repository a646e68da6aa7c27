"""The benchmark of learned turns: what comes of a chance to turn, what is learned, and how turns are compared."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.agents.beyond import RATES, Args, Chances, compare, learn_turn, main, margin_home
from homeward.envs.options import OptionError
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv

INF = np.inf


def chances_of(margin: list[list[float]], home: list[list[bool]], forced: list[list[bool]]) -> Chances:
    """Chances 100 m apart, with nothing observed."""
    score = np.cumsum(np.full(np.shape(margin), 100.0), axis=1) * np.array(home)
    inputs = np.zeros((*np.shape(margin), 1), np.float32)
    return Chances(inputs, np.array(margin), score, np.array(home), np.array(forced))


def test_a_mission_turns_at_the_first_chance_below_the_reserve_or_where_it_must() -> None:
    chances = chances_of(
        [[4.0, 2.0, 1.0], [4.0, 2.0, 1.0], [4.0, 3.5, INF], [4.0, 3.5, 3.4]],
        [[True, True, False], [True, False, False], [True, True, False], [True, True, True]],
        [[False] * 3, [False] * 3, [False, True, False], [False] * 3],
    )
    score, stranded = chances.outcome(chances.margin, 3.0)
    assert score.tolist() == [200.0, 0.0, 200.0, 0.0]
    assert stranded.tolist() == [False, True, False, True]


def test_the_margin_home_is_the_most_that_the_environment_leaves() -> None:
    count, chosen, left = 4, np.array([1, 3]), []
    for speed in (2, 3, 4):
        env = HomewardVectorEnv(count, autoreset_mode="Disabled", mission="OutAndBack", difficulty="harsh")
        env.reset(seed=3)
        for _ in range(30):
            env.step(np.tile([4, 0, GO], (count, 1)))
        before = env.batch.records.copy()
        margin = margin_home(env.batch, chosen)
        assert (env.batch.records == before).all()
        while not env.batch.records["over"].all():
            env.step(np.tile([speed, 0, RETURN], (count, 1)))
        assert env.batch.records["home"].all()
        left.append(env.batch.records["energy_j"][chosen] / env.batch.known.shared["usable_j"][0])
    assert margin == pytest.approx(np.max(left, axis=0), abs=1e-9)


def test_it_learns_which_missions_get_home() -> None:
    rng = np.random.default_rng(0)
    missions, margin = 256, np.arange(6.0, -3.0, -0.5)
    strong = rng.random(missions) < 0.5  # these come home with much less than is believed
    inputs = np.repeat(strong[:, None, None], len(margin), axis=1).astype(np.float32)
    home = margin > np.where(strong, -1.6, 3.4)[:, None]
    score = np.where(home, 100.0 * np.arange(1, 1 + len(margin)), 0.0)
    chances = Chances(inputs, np.tile(margin, (missions, 1)), score, home, np.zeros_like(home))
    row = compare(chances, learn_turn(chances, 60, 0)(chances), 0)
    for rate in RATES:
        assert 0.15 < row[rate]["learned"] <= row[rate]["last"]
        assert row[rate]["learned_ci95"][0] > 0.1


def test_the_planners_own_margin_gains_nothing() -> None:
    rng = np.random.default_rng(1)
    margin = np.sort(rng.normal(3.0, 2.0, (300, 12)))[:, ::-1]
    home = margin > rng.normal(1.0, 0.3, (300, 1))
    chances = chances_of(margin.tolist(), home.tolist(), np.zeros_like(home).tolist())
    row = compare(chances, chances.margin, 0)
    for rate in RATES:
        assert row[rate]["learned"] == 0.0 and row[rate]["learned_ci95"] == [0.0, 0.0]
        assert row[rate]["last"] > 0.0


def test_rows_are_printed_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = Args(missions=("OutAndBack",), difficulties=("harsh",), training=24, episodes=24, epochs=1, out=tmp_path)
    main(args)
    kept = json.loads((tmp_path / "beyond.json").read_text())
    rows = kept["results"]["OutAndBack, harsh"]
    assert list(rows) == ["learned from", "seed 7", "seed 29"]
    for row in rows.values():
        assert row["1 %"]["last"] > 0.0 and row["planner"]["stranded"] == sorted(row["planner"]["stranded"])[::-1]
    capsys.readouterr()
    rows["seed 7"]["1 %"]["planner"] = 7777.0
    (tmp_path / "beyond.json").write_text(json.dumps(kept))
    main(args)
    assert "7777" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("args", "told"),
    [
        (Args(missions=("Patrol",)), "--missions of OutAndBack, Survey"),
        (Args(difficulties=("calm",)), "--difficulties of known"),
        (Args(episodes=0), "at least 1"),
        (Args(seeds=(-1,)), "--seeds of 0 or more"),
        (Args(seeds=()), "--seeds of 0 or more"),
    ],
)
def test_arguments_that_cannot_be_used_are_refused(args: Args, told: str) -> None:
    with pytest.raises(OptionError, match=told):
        main(args)
