"""Text tables of unknown format: inferred from their beginning, read in pieces, refused where they
are broken."""

import gzip
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.diagnosis import read_recording
from homeward.logs import RecordingError, limits, tables
from homeward.logs.tables import opened, sniff
from tests.logs.refused import Write, refusal


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "run.csv"
    path.write_bytes(text.encode(encoding))
    return path


def test_the_format_is_that_of_the_beginning(tmp_path: Path) -> None:
    found = sniff(written(tmp_path, "# logger\nt;v°\ns;m/s\n0,5;1,25\n1,0;-2,5e1\n", "cp1252"))
    assert (found.header, found.units) == (["t", "v°"], ("s", "m/s"))
    assert (found.separator, found.decimal, found.encoding, found.skipped) == (
        ";",
        ",",
        "cp1252",
        (0, 2),
    )
    (piece,) = found.pieces(["v°", "t"])
    assert piece.to_dict("list") == {"v°": [1.25, -25.0], "t": [0.5, 1.0]}
    assert found.notes == (
        "encoding cp1252", "cells separated by semicolons", "decimal commas",
        "1 line of comment before the names left out", "the line of units after the names left out",
    )  # fmt: skip


@pytest.mark.parametrize("mark", ["utf-16-le", "utf-16-be"])
def test_a_wide_encoding_is_known_by_its_mark(mark: str, tmp_path: Path) -> None:
    found = sniff(written(tmp_path, "\ufeffa,b\n1,2\n3,4\n", mark))
    assert (found.encoding, found.header) == ("utf-16", ["a", "b"])
    assert pd.concat(found.pieces(["a", "b"])).to_numpy().tolist() == [[1, 2], [3, 4]]
    with pytest.raises(RecordingError, match=r"the last line is cut off \(1 of 2 cells\)"):
        list(sniff(written(tmp_path, "\ufeffa,b\n1,2\n3", mark)).pieces(["a"]))


def test_a_given_format_is_not_inferred(tmp_path: Path) -> None:
    path = written(tmp_path, "a;b\n1;2\n")
    assert sniff(path, separator=",").header == ["a;b"]
    assert sniff(path, decimal=",").decimal == ","


def test_quoted_cells_hold_separators(tmp_path: Path) -> None:
    found = sniff(written(tmp_path, '"a, or b",c\n"1.5",2\n'))
    assert found.header == ["a, or b", "c"]
    assert pd.concat(found.pieces(["a, or b"])).iloc[0, 0] == 1.5


def test_decimal_commas_only_where_no_cell_has_a_point(tmp_path: Path) -> None:
    assert sniff(written(tmp_path, "a;b\n1,5;x\n")).decimal == ","
    assert sniff(written(tmp_path, "a;b\n1,5;2.5\n")).decimal == "."


def test_pieces_count_their_rows_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "_PIECE", 4)
    path = written(tmp_path, "a,b\n" + "".join(f"{row},{row * row}\n" for row in range(10)))
    pieces = list(sniff(path).pieces(["b"]))
    assert [len(piece) for piece in pieces] == [4, 4, 2]
    assert pd.concat(pieces)["b"].to_dict() == {row: row * row for row in range(10)}
    monkeypatch.setattr(limits, "MOST_ROWS", 9)
    with pytest.raises(RecordingError, match="has more than 9 rows; cut it into several runs"):
        list(sniff(path).pieces(["b"]))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "holds no samples"),
        (b" \n\n", "holds no samples"),
        (b"a,b\n1,\x002\n", "is not text but binary data"),
        (b"\xff\xfea\x00\x00", "is not text but binary data"),
        (
            b"a,b\n1,2,3\n",
            r"row 1 has 3 cells, the header 2; numbers with decimal commas need another separator",
        ),
        (b"a;b\n1;2;3\n", r"row 1 has 3 cells, the header 2$"),
    ],
)
def test_what_is_no_table_is_refused(content: bytes, said: str, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_bytes(content)
    with pytest.raises(RecordingError, match=said):
        sniff(tmp_path / "run.csv")


def test_a_packed_file_is_unpacked_and_a_broken_one_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv.GZ"
    path.write_bytes(gzip.compress(b"a,b\n1,2\n"))
    with opened(path) as file:
        assert file.read() == b"a,b\n1,2\n"
    path.write_bytes(b"a,b\n1,2\n")
    with pytest.raises(RecordingError, match="is not a whole gzip file"):
        sniff(path)


def test_limits_of_bytes_and_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "_LONGEST_LINE", 10)
    with opened(written(tmp_path, "0123456789\n" * 20)) as file:
        assert len(file.read()) == 220
    with (
        pytest.raises(RecordingError, match="a line of more than 10 bytes"),
        opened(written(tmp_path, "01234567890")) as file,
    ):
        file.read()
    with (
        pytest.raises(RecordingError, match="a line of more than 10 bytes"),
        opened(written(tmp_path, "a\n01234567890")) as file,
    ):
        file.read()
    monkeypatch.setattr(limits, "MOST_BYTES", 100)
    with (
        pytest.raises(RecordingError, match="GB, unpacked; cut it"),
        opened(written(tmp_path, "a\n" * 51)) as file,
    ):
        file.read()


