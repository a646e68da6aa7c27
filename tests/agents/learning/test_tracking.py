"""What is logged of a training run: the learning curve and the settings, in TensorBoard and in
Weights & Biases."""

from __future__ import annotations

import dataclasses
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("stable_baselines3")

from homeward.agents.evaluation.learning_curve import read_curve
from homeward.agents.learning.settings import TrainingError
from homeward.agents.trained.run_folder import CHECKPOINT, RUN, TENSORBOARD, WANDB
from homeward.commands import train
from tests.parallel_cases import SETTINGS, STEPS

pytestmark = pytest.mark.usefixtures("short_curves")


def small(out: Path, **changes: Any) -> train.Args:
    args = train.Args(out=out, steps=STEPS, curve=2, decision_s=120.0, ppo=SETTINGS)
    return dataclasses.replace(args, **changes)


def test_tensorboard_has_the_curve_and_the_settings(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
    from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

    folder = train.main(small(tmp_path / "run"))
    events = EventAccumulator(str(folder / TENSORBOARD))
    events.Reload()
    curve = read_curve(folder)
    assert len(curve) == 3
    for name in ("score", "stranded_rate", "late_rate"):
        logged = [(event.step, event.value) for event in events.Scalars(f"curve/{name}")]
        assert logged == [
            (point.steps, pytest.approx(getattr(point, name), rel=1e-5)) for point in curve
        ]
    written = events.PluginTagToContent("hparams")
    begun = HParamsPluginData.FromString(
        written["_hparams_/session_start_info"]
    ).session_start_info.hparams
    assert begun["clip"].number_value == SETTINGS.clip
    assert begun["env"].string_value == "homeward/Survey-v0"
    metrics = HParamsPluginData.FromString(written["_hparams_/experiment"]).experiment.metric_infos
    assert {metric.name.tag for metric in metrics} <= set(events.Tags()["scalars"])


def test_weights_and_biases_gets_the_curve_offline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    folder = train.main(
        small(tmp_path / "sweep" / "seed_0", wandb="homeward-test", steps=STEPS // 2)
    )
    train.main(small(folder, wandb="homeward-test", resume=True))
    runs = sorted(
        (folder / WANDB).glob("offline-run-*/*.wandb"), key=lambda file: file.stat().st_mtime_ns
    )
    records = [record for file in runs for record in offline_records(file)]
    begun = [record.run for record in records if record.HasField("run")]
    identifier = (folder / WANDB / "id.txt").read_text()
    assert len(runs) == 2  # the second goes on under the same id
    assert {(run.project, run.run_id, run.run_group) for run in begun} == {
        ("homeward-test", identifier, "sweep")
    }
    assert {run.display_name for run in begun} == {"sweep/seed_0"}
    logged = [
        {item.key or item.nested_key[0]: item.value_json for item in record.history.item}
        for record in records
        if record.HasField("history")
    ]
    scores = {
        int(float(row["steps"])): float(row["curve/score"])
        for row in logged
        if "curve/score" in row
    }
    assert scores == {
        point.steps: pytest.approx(point.score, rel=1e-5) for point in read_curve(folder)
    }
    assert sum("missions/score" in row for row in logged) > 1


def offline_records(file: Path) -> Iterator[Any]:
    """Records of a file of Weights & Biases: LevelDB's log format, in blocks of 32 KiB, behind a
    header of 7 bytes."""
    from wandb.proto.wandb_internal_pb2 import Record

    content, at, whole = file.read_bytes(), 7, b""
    while at + 7 <= len(content):
        if 32768 - at % 32768 < 7:
            at += 32768 - at % 32768
            continue
        _, length, kind = struct.unpack_from("<IHB", content, at)
        whole += content[at + 7 : at + 7 + length]
        at += 7 + length
        if kind in (1, 4):  # whole, or the last of its parts
            yield Record.FromString(whole)
            whole = b""


def test_without_wandb_nothing_is_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(TrainingError, match=r"--wandb needs wandb: pip install .*wandb"):
        train.main(small(tmp_path / "run", wandb="homeward-test"))
    assert not (tmp_path / "run" / RUN).exists()


def test_wandb_that_cannot_be_used_takes_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wandb = pytest.importorskip("wandb")

    def refuse(**_: Any) -> None:
        raise wandb.errors.UsageError("api_key not configured (no-tty)")

    monkeypatch.setattr(wandb, "init", refuse)
    with pytest.raises(
        TrainingError, match=r"Weights & Biases: api_key not configured .* set WANDB_MODE=offline"
    ):
        train.main(small(tmp_path / "run", wandb="homeward-test"))
    assert not (tmp_path / "run" / CHECKPOINT).exists()
    monkeypatch.undo()
