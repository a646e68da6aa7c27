"""Drives for the benchmark of coverage: those held out are none of those that are diagnosed."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.on_the_robot import range_drives
from benchmarks.on_the_robot.range_drives import (
    BLOCKS,
    GROUNDS,
    HELD_OUT,
    LONGEST_S,
    SHORTEST_S,
    TRAINING,
    WINDOWS,
    rover_site,
    sites,
)
from homeward.physics import load_robot


def test_drives_held_out_are_none_of_those_diagnosed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = "\n".join(f"{number},0,0" for number in range(100))
    (tmp_path / "drive.csv").write_text(f"s,ns,VI\n{lines}\n")
    monkeypatch.setattr(range_drives, "fetch", lambda name, group: [tmp_path / "drive.csv"])
    for make in sites("f1tenth", 0, 2, tmp_path / "out"):
        site = make()
        read = [path.read_text().splitlines()[1:] for path in (*site.training, *site.held_out)]
        assert (
            len(site.training) == BLOCKS - 1 and len({line for one in read for line in one}) == 100
        )
        assert sum(map(len, read)) == 100


def test_half_of_the_huskys_runs_are_held_out_and_cut_into_windows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Six runs of a minute and longer, and one that is too short."""
    paths = [tmp_path / f"run{number}.csv" for number in range(7)]
    for number, path in enumerate(paths):
        time_s = np.arange(0.0, 10.0 if number == 6 else 60.0 + 40.0 * number, 0.1)
        pd.DataFrame(
            {"time": time_s + 5.0, "sample": 1000 * number + np.arange(len(time_s))}
        ).to_csv(path, index=False)
    monkeypatch.setattr(range_drives, "fetch", lambda name, group: paths)
    made = [make() for make in sites("husky", 0, 2, tmp_path / "out")]
    assert [site.name.split()[-1] for site in made] == list(GROUNDS)
    site = made[0]
    assert len(site.training) == 3 and len(site.held_out) == len(site.runs) == 3 * WINDOWS
    assert {path.stem for path in site.training} | set(site.runs) == {
        f"run{number}" for number in range(6)
    }
    for path, run in zip(site.held_out, site.runs, strict=True):
        window, whole = pd.read_csv(path), pd.read_csv(tmp_path / f"{run}.csv")
        length_s = float(window["time"].iloc[-1] - window["time"].iloc[0])
        assert SHORTEST_S - 0.2 <= length_s <= min(LONGEST_S, float(np.ptp(whole["time"]))) + 0.2
        assert (
            set(window["sample"]) <= set(whole["sample"]) and (np.diff(window["sample"]) == 1).all()
        )
    again = sites("husky", 0, 2, tmp_path / "out")[0]()
    assert again == site
    assert any(
        sites("husky", seed, 2, tmp_path / "out")[0]().training != site.training
        for seed in (1, 2, 3)
    )


def test_a_rovers_drives_are_its_own_and_its_file_is_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    from benchmarks.concealed.plants import rover_scenarios

    monkeypatch.setattr(rover_scenarios, "RUN_S", 8.0)
    site = rover_site(0, 2, tmp_path)
    assert site.name == "rover 2, loads"
    assert (len(site.training), len(site.held_out)) == (TRAINING, HELD_OUT)
    assert not set(site.training) & set(site.held_out) and site.runs == [
        path.stem for path in site.held_out
    ]
    assert load_robot(site.nominal).mass_kg > 0.0
    read = [path.read_bytes() for path in (*site.training, *site.held_out)]
    assert len(set(read)) == TRAINING + HELD_OUT
    again = rover_site(0, 2, tmp_path / "again")
    assert [path.read_bytes() for path in (*again.training, *again.held_out)] == read
