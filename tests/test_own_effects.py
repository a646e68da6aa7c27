"""An effect of one's own, from a Python file that is named: used like the others, or refused in one
line."""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

from homeward import load_robot, own_effects
from homeward.commands.diagnose import Args, main
from homeward.diagnosis import RecordingError
from homeward.diagnosis.tell.made_by import made_by
from homeward.physics import RobotError, kernel_cache
from homeward.physics.effects import EFFECTS
from homeward.physics.effects.own import OwnEffectError, with_own

LAMP = "homeward.physics.effects.own_lamp"


@pytest.fixture
def lamp(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The effect of the page, named in the environment; tests/docs diagnoses with it."""
    page = (root / "docs" / "extending.md").read_text("utf-8")
    (text,) = re.findall(r'^```python title="lamp.py"\n(.+?)^```$', page, re.MULTILINE | re.DOTALL)
    path = tmp_path / "lamp.py"
    path.write_text(text)
    monkeypatch.setenv(own_effects.VARIABLE, str(path))
    monkeypatch.delitem(sys.modules, LAMP, raising=False)
    return path


def test_it_is_among_those_of_its_kind_and_kernels_depend_on_it(lamp: Path) -> None:
    ids = [effect.id for effect in with_own(EFFECTS)]
    assert ids.index("lamp") + 1 == ids.index("intermittent_load")
    assert [name for name in ids if name != "lamp"] == [effect.id for effect in EFFECTS]
    assert lamp in kernel_cache.sources("homeward.physics.kernel", lamp.with_name("kernel.py"))
    assert made_by(0).own_effects == {"lamp.py": hashlib.sha256(lamp.read_bytes()).hexdigest()}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("EFFECT = ", "OTHER = ", "has no EFFECT = Effect"),
        (
            "import numpy",
            "import no_such_thing, numpy",
            "cannot be run: ModuleNotFoundError: No module named 'no_such",
        ),
        ('id="lamp"', 'id="heater"', "its id 'heater' is taken"),
        (
            'kind="ancillary"',
            'kind="light"',
            "its kind 'light' is none of force, drive, ancillary, battery",
        ),
        ('"W", 0.0, 1000.0', '"W", 1.0, 1000.0', "'power_w' must be zero by default"),
        (
            'parameters=(Parameter("power_w", "W", 0.0, 1000.0, "power while turning"),)',
            "parameters=()",
            "no parameters",
        ),
    ],
)
def test_a_file_that_cannot_be_used_takes_one_line(
    lamp: Path, old: str, new: str, said: str
) -> None:
    text = lamp.read_text()
    assert old in text
    lamp.write_text(text.replace(old, new))
    with pytest.raises(OwnEffectError, match=said) as error:
        with_own(EFFECTS)
    assert str(error.value).startswith(f"effects of {lamp}: ") and "\n" not in str(error.value)


def test_a_command_ends_with_that_line(root: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "homeward", "diagnose", f"--effects={tmp_path / 'no.py'}"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert (
        done.stderr
        == f"homeward: effects of {tmp_path / 'no.py'}: no such Python file; give a file.py with an EFFECT\n"
    )


def test_a_robot_file_asks_for_the_option_and_runs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "lit.toml"
    path.write_text(load_robot("husky").to_toml() + "\n[effects.lamp]\npower_w = 2.0\n")
    with pytest.raises(
        RobotError,
        match=r"effects\.lamp .* needs --effects FILE\.py \(diagnose\) or HOMEWARD_EFFECTS",
    ):
        load_robot(path)
    with pytest.raises(RecordingError, match="in Python set HOMEWARD_EFFECTS before the import"):
        main(Args(effects=tmp_path / "lamp.py"))
