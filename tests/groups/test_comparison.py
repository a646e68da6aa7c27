"""Named groups: what differs is named with its size, chance and driving style are not, and bad input is refused."""

import dataclasses
import io
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from rich.console import Console

import diagnose
from homeward import Robot, synthetic
from homeward.diagnosis import Recording, RecordingError
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.residual_test import independent_blocks
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.groups.comparison import Quantity, compare
from homeward.groups.report import show_groups, write_groups
from homeward.groups.runs import compare_standing, values_of_runs
from tests.groups.test_standing import noise, standing

POWER = Quantity("P_anc", "W")
SIX = [name for name in "abcdef" for _ in range(3)]


def of_values(labels: Sequence[str], values: Sequence[float] | NDArray[np.float64]) -> Any:
    return compare(labels, {POWER: np.array(values)})[1]


@pytest.mark.parametrize(
    ("labels", "spread"),
    [(SIX, 1.0), (list("aaabbb"), 1.0), (list("aabb"), 1.0), (SIX, np.repeat([1.0, 1.0, 1.0, 1.0, 3.0, 3.0], 3))],
)
def test_groups_that_do_not_differ_are_not_named(labels: list[str], spread: Any) -> None:
    rng = np.random.default_rng(0)
    alarms = sum(any(one.named for one in of_values(labels, spread * rng.normal(size=len(labels)))) for _ in range(200))
    assert alarms / 200 <= 0.05


def test_the_interval_of_a_difference_covers_it() -> None:
    rng = np.random.default_rng(1)
    covered = []
    for _ in range(400):
        (one,) = of_values(list("aaabbb"), np.repeat([5.0, 7.0], 3) + rng.normal(size=6))
        covered.append(one.ci95[0] <= 2.0 <= one.ci95[1])
    assert 0.93 <= np.mean(covered) <= 0.985


def test_a_real_difference_is_named_and_proved_on_runs_left_out() -> None:
    rng = np.random.default_rng(2)
    shift = np.repeat([0.0, 0.0, 0.0, 0.0, 0.0, 0.6], 3)
    found = of_values(SIX, 9.0 + shift + 0.05 * rng.normal(size=18))
    assert [(one.group, one.minus) for one in found if one.named].count(("f", "a")) == 1
    assert all("f" in (one.group, one.minus) for one in found if one.named)
    best = found[0]
    assert best.ci95[0] < 0.6 < best.ci95[1] and best.held_out_rmse < 0.3 * best.held_out_rmse_without_groups


def test_one_odd_run_names_nothing() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        values = rng.normal(size=18)
        values[rng.integers(18)] += 20.0
        assert not any(one.named for one in of_values(SIX, values))
        assert not any(one.named for one in of_values(list("aaabbb"), values[:6] + 20.0 * (np.arange(6) == 2)))


def test_runs_that_agree_to_the_digit() -> None:
    assert of_values(list("aabb"), [5.0, 5.0, 6.0, 6.0])[0].named
    assert not of_values(list("aabb"), [5.0, 5.0, 5.0, 5.0])[0].named
    assert not of_values(list("aabb"), [0.0, 0.0, 0.0, 0.0])[0].named


def test_standing_groups_with_autocorrelated_noise_and_drift() -> None:
    rng = np.random.default_rng(4)
    alarms = 0
    for _ in range(100):
        warming = 3.0 * np.exp(-np.arange(120) / 40.0)
        runs = [standing(9.0 + rng.normal(0.0, 0.05) - warming + noise(rng, 120, 0.95)) for _ in range(6)]
        runs = [dataclasses.replace(run, name=str(i), sha256=str(i)) for i, run in enumerate(runs)]
        found = compare_standing(runs, list("aaabbb"))
        alarms += found.verdict != "no_difference"
    assert alarms <= 10
    assert any("compare runs of equal length" in remark for remark in found.remarks)


def test_one_run_per_group_is_not_testable() -> None:
    rng = np.random.default_rng(5)
    runs = [standing(level + noise(rng, 200, 0.5), str(level)) for level in (5.0, 9.0, 14.0)]
    found = compare_standing(runs, ["low", "middle", "high"])
    assert found.verdict == "not_testable" and not found.differences
    assert [one.ci95 is not None and one.run_spread is None for one in found.levels] == [True] * 3
    assert any("the spread between runs is unknown" in remark for remark in found.remarks)


def test_a_load_of_a_robot_that_drives_is_no_ancillary_power() -> None:
    rng = np.random.default_rng(6)
    runs = [standing(np.abs(8.0 + 6.0 * noise(rng, 200, 0.9)), str(i)) for i in range(4)]
    found = compare_standing(runs, list("aabb"))
    assert {one.quantity for one in found.levels} == {"mean power"}
    assert any("if it drives" in remark for remark in found.remarks)


