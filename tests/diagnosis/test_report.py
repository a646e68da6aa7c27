"""What is written: whole files, a page that needs no network, nothing of a recording taken for markup."""

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Diagnosis, Recording, analyse
from homeward.diagnosis.report import corrected_toml, report_html, write_outputs

Drive = Callable[..., list[Recording]]
EVIL = "</script><img src=x onerror=document.title=1>\"'.csv"
CHROMIUM = shutil.which("chromium")


@pytest.fixture(scope="module")
def turning(drive: Drive, husky: Robot) -> Analysis:
    runs = [replace(run, name=EVIL + str(i)) for i, run in enumerate(drive(husky, effects={"turning": {"scrub": 0.3}}))]
    return analyse(runs, replace(husky, name="<b>husky</b>"))


def test_outputs_can_be_read_back(turning: Analysis, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    written = write_outputs(turning, folder)
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in written)
    assert Diagnosis.from_json((folder / "diagnosis.json").read_text()) == turning.diagnosis
    assert load_robot(folder / "corrected.toml") == turning.corrected


def test_changed_lines_say_what_they_were(drive: Drive, husky: Robot) -> None:
    analysis = analyse(drive(husky, rolling_resistance=0.2), husky)
    text = corrected_toml(analysis)
    (line,) = re.findall(r"^rolling_resistance = .*", text, re.MULTILINE)
    assert "it was 0.14" in line and "losses kept as assumed" in line
    assert "fitted" not in re.findall(r"^motor_loss = .*", text, re.MULTILINE)[0]


def test_page_opens_on_the_verdict_and_needs_no_network(turning: Analysis) -> None:
    page = report_html(turning)
    body = page[page.index("<body>") :]
    assert body.index("Unknown physics") < body.index("turning faster than") < body.index("Recorded against simulated")
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", page)
    assert page.count("plotly.js v") == 1
    assert 'name="viewport"' in page


def test_recorded_strings_are_escaped(turning: Analysis) -> None:
    page = report_html(turning)
    assert "<img src=x" not in page and "<b>husky</b>" not in page
    assert "&lt;img src=x" in page
    # Every script that is opened is closed once: no name has ended one early.
    assert len(re.findall(r"<script[ >]", page)) == page.count("</script>")


def test_report_without_a_usable_run(drive: Drive, husky: Robot) -> None:
    (run,) = drive(husky, runs=1)
    dead = replace(run, channels={**run.channels, "power_w": 0.0 * run.channels["power_w"]})
    analysis = analyse([dead], husky)
    page = report_html(analysis)
    assert "Not testable" in page and "zero throughout" in page and len(page) < 100_000
    assert "Nothing was changed" in corrected_toml(analysis)


def test_a_full_disk_leaves_no_broken_file(turning: Analysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "report.html").write_text("old")

    def full(path: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        write_outputs(turning, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text() == "old"


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_page_draws_its_figures_in_a_browser(turning: Analysis, tmp_path: Path) -> None:
    write_outputs(turning, tmp_path)
    command = [
        str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=8000", "--dump-dom",
        (tmp_path / "report.html").as_uri(),
    ]  # fmt: skip
    page = subprocess.run(command, capture_output=True, text=True, timeout=120).stdout
    assert page.count('class="main-svg"') >= 2
    assert "husky" in re.findall(r"<title>(.*?)</title>", page)[0], "a recording's name was run as a script"
