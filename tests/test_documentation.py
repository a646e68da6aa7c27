"""What the README, the pages and the files that ship say is so."""

import re
from pathlib import Path

import pytest

from homeward.agents.learning.settings import PPOSettings


def page_of(root: Path, name: str) -> str:
    return " ".join((root / "docs" / name).read_text("utf-8").split())


def test_the_readme_is_read_in_a_minute(root: Path) -> None:
    assert len((root / "README.md").read_text("utf-8").splitlines()) <= 80


def test_every_environment_variable_is_documented(root: Path) -> None:
    folders = [root / "homeward", root / "envs", root / "agents"]
    sources = [*(file for folder in folders for file in folder.rglob("*.py")), root / "Makefile"]
    named = {name for file in sources for name in re.findall(r"HOMEWARD_[A-Z]+", file.read_text("utf-8"))}
    assert {"HOMEWARD_CACHE", "HOMEWARD_DATA"} <= named
    assert {name for name in named if f"| `{name}` |" not in page_of(root, "index.md")} == set()


def test_the_default_of_the_stranding_cost_is_the_one_documented(root: Path) -> None:
    said = f"`--stranding-cost`, by default {PPOSettings().stranding_cost:g} times a good score"
    assert said in page_of(root, "agents.md")


def test_every_route_that_ships_names_its_source(root: Path) -> None:
    routes = sorted((root / "homeward" / "routes").glob("*.csv"))
    assert routes
    for route in routes:
        comments = [line for line in route.read_text("utf-8").splitlines() if line.startswith("#")]
        assert any("Source: " in line for line in comments), route.name
