"""Output of a training run's figures: TensorBoard and, if requested, Weights & Biases."""

from __future__ import annotations

import numbers
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import HParam, KVWriter, Logger

from homeward.agents.evaluation.learning_curve import Point
from homeward.agents.learning.settings import TrainingError
from homeward.agents.trained.run_folder import WANDB
from homeward.files import write_whole

_CURVE = {f"curve/{name}": name for name in ("score", "stranded_rate", "late_rate")}


def log_settings(logger: Logger, settings: Mapping[str, Any]) -> None:
    """Log the settings of a run, so that TensorBoard's page HPARAMS compares the runs of a folder
    by their curves."""
    _write(logger, {"settings": HParam(settings, dict.fromkeys(_CURVE, 0.0))}, 0)


def log_point(logger: Logger, point: Point) -> None:
    """Log a point of the learning curve at its number of decisions."""
    _write(logger, {tag: getattr(point, name) for tag, name in _CURVE.items()}, point.steps)


def _write(logger: Logger, values: Mapping[str, Any], steps: int) -> None:
    for output in logger.output_formats:
        output.write(dict(values), dict.fromkeys(values, ()), steps)


class WandbOutput(KVWriter):
    """Logs the same to Weights & Biases as to TensorBoard; runs side by side in a folder form a
    group there.

    Args:
        project: Name of the project.
        folder: Folder of the training run; a continued run keeps the id that is stored there.
        settings: Settings of the run.

    Raises:
        TrainingError: Weights & Biases cannot be used: nobody is logged in, or it does not respond.
        OSError: The folder cannot be written to.
    """

    def __init__(self, project: str, folder: Path, settings: Mapping[str, Any]) -> None:
        import wandb  # an option, and slow to import

        folder = folder.resolve()
        id_file = folder / WANDB / "id.txt"
        if not id_file.is_file():
            write_whole(id_file, secrets.token_hex(4))
        try:
            self._run = wandb.init(
                project=project,
                name=f"{folder.parent.name}/{folder.name}",
                group=folder.parent.name,
                id=id_file.read_text("utf-8"),
                resume="allow",
                dir=folder,
                config=dict(settings),
                settings=wandb.Settings(silent=True, console="off"),
            )
        except wandb.errors.Error as error:
            raise TrainingError(
                f"Weights & Biases: {error}: run `wandb login`, or set WANDB_MODE=offline and send it later"
            ) from None
        # Its own steps cannot go back to a checkpoint.
        self._run.define_metric("*", step_metric="steps")

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Log the numbers among the values."""
        figures = {
            key: float(value)
            for key, value in key_values.items()
            if isinstance(value, numbers.Real)
        }
        if figures:
            self._run.log({"steps": step, **figures})

    def close(self) -> None:
        """Send or write the rest."""
        self._run.finish()
