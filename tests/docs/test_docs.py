"""The site builds without a warning, holds what it takes from the code, and fetches nothing; its
recipes work."""

import html
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from docs import reference_scores as reference
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.menu import MENU
from homeward.diagnosis.tell.next_drive import GUIDE
from homeward.envs import IDS
from homeward.envs.features import NAMES

pytest.importorskip("mkdocs", reason="the site needs the extra docs")

AFTER_THE_RECIPES = """
import dataclasses
from types import SimpleNamespace

import gymnasium as gym
import homeward
import numpy as np
from homeward.agents.oracle import OracleError, check
from homeward.agents.registry import AGENTS, Request
from homeward.envs import kernel, reward
from homeward.envs.batch import Batch
from homeward.envs.features import FEATURES, OBSERVATION_DTYPE
from homeward.envs.options import Options, known_of
from homeward.physics.kernel import Conditions, demand, full_charge
from homeward.physics.plain import plain


def power_w(robot, yaw_rate_radps):  # by the kernel's formula in plain Python, which needs no compilation
    p, s = (records.view(np.recarray)[0] for records in (robot.record(), full_charge(robot, robot.usable_energy_j)))
    return demand(p, s, Conditions(1.0, 0.0, 0.0, 0.0, 1.0, yaw_rate_radps, 0.0, 0.0, 20.0, 0.0, 1.0))


rusti = homeward.load_robot("rusti")
lit = dataclasses.replace(rusti, effects={"lamp": {"power_w": 2.0}})
for yaw_rate_radps, lamp_w in ((0.0, 0.0), (-0.5, 2.0)):
    assert abs(power_w(lit, yaw_rate_radps) - power_w(rusti, yaw_rate_radps) - lamp_w) < 1e-9

assert gym.spec("homeward/Frontier-v0").kwargs == {"mission": "Frontier"}
options = Options("Frontier", difficulty="known", shaping="none")
known = known_of(options).shared.view(np.recarray)[0]
start = SimpleNamespace(furthest_m=0.0, position_m=0.0, returning=False)
assert abs(reward.attainable(start, None, known, known.usable_j) / known.score_scale - 1.0) < 1e-9
far = SimpleNamespace(furthest_m=30.0, position_m=10.0, returning=False)
assert (reward.score(far, known), reward.attainable(far, None, known, 0.0)) == (900.0, 0.0)

# An episode of a rule, by the kernel in plain Python, where keys of random numbers overflow with a warning.
np.seterr(over="ignore")
kernel.prefetch = lambda record: None
batch = Batch(options, 1)
constants, records, routes, robots = map(plain, (batch.constants, batch.records, batch.routes, batch.robots))
observations = np.zeros((1, len(FEATURES)), np.float32)
rows = plain(observations.view(OBSERVATION_DTYPE)[:, 0])
kernel.reset_missions.py_func([0], [np.random.default_rng(7)], constants, records, robots, routes, rows)
rule, begun, ended = AGENTS["dmax_mapped"](Request(known_of(options))), np.ones(1, np.bool_), 0
rewards, terminated, truncated = np.zeros(1), np.zeros(1, np.bool_), np.zeros(1, np.bool_)
while not ended:
    actions = rule.act(observations, begun)
    ended = kernel.step_in_turn.py_func(
        actions, np.empty((0, 3), np.float32), constants, records, robots, routes, rows, rewards, terminated, truncated
    )
    begun[:] = False
mission = batch.records[0]
assert mission["home"] and mission["score"] == mission["furthest_m"] ** 2 > 0.0
assert abs(rewards[0] - mission["score"] / known.score_scale) < 1e-9
try:
    check(options)
except OracleError as error:
    assert str(error).startswith("the oracle has no bound for Frontier: its score is neither")
else:
    raise AssertionError("the bound is given")
"""

THE_LAMP_IS_NAMED = """
import dataclasses

import homeward
from homeward.diagnosis import Recording, diagnose
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.menu import MENU
from homeward.synthetic import record

husky = homeward.load_robot("husky")
lit = dataclasses.replace(husky, effects={"lamp": {"power_w": 40.0}})
drives = {str(seed): record(lit, seed)[:1200] for seed in range(4)}
runs = [Recording(name, name, {one: of[one].to_numpy(float) for one in of}) for name, of in drives.items()]
(lamp,) = diagnose(runs, husky).missing_physics
assert lamp.effect == "lamp" and lamp.sentence == "A warning lamp is lit while the robot turns.", lamp
assert abs(lamp.parameters["power_w"].value - 40.0) < 4.0, lamp.parameters
assert lamp.where[0].condition.startswith("turning faster than"), lamp.where
assert any(one.sentence in lamp.to_tell_apart for one in MENU), lamp.to_tell_apart
assert CATALOGUE["lamp"].measurement == "put a clamp meter on the lead of the lamp"
"""


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built with warnings as errors."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    build = subprocess.run(command, cwd=root, capture_output=True, text=True)
    assert build.returncode == 0, build.stderr
    return folder


