"""What no known effect explains is put into a formula, and noise into none."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording, analyse
from homeward.diagnosis.explain.formula import Empirical, Search, _sectors, candidates, propose
from homeward.diagnosis.explain.residual_test import independent_blocks
from homeward.diagnosis.fit.fitted import with_columns
from homeward.diagnosis.fit.folds import cut_folds
from homeward.diagnosis.fit.held_out import held_out
from homeward.diagnosis.fit.refit import Refit, refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.physics import replay
from homeward.physics.model import GRAVITY_MPS2

Drive = Callable[..., list[Recording]]
Channels = Mapping[str, np.ndarray]
Hidden = Callable[[Robot, Channels], np.ndarray]


def with_hidden(recordings: list[Recording], robot: Robot, hidden: Hidden) -> list[Recording]:
    """The recordings with a heading, a payload that changes while standing or not, and a hidden
    power."""
    changed = []
    for run in recordings:
        channels = dict(run.channels)
        channels["heading_rad"] = np.angle(np.exp(1j * np.cumsum(channels["yaw_rate_radps"]) * 0.1))
        channels["payload_kg"] = 10.0 * (channels["time_s"] // 60.0 % 3.0)
        channels["power_w"] = (
            channels["power_w"] + carried(robot, channels) + hidden(robot, channels)
        )
        changed.append(dataclasses.replace(run, channels=channels))
    return changed


def carried(robot: Robot, channels: Channels) -> np.ndarray:
    """What the recorded payload costs by its mass."""
    of = (channels["time_s"], channels["speed_mps"])
    grade = channels["grade_rad"]
    without = replay(robot, *of, grade_rad=grade).power_w
    added = np.zeros(len(grade))
    for payload_kg in np.unique(channels["payload_kg"]):
        loaded = dataclasses.replace(robot, mass_kg=robot.mass_kg + payload_kg)
        here = channels["payload_kg"] == payload_kg
        added[here] = (replay(loaded, *of, grade_rad=grade).power_w - without)[here]
    return added


def prepared(
    recordings: list[Recording], robot: Robot
) -> tuple[Refit, Runs, np.ndarray, np.ndarray]:
    """The refit of some recordings, their windows, blocks and folds."""
    runs = average(usable_runs(recordings, robot)[0])
    fit = refit(runs, robot)
    block = independent_blocks(fit, runs).channels
    return fit, runs, block, cut_folds(runs, block)[0]


def proposed(recordings: list[Recording], robot: Robot) -> Empirical | None:
    """The formula for some recordings."""
    return propose(*prepared(recordings, robot), rng=np.random.default_rng(0))


def weight_w(robot: Robot, channels: Channels) -> np.ndarray:
    """m g v of a recording."""
    return np.asarray(robot.mass_kg * GRAVITY_MPS2 * channels["speed_mps"])


def turning_squared(robot: Robot, channels: Channels) -> np.ndarray:
    return (
        0.3
        * weight_w(robot, channels)
        * (channels["yaw_rate_radps"] * robot.track_m / robot.max_speed_mps) ** 2
    )


def sensing_while_driving(robot: Robot, channels: Channels) -> np.ndarray:
    return 0.15 * weight_w(robot, channels) * channels["sensing_hz"] / robot.max_sensing_hz


def northern_sector(robot: Robot, channels: Channels) -> np.ndarray:
    return (
        0.04
        * weight_w(robot, channels)
        * (np.abs(channels["heading_rad"] - np.pi / 2.0) < np.pi / 4.0)
    )


def payload_squared(robot: Robot, channels: Channels) -> np.ndarray:
    return 180.0 * (channels["speed_mps"] > 0.02) * (channels["payload_kg"] / robot.mass_kg) ** 2


@pytest.mark.parametrize(
    ("hidden", "text", "coefficient", "unit"),
    [
        (turning_squared, "m g v (|w| B / v_max)^2", 0.3, "1"),
        (sensing_while_driving, "m g v (f_s / f_max)", 0.15, "1"),
        (northern_sector, "m g v [heading within 45 deg of 90 deg]", 0.04, "1"),
        (payload_squared, "[v > 0] (payload / m)^2", 180.0, "W"),
    ],
)
def test_a_term_outside_the_catalogue_is_found_with_its_size(
    hidden: Hidden, text: str, coefficient: float, unit: str, drive: Drive, husky: Robot
) -> None:
    found = proposed(with_hidden(drive(husky, minutes=4.0), husky, hidden), husky)
    assert found is not None
    (term,) = found.terms
    assert (term.text, term.unit) == (text, unit)
    assert term.coefficient == pytest.approx(coefficient, rel=0.15)
    assert term.ci95[0] < term.coefficient < term.ci95[1]
    assert term.text not in term.alternatives
    assert found.held_out_gain > 0.3 and found.gain_ci95[0] > 0.0 and found.p_value <= 0.05
    np.testing.assert_allclose(found.contribution[:, 0], term.coefficient * found.columns[:, 0])


def test_two_terms_are_found_together(drive: Drive, husky: Robot) -> None:
    both = with_hidden(
        drive(husky, minutes=4.0),
        husky,
        lambda *given: turning_squared(*given) + northern_sector(*given),
    )
    found = proposed(both, husky)
    assert found is not None
    assert {one.text for one in found.terms} == {
        "m g v (|w| B / v_max)^2",
        "m g v [heading within 45 deg of 90 deg]",
    }
    assert found.contribution.shape == (len(found.columns), 2)


@pytest.mark.parametrize("seed", range(4))
def test_noise_follows_no_formula(seed: int, husky: Robot, drive: Drive) -> None:
    robot = dataclasses.replace(
        husky, rolling_resistance=(0.8 + 0.15 * seed) * husky.rolling_resistance
    )
    recordings = drive(robot, runs=4)[seed % 2 :]
    assert (
        proposed(
            with_hidden(recordings, robot, lambda _, channels: 0.0 * channels["speed_mps"]), husky
        )
        is None
    )


def test_a_power_that_no_channel_tells_has_no_formula(drive: Drive, husky: Robot) -> None:
    """Bursts at random moments are structure, and not of these channels."""
    rng = np.random.default_rng(3)

    def bursts(robot: Robot, channels: Channels) -> np.ndarray:
        return 20.0 * np.repeat(rng.random(len(channels["time_s"]) // 50) < 0.3, 50)

    assert proposed(with_hidden(drive(husky), husky, bursts), husky) is None


def test_unknown_physics_is_said_with_its_formula(drive: Drive, husky: Robot) -> None:
    analysis = analyse(with_hidden(drive(husky), husky, payload_squared), husky)
    diagnosis, evidence = analysis.diagnosis, analysis.evidence
    assert diagnosis.verdict == "unknown_physics" and diagnosis.missing_physics == ()
    assert [(check.condition, check.holds) for check in diagnosis.together][-1] == (
        "channel",
        False,
    )
    assert evidence is not None and evidence.empirical is not None
    assert (
        evidence.empirical.text in diagnosis.summary
        and "a description, not a cause" in diagnosis.summary
    )
    assert all(place.condition.startswith("payload above") for place in diagnosis.where)
    assert diagnosis.next_experiment is not None and "payload above" in diagnosis.next_experiment
    assert diagnosis.fit is not None
    arms = diagnosis.fit.arms
    assert arms["corrected"].rmse < 0.5 * min(arms["refit"].rmse, arms["placebo"].rmse)
    assert analysis.corrected.effects == husky.effects


def test_the_formula_is_written_with_signs_and_units(drive: Drive, husky: Robot) -> None:
    found = proposed(
        with_hidden(
            drive(husky), husky, lambda *given: -turning_squared(*given) + payload_squared(*given)
        ),
        husky,
    )
    assert found is not None
    assert found.constants == {"m": "m = 50 kg", "v_max": "v_max = 1 m/s", "B": "B = 0.5708 m"}
    first, second = sorted(found.terms, key=lambda one: one.unit)
    assert (first.coefficient < 0.0) and (second.coefficient > 0.0)
    assert f"{abs(second.coefficient):.3g} W [v > 0] (payload / m)^2" in found.text
    assert f"-{abs(first.coefficient):.3g} m g v" in found.text.replace("- ", "-")


def test_a_direction_and_its_opposite_share_the_cosine() -> None:
    """A function of the heading counts one side, and that of the opposite side the other."""
    heading_rad = np.linspace(-np.pi, np.pi, 37)
    functions = {name: values for _, name, values, _ in _sectors(heading_rad)}
    for degrees in range(0, 180, 45):
        ahead, behind = (functions[f"cos(heading - {at} deg)+"] for at in (degrees, degrees + 180))
        np.testing.assert_allclose(
            ahead - behind, functions[f"cos(heading - {degrees} deg)"], atol=1e-12
        )
        np.testing.assert_allclose(ahead * behind, 0.0, atol=1e-12)


def test_the_search_agrees_with_fits_one_by_one(drive: Drive, husky: Robot) -> None:
    """Errors of all candidates at once are those of the plain held-out fits, where no bound is in
    the way."""
    # so that drag has no bound within reach
    unknown = dataclasses.replace(husky, drag_ns2_per_m2=0.0)
    fit, runs, _, fold = prepared(with_hidden(drive(husky), husky, turning_squared), unknown)
    library = candidates(fit, runs)
    scores = Search(library, fit, runs, fold, correlation=1.0).scores(library.parts, [])

    def error(columns: np.ndarray) -> float:
        predicted = held_out(lambda chosen: with_columns(fit, chosen, runs.observed, columns), fold)
        return float(((runs.observed - predicted) ** 2).sum())

    n = len(fold)
    base, rng = error(np.zeros((n, 0))), np.random.default_rng(0)
    for one in rng.choice(len(library.places), 25, replace=False).tolist():
        expected = n * np.log(base / error(library.columns([one]))) - np.log(n) - library.cost[one]
        assert scores[one] == pytest.approx(expected, abs=3e-3 * n)  # 0.3 % of the squared error


def test_candidates_are_products_of_different_channels_each_once(
    drive: Drive, husky: Robot
) -> None:
    fit, runs, _, _ = prepared(
        with_hidden(drive(husky, minutes=4.0), husky, turning_squared), husky
    )
    library = candidates(fit, runs)
    texts = library.texts
    assert len(texts) == len(set(texts)) > 1000
    assert "m g v [v > 0]" not in texts and "m g v (v / v_max) (v / v_max)^2" not in texts
    bases = library.places[:, 0]
    cheapest = [float(library.cost[bases == base].min()) for base in np.unique(bases)]
    assert cheapest == [pytest.approx(2.0 * np.log(3.0))] * 3


@pytest.mark.parametrize(("track_m", "turning"), [(0.5, "B / v_max"), (0.0, "v_max / g")])
def test_a_candidate_is_what_its_formula_says(
    track_m: float, turning: str, short_fit: Refit, short_runs: Runs, husky: Robot
) -> None:
    robot, windows = dataclasses.replace(husky, track_m=track_m), len(short_runs.observed)
    fit = dataclasses.replace(
        short_fit, parameters=dataclasses.replace(short_fit.parameters, nominal=robot)
    )
    warm_c, soc, far_m = (
        np.linspace(-5.0, 45.0, windows),
        np.linspace(1.0, 0.3, windows),
        np.linspace(-4, 9.0, windows),
    )
    payload_kg = np.linspace(0.0, 10.0, windows)
    own = {"temperature_c": warm_c, "soc": soc, "base_distance_m": far_m, "payload_kg": payload_kg}
    runs = dataclasses.replace(short_runs, context={**short_runs.context, **own})
    v, w, a, grade, hz = (
        runs.context[name]
        for name in ("speed_mps", "yaw_rate_radps", "accel_mps2", "grade_rad", "sensing_hz")
    )
    scale_s = {
        "B / v_max": track_m / robot.max_speed_mps,
        "v_max / g": robot.max_speed_mps / GRAVITY_MPS2,
    }[turning]
    passed_s = runs.elapsed_s
    expected = {
        "v / v_max": v / robot.max_speed_mps, f"|w| {turning}": np.abs(w) * scale_s,
        f"w+ {turning}": np.maximum(w, 0.0) * scale_s, "|a| / g": np.abs(a) / GRAVITY_MPS2,
        "a+ / g": np.maximum(a, 0.0) / GRAVITY_MPS2, "a- / g": np.maximum(-a, 0.0) / GRAVITY_MPS2,
        "|sin(grade)|": np.abs(np.sin(grade)), "sin(grade)+": np.maximum(np.sin(grade), 0.0),
        "sin(grade)-": np.maximum(-np.sin(grade), 0.0), "f_s / f_max": hz / robot.max_sensing_hz,
        "(T - 20 C) / 20 K": (warm_c - 20.0) / 20.0, "(T - 20 C)+ / 20 K": np.maximum(warm_c - 20.0, 0.0) / 20.0,
        "(20 C - T)+ / 20 K": np.maximum(20.0 - warm_c, 0.0) / 20.0, "r / r_max": np.abs(far_m) / 9.0,
        "payload / m": payload_kg / robot.mass_kg, "1 - soc": 1.0 - soc, "t / t_max": passed_s / passed_s.max(),
    }  # fmt: skip
    library = candidates(fit, runs)
    weight_w = robot.mass_kg * GRAVITY_MPS2 * np.abs(v)
    for text, values in expected.items():
        column = library.columns([library.texts.index(f"m g v ({text})")])[:, 0]
        np.testing.assert_allclose(column, weight_w * values, rtol=1e-9, err_msg=text)
