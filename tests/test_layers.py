"""Dependencies point one way: physics <- envs <- agents, physics <- estimation <- agents,
estimation <- companion, physics and logs <- diagnosis; `import homeward` stays light; and only the
tests of the benchmarks need them."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

import homeward

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "homeward/physics": {
        "homeward.envs", "homeward.agents", "homeward.diagnosis", "homeward.estimation", "homeward.companion",
    },
    "homeward/estimation": {"homeward.envs", "homeward.agents", "homeward.diagnosis", "homeward.companion"},
    "homeward/companion": {"homeward.envs", "homeward.agents", "homeward.diagnosis"},
    "homeward/logs": {
        "homeward.envs", "homeward.agents", "homeward.diagnosis", "homeward.estimation", "homeward.companion",
        "homeward.physics", "homeward.groups", "homeward.watch",
    },
    "homeward/diagnosis": {
        "homeward.envs", "homeward.agents", "homeward.estimation", "homeward.companion", "homeward.groups",
    },
    "homeward/layout": {
        "homeward.envs", "homeward.agents", "homeward.diagnosis", "homeward.estimation", "homeward.companion",
        "homeward.groups", "homeward.watch", "homeward.physics", "homeward.logs",
    },
    "homeward/groups": {"homeward.envs", "homeward.agents", "homeward.estimation", "homeward.companion"},
    "envs": {"homeward.agents", "homeward.diagnosis", "homeward.estimation", "homeward.companion"},
    "agents": {"homeward.diagnosis", "homeward.companion"},
}  # fmt: skip
PHYSICS_MAY_IMPORT = {
    "homeward",
    "filelock",
    "llvmlite",
    "numba",
    "numpy",
} | sys.stdlib_module_names
"""llvmlite is a part of numba; with filelock one process compiles, and the others wait."""
LEARNING = {"stable_baselines3", "tensorboard", "torch"}
HEAVY = ("torch.", "stable_baselines3.", "matplotlib.pyplot.", "pandas.", "scipy.")


def python_files(folder: str) -> list[Path]:
    """Python files of the checkout under a folder; `rglob` does not enter the linked folders a
    second time."""
    return sorted((ROOT / folder).rglob("*.py"))


def module_name(file: Path) -> str:
    """Import name of a file of the package, wherever its folder lies."""
    parts = list(file.relative_to(ROOT).with_suffix("").parts)
    if parts[0] in ("envs", "agents"):
        parts.insert(0, "homeward")
    return ".".join(parts)


def imports(tree: ast.AST, module: str) -> Iterator[str]:
    """Names that the import statements of a module or a statement refer to, relative ones made
    absolute."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # The file's own name counts as the first level, for `__init__` as for any other file.
            base = [*module.split(".")[: -node.level], node.module] if node.level else [node.module]
            prefix = ".".join(part for part in base if part)
            yield from (f"{prefix}.{alias.name}" for alias in node.names)


def imports_on_load(file: Path) -> set[str]:
    """Names imported when the file is loaded: outside functions and `if TYPE_CHECKING`."""
    names: set[str] = set()
    pending: list[ast.AST] = [ast.parse(file.read_text("utf-8"))]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            names.update(imports(node, module_name(file)))
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            pending.extend(node.orelse)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            pending.extend(ast.iter_child_nodes(node))
    return names


def all_imports(file: Path) -> set[str]:
    """Names imported anywhere in the file, in functions too."""
    return set(imports(ast.parse(file.read_text("utf-8")), module_name(file)))


def within(name: str, packages: set[str]) -> bool:
    """Whether a dotted name is one of the packages or lies in one."""
    return any(name == package or name.startswith(package + ".") for package in packages)


@pytest.mark.parametrize("folder", FORBIDDEN)
def test_dependencies_point_one_way(folder: str) -> None:
    files = python_files(folder)
    assert files, f"{folder} holds no Python file"
    wrong = [
        f"{file.relative_to(ROOT)} imports {name}"
        for file in files
        for name in sorted(all_imports(file))
        if within(name, FORBIDDEN[folder])
    ]
    assert not wrong, "\n".join(wrong)