def test_nothing_is_fetched_when_a_page_is_read(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 10
    fetched = re.compile(
        r'<(?:script|img|iframe)[^>]+src="(?:https?:)?//[^"]*|<link [^>]*href="(?:https?:)?//[^"]*'
    )
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
        assert all(
            f"<code>{parameter.name}</code>" in effects for parameter in one.entry.parameters
        )
    environments = (site / "environments.html").read_text("utf-8")
    assert [name for name in NAMES if f"<td><code>{name}</code></td>" not in environments] == []


def test_every_drive_that_is_advised_is_on_the_page_that_the_advice_names(
    root: Path, site: Path
) -> None:
    assert (root / GUIDE).is_file()
    page = html.unescape((site / Path(GUIDE).with_suffix(".html").name).read_text("utf-8"))
    for drive in MENU:
        assert f'<h3 id="{drive.id.replace("_", "-")}">' in page
        assert f"{drive.sentence[0].upper()}{drive.sentence[1:]} (" in page


def test_each_environment_has_a_page_in_the_form_of_gymnasium(site: Path) -> None:
    headings = (
        "description", "action-space", "observation-space", "rewards", "starting-state", "episode-end", "arguments",
        "reference-scores", "version-history",
    )  # fmt: skip
    for mission, env_id in IDS.items():
        name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", mission).lower()
        page = (site / "environments" / f"{name}.html").read_text("utf-8")
        assert f"<code>{env_id}</code>" in page
        assert re.findall(r'<h2 id="([\w-]+)">', page) == list(headings)
        assert [
            agent for agent in reference.AGENTS if f"<td><code>{agent}</code></td>" not in page
        ] == []
        assert "<td>optimum, between</td>" in page


def test_links_between_folders_stay_links(site: Path) -> None:
    page = (site / "environments" / "survey.html").read_text("utf-8")
    assert 'href="../environments.html#action-space"' in page


def test_every_page_is_in_the_navigation(root: Path, site: Path) -> None:
    home = (site / "index.html").read_text("utf-8")
    pages = [
        path.relative_to(root / "docs").with_suffix(".html")
        for path in (root / "docs").rglob("*.md")
    ]
    assert [
        page
        for page in pages
        if page.name != "index.html" and f'href="{page.as_posix()}"' not in home
    ] == []


def test_the_pages_of_the_api_show_what_is_public_and_no_more(root: Path, site: Path) -> None:
    """A package with `__all__` is public, and so are the modules that it names there, with all
    their public names."""
    pages = sorted((root / "docs" / "api").glob("*.md"))
    asked = {
        name
        for page in pages
        for name in re.findall(r"^::: ([\w.]+)$", page.read_text("utf-8"), re.MULTILINE)
    }
    shown = {
        name
        for page in pages
        for name in re.findall(
            r'id="(homeward[\w.]*)"', (site / "api" / f"{page.stem}.html").read_text("utf-8")
        )
    }
    public, pending = {"homeward"}, ["homeward"]
    while pending:
        package = pending.pop()
        exec(f"from {package} import *", named := dict[str, object]())
        names = {
            f"{package}.{name}": one for name, one in named.items() if not name.startswith("__")
        }
        modules = {name for name, one in names.items() if isinstance(one, ModuleType)}
        assert {name for name in shown if name.rpartition(".")[0] == package} - modules == set(
            names
        ) - modules
        public |= modules
        pending += sorted(name for name in modules if hasattr(sys.modules[name], "__path__"))
    assert asked - {"homeward.physics.Robot"} == public


@pytest.fixture(scope="module")
def extended(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project, extended by the recipes."""
    folder = tmp_path_factory.mktemp("extended")
    for name in ("agents", "envs", "homeward"):
        # bytecode too: of what is patched it is made anew
        shutil.copytree(root / name, folder / name, symlinks=True)
    page = (root / "docs" / "extending.md").read_text("utf-8")
    for path, text in re.findall(
        r'^```python title="(.+?)"\n(.+?)^```$', page, re.MULTILINE | re.DOTALL
    ):
        assert not (folder / path).exists()
        (folder / path).write_text(text)
    patch = "".join(re.findall(r"^```diff\n(.+?)^```$", page, re.MULTILINE | re.DOTALL))
    subprocess.run(["git", "apply", "-"], cwd=folder, input=patch, text=True, check=True)
    return folder


def test_the_recipes_for_an_effect_and_a_mission_work_and_the_effect_is_named(
    extended: Path, tmp_path: Path
) -> None:
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", AFTER_THE_RECIPES + THE_LAMP_IS_NAMED],
        cwd=extended,
        capture_output=True,
        text=True,
        env={
            **os.environ,
            "PYTHONPATH": str(extended),
            "HOMEWARD_CACHE": str(tmp_path),
            "NUMBA_OPT": "0",
            "HOMEWARD_EFFECTS": "lamp.py",
        },
    )
    assert run.returncode == 0, run.stderr
