"""Recordings that are refused, and why."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from homeward.diagnosis import RecordingError, read_recording

Write = Callable[[pd.DataFrame], Path]


def refusal(path: Path, columns: str | Path | None = None) -> str:
    """The message with which a recording is refused: one line that starts with the file."""
    with pytest.raises(RecordingError) as error:
        read_recording(path, columns)
    message = str(error.value)
    assert "\n" not in message and len(message) < 500
    return message