def files_in_circles(imported: dict[str, set[str]]) -> list[list[str]]:
    """Modules that import each other, also in functions and for types only: each circle by the
    names of its modules."""
    modules = sorted(imported)
    arrows = np.array([[target in imported[module] for target in modules] for module in modules])
    circles, number = connected_components(arrows, connection="strong")
    members = [
        [modules[index] for index in np.flatnonzero(number == circle)] for circle in range(circles)
    ]
    return [circle for circle in members if len(circle) > 1]


def test_no_files_import_each_other() -> None:
    """A package's `__init__`, which hands names on, is left out."""
    files = [
        file
        for folder in ("homeward", "envs", "agents", "benchmarks")
        for file in python_files(folder)
    ]
    names = {module_name(file): file for file in files if file.stem != "__init__"}
    imported: dict[str, set[str]] = {}
    for module, file in names.items():
        asked = all_imports(file)  # of a module or of a name in it
        imported[module] = (asked | {name.rpartition(".")[0] for name in asked}) & set(names) - {
            module
        }
    assert files_in_circles(imported) == []
    assert imported["homeward.commands.range_plot"] == {"homeward.commands.range_parts"}


def test_a_circle_is_seen() -> None:
    assert files_in_circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]


def test_no_package_has_a_name_that_hides_a_module_of_it() -> None:
    """`import homeward.a.b as b` would give the name b of `homeward.a`, and not the file
    `homeward/a/b.py`."""
    hidden = []
    for file in (
        file for folder in ("homeward", "envs", "agents") for file in python_files(folder)
    ):
        package = module_name(file.parent)
        if file.stem == "__init__":
            named = (name.rpartition(".") for name in imports_on_load(file))
            hidden += [
                f"{package}.{name}" for origin, _, name in named
                if origin != package and (file.parent / f"{name}.py").is_file()
            ]  # fmt: skip
    assert hidden == []


def test_physics_needs_only_numpy_and_numba() -> None:
    wrong = [
        f"{file.relative_to(ROOT)} imports {name}"
        for file in python_files("homeward/physics")
        for name in sorted(all_imports(file))
        if name.split(".")[0] not in PHYSICS_MAY_IMPORT
    ]
    assert not wrong, "\n".join(wrong)


def test_only_learning_imports_its_libraries() -> None:
    agents = [
        file
        for file in python_files("agents")
        if not file.is_relative_to(ROOT / "agents" / "learning")
    ]
    scripts = [ROOT / "evaluate.py", ROOT / "diagnose.py"]
    wrong = [
        f"{file.relative_to(ROOT)} imports {name}"
        for file in [*python_files("homeward"), *python_files("envs"), *agents, *scripts]
        for name in sorted(all_imports(file))
        if within(name, LEARNING)
    ]
    assert not wrong, "\n".join(wrong)


MAY_LOOK = {"oracle", "trained/provenance.py", "evaluation/episodes.py"}
"""What looks behind the observations: the oracle, hashes, and the trace of an evaluation."""


