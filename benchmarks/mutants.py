"""Print which small faults the tests notice: one changed operator, comparison or number in each of
some lines.

    python benchmarks/mutants.py --lines 30 --seed 1

The lines are drawn from those of `homeward`, `envs` and `agents` as they are now, where a statement
that Python executes holds something to change: no docstrings, imports, type hints, blocks for type
checkers, protocols or overloads. The commit is printed, as a seed draws other lines from other
code. Each fault is made in a copy of the checkout and run against the tests near it: all faults
against the tests of their file, those that are left against the tests of their folder, then against
those that import their file, and then against all others.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import tyro
from rich.console import Console

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.tables import table

ROOT = Path(__file__).parents[1]
FOLDERS = ("homeward", "envs", "agents")
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
"""What each operator becomes."""
STAGES = ("its file", "its folder", "those that import it", "all")
LONGEST_S = 1800.0
"""Time, s, after which tests of a fault do not end. Chosen: all tests take a quarter of it."""


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
    tree = ast.parse(file.read_text("utf-8"))
    described = _only_described(tree)
    for number, node in enumerate(ast.walk(tree)):
        if isinstance(node, ast.expr) and node not in described and _change(node):
            nodes.setdefault(node.lineno, []).append(number)
    return nodes


def _only_described(tree: ast.Module) -> set[ast.AST]:
    """Nodes that describe code to readers and type checkers, and that no test could notice.

    Docstrings and imports hold nothing that `_change` changes; these do: type hints, what stands
    below `if TYPE_CHECKING`, and classes and functions that only say which calls there are.
    """
    tops: list[ast.AST] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign | ast.arg) and node.annotation is not None:
            tops.append(node.annotation)
        elif isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            tops += node.body
        elif isinstance(node, ast.ClassDef | ast.FunctionDef) and _says_only_calls(node):
            tops.append(node)
        elif isinstance(node, ast.FunctionDef) and node.returns is not None:
            tops.append(node.returns)
    return {node for top in tops for node in ast.walk(top)}


def _says_only_calls(node: ast.ClassDef | ast.FunctionDef) -> bool:
    """Whether a class is a protocol, or a function an overload."""
    if isinstance(node, ast.ClassDef):
        return any("Protocol" in ast.unparse(base) for base in node.bases)
    return any("overload" in ast.unparse(decorator) for decorator in node.decorator_list)


def mutant_of(file: Path, number: int) -> Mutant:
    """A file with one node changed."""
    text = file.read_text("utf-8")
    tree = ast.parse(text)
    before = ast.unparse(tree).splitlines()
    node = list(ast.walk(tree))[number]
    _change(node)
    after = ast.unparse(tree).splitlines()
    old, new = next((old, new) for old, new in zip(before, after, strict=False) if old != new)
    assert isinstance(node, ast.expr)
    return Mutant(file, node.lineno, old.strip(), new.strip(), _source(text, tree, node))


def _source(text: str, tree: ast.Module, node: ast.expr) -> str:
    """Text of a changed tree: as before but for the node, because tests also read comments and
    layout."""
    lines = text.encode().splitlines(keepends=True)
    assert node.end_lineno is not None and node.end_col_offset is not None
    start = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    content = b"".join(lines)
    try:
        source = (content[:start] + f"({ast.unparse(node)})".encode() + content[end:]).decode()
        is_same_tree = ast.dump(ast.parse(source)) == ast.dump(tree)
    except (SyntaxError, UnicodeDecodeError):
        is_same_tree = False
    # in an f-string, Python 3.11 has no places of nodes
    return source if is_same_tree else ast.unparse(tree)


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
    """Faults of different lines: all lines that can be changed are equally likely, and then all
    changes of a line.

    A longer draw of the same seed begins with the shorter one.
    """
    files = [file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py"))]
    lines = [(file, nodes) for file in files for nodes in changeable(file).values()]
    mutants = []
    for place in rng.permutation(len(lines))[:count]:
        file, nodes = lines[place]
        mutants.append(mutant_of(file, int(rng.choice(nodes))))
    return mutants


def tests_of(mutant: Mutant, checkout: Path, stage: int) -> tuple[list[str], list[str]]:
    """Tests of a stage, and those in them that earlier stages ran."""
    inside = mutant.file.relative_to(ROOT)
    module = Path(*[part for part in inside.parts if part != "homeward"])
    folder = Path("tests", *module.parts[:-1])
    nearest = next(place for place in (folder, *folder.parents) if (checkout / place).is_dir())
    # The links in `homeward` are what the tests collect: a file's own examples belong to it.
    examples = Path("homeward", module)
    file = [
        str(path)
        for path in (folder / f"test_{module.name}", examples)
        if (checkout / path).exists()
    ]
    near = [str(nearest)]
    if nearest == Path("tests"):  # of a file at the top: without the other folders
        near = [
            str(path.relative_to(checkout))
            for path in sorted((checkout / nearest).glob("test_*.py"))
        ]
    name = re.compile(rf"\b{re.escape('.'.join(examples.with_suffix('').parts))}\b")
    importing = [
        str(path.relative_to(checkout))
        for path in sorted((checkout / "tests").rglob("test_*.py"))
        if name.search(path.read_text("utf-8"))
    ]
    stages = (file, near, importing, ["tests", "homeward", "README.md", "docs"])
    seen = [path for tests in stages[:stage] for path in tests]
    return [path for path in stages[stage] if not _within(path, seen)], seen


def _within(path: str, folders: list[str]) -> bool:
    return any(Path(path).is_relative_to(folder) for folder in folders)


def noticed_by(mutant: Mutant, checkout: Path, stage: int) -> str:
    """The first test of a stage that fails with a fault; empty: none does."""
    tests, seen = tests_of(mutant, checkout, stage)
    if not tests:
        return ""
    place = checkout / mutant.file.relative_to(ROOT)
    original = place.read_text("utf-8")
    place.write_text(mutant.source, "utf-8")
    try:
        return _first_failure(checkout, tests, seen)
    finally:
        place.write_text(original, "utf-8")


def _first_failure(checkout: Path, tests: list[str], seen: list[str]) -> str:
    """The first of some tests that fails in a checkout; empty: all pass."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-n",
        "2",
        "--dist",
        "worksteal",
        "-p",
        "no:cacheprovider",
    ]
    command += [f"--ignore={path}" for path in seen]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    with subprocess.Popen(
        [*command, *tests],
        cwd=checkout,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            output, _ = process.communicate(timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return "a test that does not end"
    if process.returncode in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        return ""
    if process.returncode == pytest.ExitCode.USAGE_ERROR:
        raise RuntimeError(f"pytest cannot run {tests}:\n{output}")
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
    return failed[1] if failed else output.strip().splitlines()[-1]


def main(args: Args) -> None:
    """Draw the faults, try them stage by stage, and print the table."""
    console = Console()
    rng = np.random.default_rng(args.seed)
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True
    )
    console.print(f"commit {commit.stdout.strip() or 'unknown'}")
    faults = dict(enumerate(drawn(args.lines, rng), 1))
    if args.only:
        faults = {number: fault for number, fault in faults.items() if number in args.only}
    noticed: dict[int, str] = {}  # by which test
    with tempfile.TemporaryDirectory() as folder:
        checkout = Path(folder) / "checkout"
        tracked = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        for name in filter(None, tracked.split("\0")):
            (checkout / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, checkout / name, follow_symlinks=False)
        for stage, tests in enumerate(STAGES):
            for number, fault in faults.items():
                if noticed.get(number):
                    continue
                noticed[number] = noticed_by(fault, checkout, stage)
                shown = noticed[number] or f"not by the tests of: {tests}"
                console.print(
                    f"{number} {fault.place}: {shown}",
                    markup=False,
                    highlight=False,
                    soft_wrap=True,
                )
    shown_faults = table(
        f"{args.lines} lines, seed {args.seed}", ("", "line", "before", "after", "noticed by"), ()
    )
    for number, fault in faults.items():
        shown_faults.add_row(
            str(number), fault.place, fault.before, fault.after, noticed[number] or "none"
        )
    console.print(shown_faults)
    console.print(f"noticed: {sum(test != '' for test in noticed.values())} of {len(faults)}")


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
