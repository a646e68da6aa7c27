"""Pages hold what is generated for them, among it sections of the page of results, and their links
lead somewhere."""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("mkdocs", reason="the site needs the extra docs")

from docs import generate

SECTION = re.compile(r"^### ([^\n]+)\n(.*?)(?=^###? |\Z)", re.MULTILINE | re.DOTALL)
INCLUDE = re.compile(r"^(.*)\n\n<!-- generated: results (.+) -->$", re.MULTILINE)
COMMITS = re.compile(r"\bcommits?\s+[0-9a-f]{7,40}\b")
PAGE = "# Results\n\n## Food\n\n### Bread\n\nEach slice:\n\n#### Crust\n\n7 mm\n\n### Tea\n\nhot\n\n## Room\n\nlarge\n"


LINK = re.compile(r"\]\((?!\w+:)([^)#\s]*)(?:#([^)]+))?\)")
ONLY_ON_THE_SITE = ("worked_case/report.html",)
FENCED = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def anchor(heading: str) -> str:
    """Anchor of a heading, as GitHub and MkDocs make it."""
    said = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", heading).lower()
    return re.sub(r"[^\w -]", "", said).replace(" ", "-")


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "results.md").write_text(PAGE)
    monkeypatch.setattr(generate, "ROOT", tmp_path)


@pytest.fixture(scope="module")
def pages(root: Path) -> dict[str, str]:
    """All pages by their path, without what is generated; those of environments lie in a folder."""
    docs = root / "docs"
    return {
        path.relative_to(docs).as_posix(): generate.emptied(path.read_text("utf-8"))
        for path in docs.rglob("*.md")
    }


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("heading", "body"),
    [
        ("Bread", "Each slice:\n\n#### Crust\n\n7 mm"),
        ("Crust", "7 mm"),
        ("Tea", "hot"),
        ("Room", "large"),
    ],
)
def test_a_section_ends_before_the_next_that_is_not_part_of_it(heading: str, body: str) -> None:
    assert generate.results(heading) == body


@pytest.mark.usefixtures("small")
def test_a_section_that_the_page_lacks_is_refused_by_name() -> None:
    with pytest.raises(KeyError, match=r"no section 'Cake', only Food, Bread"):
        generate.results("Cake")


@pytest.mark.usefixtures("small")
def test_the_command_writes_parts_that_stay_and_are_made_anew_and_the_build_warns_of_old_ones(
    caplog: pytest.LogCaptureFixture,
) -> None:
    kitchen = generate.ROOT / "docs" / "kitchen.md"
    asked = "# Kitchen\n\n<!-- generated: results Bread -->\n\nthe end\n"
    kitchen.write_text(asked)
    generate.main()
    whole = kitchen.read_text()
    assert whole == (
        "# Kitchen\n\n<!-- generated: results Bread -->\n\nEach slice:\n\n## Crust\n\n7 mm\n\n"
        "<!-- end of generated -->\n\nthe end\n"
    )
    assert generate.filled(whole) == whole and generate.emptied(whole) == asked
    page = SimpleNamespace(file=SimpleNamespace(src_uri="kitchen.md"))
    shown = "# Kitchen\n\nEach slice:\n\n## Crust\n\n7 mm\n\nthe end\n"
    assert generate.on_page_markdown(whole, page) == shown and caplog.text == ""
    assert generate.on_page_markdown(whole.replace("7", "8"), page) == shown
    assert (
        "kitchen.md: its generated parts are out of date; run python -m docs.generate"
        in caplog.text
    )


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("above", "below"), [("# Kitchen", "##"), ("# Kitchen\n\n## Table", "###")]
)
def test_headings_that_are_included_come_below_that_of_the_page(above: str, below: str) -> None:
    page = SimpleNamespace(file=SimpleNamespace(src_uri="kitchen.md"))
    filled = generate.on_page_markdown(
        f"{above}\n\n<!-- generated: results Bread -->\n\nthe end\n", page
    )
    assert filled == f"{above}\n\nEach slice:\n\n{below} Crust\n\n7 mm\n\nthe end\n"


def test_every_include_is_below_a_link_to_its_section(pages: dict[str, str]) -> None:
    included = [(name, *found) for name, page in pages.items() for found in INCLUDE.findall(page)]
    assert (
        len(included) == sum(page.count("<!-- generated: results ") for page in pages.values()) > 10
    )
    assert [
        one for one in included if f"[Results](results.md#{anchor(one[2])})" not in one[1]
    ] == []


def test_every_section_has_a_name_of_its_own_and_is_in_the_contents(pages: dict[str, str]) -> None:
    headings = re.findall(r"^###? (.+)$", pages["results.md"], re.MULTILINE)
    assert len(set(headings)) == len(headings)
    contents, _, _ = pages["results.md"].partition("\n## ")
    assert re.findall(r"\[(.+?)\]\(#(.+?)\)", contents) == [
        (heading, anchor(heading)) for heading in headings
    ]


def test_every_section_says_at_which_commit_it_was_measured(root: Path) -> None:
    sections = SECTION.findall((root / "docs" / "results.md").read_text("utf-8"))
    assert len(sections) > 20
    assert [heading for heading, text in sections if not COMMITS.search(text)] == []


def test_no_other_page_says_at_which_commit_something_was_measured(pages: dict[str, str]) -> None:
    """What was measured is on the page of results; elsewhere a commit is where a version ended."""
    assert [
        name for name, page in pages.items() if name != "results.md" and COMMITS.search(page)
    ] == []


def test_every_link_within_the_project_leads_to_a_file_and_a_heading(root: Path) -> None:
    """In the files as they are, with what is generated, by the anchors that viewers make of
    headings."""
    files = [*root.glob("*.md"), *(root / "docs").rglob("*.md"), *(root / "ros2").rglob("*.md")]
    texts = {file: FENCED.sub("", file.read_text("utf-8")) for file in files}
    anchors = {
        file: {anchor(found) for found in re.findall(r"^#+ (.+)$", texts[file], re.MULTILINE)}
        for file in files
    }
    dead = []
    for file, text in texts.items():
        for path, name in LINK.findall(text):
            target = (file.parent / path).resolve() if path else file
            if path in ONLY_ON_THE_SITE:
                continue
            if not target.exists() or (name and target in anchors and name not in anchors[target]):
                dead.append(f"{file.relative_to(root)}: ({path}{'#' if name else ''}{name})")
    assert dead == []
