"""What trades with a size at its bound, or with a group that errors of its channel attenuate, is
known as a product and from one side."""

import dataclasses

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting, responses
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.explain.limits import LOSSES, Limited, limited
from homeward.diagnosis.fit.estimates import estimates
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.parameter_groups import GROUPS, MASS, ROLLING
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.tell.corrected import comments
from homeward.diagnosis.tell.report import report_html
from homeward.logs.channels import Array
from homeward.physics import replay
from homeward.physics.effects import EFFECTS
from tests.diagnosis.made_up import ends

SHARE = 0.9
FACTOR = 1.05
BOUND = next(effect.switch.high for effect in EFFECTS if effect.id == "regeneration")
STEP_S = 0.2


def car(motor_loss: float, friction_loss: float) -> Robot:
    """A car of 1580 kg whose drive loses these shares."""
    return dataclasses.replace(
        load_robot("husky"),
        mass_kg=1580.0,
        rolling_resistance=0.01,
        drag_ns2_per_m2=0.395,
        motor_loss=motor_loss,
        friction_loss=friction_loss,
        max_speed_mps=40.0,
        rated_energy_j=8e7,
        sensing_idle_w=0.0,
        communication_w=0.0,
        controller_w=300.0,
        sensing_j_per_sample=0.0,
        computer_j_per_sample=0.0,
        track_m=0.0,
    )


TRUE = dataclasses.replace(
    car(0.05, 0.03),
    effects={"inertia": {"mass_factor": FACTOR}, "regeneration": {"share": SHARE}},
)
FILES = {"assumes 14.5 %": car(0.1, 0.05), "assumes 25 %": car(0.2, 0.06)}
GOOD = car(0.03, 0.02)
GAMMA = TRUE.traction_efficiency


