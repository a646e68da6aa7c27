from __future__ import annotations

import gzip
import re
from collections import Counter
from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest

import homeward
from benchmarks.plants import base, plant
from benchmarks.plants.case import Array, Case, Run, anonymous, read_truth, write
from benchmarks.plants.fleet import FLEET
from benchmarks.plants.observe import NOISE, window_rms
from benchmarks.plants.rollout import EFFECTS, INSTRUMENTS, Rollout, Scenario, simulate
from homeward.diagnosis.recordings import read_recording
from homeward.physics import Robot
from homeward.physics.model import ancillary_power, drive_power, traction_force

Rolled = list[tuple[Rollout, Case]]


@pytest.fixture(scope="module")
def rolled() -> Rolled:
    return list(plant.rollouts())


@pytest.fixture
def case() -> Case:
    time_s = np.arange(50) / 10.0
    run = Run({"time_s": time_s, "speed_mps": 1.0 + 0.0 * time_s, "power_w": 50.0 + time_s}, time_s > 2.0)
    robot = homeward.load_robot("husky")
    return Case(anonymous("plant", 3), "plant", "single", ("standby",), "low", 3, robot, (run, run), 0.1)


def of_kind(rolled: Rolled, *kinds: str) -> Iterator[tuple[Rollout, Case]]:
    return ((rollout, case) for rollout, case in rolled if case.kind in kinds)


def observed(run: Run) -> Array:
    channels = run.channels
    if "power_w" in channels:
        return channels["power_w"]
    if "voltage_v" in channels:
        return channels["voltage_v"] * channels["current_a"]
    return channels["motor_left_a"] + channels["motor_right_a"]


def speed(run: Run) -> Array:
    channels = run.channels
    if "speed_mps" in channels:
        return channels["speed_mps"]
    return 0.5 * (channels["wheel_left_mps"] + channels["wheel_right_mps"])


def paper_power(robot: Robot, run: Run) -> Array:
    grade_rad = run.channels.get("grade_rad", np.zeros(speed(run).size))
    force_n = traction_force(robot, speed(run), grade_rad)
    return np.asarray(ancillary_power(robot, run.channels["sensing_hz"]) + drive_power(robot, force_n, speed(run)))


def test_written_case_keeps_the_truth_out_of_sight(case: Case, tmp_path: Path) -> None:
    paths = write(case, tmp_path / "seen", tmp_path / "truth")
    assert sorted(p.name for p in (tmp_path / "seen" / case.name).iterdir()) == ["robot.toml", *(p.name for p in paths)]
    np.testing.assert_allclose(read_recording(paths[0]).channels["power_w"], case.runs[0].channels["power_w"])
    known = read_truth(tmp_path / "truth", case.name)
    assert (known.truth, known.kind, known.noise, known.seed) == (("standby",), "single", "low", 3)
    np.testing.assert_array_equal(known.affected[1], case.runs[1].affected)


def test_truth_beside_the_recordings_is_refused(case: Case, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="separate"):
        write(case, tmp_path, tmp_path / "truth")


def test_the_same_seed_writes_the_same_bytes(tmp_path: Path) -> None:
    for folder in ("once", "again"):
        for case in islice(plant.cases(seed=1), 4):
            write(case, tmp_path / folder / "seen", tmp_path / folder / "truth")
    once, again = ({p.relative_to(tmp_path / f): p.read_bytes() for p in (tmp_path / f).rglob("*") if p.is_file()}
                   for f in ("once", "again"))  # fmt: skip
    assert once == again and len(once) > 20


def test_other_seeds_hide_the_same_effects_elsewhere() -> None:
    first, second = next(plant.cases(seed=0)), next(plant.cases(seed=1))
    assert first.truth == second.truth and first.name != second.name
    assert not np.array_equal(observed(first.runs[0])[:500], observed(second.runs[0])[:500])


def test_there_are_enough_cases_of_every_kind(rolled: Rolled) -> None:
    kinds = Counter(case.kind for _, case in rolled)
    singles = Counter(case.truth[0] for _, case in of_kind(rolled, "single"))
    assert set(singles) == {*EFFECTS, *INSTRUMENTS} - {case.truth[0] for _, case in of_kind(rolled, "outside")}
    assert min(singles.values()) >= 6
    assert kinds["pair"] >= 16 and kinds["outside"] >= 6 and kinds["invisible"] >= 12
    assert kinds["exact"] >= 40 and kinds["misset"] >= 40
    assert len({case.name for _, case in rolled}) == len(rolled)


def test_visible_effects_survive_a_refit_and_invisible_ones_do_not(rolled: Rolled) -> None:
    for rollout, case in of_kind(rolled, "single", "pair", "outside"):
        assert max(rollout.absorbed) < 0.9, case.truth
        assert min(rollout.energy_share) > 0.03 and max(rollout.energy_share) < 0.32, (case.truth, rollout.energy_share)
    for rollout, case in of_kind(rolled, "invisible"):
        assert min(rollout.absorbed) >= 0.9, case.truth


def test_affected_samples_hold_most_of_an_effect_and_are_not_all(rolled: Rolled) -> None:
    for rollout, case in of_kind(rolled, "single"):
        affected = np.concatenate([run.affected for run in case.runs])
        effect = np.abs(np.concatenate(rollout.effects[0]))
        assert effect[affected].sum() > 0.75 * effect.sum(), case.truth
        assert 0.02 < affected.mean() < 1.0, case.truth


