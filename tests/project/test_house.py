"""Every file has its test, and random generators are passed in."""

import ast
from collections.abc import Iterator
from pathlib import Path

CODE = ("homeward", "envs", "agents", "benchmarks")
SEEDED = {
    "agents/registry.py": "seed of a request for the agent `random`",
    "agents/trained/onnx_export.py": "a command; which observations check its file is nobody's choice",
    "homeward/commands/evaluate.py": "--seed",
    "homeward/diagnosis/chain.py": "seed of `diagnose`",
    "homeward/diagnosis/read/noise.py": "fixed draws: the noise of a recording has one estimate, whatever the seed",
    "homeward/synthetic.py": "seed of a recording",
    "homeward/watch/ros2/simulated.py": "--seed",
}
"""Files that make a random generator, and why; everywhere else it is passed in."""


def sources(root: Path, folders: tuple[str, ...] = CODE) -> Iterator[Path]:
    """Files of code relative to the checkout; the search does not enter linked folders."""
    return (
        file.relative_to(root)
        for folder in folders
        for file in sorted((root / folder).rglob("*.py"))
    )


def test_every_file_has_its_test(root: Path) -> None:
    """Its own, `tests/a/test_b.py` for `a/b.py`, or its folder's, `tests/a/test_a.py` or
    `tests/test_a.py`; an `__init__` is its package."""
    tests = {
        test.relative_to(root / "tests").as_posix() for test in (root / "tests").rglob("test_*.py")
    }
    alone = []
    for file in sources(root):
        inside = file.relative_to("homeward") if file.parts[0] == "homeward" else file
        folder = inside.parent
        of_folder = f"test_{folder.name}.py"
        own = (folder / f"test_{file.stem}.py", folder / of_folder, folder.parent / of_folder)
        if file.stem != "__init__" and not any(one.as_posix() in tests for one in own):
            alone.append(file.as_posix())
    assert alone == []


def test_random_generators_are_passed_in(root: Path) -> None:
    """A `SeedSequence` draws nothing: it makes the seeds that Gymnasium and PyTorch ask for."""
    allowed = {"Generator", "SeedSequence"}

    def drawn(node: ast.AST) -> bool:
        if isinstance(node, ast.Attribute):
            return (
                ast.unparse(node.value) in ("np.random", "numpy.random")
                and node.attr not in allowed
            )
        if isinstance(node, ast.ImportFrom):
            return node.module == "random" or (
                node.module == "numpy.random" and not {one.name for one in node.names} <= allowed
            )
        return isinstance(node, ast.Import) and any(
            one.name in ("random", "numpy.random") for one in node.names
        )

    files = sources(root, ("homeward", "envs", "agents"))
    found = {
        file
        for file in files
        if any(map(drawn, ast.walk(ast.parse((root / file).read_text("utf-8")))))
    }
    assert {file.as_posix() for file in found} == set(SEEDED)