def test_what_else_differs_is_told() -> None:
    rng = np.random.default_rng(7)
    volts = (np.repeat([12.0, 11.0], 3) + 0.01 * rng.normal(size=6)).tolist()
    runs = [
        standing(9.0 + i // 3 + 0.1 * noise(rng, 200, 0.0), str(i), voltage_v=np.full(200, volt))
        for i, volt in enumerate(volts)
    ]
    found = compare_standing(runs, list("aaabbb"))
    assert found.verdict == "groups_differ"
    assert any("the battery voltage differs too between b and a" in remark for remark in found.remarks)
    assert any("the order of the runs" in remark for remark in found.remarks)
    for i, run in enumerate(runs):
        run.channels["time_s"][:] += 1000.0 * i
    assert any("in one stretch" in remark for remark in compare_standing(runs, list("aaabbb")).remarks)
    assert not any("stretch" in remark for remark in compare_standing(runs[:3] + runs[3:], list("ababab")).remarks)


def test_power_and_current_are_not_mixed() -> None:
    power = standing(9.0 + noise(np.random.default_rng(8), 100, 0.0), "power")
    channels = {name: values for name, values in power.channels.items() if name != "power_w"}
    current = Recording("amps", "", channels | {"motor_left_a": power.channels["power_w"],
                                                "motor_right_a": np.zeros(100)})  # fmt: skip
    with pytest.raises(RecordingError, match="compare one kind"):
        compare_standing([power, current], ["a", "b"])


def drives(robot: Robot, seed: int, speeds: tuple[float, ...], monkeypatch: pytest.MonkeyPatch) -> list[Recording]:
    """Three runs of a robot at these speeds."""
    levels = synthetic._levels
    with monkeypatch.context() as patch:
        patch.setattr(
            synthetic, "_levels", lambda rng, choices, *rest: levels(rng, speeds if 0.9 in choices else choices, *rest)
        )
        tables = [synthetic.record(robot, seed + run) for run in range(3)]
    return [
        Recording(f"{seed + i}.csv", str(seed + i), {str(c): table[c].to_numpy(dtype=float) for c in table})
        for i, table in enumerate(tables)
    ]


def named(recordings: list[Recording], robot: Robot) -> set[str]:
    """Names of what differs between the first and the last three runs, without a search for missing physics."""
    runs = average(usable_runs(recordings, robot)[0])
    fit = refit(runs, robot)
    evidence = SimpleNamespace(
        runs=runs, fitted=fit, corrected=None, block=independent_blocks(fit, runs).channels
    )  # fmt: skip
    found = compare(list("aaabbb"), values_of_runs(cast(Evidence, evidence)))[1]
    assert len(found) >= 4
    return {one.quantity for one in found if one.named}


SLOW, FAST, ALL = (0.0, 0.2, 0.3, 0.4), (0.0, 0.6, 0.8, 0.9), (0.0, 0.3, 0.5, 0.7, 0.9)


def test_groups_that_are_only_driven_otherwise(husky: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    for seed in (0, 1000, 2000):
        runs = drives(husky, seed, SLOW, monkeypatch) + drives(husky, seed + 100, FAST, monkeypatch)
        assert named(runs, husky) == set()


@pytest.mark.parametrize(
    ("change", "quantity"),
    [
        ({"rolling_resistance": 1.15}, "C_rr m / Gamma"),
        ({"controller_w": 1.5}, "P_anc, idle part"),
    ],
)
def test_a_changed_parameter_is_named_from_drives(
    husky: Robot, monkeypatch: pytest.MonkeyPatch, change: dict[str, float], quantity: str
) -> None:
    fields: dict[str, Any] = {name: factor * getattr(husky, name) for name, factor in change.items()}
    other = dataclasses.replace(husky, **fields)
    assert named(drives(husky, 0, ALL, monkeypatch) + drives(other, 100, ALL, monkeypatch), husky) == {quantity}


def written(folder: Path, name: str, level: float, seed: int, *, speed: bool = True) -> Path:
    rng = np.random.default_rng(seed)
    table = pd.DataFrame({"time_s": 0.1 * np.arange(400), "power_w": level + noise(rng, 400, 0.5)})
    if speed:
        table["speed_mps"] = 0.0
    table.to_csv(folder / name, index=False)
    return folder / name


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["diagnose.py", *map(str, arguments)])
    return diagnose.run()


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    for i in range(3):
        written(tmp_path, f"a{i}.csv", 9.0, i)
        written(tmp_path, f"b{i}.csv", 12.0, 10 + i)
    return tmp_path


def test_groups_from_the_command_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], logs: Path
) -> None:
    out = logs / "out"
    several = f"after={logs / 'b0.csv'},{logs / 'b1.csv'}"
    groups = ("--group", f"before={logs}/a*.csv", "--group", several, "--group", f"after={logs / 'b2.csv'}")
    assert run(monkeypatch, *groups, "--out", out) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("groups_differ P_anc, idle part is 3.") and "Significant: 1 of 1 compared" in said
    data = json.loads((out / "groups.json").read_text())
    assert (data["schema"], data["kind"], data["verdict"]) == (1, "standing", "groups_differ")
    assert [one["group"] for one in data["runs"]] == ["before"] * 3 + ["after"] * 3
    (difference,) = data["differences"]
    assert difference["value"] == pytest.approx(3.0, abs=0.3) and difference["named"] and difference["p_holm"] < 0.05
    page = (out / "groups.html").read_text()
    assert "Groups differ" in page and "figure-group-0" in page and "http" not in page.split("</script>")[-1]
    assert re.search(r"<li>before: a0\.csv, P_anc, idle part (8|9)\.\d+<br>", page) and str(logs) not in page
    assert re.search(r'<div role="img" aria-label="P_anc, idle part, means: before (8|9)(\.\d+)? W, 95 % ', page)
    assert '"dragmode":false' in page, "a finger that scrolls would zoom, and no key would undo it"


