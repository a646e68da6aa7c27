"""What others build from: the recipe for conda-forge, the image of a robot, and the container for
development."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="module")
def project(root: Path) -> dict[str, Any]:
    whole = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))
    return {**whole["project"], "build": whole["build-system"]["requires"]}


def recipe_list(text: str, heading: str) -> set[str]:
    """Entries of a list in the recipe, which is YAML only after its templates are filled."""
    block = re.search(rf"^  {heading}:\n((?:    - .+\n)+)", text, re.MULTILINE)
    assert block is not None, heading
    return {line.strip().removeprefix("- ").replace(" ", "") for line in block[1].splitlines()}


def test_the_recipe_asks_for_what_the_project_asks_for(root: Path, project: dict[str, Any]) -> None:
    text = (root / "conda" / "recipe" / "meta.yaml").read_text("utf-8")
    python = f"python{project['requires-python']}"
    assert recipe_list(text, "run") == {python, *project["dependencies"]}
    assert recipe_list(text, "host") == {"pip", python, *project["build"]}
    assert re.findall(r'version = "(.+?)"', text) == [project["version"]]
    assert recipe_list(text, "entry_points") == {
        f"{name}={of}" for name, of in project["scripts"].items()
    }
    about = dict(re.findall(r"^  (summary|license|license_file): (.+)$", text, re.MULTILINE))
    assert about == {
        "summary": project["description"],
        "license": project["license"],
        "license_file": "LICENSE",
    }


def test_the_image_has_all_that_an_install_reads(root: Path, project: dict[str, Any]) -> None:
    text = (root / "Dockerfile").read_text("utf-8")
    copied = {
        name
        for line in re.findall(r"^COPY (.+)$", text, re.MULTILINE)
        for name in line.split()[:-1]
    }
    assert all((root / name).exists() for name in copied)
    linked = {
        link.resolve().relative_to(root.resolve()).parts[0]
        for link in (root / "homeward").rglob("*")
        if link.is_symlink()
    }
    assert copied >= {
        "homeward",
        *linked,
        "pyproject.toml",
        "setup.py",
        "README.md",
        "constraints.txt",
        "LICENSE",
    }
    kept = {
        line.removeprefix("!") for line in (root / ".dockerignore").read_text("utf-8").splitlines()
    }
    assert all(name in kept or (name.endswith(".py") and "*.py" in kept) for name in copied)
    (extra,) = re.findall(r"'\.\[(\w+)\]'", text)
    assert extra in project["optional-dependencies"]
    assert (
        text.index("RUN useradd")
        < text.index("USER homeward")
        < text.index('ENTRYPOINT ["homeward", "watch"]')
    )
    (version,) = re.findall(r"^FROM python:([\d.]+)-slim$", text, re.MULTILINE)
    assert f"Programming Language :: Python :: {version}" in project["classifiers"]


def test_the_container_for_development_is_set_up_by_make(root: Path) -> None:
    described = json.loads((root / ".devcontainer" / "devcontainer.json").read_text("utf-8"))
    target = described["postCreateCommand"].removeprefix("make ")
    assert f"\n{target}:" in (root / "Makefile").read_text("utf-8")
