"""The wings of the diagnosis build on each other one way: read, fit, explain, tell."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "homeward" / "diagnosis"
WINGS = ("read", "fit", "explain", "tell")


def imported(file: Path) -> Iterator[str]:
    """Wings that a file imports from, also in functions, but not for type checkers alone."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
            "homeward.diagnosis."
        ):
            yield (node.module or "").split(".")[2]


@pytest.mark.parametrize("wing", WINGS)
def test_no_wing_knows_a_later_one(wing: str) -> None:
    files = sorted((FOLDER / wing).rglob("*.py"))
    assert files
    later = WINGS[WINGS.index(wing) + 1 :]
    wrong = [
        f"{file.relative_to(FOLDER)} imports {name}"
        for file in files
        for name in imported(file)
        if name in later
    ]
    assert not wrong


def test_only_the_method_lies_beside_the_wings() -> None:
    beside = {file.stem for file in FOLDER.glob("*.py")}
    assert beside == {"__init__", "chain", "evidence", "result", "thresholds"}