def drive(robot: Robot, seed: int, seconds: float = 400.0) -> dict[str, Array]:
    """A drive over hills at changing speeds."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, STEP_S)
    goals = np.repeat(rng.choice([0.0, 6.0, 10.0, 14.0, 18.0, 22.0], 100), 50)[: len(time_s)]
    speed = np.zeros(len(time_s))
    for index in range(1, len(time_s)):
        change = np.clip(goals[index] - speed[index - 1], -1.25 * STEP_S, STEP_S)
        speed[index] = speed[index - 1] + 0.9 * change
    path_m = np.cumsum(speed) * STEP_S
    grade = np.arctan(0.017 * np.cos(path_m / 900.0 + seed) + 0.019 * np.cos(path_m / 310.0))
    power_w = replay(robot, time_s, speed, grade_rad=grade).power_w
    return {
        "time_s": time_s,
        "speed_mps": speed,
        "grade_rad": grade,
        "power_w": power_w + rng.normal(0.0, 200.0, len(time_s)),
    }


def recorded(robot: Robot, runs: int = 3) -> list[Recording]:
    return [Recording(f"run{run}.csv", str(run), drive(robot, run)) for run in range(runs)]


def windows(recordings: list[Recording], robot: Robot) -> Runs:
    return average(usable_runs(recordings, robot)[0])


def with_limits(runs: Runs, robot: Robot, inertia: Hypothesis = CATALOGUE["inertia"]) -> Limited:
    fit = refit(runs, robot)
    setting = Setting.of(fit, runs)
    hypotheses = (inertia, CATALOGUE["regeneration"])
    terms = [next(responses(hypothesis, setting)) for hypothesis in hypotheses]
    block = cut_blocks(runs.run)
    model = fit_model(fit, terms, runs, block)
    return limited(model, estimates(model, runs, block), fit.parameters, runs, block)


def by_group(model: Corrected) -> Array:
    return np.asarray(model.theta * model.parameters.to_group)


@pytest.mark.parametrize("name", FILES)
def test_a_share_that_exceeds_its_bound_by_the_losses_of_the_file_lowers_these(name: str) -> None:
    found = with_limits(windows(recorded(TRUE), FILES[name]), FILES[name])
    groups = by_group(found.model)
    # Each group is that of the robot, whatever the file assumes of the losses.
    assert groups[MASS] == pytest.approx(TRUE.mass_kg / GAMMA, rel=0.005)
    assert groups[ROLLING] == pytest.approx(15.8 / GAMMA, rel=0.02)
    assert found.model.values[0] == pytest.approx(FACTOR, rel=0.005)
    (product,) = found.products
    low, high = ends(product.value)
    assert product.name == "regeneration share x Gamma" and low < SHARE * GAMMA < high
    limit = found.limits["regeneration share"]
    assert limit.side == "at least" and limit.ci95 == (low, BOUND)
    assert low < SHARE < BOUND
    lost = found.limits[LOSSES]
    assert lost.side == "at most" and lost.ci95[0] < 0.08 < lost.ci95[1] < 0.145


def test_a_drive_loses_no_less_than_nothing() -> None:
    """Braking returns 3 % more than it can: the meter errs, and the share stays at its bound."""
    ideal = {**TRUE.effects, "regeneration": {"share": BOUND}}
    lossless = dataclasses.replace(TRUE, motor_loss=0.0, friction_loss=0.0, effects=ideal)
    robot = FILES["assumes 14.5 %"]
    runs = windows(recorded(lossless), robot)
    braking = np.where(runs.observed < 0.0, 1.03, 1.0)
    found = with_limits(dataclasses.replace(runs, observed=braking * runs.observed), robot)
    assert found.model.parameters.nominal.traction_efficiency == 1.0
    share = found.limits["regeneration share"]
    assert share.side == "at least" and share.ci95[0] < BOUND == share.ci95[1]
    low, high = ends(found.products[0].value)
    assert low < high <= BOUND


def test_a_file_with_the_right_losses_keeps_them_and_has_no_limits() -> None:
    robot = dataclasses.replace(TRUE, effects={})
    found = with_limits(windows(recorded(TRUE), robot), robot)
    assert found.limits == {} and found.products == ()
    assert found.model.parameters.nominal.motor_loss == robot.motor_loss
    assert found.model.values[1] == pytest.approx(SHARE, rel=0.005)


def test_what_leaves_its_interval_without_the_bound_of_a_size_is_not_known() -> None:
    # More inertia than the bound allows is taken for mass.
    largest = 0.9 * FACTOR
    tight = dataclasses.replace(CATALOGUE["inertia"], bounds=(0.0, largest))
    robot = dataclasses.replace(TRUE, effects={})
    found = with_limits(windows(recorded(TRUE), robot), robot, tight)
    limit = found.limits["inertia mass_factor"]
    assert limit.side == "at least" and limit.ci95[0] < largest == limit.ci95[1]
    mass = found.estimates[MASS]
    assert mass.status == "confounded" and "inertia" in mass.mixed_with and not mass.off


def with_noisy_slopes(runs: Runs, error_rad: float) -> Runs:
    """The same with slopes that err by this much, for seconds each, and say so."""
    rng = np.random.default_rng(0)
    signals = []
    for run in runs.signals:
        noise = np.repeat(rng.normal(0.0, error_rad, len(run.time_s)), 10)[: len(run.time_s)]
        grade = run.grade_rad + noise
        signals.append(
            dataclasses.replace(
                run,
                grade_rad=grade,
                context={**run.context, "grade_rad": grade},
                error={**run.error, "grade_rad": error_rad},
            )
        )
    return average(signals)


def test_of_a_mass_that_errors_of_slopes_attenuate_only_the_product_with_inertia_is_known() -> None:
    runs = with_noisy_slopes(windows(recorded(TRUE), GOOD), error_rad=0.02)
    found = with_limits(runs, GOOD)
    mass = found.estimates[MASS]
    assert by_group(found.model)[MASS] < 0.8 * TRUE.mass_kg / GAMMA
    assert mass.status == "attenuated" and mass.fitted is None and not mass.off
    (product,) = found.products
    low, high = ends(product.value)
    assert product.of == ("m / Gamma", "inertia mass_factor")
    assert low < FACTOR * TRUE.mass_kg / GAMMA < high
    factor = found.limits["inertia mass_factor"]
    assert factor.side == "at most" and factor.ci95[0] == 0.0 and factor.ci95[1] > FACTOR
    of_mass = found.limits["m / Gamma"]
    assert of_mass.side == "at least" and of_mass.ci95[0] < TRUE.mass_kg / GAMMA


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    return analyse(recorded(TRUE), FILES["assumes 14.5 %"])


def test_summary_report_and_file_say_at_least(analysis: Analysis) -> None:
    diagnosis = analysis.diagnosis
    assert "regeneration share is at least 0.8" in diagnosis.summary
    share = next(
        effect.parameters["share"]
        for effect in diagnosis.missing_physics
        if effect.effect == "regeneration"
    )
    low, high = ends(share)
    assert share.limit == "at least" and low < SHARE < high == BOUND
    assert "at least 0.8" in report_html(analysis)
    names = [product.name for product in diagnosis.products]
    assert "regeneration share x Gamma" in names
    for group in diagnosis.parameters_off:
        symbols = [entry.symbol for entry in GROUPS["W"]]
        true = dict(zip(symbols[2:], np.array([15.8, 0.395, 1580.0]) / GAMMA, strict=True))
        assert group.ci95[0] < true[group.group] < group.ci95[1]


def test_no_number_of_the_file_is_proven_or_exceeds_its_bound_that_is_limited(
    analysis: Analysis,
) -> None:
    file = analysis.diagnosis.file
    assert file is not None
    numbers = {number.name: number for number in file.numbers}
    share = numbers["regeneration share"]
    assert not share.proven and share.limit == "at least" and ends(share)[1] == BOUND
    assert not numbers[LOSSES].proven and numbers[LOSSES].limit == "at most"
    said = comments(analysis.robot, analysis.corrected, file.numbers)
    assert "not proven" in said["regeneration.share"] and "at least" in said["regeneration.share"]
    assert "losses" in said["motor_loss"] and "at most" in said["friction_loss"]
    assert analysis.corrected.traction_efficiency > analysis.robot.traction_efficiency
