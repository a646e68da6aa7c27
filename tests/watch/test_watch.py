"""Recordings replayed as if live: predictions hold where the model does, and misses are shown."""

import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from homeward import quantities
from homeward.commands.watch import Args, main
from homeward.companion import Companion, CompanionError, HomeOption
from homeward.diagnosis import RecordingError, read_recording
from homeward.diagnosis.fit.replay import current_a
from homeward.diagnosis.read.signals import signals
from homeward.physics import load_robot, replay
from homeward.physics.uncertainty import Uncertainty
from homeward.watch.coverage import rows_of
from homeward.watch.live import LiveView, view
from homeward.watch.page import verdict, watch_html
from homeward.watch.predictions import Watched
from homeward.watch.replay import Rest, watch

STEP_S = 2.0
"""Between the readings of a drive. Chosen: a window of the companion, 54 s, still holds 27 of them."""


def drive(folder: Path, seed: int, rolling: float = 1.0, spoiled: float = 1.0) -> Path:
    """A Husky's drive of 40 minutes with stops and hills by the physics kernel, in steps of 2 s.

    From the middle on it takes `spoiled` times as much.
    """
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 2400.0, STEP_S)
    speed = np.repeat(rng.choice([0.0, 0.5, 0.8, 1.0, 1.0], 40), round(60.0 / STEP_S))
    grade = 0.05 * np.sin(time_s / 300.0 + rng.uniform(0.0, 6.0))
    robot = load_robot("husky")
    power = replay(robot, time_s, speed, grade_rad=grade, accel_mps2=0.0).power_w
    flat = replay(robot, time_s, 0.0 * time_s).power_w
    power = flat + rolling * (power - flat)
    power[time_s >= 1200.0] *= spoiled
    power *= 1.0 + 0.005 * rng.normal(size=len(time_s))
    path = folder / f"run{seed}.csv"
    pd.DataFrame(
        {
            "time_s": time_s,
            "speed_mps": speed,
            "power_w": power,
            "grade_rad": grade,
            "heading_rad": time_s / 2000.0,
        }
    ).to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Watched]:
    folder = tmp_path_factory.mktemp("drives")
    return [watch(read_recording(drive(folder, seed)), load_robot("husky")) for seed in range(3)]


@pytest.fixture(scope="module")
def spoiled(tmp_path_factory: pytest.TempPathFactory) -> Watched:
    """The first of these drives, if from its middle on all took 1.6 times as much."""
    folder = tmp_path_factory.mktemp("spoiled")
    return watch(read_recording(drive(folder, 0, spoiled=1.6)), load_robot("husky"))


def test_predictions_hold_where_the_model_does(runs: list[Watched]) -> None:
    rows = rows_of(runs)
    assert rows[-1].moments == sum(len(one.time_s) for one in runs) and rows[-1].runs == 3
    assert rows[-1].covered > 0.8 and abs(rows[-1].bias) < 0.03
    early, late = rows[0], rows[-3]
    assert late.error < early.error + 0.02 and late.width < early.width  # it has learned on the way


def test_what_was_left_and_what_it_took_are_those_of_the_recording(
    runs: list[Watched], tmp_path: Path
) -> None:
    table = pd.read_csv(drive(tmp_path, 0))
    one = runs[0]
    np.testing.assert_allclose(
        one.left_m[0], STEP_S * table["speed_mps"].iloc[:-1].sum(), rtol=0.02
    )
    np.testing.assert_allclose(one.took_j[0], STEP_S * table["power_w"].iloc[:-1].sum(), rtol=0.02)
    assert (np.diff(one.left_m) <= 0.0).all() and (np.diff(one.took_j) < 0.0).all()


def test_a_change_that_nobody_could_foresee_is_a_miss(spoiled: Watched) -> None:
    early = spoiled.time_s < 1000.0
    assert early.any() and not spoiled.covered[early & (spoiled.time_s > 300.0)].any()
    assert rows_of([spoiled])[-1].bias < -0.05
    assert "too rarely" in verdict(rows_of([spoiled])[0]) or rows_of([spoiled])[0].covered >= 0.8


