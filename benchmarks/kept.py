"""Results that are kept as they come, so that a benchmark that was killed goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from homeward.files import write_whole
from homeward.parallel import code_hash

Task = TypeVar("Task")


class Kept:
    """Results by name in a JSON file, which are dropped where they are of other settings or other code.

    Args:
        file: Where they are kept.
        settings: What all of them depend on.

    Attributes:
        results: What was kept so far.
    """

    def __init__(self, file: Path, **settings: Any) -> None:
        self._file = file
        self._settings = json.loads(json.dumps({**settings, "code": code_hash()}))  # as it is read again
        content: dict[str, Any] = json.loads(file.read_text("utf-8")) if file.is_file() else {}
        self.results: dict[str, Any] = content["results"] if content.get("settings") == self._settings else {}

    def keep(self, name: str, result: Any) -> None:
        """Keep one more.

        Raises:
            OSError: The folder cannot be written to.
        """
        self.results[name] = result
        write_whole(self._file, json.dumps({"settings": self._settings, "results": self.results}, indent=1) + "\n")

    def missing(self, tasks: Mapping[str, Task]) -> dict[str, Task]:
        """Those of some tasks that have no result yet."""
        return {name: task for name, task in tasks.items() if name not in self.results}
