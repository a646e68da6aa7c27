"""Files that once ended in a traceback, a hang or gigabytes are refused; `test_mutated.py` looks
for more."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from homeward.agents.trained.policy_file import PolicyFileError, load_policy
from homeward.diagnosis import RecordingError, load_columns, read_recording
from homeward.envs.conditions.instruments import InstrumentError, load_instruments
from homeward.envs.routes import RouteError, load_route
from homeward.logs.bags.topics import load_topics
from homeward.logs.propose import propose
from homeward.physics import RobotError, load_robot

BROKEN = Path(__file__).parent / "broken"
LONGEST_S = 10.0
LOADERS: dict[str, tuple[Callable[[Path], Any], type[Exception]]] = {
    "robot": (load_robot, RobotError),
    "route": (lambda path: load_route(path, 5.0), RouteError),
    "csv": (read_recording, RecordingError),
    "parquet": (read_recording, RecordingError),
    "ros1": (read_recording, RecordingError),
    "ros2": (read_recording, RecordingError),
    "ardupilot": (read_recording, RecordingError),
    "px4": (read_recording, RecordingError),
    "columns": (load_columns, RecordingError),
    "topics": (load_topics, RecordingError),
    "proposal": (propose, RecordingError),
    "policy": (load_policy, PolicyFileError),
    "instruments": (load_instruments, InstrumentError),
}
"""What reads the files of each folder of `broken`, and how it refuses."""
FILES = sorted(path for path in BROKEN.glob("*/*"))


def test_every_folder_has_a_loader() -> None:
    assert {path.parent.name for path in FILES} <= set(LOADERS) and FILES


@pytest.mark.filterwarnings("ignore::homeward.physics.plausible.PlausibilityWarning")
@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_what_once_broke_is_refused(path: Path) -> None:
    read, refusal = LOADERS[path.parent.name]
    began = time.monotonic()
    with pytest.raises(refusal) as error:
        read(path)
    assert time.monotonic() - began < LONGEST_S
    assert str(error.value)


SHIPPED = Path(__file__).parents[2] / "agents" / "policies" / "OutAndBack_scratch"


@pytest.mark.parametrize("shape", [[0, 2**62], [2**62, 0], [2**32, 2**32], [0], [-1, 4], [1] * 70])
def test_weights_of_an_impossible_shape(tmp_path: Path, shape: list[int]) -> None:
    folder = tmp_path / "policy"
    shutil.copytree(SHIPPED, folder)
    header = {f"layers.{index}.{part}": {"dtype": "F32", "shape": shape, "data_offsets": [0, 0]}
              for index in range(3) for part in ("weight", "bias")}  # fmt: skip
    text = json.dumps(header).encode()
    weights = len(text).to_bytes(8, "little") + text
    (folder / "policy.safetensors").write_bytes(weights)
    _hash_set_right(folder, weights)
    with pytest.raises(PolicyFileError):
        load_policy(folder)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        '{"a":' * 100_000,
        '{"schema": 1e999}',
        '{"schema": ' + "9" * 5000 + "}",
        '{"a": NaN}',
        "null",
    ],
    ids=["lists", "tables", "infinite", "digits", "NaN", "null"],
)
def test_descriptions_that_are_deep_or_infinite(tmp_path: Path, text: str) -> None:
    folder = tmp_path / "policy"
    shutil.copytree(SHIPPED, folder)
    (folder / "policy.json").write_text(text)
    with pytest.raises(PolicyFileError):
        load_policy(folder)


SPACES: list[Any] = [
    {"type": "MultiDiscrete", "nvec": [2**62, 1, 1]}, {"type": "MultiDiscrete", "nvec": []},
    {"type": "Box", "low": [1e999], "high": [0]}, {"type": "Box", "low": 0, "high": "x"},
    {"type": "MultiDiscrete", "nvec": [[1, 2], [3]]}, [], None,
]  # fmt: skip


@pytest.mark.parametrize("space", SPACES)
def test_action_spaces_that_are_none(tmp_path: Path, space: Any) -> None:
    folder = tmp_path / "policy"
    shutil.copytree(SHIPPED, folder)
    description = json.loads((folder / "policy.json").read_text())
    (folder / "policy.json").write_text(json.dumps(description | {"action_space": space}))
    with pytest.raises(PolicyFileError):
        load_policy(folder)


def _hash_set_right(folder: Path, weights: bytes) -> None:
    description = json.loads((folder / "policy.json").read_text())
    description["weights_sha256"] = hashlib.sha256(weights).hexdigest()
    (folder / "policy.json").write_text(json.dumps(description))
