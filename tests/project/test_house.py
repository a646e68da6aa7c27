"""Where things are: small folders, tests that mirror files, and names that mean one thing."""

import ast
import itertools
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

CODE = ("homeward", "envs", "agents", "benchmarks")
MOST_FILES = 15
"""In a folder; `effects` holds one file an effect."""
ACROSS = {
    "agents/policies/test_shipped_policies", "commands/test_parallel_commands", "diagnosis/read/test_instruments",
    "diagnosis/test_command_line", "diagnosis/test_real_recordings", "diagnosis/test_second_diagnosis",
    "diagnosis/test_verdicts", "diagnosis/test_wings", "docs/test_documentation", "docs/test_headlines",
    "envs/conditions/test_randomise", "envs/conditions/test_true_robot", "examples/test_other_stacks",
    "physics/test_paper", "project/test_house", "project/test_makefile", "project/test_packaging",
    "project/test_release", "project/test_thresholds", "robots/test_presets", "robustness/test_broken",
    "robustness/test_killed", "robustness/test_mutated", "test_layers",
    "test_parallel_cluster", "watch/ros2/test_command", "watch/ros2/test_page",
}  # fmt: skip
"""Tests of what is in no one file: files that ship, pages, commands, and what several files do together."""
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
    return (file.relative_to(root) for folder in folders for file in sorted((root / folder).rglob("*.py")))


def test_no_folder_is_too_full_to_read(root: Path) -> None:
    count = Counter(file.parent for file in sources(root, (*CODE, "tests")))
    assert len(count) > 30
    assert {folder: n for folder, n in count.items() if n > MOST_FILES and folder.name != "effects"} == {}


def test_tests_mirror_the_files(root: Path) -> None:
    """`tests/a/test_b.py` is about `a/b.py`, the package `a/b` or, where b is the folder's name, the package `a`."""
    files = [*sources(root, (*CODE, "docs", "examples")), *map(Path, ("train.py", "evaluate.py", "diagnose.py"))]
    inside = [file.relative_to("homeward") if file.parts[0] == "homeward" else file for file in files]
    subjects = {one.as_posix().removesuffix(".py") for file in inside for one in (file, *file.parents)}
    lost = []
    for test in sorted((root / "tests").rglob("test_*.py")):
        folder, name = test.parent.relative_to(root / "tests"), test.stem.removeprefix("test_")
        known = (folder / name).as_posix() in subjects or (folder.name == name and folder.as_posix() in subjects)
        if known == ((folder / test.stem).as_posix() in ACROSS):
            lost.append((folder / test.stem).as_posix())
    assert lost == []


def test_every_file_has_its_test(root: Path) -> None:
    """Its own, `tests/a/test_b.py` for `a/b.py`, or its folder's, `tests/a/test_a.py` or `tests/test_a.py`; an
    `__init__` is its package."""
    tests = {test.relative_to(root / "tests").as_posix() for test in (root / "tests").rglob("test_*.py")}
    alone = []
    for file in sources(root):
        inside = file.relative_to("homeward") if file.parts[0] == "homeward" else file
        folder = inside.parent
        of_folder = f"test_{folder.name}.py"
        own = (folder / f"test_{file.stem}.py", folder / of_folder, folder.parent / of_folder)
        if file.stem != "__init__" and not any(one.as_posix() in tests for one in own):
            alone.append(file.as_posix())
    assert alone == []


def test_a_class_has_its_name_for_itself(root: Path) -> None:
    """All but the arguments of scripts, of which each has its own."""
    names = Counter(
        node.name
        for file in sources(root)
        for node in ast.walk(ast.parse((root / file).read_text("utf-8")))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert [name for name, n in names.items() if n > 1 and name != "Args"] == []


def test_random_generators_are_passed_in(root: Path) -> None:
    """A `SeedSequence` draws nothing: it makes the seeds that Gymnasium and PyTorch ask for."""
    allowed = {"Generator", "SeedSequence"}

    def drawn(node: ast.AST) -> bool:
        if isinstance(node, ast.Attribute):
            return ast.unparse(node.value) in ("np.random", "numpy.random") and node.attr not in allowed
        if isinstance(node, ast.ImportFrom):
            return node.module == "random" or (
                node.module == "numpy.random" and not {one.name for one in node.names} <= allowed
            )
        return isinstance(node, ast.Import) and any(one.name in ("random", "numpy.random") for one in node.names)

    files = sources(root, ("homeward", "envs", "agents"))
    found = {file for file in files if any(map(drawn, ast.walk(ast.parse((root / file).read_text("utf-8")))))}
    assert {file.as_posix() for file in found} == set(SEEDED)


@pytest.mark.parametrize("ending", ["s", "d", "ed", "r", "er"])
def test_no_two_modules_differ_by_an_ending(ending: str, root: Path) -> None:
    """Subcommands are called as their users call them."""
    named = {file.parent.name if file.stem == "__init__" else file.stem for file in sources(root)}
    named -= {file.stem for file in (root / "homeward" / "commands").glob("*.py")}
    assert [name for name in sorted(named) if name + ending in named] == []


def test_no_two_modules_differ_by_a_letter(root: Path) -> None:
    """Within a part; words that only look alike, such as `pace` and `page`, lie far apart."""
    for _, part in itertools.groupby(sources(root), lambda file: file.parent):
        for one, other in itertools.combinations(sorted(file.stem for file in part), 2):
            assert len(one) != len(other) or sum(a != b for a, b in zip(one, other, strict=True)) > 1, (one, other)
