"""What is written: whole files, a page that needs no network, nothing of a recording taken for
markup."""

import html
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Diagnosis, Recording, analyse
from homeward.diagnosis.explain.formula import Empirical, EmpiricalTerm
from homeward.diagnosis.explain.named import Naming
from homeward.diagnosis.tell.report import corrected_toml, ranking, report_html, write_outputs
from tests.diagnosis.conftest import Analyse
from tests.diagnosis.made_up import ends, with_power

Drive = Callable[..., list[Recording]]
EVIL = "</script>ü漢<img src=x onerror=document.title=1>\"'\udcff.csv"
CHROMIUM = shutil.which("chromium")


@pytest.fixture(scope="module")
def turning(drive: Drive, husky: Robot) -> Analysis:
    runs = [
        replace(run, name=EVIL + str(i))
        for i, run in enumerate(drive(husky, minutes=4.0, effects={"turning": {"scrub": 0.3}}))
    ]
    return analyse(runs, replace(husky, name="<b>husky</b>"))


@pytest.fixture(scope="module")
def standby(short_drive: Drive, husky: Robot, analyse_once: Analyse) -> Analysis:
    """A load that is switched on part way: a faulty sensor would read the same."""
    runs = short_drive(husky, runs=3)
    later = with_power(runs, lambda of: of["power_w"] + 25.0 * (of["time_s"] > 75.0))
    return analyse_once(later, husky)


@pytest.fixture(scope="module")
def off(short_drive: Drive, husky: Robot, analyse_once: Analyse) -> Analysis:
    """A robot that rolls harder than its file says."""
    return analyse_once(short_drive(husky, rolling_resistance=0.2), husky)


@pytest.fixture(scope="module")
def current(short_drive: Drive, husky: Robot) -> Analysis:
    """Motor current only, in proportion to what driving takes."""
    runs = []
    for run in short_drive(husky, effects={"turning": {"scrub": 0.3}}):
        motor_a = 0.01 * np.maximum(run.channels["power_w"] - 60.0, 0.0)
        kept = {name: run.channels[name] for name in ("time_s", "speed_mps", "yaw_rate_radps")}
        runs.append(
            replace(run, channels={**kept, "motor_left_a": motor_a, "motor_right_a": motor_a})
        )
    return analyse(runs, husky)


@pytest.fixture(scope="module")
def dead(short_drive: Drive, husky: Robot) -> Analysis:
    return analyse(with_power(short_drive(husky, runs=1), lambda of: 0.0 * of["power_w"]), husky)


def unnamed(analysis: Analysis) -> Analysis:
    """The same analysis, had the mismatch been located and no effect named."""
    assert analysis.evidence is not None and analysis.evidence.location is not None
    predictions = {
        name: analysis.evidence.predictions[name] for name in ("nominal", "refit", "black_box")
    }
    evidence = replace(analysis.evidence, predictions=predictions, naming=Naming(), corrected=None)
    where = analysis.evidence.location.places
    diagnosis = replace(
        analysis.diagnosis, verdict="unknown_physics", missing_physics=(), where=where
    )
    return replace(analysis, diagnosis=diagnosis, evidence=evidence)


def text_of(page: str) -> str:
    """What a reader sees, without scripts and styles, between single spaces."""
    page = re.sub(r"<(script|style)[ >].*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", page)).split())


def test_outputs_can_be_read_back(turning: Analysis, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    written = write_outputs(turning, folder)
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in written)
    assert Diagnosis.from_json((folder / "diagnosis.json").read_text()) == turning.diagnosis
    assert replace(load_robot(folder / "corrected.toml"), uncertainty=None) == turning.corrected


def test_changed_lines_say_what_they_were(off: Analysis) -> None:
    text = corrected_toml(off)
    (line,) = re.findall(r"^rolling_resistance = .*", text, re.MULTILINE)
    assert "it was 0.14" in line and "proven: C_rr m / Gamma = " in line
    assert "fitted" not in re.findall(r"^motor_loss = .*", text, re.MULTILINE)[0]


def test_page_opens_on_the_verdict_and_needs_no_network(turning: Analysis) -> None:
    page = report_html(turning)
    body = page[page.index("<body>") :]
    order = [
        "Missing physics",
        "turning faster than",
        "plotly.js v",
        "Recorded against simulated",
        "Residuals and when",
    ]
    assert sorted(order, key=body.index) == order
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=(?!\"data:)", page)
    assert page.count("plotly.js v") == 1
    assert 'name="viewport"' in page