def test_last_line_with_an_empty_cell_is_not_a_cut_one(table: pd.DataFrame, csv: Write) -> None:
    table.loc[599, "power_w"] = np.nan
    assert len(read_recording(csv(table))) == 600


@pytest.mark.parametrize("packed", [False, True])
def test_half_last_line(table: pd.DataFrame, csv: Write, tmp_path: Path, packed: bool) -> None:
    text = csv(table).read_bytes().rstrip(b"\n")
    text = text[: text.rindex(b",")]
    path = tmp_path / ("run.csv.gz" if packed else "run.csv")
    path.write_bytes(gzip.compress(text) if packed else text)
    assert "last line is cut off (3 of 4 cells)" in refusal(path)


def test_binary_in_a_csv(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    assert "binary" in refusal(path)


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_tables_as_other_programs_write_them(
    table: pd.DataFrame, tmp_path: Path, separator: str, decimal: str, encoding: str
) -> None:
    path = tmp_path / "run.csv"
    table.assign(**{"Temp °C": 20.5}).to_csv(
        path, sep=separator, decimal=decimal, encoding=encoding, index=False
    )
    recording = read_recording(path)
    for name in table:
        np.testing.assert_allclose(recording.channels[str(name)], table[name], rtol=1e-12)
    plain = separator == "," and decimal == "." and encoding in ("utf-8", "utf-8-sig")
    assert len(recording.notes) == (0 if plain else 1)


@pytest.mark.parametrize(
    ("head", "notes"),
    [
        (
            "# logger 3.1\n#\ntime_s,speed_mps,power_w\n",
            "2 lines of comment before the names left out",
        ),
        ("# time_s,speed_mps,power_w\n", ""),  # as numpy.savetxt writes it
        ("# logger\n# time_s,speed_mps,power_w\n", "1 line of comment before the names left out"),
        ("time_s,speed_mps,power_w\ns,m/s,W\n", "the line of units after the names left out"),
        (
            "# a\ntime_s,speed_mps,power_w\n[s],[m/s],[W]\n",
            "left out, the line of units after the names left out",
        ),
    ],
)
def test_comments_and_units_around_the_names(
    table: pd.DataFrame, tmp_path: Path, head: str, notes: str
) -> None:
    path = tmp_path / "run.csv"
    rows = table[["time_s", "speed_mps", "power_w"]].to_csv(index=False, header=False)
    path.write_text(head + rows)
    recording = read_recording(path)
    np.testing.assert_allclose(recording.channels["power_w"], table["power_w"], rtol=1e-12)
    assert (
        len(recording) == 600
        and notes in "".join(recording.notes)
        and bool(notes) == bool(recording.notes)
    )


def test_cells_between_spaces(table: pd.DataFrame, tmp_path: Path) -> None:
    path = tmp_path / "run.txt"
    columns = ["time_s", "speed_mps", "power_w"]
    np.savetxt(path, table[columns], "%12.6f", header=" ".join(columns))
    recording = read_recording(path)
    np.testing.assert_allclose(recording.channels["speed_mps"], table["speed_mps"], atol=1e-6)
    assert recording.notes == ("read with cells separated by spaces",)


def test_a_name_with_spaces_is_one_name(table: pd.DataFrame, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("the time of day\n1\n2\n")
    assert "it has the time of day" in refusal(tmp_path / "run.csv")
    table.to_csv(tmp_path / "run.tsv", sep="\t", index=False)
    assert len(read_recording(tmp_path / "run.tsv")) == 600


def test_commas_for_both_cells_and_decimals_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(
        "time_s,speed_mps,power_w\n" + "".join(f"0,{row},1,0,5,5\n" for row in range(9))
    )
    assert "row 1 has 6 cells, the header 3; numbers with decimal commas" in refusal(path)


def test_a_half_line_of_a_wide_encoding(table: pd.DataFrame, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    text = table.to_csv(index=False).rstrip("\n")
    path.write_text(text[: text.rindex(",")], "utf-16")
    assert "last line is cut off (3 of 4 cells)" in refusal(path)


@pytest.mark.parametrize(
    ("lines", "said"),
    [(b"0,0,0\n", "more than 100000 rows"), (b"0" * 2**16, "a line of more than 1048576 bytes")],
)
def test_a_file_that_unpacks_to_gigabytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: bytes, said: str
) -> None:
    monkeypatch.setattr("homeward.logs.limits.MOST_ROWS", 100_000)
    path = tmp_path / "run.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(b"time_s,speed_mps,power_w\n")
        for _ in range(1000):
            file.write(lines * (600 if len(lines) < 10 else 1))
    assert said in refusal(path)
    monkeypatch.setattr("homeward.logs.limits.MOST_BYTES", 2**20)
    monkeypatch.setattr("homeward.logs.limits.MOST_ROWS", 10**9)
    assert "GB, unpacked" in refusal(path) or len(lines) > 10
