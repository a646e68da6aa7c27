"""Print which small faults the tests notice: one changed operator, comparison or number in each of some lines.

    python benchmarks/mutants.py --lines 30 --seed 1

The lines are drawn from those of `homeward`, `envs` and `agents` that hold something to change. Each fault is made in a
copy of the checkout and run against the tests of its own folder and, if they pass, against all others.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import tyro
from rich.console import Console

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own

from benchmarks.tables import table

ROOT = Path(__file__).parents[1]
FOLDERS = ("homeward", "envs", "agents")
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
"""What each operator becomes."""


@dataclass(frozen=True)
class Args:
    """Which faults."""

    lines: int = 30
    """Number of lines."""
    seed: int = 0
    """Seed of the draw."""
    only: tuple[int, ...] = ()
    """Which of the lines to try, by their numbers in the draw, from 1; by default all."""


@dataclass(frozen=True)
class Mutant:
    """A changed line of a file."""

    file: Path
    line: int
    before: str
    after: str
    source: str

    @property
    def place(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line}"


def changeable(file: Path) -> dict[int, list[int]]:
    """Nodes of a file that can be changed: their numbers in the order of `ast.walk`, by line."""
    nodes: dict[int, list[int]] = {}
    for number, node in enumerate(ast.walk(ast.parse(file.read_text("utf-8")))):
        if isinstance(node, ast.expr) and _change(node):
            nodes.setdefault(node.lineno, []).append(number)
    return nodes


def mutant_of(file: Path, number: int) -> Mutant:
    """A file with one node changed."""
    tree = ast.parse(file.read_text("utf-8"))
    before = ast.unparse(tree).splitlines()
    node = list(ast.walk(tree))[number]
    _change(node)
    source = ast.unparse(tree)
    pairs = zip(before, source.splitlines(), strict=False)
    old, new = next(pair for pair in pairs if pair[0] != pair[1])
    assert isinstance(node, ast.expr)
    return Mutant(file, node.lineno, old.strip(), new.strip(), source)


def _change(node: ast.AST) -> bool:
    """Change a node in place; False if there is nothing to change."""
    if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPPED:
        node.op = SWAPPED[type(node.op)]()  # type: ignore[assignment]
        return True
    if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
        node.ops[0] = SWAPPED[type(node.ops[0])]()  # type: ignore[call-overload]
        return True
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        node.value = not node.value if isinstance(node.value, bool) else node.value + 1
        return True
    return False


def drawn(count: int, rng: np.random.Generator) -> list[Mutant]:
    """Faults of different lines: all lines that can be changed are equally likely, and then all changes of a line."""
    files = [file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py"))]
    lines = [(file, nodes) for file in files for nodes in changeable(file).values()]
    chosen = rng.choice(len(lines), count, replace=False)
    return [mutant_of(lines[line][0], int(rng.choice(lines[line][1]))) for line in chosen]


def noticed_by(mutant: Mutant, checkout: Path) -> str:
    """Which tests fail with a fault: those of its folder, others, or none."""
    inside = mutant.file.relative_to(ROOT)
    place = checkout / inside
    original = place.read_text("utf-8")
    place.write_text(mutant.source, "utf-8")
    try:
        own, *wider = _folders(inside, checkout)
        if not _pass(checkout, own, []):
            return "its folder"
        seen = own
        for tests in wider:
            if not _pass(checkout, tests, seen):
                return "others"
            seen = tests
        return "none"
    finally:
        place.write_text(original, "utf-8")


def _folders(inside: Path, checkout: Path) -> list[list[str]]:
    """Tests of a file, from its own folder to all: those near it usually notice a fault first."""
    folder = Path("tests", *[part for part in inside.parts[:-1] if part != "homeward"])
    folders = [
        [str(place)] for place in (folder, *folder.parents) if len(place.parts) > 1 and (checkout / place).is_dir()
    ]
    if not folders:  # of a file at the top: without the other folders
        folders = [[str(path.relative_to(checkout)) for path in sorted((checkout / "tests").glob("test_*.py"))]]
    return [*folders, ["tests", "homeward", "README.md", "docs"]]


def _pass(checkout: Path, tests: list[str], seen: list[str]) -> bool:
    """Whether tests pass in a checkout, without those that were seen to; it stops at the first that fails."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "2", "--dist", "worksteal", "-p", "no:cacheprovider"]
    command += [f"--ignore={path}" for path in seen]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    code = subprocess.run([*command, *tests], cwd=checkout, env=environment, capture_output=True).returncode
    return code in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)


def main(args: Args) -> None:
    """Draw the faults, try each, and print the table."""
    console, rng = Console(), np.random.default_rng(args.seed)
    shown = table(f"{args.lines} lines, seed {args.seed}", ("", "line", "before", "after", "noticed by"), ())
    missed, tried = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        checkout = Path(folder) / "checkout"
        tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in filter(None, tracked.split("\0")):
            (checkout / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, checkout / name, follow_symlinks=False)
        for number, mutant in enumerate(drawn(args.lines, rng), 1):
            if args.only and number not in args.only:
                continue
            by = noticed_by(mutant, checkout)
            tried += 1
            missed += by == "none"
            shown.add_row(str(number), mutant.place, mutant.before, mutant.after, by)
            console.print(f"{number} {mutant.place}: {by}", markup=False, highlight=False)
    console.print(shown)
    console.print(f"noticed: {tried - missed} of {tried}")


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