def test_recorded_strings_are_escaped(turning: Analysis) -> None:
    page = report_html(turning)
    assert "<img src=x" not in page and "<b>husky</b>" not in page
    assert "&lt;img src=x" in page and "漢" in page
    # Every script that is opened is closed once: no name has ended one early.
    assert len(re.findall(r"<script[ >]", page)) == page.count("</script>")


def test_named_effect_comes_with_its_size_equation_proof_and_places(turning: Analysis) -> None:
    text = text_of(report_html(turning))
    (effect,) = turning.diagnosis.missing_physics
    low, high = ends(effect.parameters["scrub"])
    assert f"{low:.3f} to {high:.3f}" in text
    assert effect.equation.replace("Gamma", "Γ") in text and effect.source in text
    assert f"{len(effect.where)} stretches in 3 recordings" in text
    for arm in ("nominal", "refit", "corrected", "black box", "placebo", "66 to 91 %"):
        assert arm in text[text.index("How well each model predicts") :]
    assert turning.evidence is not None and turning.diagnosis.fit is not None
    assert f"{turning.evidence.range_accuracy_pct['corrected']:.1f} %" in text
    assert f"{turning.diagnosis.fit.arms['corrected'].rmse:#.3g}" in text


def test_ranking_marks_what_is_named_and_its_rivals(standby: Analysis) -> None:
    assert standby.evidence is not None
    rows = ranking(standby.evidence.naming)
    kinds = {(row.effect, row.form): row.kind for row in rows}
    assert rows[0].kind == "named" and (rows[0].effect, rows[0].form) == ("standby", "in time")
    assert kinds["sensor_offset", "in time"] == "rival" and kinds["turning", "steady"] == ""
    assert len(kinds) == len(rows), "a hypothesis is listed twice"
    assert "Confounded with: sensor offset" in text_of(report_html(standby))


def test_a_located_mismatch_without_a_name_is_shaded_where_it_was(turning: Analysis) -> None:
    page = report_html(unnamed(turning))
    assert turning.evidence is not None and turning.evidence.location is not None
    evidence, inside = turning.evidence, turning.evidence.location.inside.astype(int)
    corners = re.findall(r'"name":"located: turning faster than[^"]*"[^{}]*"x":\[([^\]]*)\]', page)
    starts = [
        int((np.diff(inside[evidence.runs.run == run], prepend=0) == 1).sum()) for run in range(3)
    ]
    assert sorted(one.count("null") for one in corners) == sorted(starts) and min(starts) > 1
    assert "The mismatch: turning faster than" in text_of(
        page
    ) and "What is missing" not in text_of(page)


def test_a_formula_is_shown_as_a_description(turning: Analysis) -> None:
    analysis = unnamed(turning)
    assert analysis.evidence is not None
    term = EmpiricalTerm(
        "m g v (|w| B / v_max)^2", 0.31, (0.28, 0.34), "1", ("m g v |w| B / v_max",)
    )
    none = np.zeros((len(analysis.evidence.runs.observed), 1))
    formula = Empirical(
        "P", (term,), {"m": "m = 50 kg"}, none, none, 111.0, 0.58, (0.5, 0.64), 0.05
    )
    text = text_of(
        report_html(replace(analysis, evidence=replace(analysis.evidence, empirical=formula)))
    )
    section = text[text.index("A formula for it") :]
    for words in (
        "without naming a cause",
        "P = 0.31 m g v (|w| B / v_max)²",
        "0.280 to 0.340",
        "m = 50 kg",
        "50 % to 64 %",
    ):
        assert words in section


def test_a_missing_channel_is_said_in_words(standby: Analysis) -> None:
    text = text_of(report_html(standby))
    assert standby.diagnosis.what_this_log_can_show["heater"] is None
    assert re.search(r"A channel is missing:[^.]*heater \(needs temperature_c\)", text)


def test_current_without_voltage_promises_no_energy(current: Analysis) -> None:
    assert current.diagnosis.fit is not None and current.diagnosis.fit.unit == "A"
    text = text_of(report_html(current))
    assert "energy and range are unknown" in text
    assert "range accuracy" not in text and "66 to 91" not in text
    assert re.search(
        r"Not visible in motor current, which is proportional to torque:[^.]*standby", text
    )


def test_runs_of_the_same_name_are_told_apart_without_local_paths(
    short_drive: Drive, husky: Robot
) -> None:
    names = ["/home/someone/ice/1.csv", "/home/someone/snow/1.csv"]
    runs = [
        replace(run, name=name) for run, name in zip(short_drive(husky, runs=2), names, strict=True)
    ]
    page = report_html(analyse(runs, husky))
    assert "ice/1.csv" in page and "snow/1.csv" in page and "someone" not in page


