"""The cases hide what they say, and are the same each time."""

import numpy as np
import pytest

from benchmarks.concealed.fixed_way.cases import CASES, Scene, simulate
from benchmarks.concealed.fixed_way.robot import EFFICIENCY, MASS_KG
from homeward.diagnosis.explain.catalogue import CATALOGUE

SHARES = {
    "01": {"surface_share": 0.1114, "payload_kg": 0.0873, "all": 0.1808},
    "02": {"surface_share": 0.0880, "viscous_ns_per_m": 0.1151, "all": 0.2031},
    "03": {"surface_share": 0.0803, "load_w": 0.0858, "all": 0.1661},
    "04": {"force_n": 0.1464, "all": 0.1464},
    "05": {"drive_share": 0.0787, "all": 0.0787},
    "06": {"drive_share": 0.0889, "all": 0.0889},
    "07": {"force_n": 0.0839, "all": 0.0839},
    "08": {"surface_share": 0.0823, "load_w": 0.0918, "all": 0.1741},
    "09": {"load_w": 0.2099, "all": 0.2099},
    "10": {"load_w": 0.1899, "all": 0.1899},
    "11": {"surface_share": 0.0864, "all": 0.0864},
    "12": {"load_w": 0.1457, "all": 0.1457},
    "13": {"surface_share": 0.0951, "all": 0.0951},
    "14": {"all": 0.0},
}
"""Share of all energy of each hidden part, by case."""


@pytest.fixture(scope="module")
def scenes() -> dict[str, Scene]:
    made = {}
    for number, case in CASES.items():
        made[number] = case.make(np.random.default_rng(case.seed))
    return made


@pytest.mark.parametrize("number", CASES)
def test_hidden_parts_consume_their_share(number: str, scenes: dict[str, Scene]) -> None:
    assert scenes[number].energy_shares() == pytest.approx(SHARES[number], abs=5e-4)


def test_a_case_has_a_hidden_part_for_each_true_effect() -> None:
    for number, case in CASES.items():
        parts = set(SHARES[number]) - {"all"}
        assert number == case.number
        assert len(case.effects) in (0, len(parts))
        assert (case.cause == "none") == (not parts)


def test_names_are_ids_of_the_diagnosis() -> None:
    for case in CASES.values():
        assert CATALOGUE.keys() >= {*case.effects, *case.tolerated}
        assert set(case.effects).isdisjoint(case.tolerated)


def test_the_same_case_gives_the_same_recordings() -> None:
    first = simulate(CASES["07"]).recordings
    second = simulate(CASES["07"]).recordings
    assert len(first) == 8
    for frame, again in zip(first, second, strict=True):
        assert np.array_equal(frame.to_numpy(), again.to_numpy())


def test_with_nothing_hidden_the_recorded_energy_is_the_one_by_hand() -> None:
    """By the recorded channels, with the formulas of the paper."""
    recorded_j = 0.0
    expected_j = 0.0
    for frame in simulate(CASES["14"]).recordings:
        grade_rad = frame["grade_rad"].to_numpy()
        speed_mps = frame["speed_mps"].to_numpy()
        rolling_and_climbing_n = MASS_KG * 9.80665 * (0.14 * np.cos(grade_rad) + np.sin(grade_rad))
        force_n = np.maximum(rolling_and_climbing_n + 0.13 * speed_mps**2, 0.0)
        expected_j += np.sum(74.0 + force_n * speed_mps / EFFICIENCY) * 0.1
        recorded_j += float(np.sum(frame["voltage_v"] * frame["current_a"])) * 0.1
    assert recorded_j == pytest.approx(expected_j, rel=0.005)


def test_both_cases_of_slow_hills_have_the_same_drives(scenes: dict[str, Scene]) -> None:
    for chatters, rough in zip(scenes["05"].drives, scenes["13"].drives, strict=True):
        assert np.array_equal(chatters.speed_mps, rough.speed_mps)


def test_slow_hills_are_slow_but_in_two_drives(scenes: dict[str, Scene]) -> None:
    slopes_mps = []
    for run in scenes["13"].drives:
        is_slope = (np.abs(run.grade_rad) > 0.05) & (run.speed_mps > 0.1)
        slopes_mps.append(np.median(run.speed_mps[is_slope]))
    hurried = slopes_mps[2], slopes_mps[6]
    assert min(hurried) > 0.6
    assert sorted(slopes_mps)[5] < 0.52


def test_the_random_device_is_unrelated_to_the_temperature(scenes: dict[str, Scene]) -> None:
    scene = scenes["10"]
    on_shares = []
    for hidden in scene.hidden:
        load_w = np.asarray(hidden.load_w)
        on_shares.append(float(np.mean(load_w[: round(720.0 / 0.1)] > 0.0)))
    assert abs(np.corrcoef(on_shares, scene.temperatures_c)[0, 1]) < 0.05
    assert np.std(on_shares) > 0.12


def test_the_compressor_runs_longer_on_hotter_days(scenes: dict[str, Scene]) -> None:
    scene = scenes["09"]
    on_shares = [float(np.mean(np.asarray(hidden.load_w) > 0.0)) for hidden in scene.hidden]
    assert np.corrcoef(on_shares, scene.temperatures_c)[0, 1] > 0.7
