"""The site builds without a warning, holds what it takes from the code, and fetches nothing; its recipes work."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from homeward.diagnosis.hypotheses import CATALOGUE
from homeward.envs.features import NAMES

pytest.importorskip("mkdocs", reason="the site needs the extra docs")

AFTER_THE_RECIPES = """
import dataclasses
from types import SimpleNamespace

import gymnasium as gym
import homeward
import numpy as np
from homeward.envs import missions
from homeward.envs.options import Options, settle
from homeward.physics.kernel import Conditions, demand, full_charge


def power_w(robot, speed_mps):  # by the kernel's formula in plain Python, which needs no compilation
    p, s = (records.view(np.recarray)[0] for records in (robot.record(), full_charge(robot, robot.usable_energy_j)))
    return demand(p, s, Conditions(speed_mps, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 20.0, 0.0, 1.0))


rusti = homeward.load_robot("rusti")
lit = dataclasses.replace(rusti, effects={"lamp": {"power_w": 2.0}})
for speed_mps, lamp_w in ((0.0, 0.0), (1.0, 2.0)):
    assert abs(power_w(lit, speed_mps) - power_w(rusti, speed_mps) - lamp_w) < 1e-9

assert gym.spec("homeward/Frontier-v0").kwargs == {"mission": "Frontier"}
setting = settle(Options("Frontier")).shared.view(np.recarray)[0]
start = SimpleNamespace(furthest_m=0.0, position_m=0.0, returning=False)
assert abs(missions.hope(start, setting, setting.usable_j) / setting.score_scale - 1.0) < 1e-9
far = SimpleNamespace(furthest_m=30.0, position_m=10.0, returning=False)
assert (missions.score(far, setting), missions.hope(far, setting, 0.0)) == (900.0, 0.0)
"""


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built with warnings as errors."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    build = subprocess.run(command, cwd=root, capture_output=True, text=True)
    assert build.returncode == 0, build.stderr
    return folder


def test_nothing_is_fetched_when_a_page_is_read(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 10
    fetched = re.compile(r'<(?:script|img|iframe)[^>]+src="(?:https?:)?//[^"]*|<link [^>]*href="(?:https?:)?//[^"]*')
    for page in pages:
        assert fetched.findall(page.read_text("utf-8")) == [], page.name
    for sheet in site.rglob("*.css"):
        assert "url(http" not in sheet.read_text("utf-8"), sheet.name


def test_equations_need_no_script(site: Path) -> None:
    page = (site / "model.html").read_text("utf-8")
    assert page.count("<math") > 20
    assert "arithmatex" not in page


def test_every_effect_and_feature_is_described(site: Path) -> None:
    effects = (site / "effects.html").read_text("utf-8")
    for name, one in CATALOGUE.items():
        assert f'<h2 id="{name}">' in effects
        assert all(f"<code>{parameter.name}</code>" in effects for parameter in one.parameters)
    environments = (site / "environments.html").read_text("utf-8")
    assert [name for name in NAMES if f"<td><code>{name}</code></td>" not in environments] == []


def test_every_page_is_in_the_navigation(root: Path, site: Path) -> None:
    home = (site / "index.html").read_text("utf-8")
    pages = [path.relative_to(root / "docs").with_suffix(".html") for path in (root / "docs").rglob("*.md")]
    assert [page for page in pages if page.name != "index.html" and f'href="{page.as_posix()}"' not in home] == []


def test_the_recipes_for_an_effect_and_a_mission_work(root: Path, tmp_path: Path) -> None:
    for name in ("agents", "envs", "homeward"):
        shutil.copytree(root / name, tmp_path / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    page = (root / "docs" / "extending.md").read_text("utf-8")
    for path, text in re.findall(r'^```python title="(.+?)"\n(.+?)^```$', page, re.MULTILINE | re.DOTALL):
        assert not (tmp_path / path).exists()
        (tmp_path / path).write_text(text)
    patch = "".join(re.findall(r"^```diff\n(.+?)^```$", page, re.MULTILINE | re.DOTALL))
    subprocess.run(["git", "apply", "-"], cwd=tmp_path, input=patch, text=True, check=True)
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", AFTER_THE_RECIPES],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )
    assert run.returncode == 0, run.stderr