def test_hills_shorter_than_places_are_no_surprise(tmp_path: Path) -> None:
    """A Husky's places are 60 m long; it drives over hills of 20 m by the very model that it is
    watched with."""
    time_s, robot = np.arange(0.0, 300.0, 0.2), load_robot("husky")
    grade = 0.06 * np.sin(2.0 * np.pi * time_s / 40.0)
    power = replay(
        robot, time_s, np.full(len(time_s), 0.5), grade_rad=grade, accel_mps2=0.0
    ).power_w
    table = pd.DataFrame(
        {
            "time_s": time_s,
            "speed_mps": 0.5,
            "power_w": power,
            "grade_rad": grade,
            "heading_rad": 0.0,
        }
    )
    table.to_csv(tmp_path / "hills.csv", index=False)
    sure = Uncertainty("a test", ("rolling", "mass"), ((1e-4, 0.0), (0.0, 1e-4)), 0.01)
    one = watch(read_recording(tmp_path / "hills.csv"), replace(robot, uncertainty=sure))
    off = one.mean_j / one.took_j - 1.0
    assert np.abs(off[one.left_m > 20.0]).max() < 0.02 and one.covered.mean() > 0.9
    assert not any("uphill" in text for _, text in one.warnings)
    table.assign(grade_rad=-grade).to_csv(tmp_path / "turned.csv", index=False)
    turned = watch(read_recording(tmp_path / "turned.csv"), robot)
    assert any("is uphill positive?" in text for _, text in turned.warnings)


def test_at_the_terminals_nothing_is_seen_of_what_the_battery_loses_inside(
    runs: list[Watched], tmp_path: Path
) -> None:
    sags = replace(load_robot("husky"), effects={"internal_resistance": {"ohm": 0.4}})
    table = pd.read_csv(drive(tmp_path, 1))
    terminals = table.drop(columns="power_w").assign(
        voltage_v=24.0, current_a=table["power_w"] / 24.0
    )
    terminals.to_csv(tmp_path / "terminals.csv", index=False)
    by_power, by_current = runs[1], watch(read_recording(tmp_path / "terminals.csv"), sags)
    assert by_current.mean_j[0] == pytest.approx(by_power.mean_j[0], rel=1e-3)
    assert abs(rows_of([by_current])[-1].bias) < 0.03
    assert by_current.advice is not None and by_power.advice is not None
    assert by_current.advice.energy_left_j.mean < 0.98 * by_power.advice.energy_left_j.mean


