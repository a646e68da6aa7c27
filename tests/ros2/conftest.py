"""The package of the node, imported where rclpy is not."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest


@pytest.fixture
def package(root: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The modules of `homeward_ros2`, with a stand-in for rclpy."""
    pytest.importorskip("rosbags", reason="needs the extra logs")
    from tests.ros2 import stand_in

    stand_in.install(monkeypatch)
    monkeypatch.syspath_prepend(str(root / "ros2"))
    names = ("messages", "process", "node", "check")
    yield SimpleNamespace(
        **{name: importlib.import_module(f"homeward_ros2.{name}") for name in names}
    )
    for name in ("homeward_ros2", *(f"homeward_ros2.{name}" for name in names)):
        sys.modules.pop(name, None)
