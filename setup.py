"""README.md as a package index shows it: its links lead to files of this version at
`[project.urls]`'s `Source`.

All else stands in pyproject.toml. While that names no `Source`, links stay relative, and
`make release` says so.
"""

import re
import tomllib
from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).parent
LINK = re.compile(r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?!\w+:|#)(?P<path>[^)]+)\)")


def description() -> str:
    """The README, its links absolute where the project has an address (paths as GitHub and GitLab
    have them)."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    readme, source = (ROOT / "README.md").read_text("utf-8"), project.get("urls", {}).get("Source")
    if source is None:
        return readme

    def absolute(link: re.Match[str]) -> str:
        kind = "raw" if link["picture"] else "blob"
        return f"{link['picture']}[{link['text']}]({source.rstrip('/')}/{kind}/v{project['version']}/{link['path']})"

    return LINK.sub(absolute, readme)


setup(long_description=description(), long_description_content_type="text/markdown")