def amps(folder: Path, seed: int, factor: float) -> Path:
    """A Husky's drive of 5 minutes with turns on the spot, recorded as motor current: `factor` of
    the file's."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, 300.0, 0.2)
    speed = np.repeat(rng.choice([0.0, 0.4, 0.8], 15), 100)
    yaw = np.repeat(rng.choice([0.0, 0.5], 15), 100)
    table = pd.DataFrame({"time_s": time_s, "speed_mps": speed, "yaw_rate_radps": yaw})
    table[["motor_left_a", "motor_right_a"]] = 1.0
    table.to_csv(folder / f"amps{seed}.csv", index=False)
    run = signals(read_recording(folder / f"amps{seed}.csv"), SCRUBS)
    each = 0.5 * factor * current_a(run, SCRUBS) * (1.0 + 0.02 * rng.normal(size=len(time_s)))
    table.assign(motor_left_a=each, motor_right_a=each).to_csv(
        folder / f"amps{seed}.csv", index=False
    )
    return folder / f"amps{seed}.csv"


CHARGE = Uncertainty("a test", (), (), 0.1, 0.05, 0.5, of="charge")
SCRUBS = replace(
    load_robot("husky"), effects={"turning": {"scrub": 0.5}}, uncertainty=CHARGE, rest_current_a=1.0
)


def test_of_motor_currents_the_charge_is_watched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "husky.toml").write_text(SCRUBS.to_toml())
    paths = tuple(amps(tmp_path, seed, factor) for seed, factor in enumerate((0.9, 1.0, 1.1)))
    runs = main(
        Args(paths, str(tmp_path / "husky.toml"), out=tmp_path / "out", soc=0.9, capacity_j=1.6e6)
    )
    for one, path in zip(runs, paths, strict=True):
        table = pd.read_csv(path)
        charge_as = float((table["motor_left_a"] + table["motor_right_a"]).iloc[:-1].sum()) * 0.2
        assert one.unit == "A s" and one.took_j[0] == pytest.approx(charge_as, rel=1e-6)
        assert one.covered.mean() > 0.8
        middle = len(one.left_m) // 2  # by then a run has shown its own part
        assert abs(one.mean_j[middle] / one.took_j[middle] - 1.0) < 0.04
        widths = (one.high_j - one.low_j) / one.mean_j
        assert widths[middle] < 0.6 * widths[0]
    printed, said = capsys.readouterr()
    assert "charge of the motors" in printed
    assert (
        said == "--soc, --capacity-j: not used: motor currents alone say nothing of the battery\n"
    )
    assert "took_as" in pd.read_csv(tmp_path / "out" / "watch.csv")
    assert "charge of the rest" in (tmp_path / "out" / "watch.html").read_text("utf-8")
    with pytest.raises(CompanionError, match="watch them separately"):
        main(Args((*paths, drive(tmp_path, 0)), str(tmp_path / "husky.toml"), out=tmp_path / "out"))


def test_nothing_of_the_future_is_told(runs: list[Watched], spoiled: Watched) -> None:
    """Up to a moment, predictions are alike, whatever the drive takes later."""
    plain = runs[0]
    before = plain.time_s < 1190.0
    np.testing.assert_allclose(plain.mean_j[before], spoiled.mean_j[before], rtol=1e-9)


def test_the_command_prints_a_table_and_writes_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = tuple(drive(tmp_path, seed, rolling=1.2) for seed in range(2))
    paths[1].write_text(paths[1].read_text().replace(",", ";"))
    mcap = tmp_path / "advice.mcap" if find_spec("foxglove") else None
    capacity_j = 0.85 * load_robot("husky").usable_energy_j
    main(
        Args(
            paths,
            "husky",
            quiet=True,
            out=tmp_path / "out",
            mcap=mcap,
            capacity_j=capacity_j,
            cruise_mps=0.8,
        )
    )
    assert mcap is None or mcap.stat().st_size > 10_000
    printed, said = capsys.readouterr()
    assert said == "run1.csv: read with cells separated by semicolons\n"
    assert "in the 90 %" in printed and "way left" in printed and "watch.html" in printed
    assert "a measured capacity of 85%" in printed and "the way home at 0.8 m/s (given)" in printed
    page = (tmp_path / "out" / "watch.html").read_text("utf-8")
    assert (
        "run0.csv" in page and "run1.csv" in page and "plotly" in page and "http-equiv" not in page
    )
    assert "<li>run1.csv: read with cells separated by semicolons</li>" in page
    assert (
        page.count(
            'role="img" aria-label="energy of the rest, kJ, over the way left in m, of 2 runs: '
        )
        == 1
    )
    assert page.count("<tr><td>run1.csv</td>") == 6, "moments of each run as a table"
    assert "probability integral transform" in page and "of 2 runs" in page
    scored = find_spec("scoringrules") is not None
    assert ('<th class="n">CRPS</th>' in page) is scored and ("No CRPS" in printed) is not scored
    assert ("No CRPS and no interval score" in page) is not scored
    assert '"dragmode":false' in page, "a finger that scrolls would zoom, and no key would undo it"
    moments = pd.read_csv(tmp_path / "out" / "watch.csv")
    assert (
        set(moments["run"]) == set(map(str, paths)) and (moments["low_j"] < moments["high_j"]).all()
    )


def test_names_on_the_page_are_escaped(runs: list[Watched]) -> None:
    robot = replace(load_robot("husky"), name="x\x1b[31m")
    page = watch_html(
        [replace(runs[0], name="<i>sneaky.csv")],
        robot,
        ["<i>sneaky too"],
        [("a.csv", "<i>sneaky note")],
    )
    # six moments in the table
    assert "<i>sneaky" not in page and page.count("&lt;i&gt;sneaky") == 3 + 6
    assert "<title>x?[31m: replayed as if live</title>" in page and "\x1b" not in page


def test_the_live_view_shows_battery_way_home_and_the_point_of_no_return(
    runs: list[Watched],
) -> None:
    console = Console(width=100, record=True, force_terminal=True)
    assert runs[0].advice is not None
    console.print(view("run0", runs[0].advice, 2400.0, 1.728e6, ("no power for 3 s",)))
    text = console.export_text()
    for part in ("battery", "way home", "point of no return", "no power for 3 s", "40 min"):
        assert part in text
    spread = runs[0].advice.energy_home_j
    others = (HomeOption("bay", 900.0, spread, spread, 0.25, False),)
    console.print(
        view("run0", replace(runs[0].advice, home="hut", others=others), 2400.0, 1.728e6, ())
    )
    several = console.export_text()
    for part in ("way to hut", "or bay", "900 m, 25.00%", "probability of getting there"):
        assert part in several
    energy = quantities.energy(runs[0].advice.energy_left_j.high)
    # whole, on a line of its own
    assert re.search(rf"\n│ +[^━\n]+ to {re.escape(energy)}\) +│\n", text)


def test_the_live_view_says_when_it_warned(runs: list[Watched]) -> None:
    console = Console(width=100, record=True, force_terminal=True)
    assert runs[0].advice is not None
    warned = replace(runs[0].advice, warnings=("no reading for 41 s",))
    with LiveView(console, 1.728e6) as live:
        live.show("run0", warned, 300.0, 2400.0)
        live.show("run0", warned, 340.0, 2400.0)  # still that of before
        live.show("run0", runs[0].advice, 2400.0, 2400.0)
    text = console.export_text()
    assert "5 min: no reading for 41 s" in text and "6 min: no reading" not in text


def test_a_way_that_ends_before_the_first_reading_cannot_be_predicted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reading is the mean of so many samples where a log is long."""
    table = pd.read_csv(drive(tmp_path, 0))
    speed_mps = np.where(np.arange(len(table)) < 5, table["speed_mps"] + 0.5, 0.0)
    table.assign(speed_mps=speed_mps).to_csv(tmp_path / "start.csv", index=False)
    monkeypatch.setattr("homeward.watch.replay._MOST_FED", len(table) // 10)
    with pytest.raises(CompanionError, match=r"the robot moves only in the first .* s, before"):
        main(Args((tmp_path / "start.csv",), "husky", out=tmp_path / "out"))


def test_what_cannot_be_watched_takes_one_line(tmp_path: Path) -> None:
    table = pd.read_csv(drive(tmp_path, 0))
    table.assign(speed_mps=0.0).to_csv(tmp_path / "stood.csv", index=False)
    currents = table.drop(columns="power_w").assign(motor_left_a=2.0, motor_right_a=2.0)
    currents.to_csv(tmp_path / "amps.csv", index=False)
    table.assign(speed_mps=3.6 * table["speed_mps"]).to_csv(tmp_path / "kmh.csv", index=False)
    table[:5].to_csv(tmp_path / "short.csv", index=False)
    said_of = {
        "stood.csv": "stood all the time", "amps.csv": "motor currents only", "kmh.csv": "another unit; km/h",
        "short.csv": "is too short",
    }  # fmt: skip
    for name, said in said_of.items():
        with pytest.raises(CompanionError, match=said):
            main(Args((tmp_path / name,), "husky", out=tmp_path / "out"))
    with pytest.raises(
        CompanionError, match=r"capacity_j = 150\.0 is not allowed; give a number in"
    ):
        # in Wh
        main(Args((tmp_path / "run0.csv",), "husky", out=tmp_path / "out", capacity_j=150.0))
    with pytest.raises(RecordingError, match="no recording"):
        main(Args((), "husky"))


def test_the_rest_of_a_recording_sums_up_to_all_of_it(tmp_path: Path) -> None:
    robot = load_robot("husky")
    run = signals(read_recording(drive(tmp_path, 3)), robot)
    rest: Any = Rest(run, Companion(robot, home="here"))
    ways, other_j = rest.from_sample(0)
    assert ways["way_m"].sum() == pytest.approx(rest.left_m[0])
    assert other_j > 0.0
    sample = round(1500.0 / STEP_S)
    later, _ = rest.from_sample(sample)
    assert later["way_m"].sum() == pytest.approx(rest.left_m[sample])