def test_report_without_a_usable_run(dead: Analysis) -> None:
    page = report_html(dead)
    assert "Not testable" in page and "zero throughout" in page and len(page) < 100_000
    assert "Nothing was changed" in corrected_toml(dead)


def test_every_plot_says_what_it_shows_and_has_its_numbers_in_a_table(turning: Analysis) -> None:
    page = report_html(turning)
    time, *conditions = re.findall(r'<div role="img" aria-label="([^"]+)">', page)
    assert 1 + len(conditions) == page.count('class="plotly-graph-div"') >= 3
    assert time.startswith(
        "power, W over time: recorded, and simulated by nominal, refit, corrected."
    )
    assert "series.parquet" in time
    ends = r"means from \S+ at \S+ to \S+ at \S+\. "
    assert all(
        re.match(rf"recorded minus simulated, W, against .+: {ends}", one) for one in conditions
    )
    (table, *_) = re.findall(r"These means as a table</summary>(.*?)</details>", page, re.DOTALL)
    assert table.count("±") == 2 * (table.count("<tr>") - 1) >= 8  # of refit and corrected


def test_page_stays_small_beside_plotly(turning: Analysis) -> None:
    import plotly.offline

    assert len(report_html(turning)) - len(plotly.offline.get_plotlyjs()) < 500_000


def test_a_full_disk_leaves_no_broken_file(
    turning: Analysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "report.html").write_text("old")

    def full(path: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        write_outputs(turning, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text() == "old"


ON_A_PHONE = """<!DOCTYPE html><title>waiting</title>
%s
<script>
onload = () => setTimeout(() => {
  document.body.textContent = JSON.stringify([...document.querySelectorAll("iframe")].map((frame) => {
    const page = frame.contentDocument, time = page.getElementById("figure-time"), runs = page.getElementById("run");
    const seen = {
      title: page.title, width: page.documentElement.scrollWidth, opens: page.body.innerText.slice(0, 600),
      plots: page.querySelectorAll(".plotly-graph-div").length,
      drawn: page.querySelectorAll(".main-svg .cartesianlayer").length,
    };
    if (time) {
      runs.selectedIndex = runs.options.length - 1;
      runs.onchange();
      page.getElementById("whole").onclick();
      seen.chosen = Number(runs.value);
      seen.shown = [...new Set(time.data.filter((trace) => trace.visible).map((trace) => trace.meta))];
      seen.range = time.layout.xaxis.range;
      seen.length = Number(runs.selectedOptions[0].dataset.length);
    }
    return seen;
  }));
}, 4000);
</script>
"""
"""Shows each report as wide as a phone and says what is there; the file of the frame follows."""


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_pages_work_in_a_browser_as_narrow_as_a_phone(
    turning: Analysis,
    standby: Analysis,
    current: Analysis,
    dead: Analysis,
    faultless: Analysis,
    off: Analysis,
    tmp_path: Path,
) -> None:
    analyses = [turning, unnamed(turning), standby, current, dead, faultless, off]
    frames = []
    for number, analysis in enumerate(analyses):
        (tmp_path / f"{number}.html").write_text(report_html(analysis))
        frames.append(
            f'<iframe src="{number}.html" width="360" height="800" style="border: 0"></iframe>'
        )
    (tmp_path / "phone.html").write_text(ON_A_PHONE % "\n".join(frames))
    command = [
        str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        "--allow-file-access-from-files", "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'profile'}",
        "--virtual-time-budget=60000", "--dump-dom", (tmp_path / "phone.html").as_uri(),
    ]  # fmt: skip
    ran = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert "CONSOLE" not in ran.stderr, [
        line for line in ran.stderr.splitlines() if "CONSOLE" in line
    ]
    pages = json.loads(html.unescape(re.findall(r"<body>(.*?)</body>", ran.stdout, re.DOTALL)[0]))
    assert {analysis.diagnosis.verdict for analysis in analyses} >= {
        "missing_physics", "unknown_physics", "no_mismatch", "parameters_off", "not_testable",
    }  # fmt: skip
    for page, analysis in zip(pages, analyses, strict=True):
        assert page["title"].startswith(analysis.robot.name), (
            "a recording's name was run as a script"
        )
        assert page["opens"].split("\n")[0].lower().replace(" ", "_") == analysis.diagnosis.verdict
        assert page["width"] <= 360, f"{analysis.diagnosis.verdict} scrolls sideways"
        assert page["drawn"] == page["plots"] and (page["plots"] >= 2) == (
            analysis.evidence is not None
        )
        if analysis.evidence is not None:
            assert page["shown"] == [page["chosen"]] and page["range"] == [0, page["length"]]
