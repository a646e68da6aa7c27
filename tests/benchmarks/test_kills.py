"""What a kill may leave behind is told from what it may not."""

from pathlib import Path

import pytest

from benchmarks.kills import faults
from benchmarks.wheels import VERSIONS, find_pythons


@pytest.mark.parametrize(
    ("name", "whole"),
    [("a.json", b'{"a": 1}\n'), ("a.csv", b"a,b\n1,2\n"), ("a.html", b"<html></html>\n"), ("a.toml", b"a = 1\n"),
     ("a.safetensors", (2).to_bytes(8, "little") + b"{}")],
)  # fmt: skip
def test_half_a_file_is_a_fault(tmp_path: Path, name: str, whole: bytes) -> None:
    (tmp_path / "sub").mkdir()
    path = tmp_path / "sub" / name
    path.write_bytes(whole)
    assert faults(tmp_path) == []
    path.write_bytes(whole[:-2])
    assert len(faults(tmp_path)) == 1
    path.rename(path.with_name(f".{name}.x1y2"))  # as a write leaves it that was killed
    assert faults(tmp_path) == []
    assert faults(tmp_path / "none") == []


def test_pythons_that_are_found_are_of_the_versions() -> None:
    assert len(find_pythons()) <= len(VERSIONS)
