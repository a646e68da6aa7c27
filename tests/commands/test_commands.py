"""The command `homeward`: every subcommand, what it prints, and how it ends."""

from __future__ import annotations

import dataclasses
import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward import __main__ as command
from homeward import load_robot
from homeward.commands.range_parts import Mission
from homeward.commands.routes import figures, generated_routes
from homeward.datasets import DATASETS, LOCAL_FOLDER
from homeward.diagnosis import read_recording
from homeward.envs.routes import load_route
from homeward.physics import d_max, mission_energy
from homeward.physics.robot import preset_names


def call(
    arguments: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    width: int = 100,
) -> tuple[int, str, str]:
    """Exit code, output and errors of `homeward ARGUMENTS`."""
    monkeypatch.setattr(sys, "argv", ["/somewhere/bin/homeward", *arguments.split()])
    monkeypatch.setenv("COLUMNS", str(width))
    code = command.run()
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.parametrize("name", command.COMMANDS)
def test_help_of_a_subcommand_teaches(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        call(f"{name} --help", monkeypatch, capsys)
    out = capsys.readouterr().out
    assert ended.value.code == 0
    assert out.startswith(f"usage: homeward {name} ")
    args = importlib.import_module(f"homeward.commands.{name}").Args
    for field in dataclasses.fields(args):
        option = f"--{field.name.replace('_', '-')}"
        assert option in out or "Positional" in str(field.type) or "name=" in str(field.type)


def test_it_is_installed_and_works_anywhere(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "homeward", "range", "husky", "--duty", "nine"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("range nobody", "neither a preset nor a file"),
        ("range rusti --duty 0", "--duty 0 is not allowed; give a share of the time, 0.001 to 1"),
        ("range rusti --grade 90", "--grade 90 is not allowed; give degrees between -45 and 45"),
        ("range rusti --speed-mps nan", "--speed-mps nan is not allowed"),
        ("range rusti --sensing-hz 1e9", "give 0 to 100 Hz"),
        ("range rusti --plot range.jpg", "ends in .png, .svg or .pdf"),
        ("robots nobody", "neither a preset nor a file"),
        ("routes nowhere", "neither a known route nor a file"),
        ("routes box --plot box", "ends in .png, .svg or .pdf"),
        ("routes generated --draws 0", "at least 1 draw"),
        ("datasets nothing", "unknown data set 'nothing'; known: husky_borealtc"),
        ("datasets husky_borealtc/SAND", "has no group 'SAND'"),
        ("evaluate --agents nobody", "unknown agent 'nobody'"),
        ("train --env nowhere", "unknown env 'nowhere'"),
        ("diagnose nothing.csv", "nothing.csv"),
    ],
)
def test_bad_input_takes_one_line(
    arguments: str,
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = call(arguments, monkeypatch, capsys)
    err = err.strip()
    assert (code, out, err.count("\n")) == (2, "", 0)
    assert err.startswith(f"homeward {arguments.split()[0]}: ") and says in err


def test_range_prints_the_estimate_of_the_paper(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    picture = tmp_path / "new" / "range.png"
    code, out, err = call(
        f"range rusti --grade 5.71 --duty 0.367 --plot {picture}", monkeypatch, capsys
    )
    assert (code, err) == (0, "")
    range_m = float(d_max(load_robot("rusti"), grade_rad=np.radians(5.71), duty=0.367))
    assert f"rusti: {range_m / 1000:.2f} km on one charge, in 2 h 10 min" in out
    shares = dict(re.findall(r"^ +(\w+) .* ([\d.]+)%", out, re.MULTILINE))
    assert shares["rolling"] == shares["grade"] == "45.5"  # tan 5.71 deg = 0.1 = C_rr
    assert shares["total"] == "100.0"
    assert sum(float(share) for name, share in shares.items() if name != "total") == pytest.approx(
        100.0, abs=0.3
    )
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("preset", preset_names())
@pytest.mark.parametrize(
    ("grade_rad", "duty", "sensing_hz"), [(0.1, 0.4, 5.0), (-0.02, 1.0, 0.0), (-0.4, 0.9, 5.0)]
)
def test_parts_add_up_to_the_equation(
    preset: str, grade_rad: float, duty: float, sensing_hz: float
) -> None:
    robot = load_robot(preset)
    parts = Mission(robot, grade_rad, duty, sensing_hz).parts_j_per_m(robot.max_speed_mps)
    whole = mission_energy(robot, 1.0, robot.max_speed_mps, grade_rad, duty, sensing_hz)
    assert sum(parts.values()) == pytest.approx(float(whole))


@pytest.mark.parametrize("duty", [1.0, 0.4])
def test_parts_by_the_kernel_add_up_to_the_range(duty: float) -> None:
    effects = {
        "standby": {"power_w": 5.0},
        "internal_resistance": {"ohm": 0.05},
        "viscous": {"drag_ns_per_m": 20.0},
    }
    mission = Mission(dataclasses.replace(load_robot("husky"), effects=effects), 0.03, duty, 0.0)
    parts = mission.parts_j_per_m(0.8)
    assert set(effects) <= set(parts)
    assert sum(parts.values()) * mission.range_m(0.8) == pytest.approx(
        mission.robot.usable_energy_j, rel=2e-3
    )


def test_parts_by_the_kernel_are_those_of_the_paper_where_both_speak() -> None:
    robot = load_robot("husky")
    mission = Mission(robot, 0.03, 0.4, 10.0)
    paper, kernel = mission._parts_of_the_paper(0.8), mission._parts_by_the_kernel(0.8)
    assert {name: kernel[name] for name in paper} == pytest.approx(paper)


def test_a_slope_that_drives_the_robot_for_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "free.toml"
    rusti = load_robot("rusti")
    free = dataclasses.replace(rusti, sensing_idle_w=0.0, communication_w=0.0, controller_w=0.0)
    file.write_text(free.to_toml())
    code, out, _ = call(f"range {file} --grade -20", monkeypatch, capsys)
    assert code == 0
    assert "any distance: the slope drives it without power" in out


def test_robots_are_listed_and_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, _ = call("robots", monkeypatch, capsys)
    assert code == 0
    for name in preset_names():
        assert f" {name} " in out and f"{name}: " in out
    assert "…" not in out
    _, out, _ = call("robots husky", monkeypatch, capsys)
    mine = tmp_path / "mine.toml"
    mine.write_text(out)
    assert load_robot(mine) == load_robot("husky")


def test_routes_are_listed_measured_and_drawn(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, _ = call("routes", monkeypatch, capsys)
    assert code == 0 and all(name in out for name in ("generated", "hidden_wind", "box", "incline"))
    picture = tmp_path / "incline.svg"
    code, out, _ = call(f"routes incline --robot rusti --plot {picture}", monkeypatch, capsys)
    assert code == 0 and "5.71 °" in out
    assert b"<svg" in picture.read_bytes()
    code, out, _ = call(
        f"routes generated --draws 20 --plot {tmp_path / 'many.png'}", monkeypatch, capsys
    )
    assert code == 0 and "3,627 m" in out


def test_figures_of_a_route(tmp_path: Path) -> None:
    file = tmp_path / "hill.csv"
    file.write_text("distance_m,elevation_m\n0,0\n100,10\n200,4\n")
    robot = load_robot("rusti")
    found = {
        name: (float(values[0]), unit)
        for name, (values, unit) in figures([load_route(file, 1.0)], robot).items()
    }
    assert found["length"] == (200.0, "m")
    assert found["climb on the way out"][0] == pytest.approx(10.0)
    assert found["descent on the way out"][0] == pytest.approx(6.0)
    assert found["steepest climb"][0] == pytest.approx(np.degrees(np.arcsin(0.1)))
    up, down = (mission_energy(robot, 100.0, 1.0, np.arcsin(sine)) for sine in (0.1, -0.06))
    assert found["energy there, rusti at 1.00 m/s"][0] == pytest.approx(
        100.0 * (up + down) / robot.usable_energy_j
    )


def test_generated_routes_are_those_of_the_environments() -> None:
    import gymnasium as gym

    env = gym.make("homeward/OutAndBack-v0")
    env.reset(seed=7)
    places = env.unwrapped.batch.routes["places"][0, :32]  # type: ignore[attr-defined]
    first, second = generated_routes(load_robot("rusti_computer"), "generated", 2, seed=7)
    np.testing.assert_allclose(np.sin(first.grade_rad), places["sin_grade"], atol=1e-7)
    assert not np.allclose(first.grade_rad, second.grade_rad)


def test_datasets_are_listed_and_fetched(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], data_folder: Path
) -> None:
    code, out, _ = call("datasets", monkeypatch, capsys)
    assert code == 0 and all(name in out for name in DATASETS)
    monkeypatch.setenv(LOCAL_FOLDER, str(data_folder))
    code, out, _ = call("datasets husky_borealtc/FLOORING", monkeypatch, capsys)
    paths = [Path(line) for line in out.splitlines()]
    assert code == 0 and len(paths) == 10 and all(path.is_file() for path in paths)


def test_scripts_run_as_subcommands(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, _ = call(
        f"evaluate --agents soc50 --episodes 2 --out {tmp_path}", monkeypatch, capsys
    )
    assert code == 0 and "soc50" in out
    assert (tmp_path / "evaluation.json").is_file()


def test_columns_are_proposed_and_written(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    table = pd.DataFrame({"t (ms)": np.arange(100) * 100, "v [km/h]": 3.6, "P (W)": 50.0, "x": 0.0})
    path, mapping = tmp_path / "run.csv", tmp_path / "map.toml"
    table.rename(columns={"P (W)": "power (W)", "v [km/h]": "speed [km/h]"}).to_csv(
        path, index=False, sep=";"
    )
    code, out, err = call(f"columns {path}", monkeypatch, capsys)
    assert (code, err) == (0, "")
    assert (
        "certain" in out
        and "its name says km/h" in out
        and "Not used: x" in out
        and "semicolons" in out
    )
    assert "With it the file reads: 100 samples over 9.9 s." in out and "[columns]" in out
    code, out, err = call(f"columns {path} --out {mapping}", monkeypatch, capsys)
    assert (code, err) == (0, "") and "--columns" in out
    assert read_recording(path, mapping).channels["speed_mps"][0] == pytest.approx(1.0)
    code, out, err = call(f"columns {path} --columns {mapping}", monkeypatch, capsys)
    assert (code, err) == (0, "") and "100 samples over 9.9 s." in out
    speed = next(line.split() for line in out.splitlines() if line.strip().startswith("speed_mps"))
    assert speed[:6] == ["speed_mps", "1", "1", "1", "100%", "m/s"]
    code, _, err = call(
        f"columns {path} --columns {mapping} --out {tmp_path}/new.toml", monkeypatch, capsys
    )
    assert code == 2 and "give one of them" in err
    before = mapping.read_bytes()
    code, _, err = call(f"columns {path} --out {mapping}", monkeypatch, capsys)
    assert code == 2 and "is not replaced" in err and mapping.read_bytes() == before
    ready = pd.DataFrame(
        {"time_s": 1714564800000 + np.arange(100) * 100, "speed_mps": 0.5, "power_w": 50.0}
    )
    ready.to_csv(path, index=False)
    code, out, err = call(f"columns {path}", monkeypatch, capsys)
    assert (
        (code, err) == (0, "")
        and "time_s is in ms" in out
        and "A mapping is not needed" in out
        and "--out" not in out
    )
    table[["x"]].to_csv(path, index=False)
    code, _, err = call(f"columns {path}", monkeypatch, capsys)
    assert code == 2 and "no column looks like a channel" in err


@pytest.mark.parametrize("width", [60, 80])
@pytest.mark.parametrize(
    "arguments",
    ["robots", "routes", "datasets", "range husky", "range rusti --grade 5.71 --duty 0.367", "routes incline",
     "evaluate --agents soc50 dmax_adaptive --episodes 4 --out OUT"],
)  # fmt: skip
def test_tables_fit_the_terminal(
    arguments: str,
    width: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    code, out, _ = call(arguments.replace("OUT", str(tmp_path)), monkeypatch, capsys, width)
    assert code == 0
    assert "…" not in out and max(map(len, out.splitlines())) <= width
    if width == 60 and arguments.startswith(("robots", "range husky", "evaluate")):
        assert f"Left out in a terminal of {width} columns: " in out
    if "evaluate" in arguments:
        assert "soc50" in out and "dmax_adaptive" in out and "stranded" in out


def test_a_name_with_markup_and_escapes_is_printed_as_text(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    robot = dataclasses.replace(load_robot("husky"), name="[red]x\x1b[31m[/red]")
    (tmp_path / "r.toml").write_text(robot.to_toml())
    for arguments in (f"range {tmp_path}/r.toml", f"routes incline --robot {tmp_path}/r.toml"):
        code, out, _ = call(arguments, monkeypatch, capsys)
        assert code == 0 and "[red]x?[31m[/red]" in out and "\x1b" not in out


def test_range_shows_what_stays_below_the_cut_off(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    robot = dataclasses.replace(
        load_robot("turtlebot3_burger"),
        cutoff_v=10.5,
        effects={"internal_resistance": {"ohm": 0.3}},
    )
    file = tmp_path / "cut.toml"
    file.write_text(robot.to_toml())
    code, out, _ = call(f"range {file}", monkeypatch, capsys)
    assert code == 0 and "a cut-off at 10.5 V: 71.9 kJ usable" in out
    of_a_charge = dict(re.findall(r"^ +(\w+) .*?([\d.]+) kJ", out, re.MULTILINE))
    both_kj = float(of_a_charge["total"]) + float(of_a_charge["below_cutoff"])
    assert both_kj == pytest.approx(71.9, abs=0.2)
    strong = dataclasses.replace(robot, cutoff_v=12.45)
    file.write_text(strong.to_toml())
    code, out, _ = call(f"range {file}", monkeypatch, capsys)
    assert code == 0 and "0 m on one charge" in out
