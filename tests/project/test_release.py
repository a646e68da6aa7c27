"""A release is made of a clean tree with one version, and sets it everywhere."""

import datetime
import importlib.util
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

DATE = datetime.date(2031, 2, 3)


@pytest.fixture(scope="module")
def release(root: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("release", root / ".ci" / "release.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def git(folder: Path, *command: str) -> None:
    name = ("-c", "user.name=t", "-c", "user.email=t@example.org")
    subprocess.run(["git", *name, *command], cwd=folder, check=True, capture_output=True)


@pytest.fixture
def tree(release: ModuleType, root: Path, tmp_path: Path) -> Path:
    """A repository of the files that say the version, with a next one begun."""
    for name in release.PLACES:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(root / name, tmp_path / name)
    begin(tmp_path, "97.0.0")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "--message", "all")
    return tmp_path


def begin(tree: Path, version: str) -> None:
    path = tree / "CHANGELOG.md"
    path.write_text(
        path.read_text("utf-8").replace("\n## ", f"\n## {version} (unreleased)\n\n## ", 1), "utf-8"
    )


def test_one_version_stands_everywhere_until_the_changelog_begins_the_next(
    release: ModuleType, root: Path
) -> None:
    said = {name: release.stands(root, name) for name in release.PLACES}
    latest = said.pop("CHANGELOG.md")
    (version,) = {one[1] for one in said.values()}
    assert latest[1] == version or latest[2] == release.UNRELEASED


def test_the_version_is_set_everywhere_and_dated(release: ModuleType, tree: Path) -> None:
    now = release.stands(tree, "pyproject.toml")[1]
    later = "98.0.0"
    release.check(tree, later)
    release.set_version(tree, later, DATE)
    assert {release.stands(tree, name)[1] for name in release.PLACES} == {later}
    assert release.stands(tree, "CHANGELOG.md")[2] == "2031-02-03"
    assert (tree / "CITATION.cff").read_text("utf-8").count("date-released: 2031-02-03\n") == 1
    git(tree, "commit", "--quiet", "--all", "--message", "release")
    for released in (later, now):
        with pytest.raises(
            release.ReleaseError, match=f"is not later than {later}, which is released"
        ):
            release.check(tree, released)


def test_a_release_follows_another_as_the_refusal_says(release: ModuleType, tree: Path) -> None:
    release.set_version(tree, "98.0.0", DATE)
    git(tree, "commit", "--quiet", "--all", "--message", "release")
    with pytest.raises(
        release.ReleaseError,
        match=r"says nothing since 98.0.0; begin it with ## 99.0.0 \(unreleased\)",
    ):
        release.check(tree, "99.0.0")
    begin(tree, "99.0.0")
    git(tree, "commit", "--quiet", "--all", "--message", "next")
    release.check(tree, "99.0.0")
    release.set_version(tree, "99.0.0", DATE)
    assert {release.stands(tree, name)[1] for name in release.PLACES} == {"99.0.0"}
    assert "\n## 98.0.0 (2031-02-03)\n" in (tree / "CHANGELOG.md").read_text("utf-8")
    assert (tree / "CITATION.cff").read_text("utf-8").count("date-released: ") == 1


@pytest.mark.parametrize("version", ["", "1.2", "v1.2.3", "1.2.3rc1"])
def test_what_is_no_version_is_refused(version: str, release: ModuleType, tree: Path) -> None:
    with pytest.raises(release.ReleaseError, match="give three numbers"):
        release.check(tree, version)


def test_an_older_version_is_refused(release: ModuleType, tree: Path) -> None:
    with pytest.raises(release.ReleaseError, match=r"is older than 97\.0\.0"):
        release.check(tree, "96.0.0")


def test_a_tree_with_changes_is_refused(release: ModuleType, tree: Path) -> None:
    (tree / "new").write_text("")
    with pytest.raises(release.ReleaseError, match="has changes"):
        release.check(tree, "99.0.0")


def test_versions_that_disagree_are_refused(release: ModuleType, tree: Path) -> None:
    path = tree / "CITATION.cff"
    path.write_text(path.read_text("utf-8").replace("\nversion: ", "\nversion: 9"), "utf-8")
    git(tree, "commit", "--quiet", "--all", "--message", "off")
    with pytest.raises(release.ReleaseError, match=r"versions disagree: .*CITATION\.cff 9"):
        release.check(tree, "99.0.0")


@pytest.mark.parametrize(
    "error", ["ReleaseError", KeyboardInterrupt], ids=["a step fails", "Ctrl-C"]
)
def test_a_build_that_ends_early_leaves_the_files_as_they_were(
    error: str | type[BaseException],
    release: ModuleType,
    tree: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = getattr(release, error) if isinstance(error, str) else error

    def fail(root: Path) -> None:
        raise expected("no")

    monkeypatch.setattr(release, "build", fail)
    before = {name: (tree / name).read_text("utf-8") for name in release.PLACES}
    with pytest.raises(expected, match="no"):
        release.release(tree, "99.0.0")
    assert {name: (tree / name).read_text("utf-8") for name in release.PLACES} == before


def test_nothing_is_uploaded_while_links_of_the_readme_lead_nowhere(
    release: ModuleType, tree: Path
) -> None:
    path = tree / "pyproject.toml"
    text = path.read_text("utf-8").replace("[project.urls]", "[tool.none]")
    path.write_text(text, "utf-8")
    assert release.upload(tree).startswith(
        "upload nothing: links of README.md are relative until [project.urls]"
    )
    path.write_text(f'{text}\n[project.urls]\nSource = "https://example.org/homeward"\n', "utf-8")
    assert release.upload(tree).endswith("twine upload dist/*")
