"""Between updates: when points, checkpoints and the policy's turn come, and which policy is the
best."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console
from stable_baselines3 import PPO

from homeward.agents.evaluation.learning_curve import Point, read_curve, write_curve
from homeward.agents.learning.callback import TrainingCallback
from homeward.agents.learning.checkpoint import Best
from homeward.agents.learning.network import layers_of
from homeward.agents.learning.ppo import one_thread
from homeward.agents.learning.settings import VALUE_FIRST
from homeward.agents.trained.run_folder import CHECKPOINT, PREVIOUS
from tests.agents.learning.small import SETTINGS, learner

ROLLOUT = SETTINGS.rollout
Scores = Callable[[int], float]


class Training:
    """A run of some updates with a made-up curve, and what its callback did."""

    def __init__(
        self,
        folder: Path,
        updates: int,
        *,
        checkpoints: Collection[int] = (),
        every: int = ROLLOUT,
        score: Scores = float,
        best: Best | None = None,
        model: PPO | None = None,
        entropy: float = 0.0,
    ) -> None:
        self.model = model or learner(entropy=entropy)
        self.output = io.StringIO()
        self.measured: list[int] = []
        self.begun_anew: list[int] = []
        self.entropies: list[float] = []
        self._score = score
        console = Console(file=self.output, width=200)
        self.callback = TrainingCallback(
            folder, updates * ROLLOUT, checkpoints, console, every, self._measure, lambda: layers_of(self.model), best,
            lambda: self.begun_anew.append(self.model.num_timesteps),
        )  # fmt: skip
        with one_thread():
            self.model.learn(
                updates * ROLLOUT - self.model.num_timesteps,
                self.callback,
                reset_num_timesteps=False,
            )
            self.callback.add_to_curve()
        self.callback.close()

    def _measure(self, steps: int, trained_s: float) -> Point:
        self.measured.append(steps)
        self.entropies.append(float(self.model.ent_coef))
        return Point(steps, trained_s, self._score(steps), 0.0, 0.0)


@pytest.mark.parametrize(
    ("every", "expected"),
    [(1, [0, 1, 2, 3, 4]), (ROLLOUT, [0, 1, 2, 3, 4]), (ROLLOUT + 1, [0, 2, 4]), (9**9, [0, 4])],
)
def test_points_are_no_closer_than_asked_and_the_end_has_one(
    tmp_path: Path, every: int, expected: list[int]
) -> None:
    training = Training(tmp_path, 4, every=every)
    assert training.measured == [update * ROLLOUT for update in expected]
    curve = read_curve(tmp_path)
    assert [point.steps for point in curve] == training.measured
    assert [point.trained_s for point in curve] == sorted(point.trained_s for point in curve)


@pytest.mark.parametrize(
    ("scores", "best"),
    [
        ([9.0, 1.0, 3.0, 2.0], 2),
        ([9.0, 1.0, 3.0, 3.0], 3),
        ([0.0, 5.0, 3.0, 4.0], 1),
        ([9.0, 0.0, 0.0, 0.0], 3),
    ],
)
def test_the_best_is_the_latest_of_the_highest_since_training_began(
    tmp_path: Path, scores: list[float], best: int
) -> None:
    training = Training(tmp_path, 3, score=lambda steps: scores[steps // ROLLOUT])
    kept = training.callback.best_policy
    assert kept is not None and (kept.steps, kept.score) == (best * ROLLOUT, scores[best])


def test_the_best_policy_is_kept_as_it_was(tmp_path: Path) -> None:
    updates = VALUE_FIRST + 2
    last = Training(tmp_path / "last", updates, score=lambda steps: 1.0)
    earlier = Training(
        tmp_path / "earlier", updates, score=lambda steps: float(steps == (updates - 1) * ROLLOUT)
    )
    assert last.callback.best_policy is not None and earlier.callback.best_policy is not None
    for (weight, _), (present, _) in zip(
        last.callback.best_policy.layers, layers_of(last.model), strict=True
    ):
        np.testing.assert_array_equal(weight, present)
    assert any(
        (weight != present).any()
        for (weight, _), (present, _) in zip(
            earlier.callback.best_policy.layers, layers_of(earlier.model), strict=True
        )
    )


def test_the_best_of_a_continued_run_is_beaten_by_no_lower_score(tmp_path: Path) -> None:
    before = Best(ROLLOUT, 2.0, [])
    for score, kept in ((1.9, True), (2.0, False)):
        always = functools.partial(lambda value, steps: value, score)
        training = Training(tmp_path / str(score), 2, best=before, score=always)
        assert (training.callback.best_policy is before) == kept


def test_a_continued_run_goes_on_with_its_curve_up_to_its_checkpoint(tmp_path: Path) -> None:
    model = learner()
    model.num_timesteps = 2 * ROLLOUT
    write_curve(
        tmp_path, [Point(update * ROLLOUT, 10.0 * update, 0.0, 0.0, 0.0) for update in range(4)]
    )
    training = Training(tmp_path, 4, model=model)
    # the point after the checkpoint is measured again
    assert training.measured == [3 * ROLLOUT, 4 * ROLLOUT]
    curve = read_curve(tmp_path)
    assert [point.steps for point in curve] == [update * ROLLOUT for update in range(5)]
    assert curve[2].trained_s == 20.0 < curve[3].trained_s < 30.0


def test_checkpoints_are_written_where_asked_and_missions_begin_anew(tmp_path: Path) -> None:
    assert Training(tmp_path, 4, checkpoints=[ROLLOUT, 3 * ROLLOUT]).begun_anew == [
        ROLLOUT,
        3 * ROLLOUT,
    ]
    assert (tmp_path / CHECKPOINT).is_file() and (tmp_path / PREVIOUS).is_file()


def test_a_run_that_continues_at_a_checkpoint_does_not_write_it_again(tmp_path: Path) -> None:
    model = learner()
    model.num_timesteps = ROLLOUT
    assert Training(tmp_path, 2, checkpoints=[ROLLOUT], model=model).begun_anew == []
    assert not (tmp_path / CHECKPOINT).exists()


def test_the_value_learns_first(tmp_path: Path) -> None:
    def parts(model: PPO) -> tuple[torch.Tensor, torch.Tensor]:
        weights = model.policy.state_dict()
        return weights["action_net.weight"].clone(), weights["value_net.weight"].clone()

    (actions, values), model = parts(learner()), learner()
    first = Training(tmp_path, VALUE_FIRST, model=model)
    assert torch.equal(parts(first.model)[0], actions) and not torch.equal(
        parts(first.model)[1], values
    )
    later = Training(tmp_path, VALUE_FIRST + 1, model=model)
    assert not torch.equal(parts(later.model)[0], actions)


def test_the_bonus_for_exploration_falls_linearly_to_nothing(tmp_path: Path) -> None:
    training = Training(tmp_path, 4, entropy=0.5)
    # A point is measured before the coefficient of its update is set.
    assert training.entropies[1:] == pytest.approx([0.5, 0.375, 0.25, 0.125])


def test_a_line_for_each_tenth_where_there_is_no_terminal(tmp_path: Path) -> None:
    lines = Training(tmp_path, 20, every=9**9).output.getvalue().splitlines()
    assert [line.partition(" steps")[0] for line in lines] == [
        f"{2 * tenth * ROLLOUT:,} of {20 * ROLLOUT:,}" for tenth in range(1, 11)
    ]


def test_home_rate_and_score_are_those_of_the_missions_that_ended(tmp_path: Path) -> None:
    callback = Training(tmp_path, 1).callback
    ends = [
        {"home": True, "stranded": False, "score": 8.0},
        {"home": False, "stranded": True, "score": 99.0},
        {},
        {"home": False, "stranded": False, "score": 99.0},
    ]
    callback.locals = {"infos": ends, "dones": np.array([True, True, False, True])}
    assert callback._on_step()
    callback._on_rollout_end()
    assert (callback.home_rate, callback.score) == pytest.approx((1.0 / 3.0, 8.0 / 3.0))
    callback._on_rollout_end()  # nothing ended since: the figures stay
    assert callback.score == pytest.approx(8.0 / 3.0)
    callback.locals = {
        "infos": [{"home": True, "stranded": False, "score": 4.0}],
        "dones": np.ones(1, np.bool_),
    }
    assert callback._on_step()
    callback._on_rollout_end()
    assert (callback.home_rate, callback.score) == (1.0, 4.0)