def test_exact_controls_are_the_papers_model_and_noise(rolled: Rolled) -> None:
    for _, case in of_kind(rolled, "exact"):
        errors = [observed(run) - paper_power(case.robot, run) for run in case.runs]
        assert window_rms(np.concatenate(errors), 0.1) == pytest.approx(case.noise_rms, rel=0.01)
        level = np.concatenate(errors).std() / np.mean(np.concatenate([observed(run) for run in case.runs]))
        assert level == pytest.approx(NOISE[case.noise], rel=0.25)
        assert not any(run.affected.any() for run in case.runs)


def test_misset_controls_need_new_values_and_nothing_else(rolled: Rolled) -> None:
    for rollout, case in of_kind(rolled, "misset"):
        columns = np.concatenate([base.columns(rollout.robot, drive) for drive in rollout.drives])
        seen = np.concatenate([observed(run) for run in case.runs])
        switched = np.concatenate([(run.channels["sensing_hz"] > 0.0) * rollout.robot.computer_w for run in case.runs])
        scale = np.abs(columns).max(axis=0) + 1e-12
        refit = (columns / scale) @ np.linalg.lstsq(columns / scale, seen - switched)[0] + switched
        nominal = np.concatenate([paper_power(case.robot, run) for run in case.runs])
        assert window_rms(seen - refit, 0.1) < 1.2 * case.noise_rms
        assert window_rms(seen - nominal, 0.1) > 1.2 * window_rms(seen - refit, 0.1) or case.noise == "high"


def test_what_is_not_hidden_is_the_papers_model(rolled: Rolled) -> None:
    for rollout, case in of_kind(rolled, "single"):
        if case.truth[0] in EFFECTS and not rollout.torque:
            for drive, clean, effect in zip(rollout.drives, rollout.clean, rollout.effects[0], strict=True):
                force_n = traction_force(rollout.robot, drive.speed_mps, drive.grade_rad)
                plain = ancillary_power(rollout.robot, drive.sensing_hz) + drive_power(
                    rollout.robot, force_n, drive.speed_mps
                )
                np.testing.assert_allclose(clean - effect, plain, rtol=1e-9, atol=1e-9)


def test_noise_levels_of_a_rollout_differ_in_noise_only(rolled: Rolled) -> None:
    (rollout, low), (same, high) = rolled[0], rolled[2]
    assert rollout is same and (low.noise, high.noise) == ("low", "high")
    assert 3.0 * low.noise_rms < high.noise_rms
    assert len(low.runs) == len(high.runs) and np.array_equal(low.runs[0].affected, high.runs[0].affected)


def test_the_tool_sees_nothing_of_the_truth(rolled: Rolled, tmp_path: Path) -> None:
    chosen = [case for _, case in rolled[::14]]
    for case in chosen:
        write(case, tmp_path / "seen", tmp_path / "truth")
    words = {*EFFECTS, *INSTRUMENTS, "single", "pair", "outside", "invisible", "exact", "misset", "truth", "affected"}
    for case in chosen:
        files = sorted((tmp_path / "seen" / case.name).iterdir())
        heads = [gzip.decompress(f.read_bytes()).decode().splitlines()[0] for f in files if f.suffix == ".gz"]
        toml = (tmp_path / "seen" / case.name / "robot.toml").read_text()
        assert not words & set(re.findall(r"\w+", " ".join([case.name, *(f.name for f in files), *heads]))), case.name
        numbers = r" = [-+.e\d]+"  # a misset robot differs from the one of the fleet in numbers only
        assert re.sub(numbers, "", toml) == re.sub(numbers, "", FLEET[case.robot.name].to_toml())
        assert homeward.load_robot(tmp_path / "seen" / case.name / "robot.toml") == case.robot
    kinds = [case.kind for case in sorted((case for _, case in rolled), key=lambda case: case.name)]
    changes = sum(kind != following for kind, following in pairwise(kinds))
    assert changes > len(kinds) / 2  # in the order of their names, kinds come mixed


@pytest.mark.parametrize("robot", ["rusti_computer", "husky", "jackal", "van", "courier", "porter"])
def test_recordings_keep_to_the_schema(rolled: Rolled, robot: str, tmp_path: Path) -> None:
    case = next(case for _, case in rolled if case.robot.name == robot)
    for path, run in zip(write(case, tmp_path / "seen", tmp_path / "truth"), case.runs, strict=True):
        recording = read_recording(path)
        for name, values in run.channels.items():
            if name != "time_s":
                np.testing.assert_allclose(recording.channels[name], values, rtol=1e-6, atol=1e-6, err_msg=name)
        assert 100.0 < run.channels["time_s"][-1] < 700.0


def test_torque_is_recorded_where_it_should_be(rolled: Rolled) -> None:
    currents = [case for _, case in rolled if "motor_left_a" in case.runs[0].channels]
    assert {case.truth[0] for case in currents} == {effect for effect, _ in plant.IN_TORQUE}
    assert all("power_w" not in run.channels for case in currents for run in case.runs)


def test_regeneration_charges_no_more_than_gravity_gives() -> None:
    rollout = simulate(Scenario("single", ("regeneration",), "van", "upland", 5))
    for drive, given in zip(rollout.drives, rollout.effects[0], strict=True):
        gravity_w = np.maximum(-rollout.robot.mass_kg * base.GRAVITY_MPS2 * np.sin(drive.grade_rad), 0.0)
        assert np.all(given <= 0.0) and np.all(-given <= gravity_w * drive.speed_mps)
