"""Between the updates of a training run: statistics, progress bar, checkpoints."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from stable_baselines3.common.callbacks import BaseCallback

from homeward.agents.evaluation.learning_curve import Point, read_curve, write_curve
from homeward.agents.learning.checkpoint import Best, save_checkpoint
from homeward.agents.learning.network import ResidualPolicy
from homeward.agents.learning.settings import VALUE_FIRST
from homeward.agents.learning.tracking import log_point
from homeward.agents.trained.policy_file import Layer


class TrainingCallback(BaseCallback):
    """Logs how missions end, shows the progress, and writes checkpoints and the learning curve.

    Args:
        folder, steps: Folder and decisions of the whole run.
        checkpoints: Decisions after which a checkpoint is written, and `begin_anew` called.
        console: Output of the bar; without a terminal, a line for each tenth of the run.
        every: Minimum number of decisions between points of the learning curve.
        measure: Computes a point of the curve, after some decisions and seconds of training.
        layers: Returns the present layers of the policy.
        best: The best policy so far, of a continued run.
        begin_anew: Restarts missions and random numbers.

    Attributes:
        best_policy: The best policy on the missions of the curve since training began, the latest
            of equals.
    """

    def __init__(
        self,
        folder: Path,
        steps: int,
        checkpoints: Collection[int],
        console: Console,
        every: int,
        measure: Callable[[int, float], Point],
        layers: Callable[[], list[Layer]],
        best_policy: Best | None,
        begin_anew: Callable[[], None],
    ) -> None:
        super().__init__()
        self._every = every
        self._measure = measure
        self._layers = layers
        self.best_policy = best_policy
        self.home_rate = self.score = float("nan")
        self._folder = folder
        self._steps = steps
        self._checkpoints = checkpoints
        self._console = console
        self._begin_anew = begin_anew
        columns = (
            TextColumn("training"), BarColumn(), TextColumn("{task.percentage:3.0f} %"), TimeRemainingColumn(),
            TextColumn("{task.fields[figures]}"),
        )  # fmt: skip
        self._bar = Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        )
        self._ends: list[tuple[bool, bool, float]] = []  # home, stranded, score counted

    def _on_training_start(self) -> None:
        self._entropy: float = self.model.ent_coef  # type: ignore[attr-defined]
        self._start_s = self._resumed_s = time.monotonic()
        self._start_step = self.num_timesteps
        self._curve = [
            point for point in read_curve(self._folder) if point.steps <= self.num_timesteps
        ]
        self._trained_s = self._curve[-1].trained_s if self._curve else 0.0
        self._tenth = 10 * self.num_timesteps // self._steps
        self._task = self._bar.add_task(
            "", total=self._steps, completed=self.num_timesteps, figures=""
        )
        self._bar.start()

    def _on_rollout_start(self) -> None:
        if not self._curve or self.num_timesteps - self._curve[-1].steps >= self._every:
            self.add_to_curve()
        assert isinstance(self.model.policy, ResidualPolicy)
        self.model.ent_coef = self._entropy * max(1.0 - self.num_timesteps / self._steps, 0.0)  # type: ignore[attr-defined]
        rollout = self.model.n_steps * self.model.n_envs  # type: ignore[attr-defined]
        self.model.policy.learn_actions(self.num_timesteps >= VALUE_FIRST * rollout)
        # The last update is done: nothing of it would be lost.
        if self.num_timesteps > self._start_step and self.num_timesteps in self._checkpoints:
            save_checkpoint(self.model, self.best_policy, self._folder)  # type: ignore[arg-type]
            self._begin_anew()

    def add_to_curve(self) -> None:
        """Measure the present policy, unless that was just done."""
        if self._curve and self.num_timesteps == self._curve[-1].steps:
            return
        now_s = time.monotonic()
        self._trained_s += now_s - self._resumed_s
        point = self._measure(self.num_timesteps, self._trained_s)
        self._curve.append(point)
        if point.steps and (self.best_policy is None or point.score >= self.best_policy.score):
            self.best_policy = Best(
                point.steps,
                point.score,
                [(weight.copy(), bias.copy()) for weight, bias in self._layers()],
            )
        write_curve(self._folder, self._curve)
        log_point(self.logger, point)
        self._resumed_s = time.monotonic()

    def _on_step(self) -> bool:
        infos = self.locals["infos"]
        for i in np.flatnonzero(self.locals["dones"]).tolist():
            info = infos[i]
            self._ends.append(
                (info["home"], info["stranded"], info["score"] if info["home"] else 0.0)
            )
        return True

    def _on_rollout_end(self) -> None:
        if self._ends:
            self.home_rate, stranded_rate, self.score = np.mean(self._ends, axis=0).tolist()
            self.logger.record("missions/home_rate", self.home_rate)
            self.logger.record("missions/stranded_rate", stranded_rate)
            self.logger.record("missions/score", self.score)
            self._ends.clear()
        speed = (self.num_timesteps - self._start_step) / (time.monotonic() - self._start_s)
        figures = f"home {self.home_rate:.1%}  score {self.score:.4g}  {speed:,.0f} steps/s"
        self._bar.update(self._task, completed=self.num_timesteps, figures=figures)
        tenth = 10 * self.num_timesteps // self._steps
        if tenth > self._tenth and not self._console.is_terminal:
            self._console.print(
                f"{self.num_timesteps:,} of {self._steps:,} steps  {figures}", highlight=False
            )
        self._tenth = tenth

    def close(self) -> None:
        """Remove the progress bar."""
        self._bar.stop()
