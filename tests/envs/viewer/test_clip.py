"""Clips of missions."""

from pathlib import Path

import numpy as np
import pytest


def test_a_clip_is_written_where_a_string_says(tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    from homeward.envs.viewer.clip import write_gif

    write_gif(str(tmp_path / "new" / "clip.gif"), [np.zeros((8, 8, 3), np.uint8)] * 2)
    assert (tmp_path / "new" / "clip.gif").read_bytes().startswith(b"GIF89a")
