"""What the terminal and the page show of a comparison."""

import dataclasses
import io
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from homeward.groups.comparison import Comparison, Difference, Level, RunValues
from homeward.groups.report import show_groups, write_groups
from homeward.groups.runs import compare_standing
from tests.groups.recorded import noise, standing

RUNS = tuple(
    RunValues(f"{group}{i}.csv", "0", group, {"P_anc": 5.0 + i, "C_rr": None})
    for group in ("warm", "cold")
    for i in (0, 1)
)
LEVELS = (
    Level("P_anc", "W", "warm", 5.1234, (4.9, 5.3468), 2, 0.14),
    Level("P_anc", "W", "cold", 7.5, None, 1, None),
    Level("C_rr", "1", "warm", 0.14, (0.13, 0.15), 2, 0.01),
)
DIFFERENCE = Difference(
    "P_anc", "W", "cold", "warm", 2.3766, (1.5, 3.2), 0.001, 0.0042, 0.0062, 0.15, 1.25, True
)
COMPARISON = Comparison(
    "standing", "groups_differ", "P_anc is higher.", RUNS, LEVELS, (DIFFERENCE,),
    ("warm0.csv: a remark", "one of none"),
)  # fmt: skip


def shown(comparison: Comparison) -> str:
    terminal = io.StringIO()
    show_groups(comparison, Console(file=terminal, width=200))
    return terminal.getvalue()


def test_recordings_have_their_shortest_distinct_names(tmp_path: Path) -> None:
    paths = [f"/far/away/{folder}/{i}.csv" for folder in ("ice", "snow") for i in (1, 2)]
    steady = [
        standing(10.0 + noise(np.random.default_rng(i), 400, 0.0), path)
        for i, path in enumerate(paths)
    ]
    runs = [dataclasses.replace(one, sha256="0", notes=("a column is left out",)) for one in steady]
    comparison = compare_standing(runs, ["ice", "ice", "snow", "snow"])
    assert comparison.runs[0].path == paths[0]
    write_groups(comparison, tmp_path)
    terminal = io.StringIO()
    show_groups(comparison, Console(file=terminal, width=200))
    for text in ((tmp_path / "groups.html").read_text("utf-8"), terminal.getvalue()):
        assert (
            "ice/1.csv: a column is left out" in text
            and "snow/2.csv" in text
            and "/far/away" not in text
        )


def test_the_terminal_has_a_line_for_each_level_and_difference() -> None:
    lines = [" ".join(line.split()) for line in shown(COMPARISON).splitlines()]
    assert lines[:2] == ["groups_differ", "P_anc is higher."]
    assert "warm P_anc 2 5.123 W 4.900 to 5.347 0.140" in lines
    assert "cold P_anc 1 7.500 W - -" in lines
    assert "warm C_rr 2 0.1400 0.1300 to 0.1500 0.0100" in lines  # a number without a unit
    assert "cold - warm P_anc 2.38 W 1.50 to 3.20 0.0042 0.15 for 1.2 differs" in lines
    assert lines[-2:] == ["- warm0.csv: a remark", "- one of none"]


def test_a_single_group_has_no_verdict_and_no_pairs() -> None:
    alone = dataclasses.replace(
        COMPARISON, runs=RUNS[:2], levels=LEVELS[:1], differences=(), remarks=()
    )
    text = shown(alone)
    assert "groups_differ" not in text and "pair" not in text and "5.123 W" in text


def test_the_files_have_what_the_comparison_has(tmp_path: Path) -> None:
    files = write_groups(COMPARISON, tmp_path / "out")
    assert [file.name for file in files] == ["groups.json", "groups.html"]
    data = json.loads(files[0].read_text("utf-8"))
    assert data == json.loads(COMPARISON.to_json())
    assert (
        data["runs"][0]["values"] == {"P_anc": 5.0, "C_rr": None}
        and data["levels"][1]["ci95"] is None
    )
    page = files[1].read_text("utf-8")
    # A figure for each quantity, with the same numbers for those who do not see it.
    assert "figure-group-0" in page and "figure-group-1" in page and "figure-group-2" not in page
    assert "P_anc, means: warm 5.123 W, 95 % 4.900 to 5.347; cold 7.500 W, 95 % –." in page


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "[red]a[/red]"])
def test_names_given_by_others_are_text(name: str, tmp_path: Path) -> None:
    runs = tuple(dataclasses.replace(one, group=name, path=f"{name}.csv") for one in RUNS[:2])
    given = dataclasses.replace(
        COMPARISON,
        runs=runs,
        levels=(dataclasses.replace(LEVELS[0], group=name),),
        differences=(),
        summary=name,
    )
    write_groups(given, tmp_path)
    assert "<script>alert" not in (tmp_path / "groups.html").read_text("utf-8")
    assert name in shown(given)


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OSError):
        write_groups(COMPARISON, tmp_path / "out")
