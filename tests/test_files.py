"""Files are whole or not there."""

import os
import resource
from pathlib import Path

import pytest

from homeward.files import no_formula, open_regular, read_toml, write_whole


def test_text_and_bytes_arrive_and_nothing_else_is_left(tmp_path: Path) -> None:
    write_whole(tmp_path / "new" / "text", "m²")
    write_whole(tmp_path / "new" / "bytes", b"\x00\xff")
    assert (tmp_path / "new" / "text").read_text("utf-8") == "m²"
    assert (tmp_path / "new" / "bytes").read_bytes() == b"\x00\xff"
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["bytes", "text"]


def test_a_write_that_fails_halfway_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_whole(path, "old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))  # as on a disk with 1000 bytes left
    try:
        with pytest.raises(OSError) as error:
            write_whole(path, "new" * 1000)
        assert error.value.filename == str(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == "old"
    assert [one.name for one in tmp_path.iterdir()] == ["file"]


def test_files_respect_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "file", "text")
    finally:
        os.umask(before)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o640


def test_a_name_that_is_no_utf8_is_written_with_question_marks(tmp_path: Path) -> None:
    write_whole(tmp_path / "file", "caf\udce9")
    assert (tmp_path / "file").read_text("utf-8") == "caf?"


@pytest.mark.parametrize("text", ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "\r=1"])
def test_a_spreadsheet_runs_no_name(text: str) -> None:
    assert no_formula(text) == f"'{text}"
    assert [no_formula(one) for one in ("-2.5", "husky", -2.5, "")] == ["-2.5", "husky", -2.5, ""]


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="has no /proc")
def test_a_file_that_fails_when_it_is_read_is_named() -> None:
    with pytest.raises(OSError) as error:
        open_regular("/proc/self/mem")
    assert error.value.filename == "/proc/self/mem"


def test_a_long_row_of_numbers_is_read(tmp_path: Path) -> None:
    """A covariance of 40 numbers has 1,600 dots, as a key of that depth would."""
    path = tmp_path / "robot.toml"
    path.write_text(f"covariance = {[[0.5] * 40] * 40}  # of their relative errors\n")
    assert read_toml(path)["covariance"][39] == [0.5] * 40
