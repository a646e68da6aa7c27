"""Faults are small, drawn by a seed, and noticed where they are tested."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import mutants
from benchmarks.mutants import changeable, drawn, mutant_of, noticed_by

SOURCE = "def double(number):\n    if number > 3:  # µ\n        return number + number\n    return 2 * number\n"
NEGLIGENT = "def test_it():\n    assert True\n"
CAREFUL = "from homeward.double import double\n\n\ndef test_it():\n    assert [double(n) for n in (1, 4)] == [2, 8]\n"


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    for folder in ("homeward", "tests/homeward", "docs"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "homeward" / "double.py").write_text(SOURCE)
    (tmp_path / "README.md").touch()
    (tmp_path / "pyproject.toml").write_text('[tool.pytest.ini_options]\npythonpath = ["."]\n')
    return tmp_path


def test_each_fault_changes_one_place(checkout: Path) -> None:
    file = checkout / "homeward" / "double.py"
    faults = [
        mutant_of(file, number) for numbers in changeable(file).values() for number in numbers
    ]
    assert {(fault.line, fault.after) for fault in faults} == {
        (2, "if number <= 3:"), (2, "if number > 4:"), (3, "return number - number"), (4, "return 2 / number"),
        (4, "return 3 * number"),
    }  # fmt: skip
    for fault in faults:  # comments and layout stay
        lines = [
            new
            for new, old in zip(fault.source.splitlines(), SOURCE.splitlines(), strict=True)
            if new != old
        ]
        assert len(lines) == 1


def test_what_only_describes_code_is_not_drawn(checkout: Path) -> None:
    file = checkout / "homeward" / "described.py"
    file.write_text(
        '"""Of 3."""\nfrom typing import TYPE_CHECKING, Literal, Protocol\nif TYPE_CHECKING:\n    ONE = 1\nelse:\n'
        "    ONE = 2\n\n\nclass Steps(Protocol):\n    def step(self, count: int = 1) -> None: ...\n\n\n"
        "def chosen(number: Literal[1, 2]) -> Literal[3]:\n    kept: Literal[3] = 3\n    return kept\n"
    )
    assert sorted(changeable(file)) == [6, 14]
    assert len(changeable(file)[14]) == 1  # the value, and not what its hint says


def test_the_same_seed_draws_the_same_faults(checkout: Path) -> None:
    first, again, other = (drawn(2, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first == again != other
    assert len({(fault.file, fault.line) for fault in first}) == 2
    assert drawn(4, np.random.default_rng(1))[:2] == first


@pytest.mark.parametrize(
    ("test", "by"), [(NEGLIGENT, ""), (CAREFUL, "tests/test_double.py::test_it")]
)
def test_a_fault_is_noticed_where_a_test_asks(checkout: Path, test: str, by: str) -> None:
    (checkout / "tests" / "test_double.py").write_text(test)
    file = checkout / "homeward" / "double.py"
    fault = next(iter(changeable(file)[3]))
    assert noticed_by(mutant_of(file, fault), checkout, 0) == by
    assert file.read_text() == SOURCE