def test_recordings_have_their_shortest_distinct_names(tmp_path: Path) -> None:
    paths = [f"/far/away/{folder}/{i}.csv" for folder in ("ice", "snow") for i in (1, 2)]
    steady = [standing(10.0 + noise(np.random.default_rng(i), 400, 0.0), path) for i, path in enumerate(paths)]
    runs = [dataclasses.replace(one, sha256="0", notes=("a column is left out",)) for one in steady]
    comparison = compare_standing(runs, ["ice", "ice", "snow", "snow"])
    assert comparison.runs[0].path == paths[0]
    write_groups(comparison, tmp_path)
    terminal = io.StringIO()
    show_groups(comparison, Console(file=terminal, width=200))
    for text in ((tmp_path / "groups.html").read_text("utf-8"), terminal.getvalue()):
        assert "ice/1.csv: a column is left out" in text and "snow/2.csv" in text and "/far/away" not in text


def test_a_standing_robot_without_groups(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], logs: Path
) -> None:
    silent = written(logs, "c.csv", 9.0, 30, speed=False)
    assert run(monkeypatch, silent, "--out", logs / "out") == 2
    assert "say --standing if the robot stood" in capsys.readouterr().err
    assert run(monkeypatch, silent, "--standing", "--out", logs / "out") == 0
    assert "the spread between runs is unknown" in " ".join(capsys.readouterr().out.split())
    data = json.loads((logs / "out" / "groups.json").read_text())
    assert data["levels"][0]["value"] == pytest.approx(9.0, abs=0.3) and (logs / "out" / "diagnosis.json").is_file()


def test_unusable_groups(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], logs: Path) -> None:
    a, b = f"a={logs}/a*.csv", f"b={logs}/b*.csv"
    table = pd.read_csv(logs / "b0.csv").assign(speed_mps=0.5)
    table.to_csv(logs / "moves.csv", index=False)
    for arguments, said in (
        (["--group", a], "one group only"),
        (["--group", a, "--group", "b"], "is not NAME=RUNS"),
        (["--group", a, "--group", "[b]=x.csv"], "is not NAME=RUNS"),
        (["--group", a, "--group", "b="], "is not NAME=RUNS"),
        (["--group", a, "--group", f"b={logs}/none*.csv"], "no file matches it as a pattern"),
        (["--group", a, "--group", f"b={logs}/a0.csv"], "is the same recording as"),
        (["--group", a, "--group", b, logs / "a0.csv"], "not both"),
        (["--group", a, "--group", "b=turtlebot3_tactics/EE9"], "has no group 'EE9'; groups: EE1"),
        (["--group", a, "--group", f"b={logs}/moves.csv", "--standing"], "leave out --standing"),
        (["--group", a, "--group", f"b={logs}"], "is a folder"),
    ):
        assert run(monkeypatch, *arguments, "--out", logs / "out") == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1


def test_the_variants_of_the_turtlebot(monkeypatch: pytest.MonkeyPatch, data_folder: Path, tmp_path: Path) -> None:
    names = ("baseline", "EE1", "EE2", "EE3", "EE4", "combined")
    groups = [part for name in names for part in ("--group", f"{name}=turtlebot3_tactics/{name}")]
    assert run(monkeypatch, *groups, "--out", tmp_path) == 0
    data = json.loads((tmp_path / "groups.json").read_text())
    differs = {frozenset((one["group"], one["minus"])) for one in data["differences"] if one["named"]}
    assert differs == {
        frozenset((high, low)) for high in ("baseline", "EE1", "EE3") for low in ("EE2", "EE4", "combined")
    }


def test_the_conditions_of_the_rover(monkeypatch: pytest.MonkeyPatch, data_folder: Path, tmp_path: Path) -> None:
    names = ("before", "powersave", "conservative", "imaging")
    groups = [part for name in names for part in ("--group", f"{name}=ase_rover/{name}_intervention")]
    assert run(monkeypatch, *groups, "--out", tmp_path) == 2  # no motion was recorded
    assert run(monkeypatch, *groups, "--standing", "--out", tmp_path) == 0
    data = json.loads((tmp_path / "groups.json").read_text())
    named_pairs = [(one["group"], one["minus"]) for one in data["differences"] if one["named"]]
    assert sorted(named_pairs) == [("imaging", "before"), ("imaging", "conservative"), ("imaging", "powersave")]
    assert any("in one stretch" in remark for remark in data["remarks"])