def looks_behind(tree: ast.AST) -> Iterator[str]:
    """What of an environment's hidden side a module names."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and node.id in ("Hidden", "constants_of", "HIDDEN_DTYPE"):
            yield node.id
        elif isinstance(node, ast.alias) and node.name in (
            "Hidden",
            "constants_of",
            "HIDDEN_DTYPE",
        ):
            yield node.name
        elif isinstance(node, ast.Attribute):
            named = ast.unparse(node)
            of_batch = node.attr in (
                "robots",
                "routes",
                "constants",
                "records",
            ) and "batch" in ast.unparse(node.value)
            if of_batch or (node.attr == "hidden" and "batch" in named):
                yield named


def test_agents_do_not_look_behind_what_is_observed() -> None:
    wrong = []
    for file in python_files("agents"):
        part = file.relative_to(ROOT / "agents")
        if not {part.as_posix(), part.parts[0]} & MAY_LOOK:
            found = set(looks_behind(ast.parse(file.read_text("utf-8"))))
            # The potential of a state, which shaping takes back when a mission is lost for being
            # late.
            found -= (
                {"self.missions.batch.records"}
                if part.as_posix() == "learning/sb3_adapter.py"
                else set()
            )
            wrong += [f"agents/{part} names {name}" for name in sorted(found)]
    assert not wrong, "\n".join(wrong)


def test_the_check_sees_how_one_may_look() -> None:
    source = "def f(env):\n a = env.batch.hidden.robot\n b = env.batch.robots[0]\n c = Hidden\n"
    source += " d = batch.routes['places']\n"
    source += "from homeward.envs.options import Hidden, constants_of\nself.hidden = 3\n"
    assert sorted(looks_behind(ast.parse(source))) == [
        "Hidden", "Hidden", "batch.routes", "constants_of", "env.batch.hidden", "env.batch.robots",
    ]  # fmt: skip


def test_only_tests_of_the_benchmarks_import_them() -> None:
    files = [
        file
        for file in python_files("tests")
        if not file.is_relative_to(ROOT / "tests" / "benchmarks")
    ]
    assert len(files) > 50
    wrong = [
        f"{file.relative_to(ROOT)} imports {name}"
        for file in files
        for name in sorted(all_imports(file))
        if within(name, {"benchmarks", "plants"})
    ]
    assert not wrong, "\n".join(wrong)


def test_the_fixed_way_is_simulated_without_what_is_tested() -> None:
    """Only its command and its score know the diagnosis."""
    folder = "benchmarks/concealed/fixed_way"
    package = folder.replace("/", ".")
    simulation = [file for file in python_files(folder) if file.stem not in ("__main__", "score")]
    assert len(simulation) > 5
    wrong = [
        f"{file.relative_to(ROOT)} imports {name}"
        for file in simulation
        for name in sorted(all_imports(file))
        if within(name, {"homeward", "benchmarks"}) and not within(name, {package})
    ]
    assert not wrong, "\n".join(wrong)


def test_no_module_of_the_package_loads_pyplot() -> None:
    wrong = [
        f"{file.relative_to(ROOT)} imports {name} when it is loaded"
        for folder in ("homeward", "envs", "agents")
        for file in python_files(folder)
        if "plot" not in file.stem
        for name in sorted(imports_on_load(file))
        if within(name, {"matplotlib.pyplot"})
    ]
    assert not wrong, "\n".join(wrong)


def test_imports_are_light() -> None:
    code = (  # numba itself loads scipy to see its version
        "import sys, numba, gymnasium; before = set(sys.modules); import homeward, homeward.envs, homeward.agents; "
        f"print([name for name in sorted(set(sys.modules) - before) if (name + '.').startswith({HEAVY})])"
    )
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert (run.returncode, run.stdout.strip()) == (0, "[]"), run.stdout + run.stderr


@pytest.mark.parametrize("name", ["envs", "agents"])
def test_bare_name_is_refused(name: str) -> None:
    run = subprocess.run(
        [sys.executable, "-c", f"import {name}"], cwd=ROOT, capture_output=True, text=True
    )
    assert run.returncode != 0
    assert (
        run.stderr.strip().splitlines()[-1].startswith(f"ImportError: import it as homeward.{name}")
    )


def test_the_checks_see_every_form_of_import() -> None:
    source = "from .. import agents\nfrom ..envs import base\nimport homeward.agents.base\ndef f():\n    import torch\n"
    names = set(imports(ast.parse(source), "homeward.physics.model"))
    assert names == {"homeward.agents", "homeward.envs.base", "homeward.agents.base", "torch"}


def test_what_the_readme_calls_is_there_after_one_import() -> None:
    code = "import homeward; print(callable(homeward.diagnosis.diagnose), callable(homeward.companion.Companion))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (run.returncode, run.stdout.strip()) == (0, "True True"), run.stderr
    with pytest.raises(AttributeError, match="no attribute 'diagnoses'"):
        homeward.diagnoses  # noqa: B018
