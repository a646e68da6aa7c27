"""Named groups: what differs is named with its size, chance and driving style are not, and bad
input is refused."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from homeward.groups.comparison import Quantity, compare
from tests.command_line import diagnosed
from tests.groups.recorded import noise

POWER = Quantity("P_anc", "W")
SIX = [name for name in "abcdef" for _ in range(3)]


def of_values(labels: Sequence[str], values: Sequence[float] | NDArray[np.float64]) -> Any:
    return compare(labels, {POWER: np.array(values)})[1]


@pytest.mark.parametrize(
    ("labels", "spread"),
    [
        (SIX, 1.0),
        (list("aaabbb"), 1.0),
        (list("aabb"), 1.0),
        (SIX, np.repeat([1.0, 1.0, 1.0, 1.0, 3.0, 3.0], 3)),
    ],
)
def test_groups_that_do_not_differ_are_not_named(labels: list[str], spread: Any) -> None:
    rng = np.random.default_rng(0)
    alarms = sum(
        any(one.named for one in of_values(labels, spread * rng.normal(size=len(labels))))
        for _ in range(200)
    )
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
    assert (
        best.ci95[0] < 0.6 < best.ci95[1]
        and best.held_out_rmse < 0.3 * best.held_out_rmse_without_groups
    )


def test_the_share_of_false_ones_among_the_named_is_small() -> None:
    """Where some groups differ: with one spread, and with a group of five times the others'."""
    rng = np.random.default_rng(4)
    level = np.repeat([0.0, 0.0, 0.0, 9.0, 9.0, 9.0], 3)
    for spread in (1.0, np.repeat([1.0, 5.0, 1.0, 1.0, 1.0, 1.0], 3)):
        false_shares = []
        true_ones = 0
        for _ in range(100):
            differences = of_values(SIX, level + spread * rng.normal(size=18))
            named = [difference for difference in differences if difference.named]
            false = [
                difference
                for difference in named
                if (difference.group in "abc") == (difference.minus in "abc")
            ]
            false_shares.append(len(false) / max(len(named), 1))
            true_ones += len(named) - len(false)
            assert all(difference.p_fdr <= difference.p_holm for difference in differences)
        assert np.mean(false_shares) <= 0.05
        assert true_ones > 400  # of 900


def test_one_odd_run_names_nothing() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        values = rng.normal(size=18)
        values[rng.integers(18)] += 20.0
        assert not any(one.named for one in of_values(SIX, values))
        assert not any(
            one.named for one in of_values(list("aaabbb"), values[:6] + 20.0 * (np.arange(6) == 2))
        )


def test_runs_that_agree_to_the_digit() -> None:
    assert of_values(list("aabb"), [5.0, 5.0, 6.0, 6.0])[0].named
    assert not of_values(list("aabb"), [5.0, 5.0, 5.0, 5.0])[0].named
    assert not of_values(list("aabb"), [0.0, 0.0, 0.0, 0.0])[0].named


def written(folder: Path, name: str, level: float, seed: int, *, speed: bool = True) -> Path:
    rng = np.random.default_rng(seed)
    table = pd.DataFrame({"time_s": 0.1 * np.arange(400), "power_w": level + noise(rng, 400, 0.5)})
    if speed:
        table["speed_mps"] = 0.0
    table.to_csv(folder / name, index=False)
    return folder / name


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
    groups = (
        "--group",
        f"before={logs}/a*.csv",
        "--group",
        several,
        "--group",
        f"after={logs / 'b2.csv'}",
    )
    assert diagnosed(monkeypatch, *groups, "--out", out) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (
        said.startswith("groups_differ P_anc, idle part is 3.")
        and "Significant: 1 of 1 compared" in said
    )
    data = json.loads((out / "groups.json").read_text())
    assert (data["schema"], data["kind"], data["verdict"]) == (2, "standing", "groups_differ")
    assert [one["group"] for one in data["runs"]] == ["before"] * 3 + ["after"] * 3
    (difference,) = data["differences"]
    assert (
        difference["value"] == pytest.approx(3.0, abs=0.3)
        and difference["named"]
        and difference["p_fdr"] < 0.05
        and difference["p_fdr"] == difference["p_holm"]  # of a single pair
    )
    page = (out / "groups.html").read_text()
    assert (
        "Groups differ" in page
        and "figure-group-0" in page
        and "http" not in page.split("</script>")[-1]
    )
    assert (
        re.search(r"<li>before: a0\.csv, P_anc, idle part (8|9)\.\d+<br>", page)
        and str(logs) not in page
    )
    assert re.search(
        r'<div role="img" aria-label="P_anc, idle part, means: before (8|9)(\.\d+)? W, 95 % ', page
    )
    assert '"dragmode":false' in page, "a finger that scrolls would zoom, and no key would undo it"


