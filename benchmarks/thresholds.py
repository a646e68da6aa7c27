"""Every number of the diagnosis that a comparison reads, and the conditions under which an effect
is named.

`python -m benchmarks.thresholds` lists them with their files and prints their counts. A threshold
of `homeward/diagnosis/thresholds.py` counts once, wherever it is read; so does a number or a
constant of a module that stands in a comparison. What follows from other thresholds is no choice of
its own; errors of instruments, the cost of a change point, and the priors of the fit made to
predict are no limits.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from homeward.diagnosis.explain.conditions import CONDITIONS, TOGETHER

FOLDER = Path(__file__).resolve().parents[1] / "homeward" / "diagnosis"
THRESHOLDS = FOLDER / "thresholds.py"
STRUCTURE = frozenset({0, 1, 2})
"""Numbers of a comparison that count things or name a sign: none, one, two."""
NO_LIMITS = frozenset(
    {"GAUGE_GAIN_SD", "CURVE_SD", "CAPACITY_SD", "SMOOTHING_ERROR", "COST_OF_A_CHANGE"}
)
"""Standard errors of instruments and a count of parameters, which no comparison reads alone."""


def named() -> dict[str, set[str]]:
    """Files of the diagnosis that read each threshold, by its name."""
    readers: dict[str, set[str]] = {}
    for statement in ast.parse(THRESHOLDS.read_text()).body:
        if isinstance(statement, ast.Assign) and not _follows_from_others(statement.value):
            for target in statement.targets:
                parts = target.elts if isinstance(target, ast.Tuple) else [target]
                readers |= {part.id: set() for part in parts if isinstance(part, ast.Name)}
    for path in sorted(FOLDER.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and node.attr in readers:
                readers[node.attr].add(str(path.relative_to(FOLDER)))
            elif isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    if alias.name in readers:
                        readers[alias.name].add(str(path.relative_to(FOLDER)))
    return readers


def _follows_from_others(value: ast.expr) -> bool:
    """Whether a value is derived from other thresholds, with no number of its own but those that
    count or halve."""
    nodes = list(ast.walk(value))
    numbers = {node.value for node in nodes if isinstance(node, ast.Constant)}
    return numbers <= STRUCTURE and any(isinstance(node, ast.Name) for node in nodes)


def written() -> list[tuple[str, str]]:
    """Comparisons that hold a number or a constant of their module, as file and text."""
    found = []
    for path in sorted(FOLDER.rglob("*.py")):
        tree = ast.parse(path.read_text())
        constants = set(_numeric_constants(tree))
        for node in ast.walk(tree):
            if isinstance(node, ast.Compare) and _has_number(node, constants):
                found.append((str(path.relative_to(FOLDER)), ast.unparse(node)))
    return sorted(set(found))


def _numeric_constants(tree: ast.Module) -> Iterator[str]:
    """Constants of a module that are numbers or tuples of numbers."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and _is_numeric(node.value):
            for target in node.targets:
                parts = target.elts if isinstance(target, ast.Tuple) else [target]
                yield from (part.id for part in parts if isinstance(part, ast.Name))


def _is_numeric(value: ast.expr) -> bool:
    parts = value.elts if isinstance(value, ast.Tuple) else [value]
    return all(
        isinstance(part, ast.Constant) and isinstance(part.value, int | float) for part in parts
    )


def _has_number(compare: ast.Compare, constants: set[str]) -> bool:
    for node in ast.walk(compare):
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            if not isinstance(node.value, bool) and node.value not in STRUCTURE:
                return True
        elif isinstance(node, ast.Name) and node.id in constants:
            return True
    return False


def main() -> None:
    """Print the numbers, the comparisons and the conditions, with their counts."""
    console = Console(width=150)
    limits = {name: files for name, files in named().items() if name not in NO_LIMITS}
    table = Table(title="Thresholds")
    for head in ("name", "read by"):
        table.add_column(head)
    for name, files in limits.items():
        table.add_row(name, ", ".join(sorted(files)))
    console.print(table)
    comparisons = written()
    table = Table(title="Numbers that stand in a comparison")
    for head in ("file", "comparison"):
        table.add_column(head)
    for row in comparisons:
        table.add_row(*row)
    console.print(table)
    console.print(
        f"{len(limits)} thresholds and {len(comparisons)} comparisons with a number of their own; "
        f"{len(CONDITIONS)} conditions under which an effect is named: "
        + ", ".join(condition.name for condition in CONDITIONS)
        + f"; {len(TOGETHER)} on all named effects together: "
        + ", ".join(condition.name for condition in TOGETHER)
    )


if __name__ == "__main__":
    main()
