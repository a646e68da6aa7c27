"""Learning curves: the deployed policy's own score, and what is read is what was written."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from homeward.agents.evaluation import episode_seeds, learning_curve, run_episodes
from homeward.agents.evaluation.learning_curve import Point, measure, read_curve, write_curve
from homeward.agents.learning.settings import TrainingError
from homeward.agents.trained.run_folder import CURVE
from tests.agents.evaluation.runs import SURVEY, made_up, policy

POINTS = [Point(0, 0.0, 12.25, 1.0, 0.0), Point(3_000_000, 1234.5, 0.0, 0.125, 0.0625)]


def test_a_curve_is_read_as_it_was_written(tmp_path: Path) -> None:
    write_curve(tmp_path, POINTS)
    assert read_curve(tmp_path) == POINTS
    assert [entry.name for entry in tmp_path.iterdir()] == [CURVE]


def test_steps_are_written_whole_and_the_rest_with_six_digits(tmp_path: Path) -> None:
    write_curve(tmp_path, [Point(123_456_789, 1.0 / 3.0, 2.0e6 / 3.0, 0.0, 0.0)])
    (point,) = read_curve(tmp_path)
    assert (point.steps, point.trained_s, point.score) == (123_456_789, 0.333333, 666667.0)


@pytest.mark.parametrize(
    "content", [None, "", "\x00", '"', "steps,trained_s,score,stranded_rate,late_rate\n"]
)
def test_a_run_without_points_has_an_empty_curve(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / CURVE).write_text(content)
    assert read_curve(tmp_path) == []


@pytest.mark.parametrize(
    "content",
    [
        "steps,trained_s\n1,2\n",
        "steps\nmany\n",
        "a" * 200_000,
        "steps,trained_s,score,stranded_rate,late_rate\n1,2,3,4\n",
        "steps,trained_s,score,stranded_rate,late_rate\n1,2,high,4,5\n",
    ],
)
def test_a_damaged_curve_is_one_line(tmp_path: Path, content: str) -> None:
    (tmp_path / CURVE).write_text(content)
    with pytest.raises(
        TrainingError, match=f"{CURVE} is damaged: delete it to continue with a new curve"
    ) as caught:
        read_curve(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("short_curves")
def test_a_point_is_of_the_episodes_of_curves() -> None:
    point = measure(policy("dmax"), SURVEY, 7, 1.5)
    episodes = run_episodes(
        policy("dmax"), SURVEY, episode_seeds(learning_curve.SEED, learning_curve.EPISODES)
    ).episodes
    assert point == Point(
        7, 1.5, episodes.score.mean(), episodes.stranded.mean(), episodes.timed_out.mean()
    )


def test_what_is_neither_home_nor_stranded_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    run = made_up([10.0, 0.0, 0.0, 0.0], [False, True, False, False])
    late = dataclasses.replace(run.episodes, timed_out=run.episodes.score < 0.0)
    late.timed_out[2:] = True
    monkeypatch.setattr(
        learning_curve, "run_episodes", lambda *_: dataclasses.replace(run, episodes=late)
    )
    point = measure(policy("dmax"), SURVEY, 0, 0.0)
    assert (point.score, point.stranded_rate, point.late_rate) == (2.5, 0.25, 0.5)


def test_episodes_of_curves_are_none_of_an_evaluation() -> None:
    curves = set(episode_seeds(learning_curve.SEED, learning_curve.EPISODES))
    assert all(curves.isdisjoint(episode_seeds(seed, 1000)) for seed in range(10))
