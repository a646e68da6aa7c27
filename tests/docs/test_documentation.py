"""What the README, the pages and the files that ship say is so."""

import pkgutil
import re
import tomllib
from pathlib import Path

import pytest

from homeward.agents.learning.settings import PPOSettings

INSTALL = re.compile(r"""pip install ([^`"\n]+)""")


def page_of(root: Path, name: str) -> str:
    return " ".join((root / "docs" / name).read_text("utf-8").split())


def test_the_readme_is_read_in_a_minute(root: Path) -> None:
    assert len((root / "README.md").read_text("utf-8").splitlines()) <= 80


def test_what_a_page_says_to_install_is_in_the_checkout(root: Path) -> None:
    known = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"][
        "optional-dependencies"
    ]
    pages = [*root.glob("*.md"), *root.glob("docs/**/*.md"), *root.glob("examples/*")]
    lines = [
        line
        for page in pages
        if page.is_file()
        for line in INSTALL.findall(page.read_text("utf-8"))
    ]
    own = [line for line in lines if line.startswith("-e ")]
    assert own and not [line for line in lines if "homeward" in line], (
        "homeward is on no package index"
    )
    for line in own:
        extras = re.match(r"-e (?:\.|'\.\[([a-z0-9,]+)\]')", line)
        assert extras is not None and set((extras[1] or "").split(",")) - {""} <= set(known), line


def test_every_environment_variable_is_documented(root: Path) -> None:
    folders = [root / "homeward", root / "envs", root / "agents"]
    sources = [*(file for folder in folders for file in folder.rglob("*.py")), root / "Makefile"]
    named = {
        name for file in sources for name in re.findall(r"HOMEWARD_[A-Z]+", file.read_text("utf-8"))
    }
    assert {"HOMEWARD_CACHE", "HOMEWARD_DATA"} <= named
    assert {name for name in named if f"| `{name}` |" not in page_of(root, "help.md")} == set()


def test_the_first_example_on_the_robot_prints_what_the_page_shows(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (root / "docs" / "on_the_robot.md").read_text("utf-8")
    first = re.search(r"^```python\n(.+?)^```\n\n```\n(.+?)^```$", page, re.MULTILINE | re.DOTALL)
    assert first is not None
    exec(first[1], {})
    assert capsys.readouterr().out == first[2]


def test_every_warning_that_the_pages_explain_is_one_that_the_code_says(root: Path) -> None:
    folders = [root / "homeward" / name for name in ("companion", "watch", "logs")]
    code = " ".join(file.read_text("utf-8") for folder in folders for file in folder.rglob("*.py"))
    pages = "".join(
        (root / "docs" / name).read_text("utf-8") for name in ("on_the_robot.md", "mavlink.md")
    )
    tables = re.findall(r"^\| warning \|.*\n\|.*\n((?:\|.*\n)+)", pages, re.MULTILINE)
    cells = [row.split("|")[1] for table in tables for row in table.splitlines()]
    explained = [re.findall(r"`(.+?)`", cell) for cell in cells]
    assert len(tables) == 5 and all(explained)
    assert [words for phrases in explained for words in phrases if words not in code] == []


def test_the_default_of_the_stranding_cost_is_the_one_documented(root: Path) -> None:
    said = f"`--stranding-cost`, by default {PPOSettings().stranding_cost:g} times the score of a good mission"
    assert said in page_of(root, "learning.md")


def test_every_name_of_code_that_a_page_gives_is_there(root: Path) -> None:
    pages = [*root.glob("*.md"), *root.glob("docs/**/*.md")]
    named = {
        name
        for page in pages
        for name in re.findall(r"`(homeward(?:\.\w+)+)`", page.read_text("utf-8"))
    }
    assert len(named) > 10
    for name in sorted(named):
        assert pkgutil.resolve_name(name) is not None


ASKED = (
    "reward", "effect", "robot", "max", "verdict", "false-alarm", "planner", "companion", "HTML", "network",
    "observation", "mission", "topic",
)  # fmt: skip


def test_the_map_leads_to_what_people_look_for_first(root: Path) -> None:
    page = (root / "CONTRIBUTING.md").read_text("utf-8")
    rows = re.search(r"^\| to change \|.*\n\|.*\n((?:\|.*\n)+)", page, re.MULTILINE)
    assert rows is not None
    for line, asked in zip(rows[1].splitlines(), ASKED, strict=True):
        what, where, name = (cell.strip() for cell in line.strip("|").split("|"))
        assert asked in what
        files = [root / path for path in re.findall(r"`(.+?)`", where)]
        assert files and all(file.is_file() for file in files), where
        defined = re.compile(rf"^(?:def |class )?{name.strip('`')}\b(?=[(:\s=])", re.MULTILINE)
        assert any(defined.search(file.read_text("utf-8")) for file in files), name


def test_every_route_that_ships_names_its_source(root: Path) -> None:
    routes = sorted((root / "homeward" / "routes").glob("*.csv"))
    assert routes
    for route in routes:
        comments = [line for line in route.read_text("utf-8").splitlines() if line.startswith("#")]
        assert any("Source: " in line for line in comments), route.name
