"""Results stored as they are computed, so that an interrupted benchmark continues."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from homeward.files import write_whole
from homeward.parallel import code_hash

Task = TypeVar("Task")


class Kept:
    """Results by name in a JSON file; those of other settings or other code are dropped.

    Args:
        file: The file.
        settings: Everything that the results depend on beside the code.

    Attributes:
        results: The results so far.
    """

    def __init__(self, file: Path, **settings: Any) -> None:
        self._file = file
        # as it is read again
        self._settings = json.loads(json.dumps({**settings, "code": code_hash()}))
        content: dict[str, Any] = json.loads(file.read_text("utf-8")) if file.is_file() else {}
        self.results: dict[str, Any] = (
            content["results"] if content.get("settings") == self._settings else {}
        )

    def keep(self, name: str, result: Any) -> None:
        """Add a result.

        Raises:
            OSError: The folder cannot be written to.
        """
        self.results[name] = result
        write_whole(
            self._file,
            json.dumps({"settings": self._settings, "results": self.results}, indent=1) + "\n",
        )

    def missing(self, tasks: Mapping[str, Task]) -> dict[str, Task]:
        """Tasks without a result."""
        return {name: task for name, task in tasks.items() if name not in self.results}