def test_a_standing_robot_without_groups(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], logs: Path
) -> None:
    silent = written(logs, "c.csv", 9.0, 30, speed=False)
    assert diagnosed(monkeypatch, silent, "--out", logs / "out") == 2
    assert "say --standing if the robot stood" in capsys.readouterr().err
    assert diagnosed(monkeypatch, silent, "--standing", "--out", logs / "out") == 0
    assert "the spread between runs is unknown" in " ".join(capsys.readouterr().out.split())
    data = json.loads((logs / "out" / "groups.json").read_text())
    assert (
        data["levels"][0]["value"] == pytest.approx(9.0, abs=0.3)
        and (logs / "out" / "diagnosis.json").is_file()
    )


def test_unusable_groups(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], logs: Path
) -> None:
    a, b = f"a={logs}/a*.csv", f"b={logs}/b*.csv"
    table = pd.read_csv(logs / "b0.csv").assign(speed_mps=0.5)
    table.to_csv(logs / "moves.csv", index=False)
    for arguments, said in (
        (["--group", a], "one group only"),
        (["--group", a, "--group", f"b={logs}/a0.csv"], "is the same recording as"),
        (["--group", a, "--group", b, logs / "a0.csv"], "not both"),
        (["--group", a, "--group", f"b={logs}/moves.csv", "--standing"], "leave out --standing"),
        (["--group", a, "--group", f"b={logs}"], "is a folder"),
    ):
        assert diagnosed(monkeypatch, *arguments, "--out", logs / "out") == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1


def test_the_variants_of_the_turtlebot(
    monkeypatch: pytest.MonkeyPatch, data_folder: Path, tmp_path: Path
) -> None:
    names = ("baseline", "EE1", "EE2", "EE3", "EE4", "combined")
    groups = [part for name in names for part in ("--group", f"{name}=turtlebot3_tactics/{name}")]
    assert diagnosed(monkeypatch, *groups, "--out", tmp_path) == 0
    data = json.loads((tmp_path / "groups.json").read_text())
    differs = {
        frozenset((one["group"], one["minus"])) for one in data["differences"] if one["named"]
    }
    assert differs == {
        frozenset((high, low))
        for high in ("baseline", "EE1", "EE3")
        for low in ("EE2", "EE4", "combined")
    } | {frozenset(("baseline", "EE3"))}


def test_the_conditions_of_the_rover(
    monkeypatch: pytest.MonkeyPatch, data_folder: Path, tmp_path: Path
) -> None:
    names = ("before", "powersave", "conservative", "imaging")
    groups = [
        part for name in names for part in ("--group", f"{name}=ase_rover/{name}_intervention")
    ]
    assert diagnosed(monkeypatch, *groups, "--out", tmp_path) == 2  # no motion was recorded
    assert diagnosed(monkeypatch, *groups, "--standing", "--out", tmp_path) == 0
    data = json.loads((tmp_path / "groups.json").read_text())
    named_pairs = [(one["group"], one["minus"]) for one in data["differences"] if one["named"]]
    assert sorted(named_pairs) == [
        ("imaging", "before"),
        ("imaging", "conservative"),
        ("imaging", "powersave"),
    ]
    assert any("in one stretch" in remark for remark in data["remarks"])
