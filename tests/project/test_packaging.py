"""What is installed is what lies in the folders."""

import email
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import gymnasium
import pytest
import setuptools
from gymnasium.envs import registration

import homeward

ROOT = Path(__file__).parents[2]
SOURCES = {
    "homeward": ROOT / "homeward",
    "homeward.envs": ROOT / "envs",
    "homeward.agents": ROOT / "agents",
}
SCRIPTS = ("train.py", "evaluate.py", "diagnose.py")


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what a wheel and a source distribution are built from."""
    source = tmp_path_factory.mktemp("built") / "source"
    source.mkdir()
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy(path, source)
    for top in (*SOURCES.values(), ROOT / "tests"):
        shutil.copytree(
            top, source / top.name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    return source


@pytest.fixture(scope="module")
def built(sources: Path) -> Path:
    """A folder with a wheel and a source distribution, built with the setuptools that is
    installed."""
    folder = str(sources.parent)
    code = f"from setuptools import build_meta; build_meta.build_sdist({folder!r}); build_meta.build_wheel({folder!r})"
    subprocess.run([sys.executable, "-c", code], cwd=sources, check=True, capture_output=True)
    return sources.parent


@pytest.fixture(scope="module")
def wheel(built: Path) -> zipfile.ZipFile:
    (file,) = built.glob("*.whl")
    return zipfile.ZipFile(file)


def files_of_packages() -> dict[str, Path]:
    """Every file below the folders of the package, under the path that it is installed at."""
    return {
        "/".join([*package.split("."), *file.relative_to(top).parts]): file
        for package, top in SOURCES.items()
        for file in top.rglob("*")  # does not enter the linked folders
        if file.is_file() and "__pycache__" not in file.parts
    }


def test_packages_are_the_folders_that_hold_python(project: dict[str, Any]) -> None:
    assert set(project["tool"]["setuptools"]["packages"]) == {
        name.rpartition("/")[0].replace("/", ".")
        for name in files_of_packages()
        if name.endswith(".py")
    }


def test_every_package_has_an_init_file(project: dict[str, Any]) -> None:
    mapping = project["tool"]["setuptools"]["package-dir"]
    for package in project["tool"]["setuptools"]["packages"]:
        assert (ROOT / mapping.get(package, package.replace(".", "/")) / "__init__.py").is_file(), (
            package
        )


@pytest.mark.parametrize("name", ["envs", "agents", *(f"commands/{script}" for script in SCRIPTS)])
def test_packages_and_scripts_at_the_top_are_linked_by_relative_links(name: str) -> None:
    link = ROOT / "homeward" / name
    assert link.is_symlink()
    assert os.readlink(link) == (name.count("/") + 1) * "../" + link.name


def test_wheel_holds_the_files_of_the_packages_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    assert {name for name in wheel.namelist() if ".dist-info/" not in name} == set(
        files_of_packages()
    )


def test_source_distribution_holds_the_packages_and_none_of_the_tests(built: Path) -> None:
    (packed,) = built.glob("*.tar.gz")
    with tarfile.open(packed) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {str(path.relative_to(ROOT)) for path in files_of_packages().values()} <= names
    assert {"CHANGELOG.md", "CITATION.cff", "LICENSE", "README.md", "constraints.txt"} <= names
    assert not [name for name in names if name.startswith("tests")]


def links_of(text: str) -> list[str]:
    return re.findall(r"\]\((.*?)\)", text)


def test_a_wheel_shows_the_readme(wheel: zipfile.ZipFile, project: dict[str, Any]) -> None:
    assert "urls" not in project["project"], "its links are absolute now: ask for that"
    (metadata,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    said = email.message_from_string(wheel.read(metadata).decode())
    assert said["Description-Content-Type"] == "text/markdown"
    assert links_of(str(said.get_payload())) == links_of((ROOT / "README.md").read_text("utf-8"))


def test_links_of_the_readme_are_absolute_where_the_project_has_an_address(
    tmp_path: Path, project: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    address = "https://example.org/us/homeward"
    for name in ("README.md", "setup.py"):
        shutil.copy(ROOT / name, tmp_path)
    text = (ROOT / "pyproject.toml").read_text("utf-8").replace("[project.urls]", "[tool.none]")
    (tmp_path / "pyproject.toml").write_text(
        f'{text}\n[project.urls]\nSource = "{address}"\n', "utf-8"
    )
    given: dict[str, str] = {}
    monkeypatch.setattr(setuptools, "setup", given.update)
    runpy.run_path(str(tmp_path / "setup.py"))
    links = links_of(given["long_description"])
    assert all(link.startswith("https://") for link in links)
    version = f"v{project['project']['version']}"
    assert links[0] == f"{address}/raw/{version}/docs/viewer.gif"
    for link in links[1:]:
        if link.startswith(address):
            page = link.removeprefix(f"{address}/blob/{version}/").split("#")[0]
            assert (ROOT / page).is_file(), link


def test_version_is_that_of_the_project(project: dict[str, Any]) -> None:
    assert homeward.__version__ == project["project"]["version"]


def test_entry_point_registers_environments() -> None:
    (entry_point,) = (
        e for e in entry_points(group="gymnasium.envs") if e.value.startswith("homeward.")
    )
    assert entry_point.name == "__root__"
    assert callable(entry_point.load())


def test_registering_needs_nothing_of_a_half_imported_gymnasium(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Versions before 1.0 load the entry point before they have these names.
    monkeypatch.delattr(gymnasium, "registry")
    monkeypatch.delattr(gymnasium, "register")
    monkeypatch.delitem(registration.registry, "homeward/Survey-v0")
    homeward.envs.register()
    assert "homeward/Survey-v0" in registration.registry


def test_make_needs_no_import(tmp_path: Path) -> None:
    code = "import gymnasium; print(gymnasium.make('homeward:homeward/Survey-v0').spec.id)"
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert (run.stdout.strip(), run.stderr) == ("homeward/Survey-v0", ""), run.stderr


def test_every_dependency_is_pinned(project: dict[str, Any]) -> None:
    lines = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    pinned = {line.split("==")[0] for line in lines if line and not line.startswith("#")}
    groups = [
        project["project"]["dependencies"],
        *project["project"]["optional-dependencies"].values(),
    ]
    wanted = [requirement for group in groups for requirement in group]
    assert {requirement.split(">=")[0] for requirement in wanted} <= pinned


def test_uninstalled_checkout_imports() -> None:
    code = (  # forgets the editable install, keeps the dependencies
        "import sys; sys.meta_path = [f for f in sys.meta_path if 'editable' not in repr(f).lower()]; "
        "import homeward.envs, homeward.agents; print(homeward.__file__)"
    )
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert run.stdout.strip() == str(ROOT / "homeward" / "__init__.py"), run.stderr
