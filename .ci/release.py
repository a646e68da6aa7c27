"""Make a release: `make release VERSION=1.2.3`.

Sets the version, builds wheel and sdist into dist/, checks them, and builds the site. Nothing is
committed or uploaded: it says how. Where a step fails, the files are as they were.
"""

from __future__ import annotations

import datetime
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
UNRELEASED = "unreleased"
VERSION = r"(\d+\.\d+\.\d+)"
PLACES = {
    "pyproject.toml": rf'^version = "{VERSION}"$',
    "homeward/__init__.py": rf'^__version__ = "{VERSION}"$',
    "CITATION.cff": rf"^version: {VERSION}$",
    "CHANGELOG.md": rf"^## {VERSION} \(([\w-]+)\)$",
}
"""Where the version stands; in the changelog the first heading counts, with its date: it may be
ahead of the others."""


class ReleaseError(RuntimeError):
    """A release that cannot be made; the message says what to change."""


def stands(root: Path, name: str) -> re.Match[str]:
    """Where a file says the version."""
    found = re.search(PLACES[name], (root / name).read_text("utf-8"), re.MULTILINE)
    if found is None:
        raise ReleaseError(f"{name} says no version in the form {PLACES[name]}")
    return found


def check(root: Path, version: str) -> None:
    """Refuse what is no version or released already, a tree with changes, and versions that
    disagree."""
    if not re.fullmatch(VERSION, version):
        raise ReleaseError(
            f"VERSION = {version!r} is not allowed; give three numbers, as in make release VERSION=1.2.3"
        )
    if _run(root, "git", "status", "--porcelain"):
        raise ReleaseError("the tree has changes; commit or stash them first")
    said = {name: stands(root, name)[1] for name in PLACES if name != "CHANGELOG.md"}
    if len(set(said.values())) > 1:
        raise ReleaseError(
            f"versions disagree: {', '.join(f'{name} {version}' for name, version in said.items())}"
        )
    latest = stands(root, "CHANGELOG.md")
    for released in re.findall(rf"^## {VERSION} \(\d", latest.string, re.MULTILINE):
        if _numbers(version) <= _numbers(released):
            raise ReleaseError(
                f"VERSION = {version} is not later than {released}, which is released"
            )
    if latest[2] != UNRELEASED:
        raise ReleaseError(
            f"CHANGELOG.md says nothing since {latest[1]}; begin it with ## {version} ({UNRELEASED})"
        )
    if _numbers(version) < _numbers(latest[1]):
        raise ReleaseError(f"VERSION = {version} is older than {latest[1]}")


def set_version(root: Path, version: str, date: datetime.date) -> None:
    """Write the version wherever it stands, and the date into changelog and citation."""
    for name in PLACES:
        path, found = root / name, stands(root, name)
        text = found.string
        line = found[0].replace(found[1], version, 1).replace(f"({UNRELEASED})", f"({date})")
        if name == "CITATION.cff":
            text = re.sub(r"^date-released: .*\n", "", text, flags=re.MULTILINE)
            line += f"\ndate-released: {date}"
        path.write_text(text.replace(found[0], line, 1), "utf-8")


def build(root: Path) -> None:
    """Build and check what is uploaded, and the site."""
    shutil.rmtree(root / "dist", ignore_errors=True)
    _run(root, sys.executable, "-m", "build")
    packages = sorted(str(path) for path in (root / "dist").iterdir())
    _run(root, sys.executable, "-m", "twine", "check", "--strict", *packages)
    _run(root, sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet")


def release(root: Path, version: str) -> None:
    """Check, set the version, and build; undo the first if the last fails."""
    check(root, version)
    set_version(root, version, datetime.date.today())
    try:
        build(root)
    except BaseException:  # Ctrl-C, too
        _run(root, "git", "checkout", "--quiet", "--", *PLACES)
        raise
    print(
        f"dist/ and site/ hold homeward {version}. Now:\n"
        f"  git commit --all --message 'Release {version}' && git tag --message 'homeward {version}' v{version}\n"
        f"  git push --follow-tags\n"
        f"  {upload(root)}"
    )


def upload(root: Path) -> str:
    """The last step; without an address, links of README.md would lead nowhere on a package
    index."""
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    if "Source" in project.get("urls", {}):
        return ".venv/bin/python -m twine upload dist/*"
    lacking = "[project.urls] in pyproject.toml says Source = ADDRESS"
    return f"upload nothing: links of README.md are relative until {lacking}"


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


def _run(root: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=root, capture_output=True, text=True)
    if done.returncode:
        said = (
            done.stderr.strip() or done.stdout.strip() or f"code {done.returncode}"
        ).splitlines()
        raise ReleaseError(f"{' '.join(command[:4])} failed: {said[-1]}")
    return done.stdout.strip()


if __name__ == "__main__":
    try:
        release(ROOT, sys.argv[1] if len(sys.argv) > 1 else "")
    except ReleaseError as error:
        sys.exit(f"release: {error}")
