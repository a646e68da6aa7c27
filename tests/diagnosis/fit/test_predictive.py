"""The fit made to predict: what drives show is found, what they do not show stays, and later drives
are predicted."""

import dataclasses

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.predictive import (
    HEATER,
    INERTIA,
    LOSSES,
    REGENERATION,
    SET_POINT,
    TURNING,
    Predictive,
    fit_predictive,
    robot_of,
)
from homeward.diagnosis.fit.replay import Runs, average, predict
from homeward.diagnosis.fit.usable import usable_runs
from homeward.physics import load_robot, replay
from homeward.physics.uncertainty import Uncertainty

CAR = dataclasses.replace(
    load_robot("husky"), mass_kg=1500.0, rolling_resistance=0.011, drag_ns2_per_m2=0.4, motor_loss=0.1,
    friction_loss=0.06, max_speed_mps=35.0, controller_w=300.0, sensing_j_per_sample=0.0,
)  # fmt: skip
DRIVES, SECONDS, STEP_S = 10, 240.0, 0.5


def drives(
    robot: Robot, seed: int, warm_c: np.ndarray, noise_w: float = 300.0, hilly: bool = True
) -> list[Recording]:
    """Drives with stops between speeds, over hills or on the level, each in its own weather."""
    rng = np.random.default_rng(seed)
    recordings = []
    for number, temperature_c in enumerate(warm_c):
        time_s = np.arange(0.0, SECONDS, STEP_S)
        goals_mps = np.repeat(rng.choice([0.0, 8.0, 14.0, 20.0], len(time_s) // 40 + 1), 40)[
            : len(time_s)
        ]
        speed = np.zeros(len(time_s))
        for index in range(1, len(time_s)):
            speed[index] = speed[index - 1] + np.clip(
                goals_mps[index] - speed[index - 1], -1.2 * STEP_S, STEP_S
            )
        grade = 0.03 * np.sin(np.cumsum(speed) * STEP_S / 150.0) * hilly
        given = {"grade_rad": grade, "temperature_c": np.full(len(time_s), temperature_c)}
        power_w = replay(robot, time_s, speed, **given).power_w + rng.normal(
            0.0, noise_w, len(time_s)
        )
        channels = {"time_s": time_s, "speed_mps": speed, "power_w": power_w, **given}
        recordings.append(Recording(f"drive{number}.csv", str(number), channels))
    return recordings


def runs_of(recordings: list[Recording], robot: Robot) -> Runs:
    return average(usable_runs(recordings, robot)[0])


def fitted(recordings: list[Recording], robot: Robot) -> tuple[Predictive, Runs]:
    runs = runs_of(recordings, robot)
    return fit_predictive(
        runs, robot, robot, lambda changed: predict(runs, changed), runs.run
    ), runs


TRUE = dataclasses.replace(
    CAR,
    motor_loss=0.05, friction_loss=0.03,
    effects={
        "inertia": {"mass_factor": 1.05}, "regeneration": {"share": 0.8},
        "heater": {"w_per_k": 150.0, "on_below_c": 16.0}, "air_temperature": {"rolling_per_k": 0.008},
    },
)  # fmt: skip
WINTER_C, SUMMER_C = np.linspace(-8.0, 12.0, DRIVES), np.linspace(18.0, 28.0, DRIVES)


@pytest.fixture(scope="module")
def winter() -> tuple[Predictive, Runs]:
    """A car with a heater, inertia and regeneration, of which its file knows nothing, in winter."""
    return fitted(drives(TRUE, 0, WINTER_C), CAR)


def test_a_file_from_the_winter_predicts_the_summer(winter: tuple[Predictive, Runs]) -> None:
    """What the heater drew must not hide in the idle power."""
    fit, _ = winter
    summer = runs_of(drives(TRUE, 1, SUMMER_C), CAR)
    error, error_given = (predict(summer, robot) - summer.observed for robot in (fit.changed, CAR))
    drawn_j = summer.observed @ summer.duration_s
    assert abs(error @ summer.duration_s) < 0.04 * drawn_j
    assert np.mean(error**2) < 0.02 * np.mean(error_given**2)


def test_what_the_drives_show_is_found_within_its_interval(winter: tuple[Predictive, Runs]) -> None:
    fit, runs = winter
    wide = dict(
        zip(
            fit.numbers,
            np.sqrt(np.diag(fit.covariance(runs, cut_blocks(runs.run)))).tolist(),
            strict=True,
        )
    )
    gamma = TRUE.traction_efficiency
    true = {
        "mass": TRUE.mass_kg / gamma, INERTIA: 1.05 * TRUE.mass_kg / gamma, HEATER: 150.0, SET_POINT: 16.0,
        "idle_power": 300.0 + CAR.sensing_idle_w + CAR.communication_w, "drag": 0.4 / gamma,
    }  # fmt: skip
    for name, value in true.items():
        assert abs(fit.numbers[name] - value) < 4.0 * wide[name], name
    assert wide[HEATER] < 0.3 * 150.0 and wide["mass"] < 0.1 * TRUE.mass_kg


def test_only_the_product_of_regeneration_and_efficiency_is_known_and_it_is_right(
    winter: tuple[Predictive, Runs],
) -> None:
    """A file that assumes losses of 14.5 % instead of 8 % would need a share above all: losses move
    with it."""
    fit, _ = winter
    product = fit.numbers[REGENERATION] * (1.0 - fit.numbers[LOSSES])
    assert product == pytest.approx(0.8 * TRUE.traction_efficiency, rel=0.05)


def test_what_the_drives_do_not_show_stays_where_it_was() -> None:
    """On the level at one temperature, without braking to speak of, nothing is known of slopes,
    heaters or turning."""
    level = drives(CAR, 2, np.full(3, 10.0), hilly=False)
    for one in level:
        one.channels["speed_mps"][:] = 10.0
        noise_w = np.random.default_rng(4).normal(0.0, 100.0, len(one))
        power_w = replay(CAR, one.channels["time_s"], one.channels["speed_mps"]).power_w
        one.channels["power_w"][:] = power_w + noise_w
    fit, _ = fitted(level, CAR)
    given = {entry.name: entry.centre for entry in fit.entries}
    assert fit.numbers["mass"] == pytest.approx(given["mass"], rel=1e-3)
    assert fit.numbers[REGENERATION] == given[REGENERATION] == 0.0
    assert not {HEATER, SET_POINT, TURNING} & set(given)


def test_of_motor_current_the_current_at_rest_is_in_the_file() -> None:
    amps_robot = dataclasses.replace(CAR, traction_n_per_a=21.0, rest_current_a=1.5)
    runs = runs_of(drives(CAR, 3, np.full(3, 20.0)), CAR)
    of_current = dataclasses.replace(runs, unit="A")
    observed = dataclasses.replace(of_current, observed=predict(of_current, amps_robot))
    plain = dataclasses.replace(amps_robot, rest_current_a=0.0)
    fit = fit_predictive(
        observed, plain, plain, lambda robot: predict(observed, robot), observed.run
    )
    assert fit.changed.rest_current_a == pytest.approx(1.5, rel=0.1)
    assert LOSSES not in fit.numbers and REGENERATION not in fit.numbers


def test_numbers_and_robot_are_one(winter: tuple[Predictive, Runs]) -> None:
    """A robot of an effect's own numbers keeps those that are not fitted."""
    fit, _ = winter
    limited = dataclasses.replace(
        CAR, effects={"regeneration": {"share": 0.1, "up_to_w": 20_000.0}}
    )
    robot = robot_of(limited, fit.numbers)
    assert robot.effects["regeneration"] == {
        "share": fit.numbers[REGENERATION],
        "up_to_w": 20_000.0,
    }
    assert robot.mass_kg / robot.traction_efficiency == pytest.approx(fit.numbers["mass"])
    accelerated_kg = (
        robot.effects["inertia"]["mass_factor"] * robot.mass_kg / robot.traction_efficiency
    )
    assert accelerated_kg == pytest.approx(fit.numbers[INERTIA])


def test_what_was_measured_at_the_wheels_narrows_the_fit() -> None:
    """On the level, two noisy drives of a car whose tyres are soft say little; the losses of the
    drive stay unknown."""
    soft = dataclasses.replace(
        CAR, rolling_resistance=0.02, effects={"viscous": {"drag_ns_per_m": 5.0}}
    )
    recordings = drives(soft, 5, np.array([20.0, 20.0]), noise_w=8000.0, hilly=False)
    car = dataclasses.replace(soft, rolling_resistance=CAR.rolling_resistance)
    names = "rolling", "drag", "mass", "viscous.drag_ns_per_m"
    measured = Uncertainty(
        fitted=names, covariance=tuple(map(tuple, np.diag([1e-4] * 4))), of="force"
    )
    wide, runs = fitted(recordings, car)
    narrow, _ = fitted(recordings, dataclasses.replace(car, uncertainty=measured))

    scale_of_wide = {entry.name: entry.scale for entry in wide.entries}
    scale_of_narrow = {entry.name: entry.scale for entry in narrow.entries}
    assert all(scale_of_narrow[name] < scale_of_wide[name] for name in ("rolling", "drag", "mass"))
    assert scale_of_narrow["viscous.drag_ns_per_m"] == pytest.approx(0.05)
    assert "viscous.drag_ns_per_m" not in scale_of_wide

    def moved_and_sd(fit: Predictive) -> tuple[float, float]:
        """How far rolling resistance moved from the file's, and how unsure it is."""
        at = [entry.name for entry in fit.entries].index("rolling")
        variance = fit.covariance(runs, runs.run)[at, at]
        return abs(fit.numbers["rolling"] - fit.entries[at].centre), float(np.sqrt(variance))

    for less, more in zip(moved_and_sd(narrow), moved_and_sd(wide), strict=True):
        assert less < 0.5 * more
